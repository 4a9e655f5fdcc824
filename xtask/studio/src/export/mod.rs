//! Exporters: a field as a file, in this project's format or another program's.
//!
//! Each takes values and gives the bytes of a file; [`program::output::write`] writes them.

mod field_file;
mod ply;
mod splatv;
mod spz;

use codec::{ALPHA_MIN, Clip, Field, Temporal, sh_coefficients};

pub use field_file::field_file;
pub use ply::static_ply;
pub use splatv::splatv;
pub use spz::spz;

/// Both regions of a clip as one field, the motionless Gaussians first. The plate is left out.
pub fn merged(clip: &Clip) -> Field {
    let (still, moving) = (&clip.static_field, &clip.dynamic_field);
    let both = |a: &[[f32; 3]], b: &[[f32; 3]]| [a, b].concat();
    let sh_degree = clip.sh_degree();
    Field {
        centers: both(&still.centers, &moving.centers),
        rotations: [&still.rotations[..], &moving.rotations].concat(),
        log_scales: both(&still.log_scales, &moving.log_scales),
        opacities: [&still.opacities[..], &moving.opacities].concat(),
        sh_degree,
        sh: both(&sh_at_degree(still, sh_degree), &sh_at_degree(moving, sh_degree)),
        temporal: moving.temporal.as_ref().filter(|_| !moving.is_empty()).map(|temporal| {
            let n = still.len();
            Temporal {
                tau: [&vec![0.0; n][..], &temporal.tau].concat(),
                s: [&vec![f32::INFINITY; n][..], &temporal.s].concat(),
                motion_order: temporal.motion_order,
                motion: both(&vec![[0.0; 3]; n * usize::from(temporal.motion_order)], &temporal.motion),
                rotation_rates: temporal
                    .rotation_rates
                    .as_ref()
                    .map(|rates| [&vec![[0.0; 4]; n][..], rates].concat()),
            }
        }),
    }
}

/// The field as it stands at clip time `t`, static: centres, rotations and opacities of that
/// instant, without the Gaussians that cannot be seen then (opacity below [`ALPHA_MIN`]).
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

/// The SH column of a field, widened with zeros to `degree`.
fn sh_at_degree(field: &Field, degree: u8) -> Vec<[f32; 3]> {
    let mut sh = Vec::with_capacity(field.len() * sh_coefficients(degree));
    for i in 0..field.len() {
        sh.extend_from_slice(field.sh_of(i));
        sh.resize((i + 1) * sh_coefficients(degree), [0.0; 3]);
    }
    sh
}
