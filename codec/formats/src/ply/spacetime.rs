//! The PLY of Spacetime Gaussians (Li et al. 2024), lite model.
//!
//! The columns of 3D Gaussian Splatting, and: `trbf_center` (tau), `trbf_scale` (the logarithm of
//! a width w in `exp(-(d / w)^2)`, so `s = w / sqrt(2)`), `motion_0..8` (`[power - 1][axis]`),
//! `omega_0..3` (rates of the quaternion). In the lite model `f_dc_0..2` is RGB in `[0, 1]`, not
//! SH. The full model has six features there, three more in `f_t_*`, and a network beside the file
//! that turns the rendered features into colours; it has no colours to import.

use std::f64::consts::FRAC_1_SQRT_2;

use crate::columns::sh_of_rgb;
use crate::imported::Imported;
use crate::limits::ImportBudget;

use super::container::Table;
use super::gaussian_splatting;

/// Reads the rows of a dynamic field.
pub(super) fn read(vertex: &Table, budget: &mut ImportBudget) -> Result<Imported, String> {
    if vertex.has("f_dc_3") || vertex.has("f_t_0") {
        return Err("Spacetime Gaussians, full model: its colours come from a neural network that a field \
                    cannot hold; export the lite model instead"
            .into());
    }
    let mut imported = gaussian_splatting::read(vertex, budget)?;
    let field = &mut imported.field;
    for color in field.sh.iter_mut().flatten() {
        *color = sh_of_rgb(f64::from(*color));
    }
    let [tau, log_width] = vertex.find(["trbf_center", "trbf_scale"])?;
    let motion: [usize; 9] = vertex.find(std::array::from_fn(|k| format!("motion_{k}")))?;
    let omega = vertex.find(["omega_0", "omega_1", "omega_2", "omega_3"])?;
    let mut temporal = budget.temporal(vertex.rows, 3)?;
    let mut rates = budget.vec(vertex.rows)?;
    for row in 0..vertex.rows {
        temporal.tau.push(vertex.get(row, tau) as f32);
        // A width beyond the range of f32 is infinite: always on.
        temporal.s.push((vertex.get(row, log_width).exp() * FRAC_1_SQRT_2) as f32);
        temporal.motion.extend(vertex.row(row, motion).as_chunks().0);
        rates.push(vertex.row(row, omega));
    }
    temporal.rotation_rates = Some(rates);
    field.temporal = Some(temporal);
    Ok(Imported { format: "Spacetime Gaussians PLY", ..imported })
}
