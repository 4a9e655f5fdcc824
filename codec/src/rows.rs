//! [`Rows`]: a run of rows of a field, to be written. Runs that do not overlap can be written by
//! several threads.

use std::mem;

use crate::{Field, Temporal, sh_coefficients};

/// Rows of a field, column by column.
pub(crate) struct Rows<'a> {
    pub(crate) centers: &'a mut [[f32; 3]],
    pub(crate) rotations: &'a mut [[f32; 4]],
    pub(crate) log_scales: &'a mut [[f32; 3]],
    pub(crate) opacities: &'a mut [f32],
    pub(crate) sh_degree: u8,
    /// [`sh_coefficients`] for each row.
    pub(crate) sh: &'a mut [[f32; 3]],
    pub(crate) temporal: Option<TemporalRows<'a>>,
}

/// The temporal columns of rows of a field.
pub(crate) struct TemporalRows<'a> {
    pub(crate) tau: &'a mut [f32],
    pub(crate) s: &'a mut [f32],
    pub(crate) motion_order: u8,
    /// As many as the motion order for each row.
    pub(crate) motion: &'a mut [[f32; 3]],
    pub(crate) rotation_rates: Option<&'a mut [[f32; 4]]>,
}

impl<'a> Rows<'a> {
    /// All rows of a field.
    pub(crate) fn of(field: &'a mut Field) -> Rows<'a> {
        let Field { centers, rotations, log_scales, opacities, sh_degree, sh, temporal } = field;
        let temporal = temporal.as_mut().map(|temporal| {
            let Temporal { tau, s, motion_order, motion, rotation_rates } = temporal;
            TemporalRows {
                tau,
                s,
                motion_order: *motion_order,
                motion,
                rotation_rates: rotation_rates.as_deref_mut(),
            }
        });
        Rows { centers, rotations, log_scales, opacities, sh_degree: *sh_degree, sh, temporal }
    }

    /// Takes the first `count` rows away.
    ///
    /// # Panics
    /// If there are fewer.
    pub(crate) fn take(&mut self, count: usize) -> Rows<'a> {
        Rows {
            centers: take(&mut self.centers, count),
            rotations: take(&mut self.rotations, count),
            log_scales: take(&mut self.log_scales, count),
            opacities: take(&mut self.opacities, count),
            sh_degree: self.sh_degree,
            sh: take(&mut self.sh, count * sh_coefficients(self.sh_degree)),
            temporal: self.temporal.as_mut().map(|temporal| TemporalRows {
                tau: take(&mut temporal.tau, count),
                s: take(&mut temporal.s, count),
                motion_order: temporal.motion_order,
                motion: take(&mut temporal.motion, count * usize::from(temporal.motion_order)),
                rotation_rates: temporal.rotation_rates.as_mut().map(|rates| take(rates, count)),
            }),
        }
    }
}

/// Takes the first `count` entries of a column away.
fn take<'a, T>(column: &mut &'a mut [T], count: usize) -> &'a mut [T] {
    let (taken, rest) = mem::take(column).split_at_mut(count);
    *column = rest;
    taken
}
