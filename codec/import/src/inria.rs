//! The PLY of 3D Gaussian Splatting (Kerbl et al. 2023) and the many tools that follow it.
//!
//! One `vertex` per Gaussian: centre `x y z`, SH `f_dc_0..2` and `f_rest_*` (all coefficients of
//! red, then of green, then of blue), `opacity` as a logit, `scale_0..2` as natural logarithms,
//! `rot_0..3` as a quaternion w, x, y, z of any length.

use codec::{Field, SH_DEGREE_MAX, sh_coefficients};

use crate::budget::ImportBudget;
use crate::imported::{Hints, Imported, Repairs};
use crate::ply::Table;

/// Reads the rows of a static field.
pub(crate) fn read(vertex: &Table, budget: &mut ImportBudget) -> Result<Imported, String> {
    let field = static_columns(vertex, budget)?;
    let repairs = Repairs::of_truncated(vertex.missing_rows());
    Ok(Imported {
        field,
        hints: Hints::default(),
        repairs,
        format: "3D Gaussian Splatting PLY",
        notes: Vec::new(),
    })
}

/// Reads the columns that this format shares with its derivatives.
pub(crate) fn static_columns(vertex: &Table, budget: &mut ImportBudget) -> Result<Field, String> {
    let [x, y, z, red, green, blue, opacity, s0, s1, s2, r0, r1, r2, r3] = vertex.find([
        "x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2", "rot_0",
        "rot_1", "rot_2", "rot_3",
    ])?;
    let sh_degree = sh_degree_of(vertex.count_numbered("f_rest_"))?;
    let rest = sh_coefficients(sh_degree) - 1;
    let rest_columns: Vec<[usize; 3]> = (0..rest)
        .map(|k| vertex.find([0, 1, 2].map(|channel| format!("f_rest_{}", channel * rest + k))))
        .collect::<Result<_, _>>()?;

    let mut field = budget.field(vertex.rows, sh_degree)?;
    for row in 0..vertex.rows {
        field.centers.push(vertex.row(row, [x, y, z]));
        field.rotations.push(vertex.row(row, [r0, r1, r2, r3]));
        field.log_scales.push(vertex.row(row, [s0, s1, s2]));
        field.opacities.push(sigmoid(vertex.get(row, opacity)));
        field.sh.push(vertex.row(row, [red, green, blue]));
        field.sh.extend(rest_columns.iter().map(|&columns| vertex.row(row, columns)));
    }
    Ok(field)
}

/// The SH degree for a number of `f_rest_*` values, all channels together.
pub(crate) fn sh_degree_of(rest: usize) -> Result<u8, String> {
    (0..=SH_DEGREE_MAX)
        .find(|&degree| 3 * (sh_coefficients(degree) - 1) == rest)
        .ok_or_else(|| format!("{rest} properties f_rest_*, where 0, 9, 24 or 45 were expected"))
}

fn sigmoid(logit: f64) -> f32 {
    (1.0 / (1.0 + (-logit).exp())) as f32
}
