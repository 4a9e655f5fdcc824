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

use std::collections::BTreeMap;
use std::f32::consts::{FRAC_1_SQRT_2, SQRT_2};

use codec::{Camera, ClipInfo, CoarseField, Field, NAME_BYTES_MAX, Surroundings, Viewpoint};
use half::f16;
use serde::de::IgnoredAny;
use serde::{Deserialize, Serialize};
use serde_json::json;

use crate::account::{Repairs, listed};
use crate::bytes::{byte_of_unit, f16_at, f32_at, u32_at};
use crate::columns::{rgb_of_sh, unpack_rgba};
use crate::imported::{Hints, Imported};
use crate::limits::ImportBudget;
use crate::statements::{Statement, honoured, ignored, noted, unread};
use crate::up_axis::{DEFAULT_UP, up_of};

/// The first bytes of a file.
pub(crate) const START: [u8; 4] = 0x674bu32.to_le_bytes();

/// Type of the chunk that holds the Gaussians.
const SPLAT: &str = "splat";

/// The keys of chunks, and the chunks.
pub(crate) const STATEMENTS: &[Statement] = &[
    honoured("type size cameras aarc", "cameras only if they see the field"),
    ignored("texwidth texheight", "size of the texture, which `size` implies"),
    noted("any other key, any other chunk", "not read"),
];

/// Longest header: parsed JSON takes many times its text.
const HEADER_MAX: u32 = 1 << 20;

/// Most bytes of memory for a byte of the header: an object within an object, `{"":`, whose map has a node for itself.
const BYTES_PER_HEADER_BYTE: u64 = 128;

/// Bytes per Gaussian.
const ROW: usize = 64;

/// Gaussians per line of the texture.
const ROWS_PER_LINE: usize = 1024;

/// Most cameras of a file that are tried, and most viewpoints that they become.
const CAMERAS_MAX: usize = 16;
const VIEWPOINTS_MAX: usize = 8;

/// Instants of a field that changes at which a camera may show it, in clip time.
const INSTANTS: [f64; 3] = [1.0 / 6.0, 0.5, 5.0 / 6.0];

/// Image size of the cameras that are written; viewers choose their own aspect ratio.
const CAMERA_SIZE: (u32, u32) = (1024, 768);

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
    #[serde(flatten)]
    others: BTreeMap<String, IgnoredAny>,
}

/// A camera of a chunk.
#[derive(Debug, Deserialize, Serialize)]
struct SplatvCamera {
    id: u32,
    img_name: String,
    /// Size of its images in pixels.
    width: u32,
    height: u32,
    /// In source units.
    position: [f64; 3],
    /// From camera axes to world axes, row-major.
    rotation: [[f64; 3]; 3],
    /// Focal lengths in pixels.
    fx: f64,
    fy: f64,
}

/// The metadata of the clip in a file of this project.
#[derive(Debug, Deserialize, Serialize)]
struct ClipRecord {
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
    let (chunk, payload, others) = splat_chunk(bytes, budget)?;
    let (rows, rest) = payload.as_chunks::<ROW>();
    let last_used = rows.iter().rposition(|row| row.iter().any(|&byte| byte != 0));
    let rows = &rows[..last_used.map_or(0, |last| last + 1)];

    // A file that ends in the texture's last line is complete, unless it ends within a row.
    let line = ROWS_PER_LINE * ROW;
    let missing_lines = chunk.size.div_ceil(line) - payload.len().div_ceil(line);
    let repairs = Repairs::truncated(missing_lines * ROWS_PER_LINE + usize::from(!rest.is_empty()));
    let mut field = budget.field(rows.len(), 0)?;
    let mut temporal = budget.temporal(rows.len(), 3)?;
    let mut rates = budget.vec(rows.len())?;
    for row in rows {
        let half = |k: usize| f16_at(row, 2 * k);
        field.centers.push([0, 1, 2].map(|axis| f32_at(row, 4 * axis)));
        field.rotations.push([6, 7, 8, 9].map(half));
        field.log_scales.push([10, 11, 12].map(|k| half(k).ln()));
        let (color, opacity) = unpack_rgba([28, 29, 30, 31].map(|k| row[k]));
        field.sh.push(color);
        field.opacities.push(opacity);
        temporal.motion.extend([[16, 17, 18], [19, 20, 21], [22, 23, 24]].map(|power| power.map(half)));
        rates.push([26, 27, 28, 29].map(half));
        temporal.tau.push(half(30));
        temporal.s.push(half(31) * FRAC_1_SQRT_2);
    }
    temporal.rotation_rates = Some(rates);
    field.temporal = Some(temporal);
    let hints = match chunk.aarc {
        Some(record) => record.into_hints()?,
        None => hints_of(&field, &chunk.cameras),
    };
    let mut imported = Imported { hints, ..Imported::new(".splatv", field, repairs) };
    let keys = unread(STATEMENTS, chunk.others.keys().map(String::as_str));
    let chunks = unread(&[], others.iter().map(String::as_str));
    let named = [("keys", keys), ("chunks", chunks)].into_iter();
    let lost = named.filter_map(|(what, names)| Some(format!("{what} that are not read: {}", names?)));
    imported.account.lost.extend(lost);
    Ok(imported)
}

/// The `splat` chunk of the file, its bytes as far as they are there, and the types of the other chunks.
fn splat_chunk<'b>(
    bytes: &'b [u8],
    budget: &mut ImportBudget,
) -> Result<(Chunk, &'b [u8], Vec<String>), String> {
    let length = bytes.get(4..8).map(|word| u32_at(word, 0)).ok_or("truncated in its header")?;
    if length > HEADER_MAX {
        return Err(format!("a header of {length} bytes, and {HEADER_MAX} are the most"));
    }
    let header = bytes.get(8..8 + length as usize).ok_or("truncated in its header")?;
    budget.spend(BYTES_PER_HEADER_BYTE * header.len() as u64)?;
    let chunks: Vec<Chunk> = serde_json::from_slice(header).map_err(|error| format!("header: {error}"))?;
    let mut rest = &bytes[8 + header.len()..];
    let (mut splat, mut others) = (None, Vec::new());
    for chunk in chunks {
        let (present, after) = rest.split_at(chunk.size.min(rest.len()));
        rest = after;
        match splat {
            None if chunk.kind == SPLAT => splat = Some((chunk, present)),
            _ => others.push(chunk.kind),
        }
    }
    let (chunk, present) = splat.ok_or("no chunk of type splat")?;
    Ok((chunk, present, others))
}

/// The up axis and viewpoints of a file by another program.
fn hints_of(field: &Field, cameras: &serde_json::Value) -> Hints {
    let instants = if field.temporal.is_some() { &INSTANTS[..] } else { &INSTANTS[..1] };
    let at_instants: Vec<CoarseField> = instants.iter().map(|&t| CoarseField::new(field, None, t)).collect();
    let is_informative = |camera: &Camera| at_instants.iter().any(|field| field.is_informative(camera));
    let listed = cameras.as_array().map_or(&[][..], Vec::as_slice).iter().take(CAMERAS_MAX);
    let named = listed.filter_map(|camera| SplatvCamera::deserialize(camera).ok()).enumerate().filter_map(
        |(i, camera)| {
            let is_name = !camera.img_name.is_empty() && camera.img_name.len() <= NAME_BYTES_MAX;
            let is_name = is_name && !camera.img_name.contains(char::is_control);
            let name = if is_name { camera.img_name.clone() } else { format!("camera {i}") };
            Some((name, camera.to_camera()?))
        },
    );
    let own: Vec<(String, Camera)> =
        named.filter(|(_, camera)| is_informative(camera)).take(VIEWPOINTS_MAX).collect();
    let up = up_of(own.iter().map(|(_, camera)| camera)).unwrap_or(DEFAULT_UP);
    let surroundings = Surroundings::new(field, None, up);
    let mut viewpoints: Vec<Viewpoint> =
        own.iter().map(|(name, camera)| surroundings.viewpoint(name, camera)).collect();
    if viewpoints.is_empty() {
        let front = front();
        viewpoints.extend(is_informative(&front).then(|| surroundings.viewpoint("front", &front)));
    }
    Hints { up: Some(up), viewpoints, ..Hints::default() }
}

impl SplatvCamera {
    /// A viewpoint.
    fn new(id: u32, viewpoint: &Viewpoint, up: [f32; 3]) -> SplatvCamera {
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

/// A field for splaTV and other readers of its format, with the metadata of its clip. Only the constant SH
/// coefficient is kept, and all but the centres lose precision to 16 or 8 bits.
pub fn write(field: &Field, info: &ClipInfo) -> Vec<u8> {
    let lines = field.len().div_ceil(ROWS_PER_LINE);
    let size = lines * ROWS_PER_LINE * ROW;
    let viewpoints = match info.viewpoints.as_slice() {
        [] => vec![Surroundings::new(field, None, info.up).opening()],
        viewpoints => viewpoints.to_vec(),
    };
    let cameras: Vec<SplatvCamera> =
        (0..).zip(&viewpoints).map(|(id, viewpoint)| SplatvCamera::new(id, viewpoint, info.up)).collect();
    let header = json!([{
        "type": SPLAT, "size": size, "texwidth": 4 * ROWS_PER_LINE, "texheight": lines,
        "cameras": cameras, "aarc": ClipRecord::from(info),
    }])
    .to_string();

    let mut bytes = Vec::with_capacity(8 + header.len() + size);
    bytes.extend(START);
    bytes.extend((header.len() as u32).to_le_bytes());
    bytes.extend(header.as_bytes());
    let payload = bytes.len();
    (0..field.len()).for_each(|i| push_row(field, i, &mut bytes));
    bytes.resize(payload + size, 0);
    bytes
}

/// What a file does not hold of a field.
pub(crate) fn lost(field: &Field) -> Vec<&'static str> {
    listed([
        (field.sh_degree > 0, "view-dependent colour (SH above degree 0)"),
        (field.filter.compensates(), "the mip filter"),
        (field.near > 0.0, "the near distance"),
    ])
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
    bytes.extend(field.sh_of(i)[0].map(|c| byte_of_unit(rgb_of_sh(c))));
    bytes.push(byte_of_unit(field.opacities[i].into()));
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
