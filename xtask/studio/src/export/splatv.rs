//! The `.splatv` file of splaTV. The module of that name in [`crate::import`] describes its layout.

use std::f32::consts::SQRT_2;

use codec::{ClipInfo, Field, SH_C0, Surroundings, Viewpoint};
use half::f16;
use serde_json::json;

use crate::import::splatv::{ClipRecord, ROW, ROWS_PER_LINE, SplatvCamera};

/// Image size of the cameras; viewers choose their own aspect ratio.
const CAMERA_SIZE: (u32, u32) = (1024, 768);

/// A field for splaTV and other readers of its format, with the metadata of its clip. Only the constant SH
/// coefficient is kept, and all but the centres lose precision to 16 or 8 bits.
pub fn splatv(field: &Field, info: &ClipInfo) -> Vec<u8> {
    let lines = field.len().div_ceil(ROWS_PER_LINE);
    let size = lines * ROWS_PER_LINE * ROW;
    let viewpoints = match info.viewpoints.as_slice() {
        [] => vec![Surroundings::new(field, None, info.up).opening()],
        viewpoints => viewpoints.to_vec(),
    };
    let cameras: Vec<SplatvCamera> =
        (0..).zip(&viewpoints).map(|(id, viewpoint)| camera(id, viewpoint, info.up)).collect();
    let header = json!([{
        "type": "splat", "size": size, "texwidth": 4 * ROWS_PER_LINE, "texheight": lines,
        "cameras": cameras, "aarc": ClipRecord::from(info),
    }])
    .to_string();

    let mut bytes = Vec::with_capacity(8 + header.len() + size);
    bytes.extend(0x674bu32.to_le_bytes());
    bytes.extend((header.len() as u32).to_le_bytes());
    bytes.extend(header.as_bytes());
    let payload = bytes.len();
    (0..field.len()).for_each(|i| push_row(field, i, &mut bytes));
    bytes.resize(payload + size, 0);
    bytes
}

fn push_row(field: &Field, i: usize, bytes: &mut Vec<u8>) {
    let static_window = (0.0, f32::INFINITY);
    let temporal = field.temporal.as_ref();
    let (tau, s) = temporal.map_or(static_window, |temporal| (temporal.tau[i], temporal.s[i]));
    let mut motion = [[0.0; 3]; 3];
    let stored = temporal.map_or(&[][..], |temporal| temporal.motion_of(i));
    motion[..stored.len()].copy_from_slice(stored);
    let rate =
        temporal.and_then(|temporal| temporal.rotation_rates.as_ref()).map_or([0.0; 4], |rates| rates[i]);

    bytes.extend(field.centers[i].iter().flat_map(|x| x.to_le_bytes()));
    push_halves(bytes, &field.rotations[i]);
    push_halves(bytes, &field.log_scales[i].map(|x| positive_half(x.exp())));
    push_halves(bytes, &[0.0]);
    let unit_byte = |x: f64| (x.clamp(0.0, 1.0) * 255.0).round() as u8;
    bytes.extend(field.sh_of(i)[0].map(|c| unit_byte(0.5 + SH_C0 * f64::from(c))));
    bytes.push(unit_byte(f64::from(field.opacities[i])));
    push_halves(bytes, motion.as_flattened());
    push_halves(bytes, &[0.0]);
    push_halves(bytes, &rate);
    push_halves(bytes, &[tau]);
    // A width too large for the format becomes infinite: always on.
    bytes.extend(f16::from_f32(positive_half(s * SQRT_2)).to_le_bytes());
}

/// A positive number that the format does not round to zero, which stands for no size and no window.
fn positive_half(x: f32) -> f32 {
    x.max(f16::from_bits(1).to_f32())
}

/// Appends numbers, clamped to the range of the format.
fn push_halves(bytes: &mut Vec<u8>, values: &[f32]) {
    let largest = f16::MAX.to_f32();
    bytes.extend(values.iter().flat_map(|x| f16::from_f32(x.clamp(-largest, largest)).to_le_bytes()));
}

/// A viewpoint in splaTV's form.
fn camera(id: u32, viewpoint: &Viewpoint, up: [f32; 3]) -> SplatvCamera {
    let (width, height) = CAMERA_SIZE;
    let camera = viewpoint.camera(up, width, height);
    let m = camera.camera_from_world;
    SplatvCamera {
        id,
        img_name: viewpoint.name.clone(),
        width,
        height,
        position: camera.position(),
        rotation: std::array::from_fn(|row| std::array::from_fn(|column| m[column][row])),
        fx: camera.k[0][0],
        fy: camera.k[1][1],
    }
}
