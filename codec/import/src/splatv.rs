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
//! | 15 | tau, and w in `exp(-((t - tau) / w)^2)`, so `s = w / sqrt(2)`; `f16`, infinite where always on |
//!
//! The chunk's `size` is the size of a texture of whole lines of 1024 rows. Files leave the rest of
//! the last line out or fill it with zeros. A chunk also lists `cameras`. They are often copied from another scene, so
//! a camera counts only if it sees the field; else the viewpoint is the capture's first camera, which the fit
//! puts at the origin, if that camera does. This project's files describe their clip under the key `aarc`, which other
//! readers skip.

use std::f32::consts::FRAC_1_SQRT_2;

use codec::{Camera, ClipInfo, Field, Surroundings, Viewpoint};
use half::f16;
use serde::{Deserialize, Serialize};

use crate::budget::ImportBudget;
use crate::field_file::NAME_MAX;
use crate::imported::{Hints, Imported, Repairs, TRUNCATED, log_of_scales, sh_of_rgb};
use crate::probe::Probe;
use crate::up_axis::up_of;

/// Up in the axes of COLMAP, which fits of Spacetime Gaussians keep.
const UP: [f32; 3] = [0.0, -1.0, 0.0];

/// Longest header: parsed JSON takes many times its text.
const HEADER_MAX: u32 = 1 << 20;

/// Bytes per Gaussian.
pub const ROW: usize = 64;

/// Gaussians per line of the texture.
pub const ROWS_PER_LINE: usize = 1024;

/// Most cameras of a file that are tried, and most viewpoints that they become.
const CAMERAS_MAX: usize = 16;
const VIEWPOINTS_MAX: usize = 8;

/// The position of the camera that splaTV and its kin have in their source, of a scene of their own. Converters copy
/// it into files of any scene.
const COPIED_POSITION: [f64; 3] = [-3.0089893469241797, -0.11086489695181866, -3.7527640949141428];

#[derive(Deserialize)]
struct Chunk {
    #[serde(rename = "type")]
    kind: String,
    size: usize,
    #[serde(default)]
    cameras: serde_json::Value,
    aarc: Option<ClipRecord>,
}

/// A camera of a chunk. `rotation` is world from camera.
#[derive(Debug, Deserialize, Serialize)]
pub struct SplatvCamera {
    /// Number of the camera.
    pub id: u32,
    /// Name.
    pub img_name: String,
    /// Width of its images in pixels.
    pub width: u32,
    /// Height of its images in pixels.
    pub height: u32,
    /// Position in source units.
    pub position: [f64; 3],
    /// Rotation from camera axes to world axes, row-major.
    pub rotation: [[f64; 3]; 3],
    /// Horizontal focal length in pixels.
    pub fx: f64,
    /// Vertical focal length in pixels.
    pub fy: f64,
}

/// The metadata of the clip in a file of this project.
#[derive(Debug, Deserialize, Serialize)]
pub struct ClipRecord {
    duration_s: f32,
    fps: f32,
    up: [f32; 3],
    metres_per_unit: f32,
    viewpoints: Vec<ViewpointRecord>,
}

#[derive(Debug, Deserialize, Serialize)]
struct ViewpointRecord {
    name: String,
    position: [f32; 3],
    target: [f32; 3],
    fov_y: f32,
}

impl From<&ClipInfo> for ClipRecord {
    fn from(info: &ClipInfo) -> ClipRecord {
        let ClipInfo { duration_s, fps, up, metres_per_unit, ref viewpoints } = *info;
        let record = |viewpoint: &Viewpoint| {
            let Viewpoint { name, position, target, fov_y } = viewpoint.clone();
            ViewpointRecord { name, position, target, fov_y }
        };
        ClipRecord {
            duration_s,
            fps,
            up,
            metres_per_unit,
            viewpoints: viewpoints.iter().map(record).collect(),
        }
    }
}

impl ClipRecord {
    /// The hints.
    ///
    /// # Errors
    /// One sentence that names the value that cannot be used.
    fn into_hints(self) -> Result<Hints, String> {
        let ClipRecord { duration_s, fps, up, metres_per_unit, viewpoints } = self;
        let viewpoint =
            |ViewpointRecord { name, position, target, fov_y }| Viewpoint { name, position, target, fov_y };
        let viewpoints = viewpoints.into_iter().map(viewpoint).collect();
        let info = ClipInfo { duration_s, fps, up, metres_per_unit, viewpoints };
        info.check()
            .map_err(|(field, value)| format!("its metadata have a bad {field}: {value}; export it again"))?;
        Ok(Hints {
            up: Some(up),
            metres_per_unit: Some(metres_per_unit),
            duration_s: Some(duration_s),
            fps: Some(fps),
            viewpoints: info.viewpoints,
            ..Hints::default()
        })
    }
}

/// Reads the rows of a dynamic field.
pub(crate) fn read(bytes: &[u8], budget: &mut ImportBudget) -> Result<Imported, String> {
    let (chunk, payload) = splat_chunk(bytes)?;
    let (rows, rest) = payload.as_chunks::<ROW>();
    let last_used = rows.iter().rposition(|row| row.iter().any(|&byte| byte != 0));
    let rows = &rows[..last_used.map_or(0, |last| last + 1)];

    let mut repairs = Repairs::default();
    // A file that ends in the texture's last line is complete, unless it ends within a row.
    let line = ROWS_PER_LINE * ROW;
    let missing_lines = chunk.size.div_ceil(line) - payload.len().div_ceil(line);
    repairs.drop_rows(TRUNCATED, missing_lines * ROWS_PER_LINE + usize::from(!rest.is_empty()));
    let mut field = budget.field(rows.len(), 0)?;
    let mut temporal = budget.temporal(rows.len(), 3)?;
    let mut rates = budget.vec(rows.len())?;
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
        temporal.s.push(half(31) * FRAC_1_SQRT_2);
    }
    temporal.rotation_rates = Some(rates);
    field.temporal = Some(temporal);
    let hints = match chunk.aarc {
        Some(record) => record.into_hints()?,
        None => hints_of(&field, &chunk.cameras, budget)?,
    };
    Ok(Imported { field, hints, repairs, format: ".splatv", notes: Vec::new() })
}

/// The `splat` chunk of the file, and its bytes as far as they are there.
fn splat_chunk(bytes: &[u8]) -> Result<(Chunk, &[u8]), String> {
    let word =
        |k: usize| bytes.get(k..k + 4).map(|word| u32::from_le_bytes([word[0], word[1], word[2], word[3]]));
    let length = word(4).ok_or("truncated in its header")?;
    if length > HEADER_MAX {
        return Err(format!("a header of {length} bytes, and {HEADER_MAX} are the most"));
    }
    let header = bytes.get(8..8 + length as usize).ok_or("truncated in its header")?;
    let chunks: Vec<Chunk> = serde_json::from_slice(header).map_err(|error| format!("header: {error}"))?;
    let mut rest = &bytes[8 + header.len()..];
    for chunk in chunks {
        let present = chunk.size.min(rest.len());
        if chunk.kind == "splat" {
            return Ok((chunk, &rest[..present]));
        }
        rest = &rest[present..];
    }
    Err("no chunk of type splat".into())
}

/// The up axis and viewpoints of a file by another program.
fn hints_of(field: &Field, cameras: &serde_json::Value, budget: &mut ImportBudget) -> Result<Hints, String> {
    let probe = Probe::new(field, budget)?;
    let listed = cameras.as_array().map_or(&[][..], Vec::as_slice).iter().take(CAMERAS_MAX);
    let named = listed.filter_map(|camera| SplatvCamera::deserialize(camera).ok()).enumerate().filter_map(
        |(i, camera)| {
            let is_name = !camera.img_name.is_empty() && camera.img_name.len() <= NAME_MAX;
            let is_name = is_name && !camera.img_name.contains(char::is_control);
            let name = if is_name { camera.img_name.clone() } else { format!("camera {i}") };
            Some((name, camera.to_camera()?))
        },
    );
    let own: Vec<(String, Camera)> =
        named.filter(|(_, camera)| probe.shows(camera)).take(VIEWPOINTS_MAX).collect();
    let up = up_of(own.iter().map(|(_, camera)| camera)).unwrap_or(UP);
    let surroundings = Surroundings::new(field, None, up);
    let mut viewpoints: Vec<Viewpoint> =
        own.iter().map(|(name, camera)| surroundings.viewpoint(name, camera)).collect();
    if viewpoints.is_empty() {
        let front = front();
        viewpoints.extend(probe.shows(&front).then(|| surroundings.viewpoint("front", &front)));
    }
    Ok(Hints { up: Some(up), viewpoints, ..Hints::default() })
}

impl SplatvCamera {
    /// The camera, unless it is broken or the camera that converters copy.
    fn to_camera(&self) -> Option<Camera> {
        let (position, r) = (self.position, self.rotation);
        let is_copied = position.iter().zip(COPIED_POSITION).all(|(a, b)| (a - b).abs() < 1e-6);
        let row = |axis: usize| {
            let [x, y, z] = [r[0][axis], r[1][axis], r[2][axis]];
            [x, y, z, -(x * position[0] + y * position[1] + z * position[2])]
        };
        let [cx, cy] = [self.width, self.height].map(|side| 0.5 * f64::from(side));
        let camera = Camera {
            width: self.width,
            height: self.height,
            k: [[self.fx, 0.0, cx], [0.0, self.fy, cy], [0.0, 0.0, 1.0]],
            camera_from_world: [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]],
        };
        (!is_copied && camera.check().is_ok()).then_some(camera)
    }
}

/// The capture's first camera: at the origin, towards +z, a focal length of 0.75 image widths at 4:3.
fn front() -> Camera {
    let [width, height] = [64.0, 48.0];
    let focal = 0.75 * width;
    Camera {
        width: width as u32,
        height: height as u32,
        k: [[focal, 0.0, 0.5 * width], [0.0, focal, 0.5 * height], [0.0, 0.0, 1.0]],
        camera_from_world: std::array::from_fn(|r| std::array::from_fn(|c| f64::from(u8::from(r == c)))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn metadata_that_a_clip_cannot_have_are_refused() {
        let record = || ClipRecord::from(&ClipInfo::default());
        assert_eq!(record().into_hints().unwrap().fps, Some(ClipInfo::default().fps));
        let error = ClipRecord { metres_per_unit: 0.0, ..record() }.into_hints().unwrap_err();
        assert_eq!(error, "its metadata have a bad metres per unit: 0.0; export it again");
        assert!(ClipRecord { up: [0.0; 3], ..record() }.into_hints().is_err());
    }
}
