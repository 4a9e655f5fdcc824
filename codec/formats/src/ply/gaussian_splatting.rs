//! The PLY of 3D Gaussian Splatting (Kerbl et al. 2023) and the many tools that follow it.
//!
//! One `vertex` per Gaussian: centre `x y z`, SH `f_dc_0..2` and `f_rest_*` (all coefficients of
//! red, then of green, then of blue), `opacity` as a logit, `scale_0..2` as natural logarithms,
//! `rot_0..3` as a quaternion w, x, y, z of any length. Variants that are read: colours `red green blue` in place of
//! `f_dc_*`, discs without `scale_2` (Huang et al. 2024), and the column `filter_3D` of Mip-Splatting (Yu et al. 2024).
//!
//! Centres that are too far from the origin for `f32` are read about another origin.

use codec::{ClipInfo, Field, SH_DEGREE_MAX, sh_coefficients};

use crate::account::{Repairs, SH_CUT, listed};
use crate::columns::{LOG_FLAT, sh_of_rgb};
use crate::imported::Imported;
use crate::limits::ImportBudget;
use crate::origin;

use super::comments::{self, FILTER_3D};
use super::container::{self, Table};

/// Names of the static columns but [`REST`], in the order of a file.
const STATIC: [&str; 14] = [
    "x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", SCALE_2, "rot_0", "rot_1",
    "rot_2", "rot_3",
];

/// The scale along the normal of a disc, which 2D Gaussians lack.
const SCALE_2: &str = "scale_2";

/// Names of colours that stand in place of the constant SH coefficients.
const RGB: [&str; 3] = ["red", "green", "blue"];

/// Beginning of the numbered names of the SH of degree 1 and above, which stand before the opacity.
const REST: &str = "f_rest_";

/// Unused columns behind the centre, which some readers expect.
const NORMAL: [&str; 3] = ["nx", "ny", "nz"];

/// Larger logits give the same opacity in `f32`; infinite ones would break other readers.
const LOGIT_MAX: f64 = 16.0;

/// Reads the rows of a static field. Its derivatives share these columns.
pub(super) fn read(vertex: &Table, budget: &mut ImportBudget) -> Result<Imported, String> {
    let (is_disc, is_rgb) = (!vertex.has(SCALE_2), !vertex.has(STATIC[3]) && vertex.has(RGB[0]));
    let mut names = STATIC;
    if is_disc {
        names[9] = names[8];
    }
    if is_rgb {
        names[3..6].copy_from_slice(&RGB);
    }
    let [x, y, z, red, green, blue, opacity, s0, s1, s2, r0, r1, r2, r3] = vertex.find(names)?;
    let rest = rest_columns(vertex)?;
    let filter = vertex.has(FILTER_3D).then(|| vertex.find([FILTER_3D])).transpose()?;
    let mut field = budget.field(vertex.rows, rest.sh_degree)?;
    for row in 0..vertex.rows {
        field.rotations.push(vertex.row(row, [r0, r1, r2, r3]));
        let mut scales = vertex.row(row, [s0, s1, s2]);
        if is_disc {
            scales[2] = scales[0].midpoint(scales[1]) + LOG_FLAT;
        }
        let mut alpha = sigmoid(vertex.get(row, opacity));
        if let Some([filter]) = filter {
            (scales, alpha) = filtered(scales, alpha, vertex.get(row, filter));
        }
        field.log_scales.push(scales);
        field.opacities.push(alpha);
        field.sh.push(match is_rgb {
            true => [red, green, blue].map(|c| sh_of_rgb(vertex.get(row, c) / vertex.white(c))),
            false => vertex.row(row, [red, green, blue]),
        });
        rest.push_row(&mut field.sh, |column| vertex.get(row, column) as f32);
    }
    let mut repairs = Repairs::truncated(vertex.missing_rows());
    if rest.is_cut {
        repairs.repair_rows(SH_CUT, vertex.rows);
    }
    let mut imported = Imported::new("3D Gaussian Splatting PLY", field, repairs);
    let assumed = listed([
        (is_disc, "without scale_2 its Gaussians are discs, a millionth as thick as wide"),
        (is_rgb, "colours are red, green and blue, without f_dc_0 the same from all sides"),
        (filter.is_some(), "the filter in space of filter_3D is part of scales and opacities"),
    ]);
    imported.account.assumed.extend(assumed.into_iter().map(String::from));
    origin::place(&mut imported, |row| [x, y, z].map(|column| vertex.exact(row, column)), budget)?;
    imported.account.assumed.extend(rest.note());
    Ok(imported)
}

/// Scales and opacity with Mip-Splatting's filter in space of this standard deviation.
fn filtered(log_scales: [f32; 3], opacity: f32, filter: f64) -> ([f32; 3], f32) {
    let wider = log_scales.map(|scale| f64::from(scale).exp().hypot(filter).ln());
    let shrunk: f64 = (0..3).map(|axis| f64::from(log_scales[axis]) - wider[axis]).sum();
    (wider.map(|scale| scale as f32), (f64::from(opacity) * shrunk.exp()) as f32)
}

/// The SH of degree 1 and above.
#[derive(Default)]
pub(super) struct Rest {
    /// Degree that is read.
    pub(super) sh_degree: u8,
    /// Whether the file has coefficients of a higher degree.
    pub(super) is_cut: bool,
    /// Columns of each coefficient.
    columns: Vec<[usize; 3]>,
    /// Columns of the amplitudes of the colours' cosines in time, for all coefficients of one frequency after the other,
    /// the constant coefficient first.
    amplitudes: Vec<[usize; 3]>,
}

impl Rest {
    /// Appends the coefficients of a row to its constant coefficient, which is the last of `sh`, from the values of its
    /// columns.
    pub(super) fn push_row(&self, sh: &mut Vec<[f32; 3]>, value: impl Fn(usize) -> f32) {
        let start = sh.len() - 1;
        sh.extend(self.columns.iter().map(|columns| columns.map(&value)));
        // The cosines have no phase: at the centre of a Gaussian in time each is 1.
        for (k, columns) in self.amplitudes.iter().enumerate() {
            let sum = &mut sh[start + k % sh_coefficients(self.sh_degree)];
            *sum = [0, 1, 2].map(|channel| sum[channel] + value(columns[channel]));
        }
    }

    /// What is assumed of colours that change over time.
    pub(super) fn note(&self) -> Option<String> {
        let note = "colours that change over time are each Gaussian's at its own centre in time";
        (!self.amplitudes.is_empty()).then(|| note.into())
    }
}

/// The columns of SH of a table, up to the degree of fields. A file has whole degrees, or degree 3 several times (4DGS,
/// whose colours change over time: once constant, and once for each of their frequencies).
pub(super) fn rest_columns(table: &Table) -> Result<Rest, String> {
    let numbers = table.count_numbered(REST);
    let (stored, largest) = (numbers / 3, sh_coefficients(SH_DEGREE_MAX));
    let is_whole = (stored + 1).isqrt().pow(2) == stored + 1;
    let is_in_time = !is_whole && (stored + 1).is_multiple_of(largest);
    if !numbers.is_multiple_of(3) || !(is_whole || is_in_time) {
        return Err(format!(
            "{numbers} properties {REST}*, and 0, 9, 24 or 45 are read; export the field with colours as SH of such a degree"
        ));
    }
    let count = stored.min(largest - 1);
    let mut columns = (0..stored)
        .map(|k| table.find([0, 1, 2].map(|channel| format!("{REST}{}", channel * stored + k))))
        .collect::<Result<Vec<_>, _>>()?;
    let further = columns.split_off(count);
    let is_cut = is_whole && !further.is_empty();
    let amplitudes = if is_in_time { further } else { Vec::new() };
    Ok(Rest { sh_degree: (count + 1).isqrt() as u8 - 1, is_cut, columns, amplitudes })
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
