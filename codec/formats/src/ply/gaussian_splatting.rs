//! The PLY of 3D Gaussian Splatting (Kerbl et al. 2023) and the many tools that follow it.
//!
//! One `vertex` per Gaussian: centre `x y z`, SH `f_dc_0..2` and `f_rest_*` (all coefficients of
//! red, then of green, then of blue), `opacity` as a logit, `scale_0..2` as natural logarithms,
//! `rot_0..3` as a quaternion w, x, y, z of any length.

use codec::{ClipInfo, Field, SH_DEGREE_MAX, sh_coefficients};

use crate::account::Repairs;
use crate::imported::Imported;
use crate::limits::ImportBudget;

use super::comments;
use super::container::{self, Table};

/// Names of the static columns but [`REST`], in the order of a file.
const STATIC: [&str; 14] = [
    "x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2", "rot_0",
    "rot_1", "rot_2", "rot_3",
];

/// Beginning of the numbered names of the SH of degree 1 and above, which stand before the opacity.
const REST: &str = "f_rest_";

/// Unused columns behind the centre, which some readers expect.
const NORMAL: [&str; 3] = ["nx", "ny", "nz"];

/// Larger logits give the same opacity in `f32`; infinite ones would break other readers.
const LOGIT_MAX: f64 = 16.0;

/// Reads the rows of a static field.
pub(super) fn read(vertex: &Table, budget: &mut ImportBudget) -> Result<Imported, String> {
    let field = static_columns(vertex, budget)?;
    Ok(Imported::new("3D Gaussian Splatting PLY", field, Repairs::truncated(vertex.missing_rows())))
}

/// Reads the columns that this format shares with its derivatives.
pub(super) fn static_columns(vertex: &Table, budget: &mut ImportBudget) -> Result<Field, String> {
    let [x, y, z, red, green, blue, opacity, s0, s1, s2, r0, r1, r2, r3] = vertex.find(STATIC)?;
    let (sh_degree, rest) = rest_columns(vertex)?;
    let mut field = budget.field(vertex.rows, sh_degree)?;
    for row in 0..vertex.rows {
        field.centers.push(vertex.row(row, [x, y, z]));
        field.rotations.push(vertex.row(row, [r0, r1, r2, r3]));
        field.log_scales.push(vertex.row(row, [s0, s1, s2]));
        field.opacities.push(sigmoid(vertex.get(row, opacity)));
        field.sh.push(vertex.row(row, [red, green, blue]));
        field.sh.extend(rest.iter().map(|&columns| vertex.row(row, columns)));
    }
    Ok(field)
}

/// The SH degree of a table, and the columns of each coefficient of degree 1 and above.
pub(super) fn rest_columns(table: &Table) -> Result<(u8, Vec<[usize; 3]>), String> {
    let numbers = table.count_numbered(REST);
    let sh_degree = (0..=SH_DEGREE_MAX)
        .find(|&degree| 3 * (sh_coefficients(degree) - 1) == numbers)
        .ok_or_else(|| format!("{numbers} properties {REST}*, where 0, 9, 24 or 45 were expected"))?;
    let rest = numbers / 3;
    let columns = (0..rest)
        .map(|k| table.find([0, 1, 2].map(|channel| format!("{REST}{}", channel * rest + k))))
        .collect::<Result<_, _>>()?;
    Ok((sh_degree, columns))
}

/// The static columns of a field, with the unused normals that some readers expect, and its filter, its near
/// distance and the metadata of its clip as comments. Windows and motion are omitted: see [`crate::frozen()`].
pub fn write_static_ply(field: &Field, info: Option<&ClipInfo>) -> Vec<u8> {
    let mut names = static_names(field.sh_degree);
    names.splice(3..3, NORMAL.map(String::from));
    let mut comments = info.map_or_else(Vec::new, comments::on_clip);
    comments.extend(comments::on_drawing(field));
    container::write(&comments, &names, field.len(), |i, row| {
        push_static(field, i, row);
        row.splice(3..3, [0.0; 3]);
    })
}

/// What a static PLY does not hold of a field.
pub(crate) fn lost(field: &Field) -> Vec<&'static str> {
    Vec::from_iter(field.filter.compensates().then_some("the mip filter for other tools"))
}

/// Names of the static columns.
pub(super) fn static_names(sh_degree: u8) -> Vec<String> {
    let rest = 3 * (sh_coefficients(sh_degree) - 1);
    let mut names = STATIC.map(String::from).to_vec();
    names.splice(6..6, (0..rest).map(|k| format!("{REST}{k}")));
    names
}

/// Appends the static columns of Gaussian `i`.
pub(super) fn push_static(field: &Field, i: usize, row: &mut Vec<f32>) {
    let sh = field.sh_of(i);
    row.extend(field.centers[i]);
    row.extend(sh[0]);
    row.extend((0..3).flat_map(|channel| sh[1..].iter().map(move |c| c[channel])));
    row.push(logit(field.opacities[i]));
    row.extend(field.log_scales[i]);
    row.extend(field.rotations[i]);
}

fn sigmoid(logit: f64) -> f32 {
    (1.0 / (1.0 + (-logit).exp())) as f32
}

fn logit(opacity: f32) -> f32 {
    let opacity = f64::from(opacity);
    (opacity / (1.0 - opacity)).ln().clamp(-LOGIT_MAX, LOGIT_MAX) as f32
}
