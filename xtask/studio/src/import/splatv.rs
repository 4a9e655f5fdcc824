//! The `.splatv` file of splaTV: Spacetime Gaussians (lite) as texels of 64 bytes each.
//!
//! `u32` magic, `u32` length of a JSON list of chunks `{"type", "size", ...}`, that list, the
//! chunks. A row of the chunk of type `splat`, as 16 little-endian words:
//!
//! | words | content |
//! |---|---|
//! | 0-2 | centre, `f32` |
//! | 3-4 | quaternion w, x, y, z, `f16` each, of any length |
//! | 5-6 | three standard deviations, `f16`; one unused |
//! | 7 | red, green, blue, opacity as bytes, `[0, 1]` each |
//! | 8-12 | nine motion coefficients `[power - 1][axis]`, `f16`; one unused |
//! | 13-14 | rates of the quaternion, `f16` |
//! | 15 | tau, and w in `exp(-((t - tau) / w)^2)`, so `s = w / sqrt(2)`; `f16` |
//!
//! The chunk's `size` is that of a texture of whole lines of 1024 rows. Files leave the rest of
//! the last line out or fill it with zeros. Their `cameras` are commonly copied from another
//! scene, so the viewpoint given is that of the capture's first camera, which the fit puts at the
//! origin.

use std::f32::consts::FRAC_1_SQRT_2;

use codec::{Field, Temporal, Viewpoint};
use half::f16;
use serde::Deserialize;

use super::imported::{Hints, Imported, Repairs, log_of_scales, sh_of_rgb};

/// Bytes per Gaussian.
pub(crate) const ROW: usize = 64;

/// Gaussians per line of the texture.
pub(crate) const ROWS_PER_LINE: usize = 1024;

#[derive(Deserialize)]
struct Chunk {
    #[serde(rename = "type")]
    kind: String,
    size: usize,
}

/// Reads the rows of a dynamic field.
pub(crate) fn read(bytes: &[u8]) -> Result<Imported, String> {
    let (payload, announced) = payload(bytes)?;
    let (rows, rest) = payload.as_chunks::<ROW>();
    let last_used = rows.iter().rposition(|row| row.iter().any(|&byte| byte != 0));
    let rows = &rows[..last_used.map_or(0, |last| last + 1)];

    let mut repairs = Repairs::default();
    // A file that ends in the texture's last line is complete: truncated ones end in a partial row or lack
    // lines.
    let is_complete = payload.len() == announced
        || rest.is_empty() && payload.len() > announced.saturating_sub(ROWS_PER_LINE * ROW);
    if !is_complete {
        repairs.drop_rows("truncated payload", announced.div_ceil(ROW) - payload.len() / ROW);
    }
    let mut field = Field::default();
    let mut temporal = Temporal { motion_order: 3, ..Temporal::default() };
    let mut rates = Vec::with_capacity(rows.len());
    for row in rows {
        let float =
            |k: usize| f32::from_le_bytes([row[4 * k], row[4 * k + 1], row[4 * k + 2], row[4 * k + 3]]);
        let half = |k: usize| f16::from_le_bytes([row[2 * k], row[2 * k + 1]]).to_f32();
        field.centers.push([float(0), float(1), float(2)]);
        field.rotations.push([6, 7, 8, 9].map(half));
        field.log_scales.push(log_of_scales([10, 11, 12].map(half), &mut repairs));
        field.sh.push([28, 29, 30].map(|k| sh_of_rgb(f64::from(row[k]) / 255.0)));
        field.opacities.push(f32::from(row[31]) / 255.0);
        temporal.motion.extend([[16, 17, 18], [19, 20, 21], [22, 23, 24]].map(|power| power.map(half)));
        rates.push([26, 27, 28, 29].map(half));
        temporal.tau.push(half(30));
        let width = half(31);
        repairs.repair_rows("infinite window width, always on", usize::from(width == f32::INFINITY));
        temporal.s.push(width * FRAC_1_SQRT_2);
    }
    temporal.rotation_rates = Some(rates);
    let hints = Hints { up: Some([0.0, -1.0, 0.0]), viewpoints: vec![front(&field)], ..Hints::default() };
    field.temporal = Some(temporal);
    Ok(Imported { field, hints, repairs, format: ".splatv" })
}

/// The bytes of the `splat` chunk in the file, and its announced size.
fn payload(bytes: &[u8]) -> Result<(&[u8], usize), String> {
    let word =
        |k: usize| bytes.get(k..k + 4).map(|word| u32::from_le_bytes([word[0], word[1], word[2], word[3]]));
    let header =
        word(4).and_then(|length| bytes.get(8..8 + length as usize)).ok_or("truncated in its header")?;
    let chunks: Vec<Chunk> = serde_json::from_slice(header).map_err(|error| format!("header: {error}"))?;
    let mut rest = &bytes[8 + header.len()..];
    for chunk in chunks {
        let present = chunk.size.min(rest.len());
        if chunk.kind == "splat" {
            return Ok((&rest[..present], chunk.size));
        }
        rest = &rest[present..];
    }
    Err("no chunk of type splat".into())
}

/// The view of the capture's first camera: at the origin, towards +z, a focal length of 0.75
/// image widths at 4:3, looking at the median depth of opaque Gaussians in front of it.
fn front(field: &Field) -> Viewpoint {
    let mut depths: Vec<f32> = (field.centers.iter().zip(&field.opacities))
        .filter(|([_, _, z], opacity)| *z > 0.0 && z.is_finite() && **opacity > 0.5)
        .map(|([_, _, z], _)| *z)
        .collect();
    depths.sort_by(f32::total_cmp);
    let depth = depths.get(depths.len() / 2).copied().unwrap_or(1.0);
    Viewpoint {
        name: "front".into(),
        position: [0.0; 3],
        target: [0.0, 0.0, depth],
        fov_y: 2.0 * (0.5f32 * (3.0 / 4.0) / 0.75).atan(),
    }
}
