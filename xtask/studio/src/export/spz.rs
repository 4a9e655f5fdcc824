//! The `.spz` file of Niantic, version 3. The module of that name in [`crate::import`] describes its
//! layout.

use std::f32::consts::FRAC_1_SQRT_2;
use std::io::Write;

use codec::Field;
use flate2::Compression;
use flate2::write::GzEncoder;

use crate::import::spz::{ANTIALIASED, COLOR_SCALE, MAGIC};

/// Bits of a stored coordinate without its sign.
const COORDINATE_BITS: i32 = 23;

/// Signs of the SH basis functions, in the order of 3D Gaussian Splatting, under a half turn about x:
/// negative if the powers of y and z sum to an odd number.
const HALF_TURN_SH: [f32; 16] =
    [1.0, -1.0, -1.0, 1.0, -1.0, 1.0, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0, -1.0, 1.0, -1.0, 1.0];

/// The static columns of a field. Windows and motion are omitted: see [`super::frozen`].
///
/// The format has y up and z back. A field whose `up` is nearer to -y, as after COLMAP, is
/// turned by half a turn about x, as Niantic's own converter does; others keep their axes.
pub fn spz(field: &Field, up: [f32; 3]) -> Vec<u8> {
    let places = binary_places(field);
    let mut bytes = MAGIC.to_vec();
    bytes.extend(3u32.to_le_bytes());
    bytes.extend((field.len() as u32).to_le_bytes());
    let flags = if field.filter.compensates() { ANTIALIASED } else { 0 };
    bytes.extend([field.sh_degree, places, flags, 0]);

    let flip = if up[1] < 0.0 { -1.0 } else { 1.0 };
    let largest = (1 << COORDINATE_BITS) - 1;
    for [x, y, z] in &field.centers {
        for x in [*x, y * flip, z * flip] {
            let fixed = (f64::from(x) * f64::from(1u32 << places)).round() as i32;
            bytes.extend(&fixed.clamp(-largest, largest).to_le_bytes()[..3]);
        }
    }
    bytes.extend(field.opacities.iter().map(|opacity| byte(opacity * 255.0)));
    for i in 0..field.len() {
        bytes.extend(field.sh_of(i)[0].map(|c| byte((c * COLOR_SCALE + 0.5) * 255.0)));
    }
    bytes.extend(field.log_scales.as_flattened().iter().map(|scale| byte((scale + 10.0) * 16.0)));
    for [w, x, y, z] in &field.rotations {
        bytes.extend(pack_rotation([*w, *x, y * flip, z * flip]).to_le_bytes());
    }
    for i in 0..field.len() {
        for (c, half_turn) in field.sh_of(i).iter().zip(HALF_TURN_SH).skip(1) {
            let sign = if flip < 0.0 { half_turn } else { 1.0 };
            bytes.extend(c.map(|x| byte(sign * x * 128.0 + 128.0)));
        }
    }

    let mut gzip = GzEncoder::new(Vec::new(), Compression::default());
    gzip.write_all(&bytes).and_then(|()| gzip.finish()).expect("a Vec takes every byte")
}

/// Largest number of binary places with which every coordinate fits.
fn binary_places(field: &Field) -> u8 {
    let extent = field.centers.as_flattened().iter().fold(0.0f32, |extent, x| extent.max(x.abs()));
    let bits_before = if extent > 0.0 { extent.log2().floor() as i32 + 1 } else { 0 };
    (COORDINATE_BITS - bits_before).clamp(0, COORDINATE_BITS) as u8
}

fn byte(x: f32) -> u8 {
    x.round() as u8
}

fn pack_rotation([w, x, y, z]: [f32; 4]) -> u32 {
    let q = [x, y, z, w];
    let largest = (1..4).fold(0, |best, k| if q[k].abs() > q[best].abs() { k } else { best });
    // The same rotation, with a positive omitted component.
    let negate = q[largest] < 0.0;
    (0..4).filter(|&k| k != largest).fold(largest as u32, |word, k| {
        let magnitude = (q[k].abs() / FRAC_1_SQRT_2 * 511.0).round().min(511.0) as u32;
        word << 10 | u32::from((q[k] < 0.0) != negate) << 9 | magnitude
    })
}
