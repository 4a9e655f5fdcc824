//! Exporters: a field as a file, in this project's format or another program's.
//!
//! Each turns values into the bytes of a file; [`program::output::write`] writes them.

mod field_file;
mod glb;
mod ply;
mod sequence;
mod splatv;
mod spz;

use codec::{ALPHA_MIN, Field};

pub use field_file::{field_file, fitted_field_file};
pub use glb::glb;
pub use ply::static_ply;
pub use sequence::{frame_of_sequence, rows_of_sequence};
pub use splatv::splatv;
pub use spz::spz;

/// The field at clip time `t` as a static one: centres, rotations and opacities of that instant, without
/// Gaussians that are invisible then (opacity below [`ALPHA_MIN`]).
pub fn frozen(field: &Field, t: f64) -> Field {
    let visible: Vec<usize> = (0..field.len()).filter(|&i| field.opacity_at(i, t) >= ALPHA_MIN).collect();
    Field {
        centers: visible.iter().map(|&i| field.position_at(i, t).map(|x| x as f32)).collect(),
        rotations: visible.iter().map(|&i| field.rotation_at(i, t).map(|x| x as f32)).collect(),
        opacities: visible.iter().map(|&i| field.opacity_at(i, t) as f32).collect(),
        temporal: None,
        ..field.select(&visible)
    }
}
