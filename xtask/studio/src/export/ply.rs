//! The PLY of 3D Gaussian Splatting, as [`crate::import`] reads it.

use codec::{ClipInfo, Field, PixelFilter, sh_coefficients};

use crate::import::field_file::MARK;

/// Larger logits give the same opacity in `f32`; infinite ones would break other readers.
const LOGIT_MAX: f64 = 16.0;

/// The static columns of a field, with the unused normals that some readers expect, and its filter, its near
/// distance and the metadata of its clip as comments. Windows and motion are omitted: see [`super::frozen`].
pub fn static_ply(field: &Field, info: Option<&ClipInfo>) -> Vec<u8> {
    let mut names = static_names(field.sh_degree);
    names.splice(3..3, ["nx", "ny", "nz"].map(String::from));
    let mut comments = info.map_or_else(Vec::new, metadata);
    comments.extend(drawing_comments(field));
    binary_ply(&comments, &names, field.len(), |i, row| {
        push_static(field, i, row);
        row.splice(3..3, [0.0; 3]);
    })
}

/// The metadata of a clip as comments. Rust prints the shortest digits that read back as the same number.
pub(super) fn metadata(info: &ClipInfo) -> Vec<String> {
    let vector = |v: [f32; 3]| format!("{} {} {}", v[0], v[1], v[2]);
    let mut comments = vec![
        format!("{MARK} duration_s {}", info.duration_s),
        format!("{MARK} fps {}", info.fps),
        format!("{MARK} up {}", vector(info.up)),
        format!("{MARK} metres_per_unit {}", info.metres_per_unit),
    ];
    comments.extend(info.viewpoints.iter().map(|view| {
        let name = view.name.replace(char::is_control, " ");
        let (position, target) = (vector(view.position), vector(view.target));
        format!("{MARK} viewpoint {position} {target} {} {name}", view.fov_y)
    }));
    comments
}

/// The comments that say how the Gaussians are drawn, where most fields differ: the filter, the near distance.
pub(super) fn drawing_comments(field: &Field) -> impl Iterator<Item = String> {
    let Field { filter, near, .. } = *field;
    let filter = (filter != PixelFilter::default()).then(|| format!("{MARK} filter {}", filter.name()));
    filter.into_iter().chain((near > 0.0).then(|| format!("{MARK} near {near}")))
}

/// Names of the static columns.
pub(super) fn static_names(sh_degree: u8) -> Vec<String> {
    let numbered = |prefix: &'static str, count: usize| (0..count).map(move |k| format!("{prefix}_{k}"));
    ["x", "y", "z"]
        .map(String::from)
        .into_iter()
        .chain(numbered("f_dc", 3))
        .chain(numbered("f_rest", 3 * (sh_coefficients(sh_degree) - 1)))
        .chain(["opacity".into()])
        .chain(numbered("scale", 3))
        .chain(numbered("rot", 4))
        .collect()
}

/// Appends the static columns of Gaussian `i`.
pub(super) fn push_static(field: &Field, i: usize, row: &mut Vec<f32>) {
    let sh = field.sh_of(i);
    row.extend(field.centers[i]);
    row.extend(sh[0]);
    row.extend((0..3).flat_map(|channel| sh[1..].iter().map(move |c| c[channel])));
    let opacity = f64::from(field.opacities[i]);
    row.push((opacity / (1.0 - opacity)).ln().clamp(-LOGIT_MAX, LOGIT_MAX) as f32);
    row.extend(field.log_scales[i]);
    row.extend(field.rotations[i]);
}

/// A little-endian PLY with one `vertex` element of `float` properties; `push_row` appends the
/// values of a row.
pub(super) fn binary_ply(
    comments: &[String],
    names: &[String],
    rows: usize,
    mut push_row: impl FnMut(usize, &mut Vec<f32>),
) -> Vec<u8> {
    let mut header = String::from("ply\nformat binary_little_endian 1.0\n");
    comments.iter().for_each(|comment| header += &format!("comment {comment}\n"));
    header += &format!("element vertex {rows}\n");
    names.iter().for_each(|name| header += &format!("property float {name}\n"));
    header += "end_header\n";

    let mut bytes = header.into_bytes();
    bytes.reserve(4 * rows * names.len());
    let mut row = Vec::with_capacity(names.len());
    for i in 0..rows {
        row.clear();
        push_row(i, &mut row);
        debug_assert_eq!(row.len(), names.len(), "one value per property");
        bytes.extend(row.iter().flat_map(|value| value.to_le_bytes()));
    }
    bytes
}
