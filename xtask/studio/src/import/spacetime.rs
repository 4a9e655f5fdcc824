//! The PLY of Spacetime Gaussians (Li et al. 2024), lite model.
//!
//! The columns of 3D Gaussian Splatting, and: `trbf_center` (tau), `trbf_scale` (the logarithm of
//! a width w in `exp(-(d / w)^2)`, so `s = w / sqrt(2)`), `motion_0..8` (`[power - 1][axis]`),
//! `omega_0..3` (rates of the quaternion). In the lite model `f_dc_0..2` is RGB in `[0, 1]`, not
//! SH. The full model has six features there, three more in `f_t_*`, and a network beside the file
//! that turns the rendered features into colours; it has no colours to import.

use std::f64::consts::FRAC_1_SQRT_2;

use codec::Temporal;

use super::imported::{Hints, Imported, Repairs, sh_of_rgb};
use super::inria;
use super::ply::Table;

/// Reads the rows of a dynamic field.
pub(crate) fn read(vertex: &Table) -> Result<Imported, String> {
    if vertex.has("f_dc_3") || vertex.has("f_t_0") {
        return Err("Spacetime Gaussians, full model: its colours come from a neural network that a field \
                    cannot hold; export the lite model instead"
            .into());
    }
    let mut field = inria::static_columns(vertex)?;
    for color in field.sh.iter_mut().flatten() {
        *color = sh_of_rgb(f64::from(*color));
    }
    let [tau, log_width] = vertex.find(["trbf_center", "trbf_scale"])?;
    let motion: [usize; 9] = vertex.find(std::array::from_fn(|k| format!("motion_{k}")))?;
    let omega = vertex.find(["omega_0", "omega_1", "omega_2", "omega_3"])?;
    let rows = 0..vertex.rows;
    let s: Vec<f32> =
        rows.clone().map(|row| (vertex.get(row, log_width).exp() * FRAC_1_SQRT_2) as f32).collect();

    let mut repairs = Repairs::default();
    repairs.drop_rows("truncated payload", vertex.missing_rows());
    repairs.repair_rows("infinite window width, always on", s.iter().filter(|s| s.is_infinite()).count());
    field.temporal = Some(Temporal {
        tau: rows.clone().map(|row| vertex.get(row, tau) as f32).collect(),
        s,
        motion_order: 3,
        motion: rows.clone().flat_map(|row| vertex.row(row, motion).as_chunks().0.to_vec()).collect(),
        rotation_rates: Some(rows.map(|row| vertex.row(row, omega)).collect()),
    });
    Ok(Imported { field, hints: Hints::default(), repairs, format: "Spacetime Gaussians PLY" })
}
