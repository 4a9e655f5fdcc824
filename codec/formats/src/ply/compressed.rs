//! The compressed PLY of PlayCanvas: 16 bytes per Gaussian, relative to chunks of 256.
//!
//! `chunk` holds the smallest and largest centre and log-scale of its Gaussians and, in newer
//! files, colour. `vertex` holds four 32-bit words: centre and scale as 11, 10, 11 bits between
//! those bounds, the quaternion as its three smaller components in 10 bits each, colour and
//! opacity in 8 bits each. An optional element `sh` holds the higher coefficients as bytes, all of
//! red, then of green, then of blue.

use std::f64::consts::SQRT_2;

use crate::account::{Repairs, SH_CUT};
use crate::columns::{sh_of_rgb, with_largest};
use crate::imported::Imported;
use crate::limits::ImportBudget;

use super::container::{Ply, Table};
use super::gaussian_splatting::{Rest, rest_columns};

/// Gaussians per chunk.
const CHUNK: usize = 256;

/// Reads the rows of a static field.
pub(super) fn read(ply: &Ply, vertex: &Table, budget: &mut ImportBudget) -> Result<Imported, String> {
    let Some(chunk) = ply.table("chunk") else {
        return Err("compressed PLY without a chunk element".into());
    };
    let words = vertex.find(["packed_position", "packed_rotation", "packed_scale", "packed_color"])?;
    let centers = bounds(chunk, "", ["x", "y", "z"])?;
    let scales = bounds(chunk, "scale_", ["x", "y", "z"])?;
    let colors = match chunk.has("min_r") {
        true => Some(bounds(chunk, "", ["r", "g", "b"])?),
        false => None,
    };
    let sh_bytes = ply.table("sh");
    let rest = sh_bytes.map_or(Ok(Rest::default()), rest_columns)?;

    let rows = vertex.rows.min(chunk.rows * CHUNK).min(sh_bytes.map_or(usize::MAX, |sh| sh.rows));
    let mut field = budget.field(rows, rest.sh_degree)?;
    for row in 0..rows {
        let [position, rotation, scale, color] = words.map(|column| vertex.get(row, column) as u32);
        let within = |bounds: &Bounds, t: [f64; 3]| bounds.at(chunk, row / CHUNK, t);
        field.centers.push(within(&centers, unpack_11_10_11(position)).map(|x| x as f32));
        field.rotations.push(unpack_rotation(rotation));
        field.log_scales.push(within(&scales, unpack_11_10_11(scale)).map(|x| x as f32));
        let [r, g, b, opacity] = color.to_be_bytes().map(|byte| f64::from(byte) / 255.0);
        let rgb = colors.as_ref().map_or([r, g, b], |bounds| within(bounds, [r, g, b]));
        field.sh.push(rgb.map(sh_of_rgb));
        field.opacities.push(opacity as f32);
        if let Some(sh) = sh_bytes {
            rest.push_row(&mut field.sh, |column| unpack_sh(sh.get(row, column)));
        }
    }

    let missing = (vertex.rows - rows).saturating_add(vertex.missing_rows());
    let mut repairs = Repairs::truncated(missing);
    if rest.is_cut {
        repairs.repair_rows(SH_CUT, rows);
    }
    let mut imported = Imported::new("compressed PLY", field, repairs);
    imported.account.assumed.extend(rest.note());
    Ok(imported)
}

/// Columns of the lower and upper ends of three ranges.
struct Bounds {
    min: [usize; 3],
    max: [usize; 3],
}

fn bounds(chunk: &Table, prefix: &str, names: [&str; 3]) -> Result<Bounds, String> {
    Ok(Bounds {
        min: chunk.find(names.map(|name| format!("min_{prefix}{name}")))?,
        max: chunk.find(names.map(|name| format!("max_{prefix}{name}")))?,
    })
}

impl Bounds {
    fn at(&self, chunk: &Table, row: usize, t: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|k| {
            let (min, max) = (chunk.get(row, self.min[k]), chunk.get(row, self.max[k]));
            min * (1.0 - t[k]) + max * t[k]
        })
    }
}

/// The lowest `bits` of `word >> shift` as a fraction of their largest value.
fn fraction(word: u32, shift: u32, bits: u32) -> f64 {
    let largest = (1 << bits) - 1;
    f64::from((word >> shift) & largest) / f64::from(largest)
}

fn unpack_11_10_11(word: u32) -> [f64; 3] {
    [fraction(word, 21, 11), fraction(word, 11, 10), fraction(word, 0, 11)]
}

/// The top two bits are the index of the largest component of w, x, y, z, which is omitted.
fn unpack_rotation(word: u32) -> [f32; 4] {
    let others = [20, 10, 0].map(|shift| (fraction(word, shift, 10) - 0.5) * SQRT_2);
    with_largest((word >> 30) as usize, others).map(|x| x as f32)
}

/// Decodes `[-4, 4]` from 256 steps: the first and last are the ends, the others are centres of steps.
fn unpack_sh(byte: f64) -> f32 {
    let t = if byte == 0.0 {
        0.0
    } else if byte == 255.0 {
        1.0
    } else {
        (byte + 0.5) / 256.0
    };
    ((t - 0.5) * 8.0) as f32
}
