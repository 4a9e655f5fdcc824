//! [`Row`]: a decoded Gaussian.

use super::trajectory::Span;
use crate::{rows::Rows, sh_coefficients};

/// A decoded Gaussian.
#[derive(Clone, Debug, Default)]
pub(super) struct Row {
    pub(super) center: [f32; 3],
    pub(super) rotation: [f32; 4],
    pub(super) log_scales: [f32; 3],
    pub(super) opacity: f32,
    pub(super) sh: Vec<[f32; 3]>,
    pub(super) tau: f32,
    pub(super) s: f32,
    pub(super) motion: [[f32; 3]; 3],
    pub(super) rotation_rate: [f32; 4],
}

impl Row {
    /// When it is alive.
    pub(super) fn span(&self) -> Span {
        Span::new(f64::from(self.opacity), f64::from(self.tau), f64::from(self.s))
    }

    /// Writes the row to row `i` of `out`, which has the columns of the chunk or more: of those, spherical
    /// harmonics keep their zeros.
    pub(super) fn write_to(&self, out: &mut Rows, i: usize) {
        out.centers[i] = self.center;
        out.rotations[i] = self.rotation;
        out.log_scales[i] = self.log_scales;
        out.opacities[i] = self.opacity;
        out.sh[i * sh_coefficients(out.sh_degree)..][..self.sh.len()].copy_from_slice(&self.sh);
        if let Some(temporal) = &mut out.temporal {
            temporal.tau[i] = self.tau;
            temporal.s[i] = self.s;
            let order = usize::from(temporal.motion_order);
            temporal.motion[i * order..][..order].copy_from_slice(&self.motion[..order]);
            if let Some(rates) = &mut temporal.rotation_rates {
                rates[i] = self.rotation_rate;
            }
        }
    }

    /// Whether every number satisfies [`Field::check`](crate::Field::check).
    pub(super) fn is_valid(&self) -> bool {
        // Without an early end, several numbers are compared at once.
        let finite = |numbers: &[f32]| numbers.iter().fold(true, |all, x| all & x.is_finite());
        (0.0..=1.0).contains(&self.opacity)
            & self.tau.is_finite()
            & finite(&self.center)
            & finite(&self.rotation)
            & finite(&self.log_scales)
            & finite(self.motion.as_flattened())
            & finite(&self.rotation_rate)
            & finite(self.sh.as_flattened())
    }
}

/// Magnitude to which the numbers of a Gaussian are cut. Format.
const NUMBER_MAX: f64 = 1e30;

/// Rounds a number of a Gaussian to `f32`, cut to [`NUMBER_MAX`].
#[inline(always)]
pub(super) fn narrowed(x: f64) -> f32 {
    x.clamp(-NUMBER_MAX, NUMBER_MAX) as f32
}
