//! [`Rows`]: a mutable view of consecutive rows of a field. Disjoint views can be written by several
//! threads.

use std::mem;

use crate::{Field, Temporal, sh_coefficients};

/// Consecutive rows of a field, column by column.
pub(crate) struct Rows<'a> {
    pub(crate) centers: &'a mut [[f32; 3]],
    pub(crate) rotations: &'a mut [[f32; 4]],
    pub(crate) log_scales: &'a mut [[f32; 3]],
    pub(crate) opacities: &'a mut [f32],
    pub(crate) sh_degree: u8,
    /// [`sh_coefficients`] per row.
    pub(crate) sh: &'a mut [[f32; 3]],
    pub(crate) temporal: Option<TemporalRows<'a>>,
}

/// The temporal columns of [`Rows`].
pub(crate) struct TemporalRows<'a> {
    pub(crate) tau: &'a mut [f32],
    pub(crate) s: &'a mut [f32],
    pub(crate) motion_order: u8,
    /// `motion_order` per row.
    pub(crate) motion: &'a mut [[f32; 3]],
    pub(crate) rotation_rates: Option<&'a mut [[f32; 4]]>,
}

impl<'a> Rows<'a> {
    /// All rows of a field.
    pub(crate) fn all(field: &'a mut Field) -> Rows<'a> {
        let Field { centers, rotations, log_scales, opacities, sh_degree, sh, filter: _, near: _, temporal } =
            field;
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

    /// Splits off the first `count` rows.
    ///
    /// # Panics
    /// If there are fewer.
    pub(crate) fn split_off(&mut self, count: usize) -> Rows<'a> {
        Rows {
            centers: split_off(&mut self.centers, count),
            rotations: split_off(&mut self.rotations, count),
            log_scales: split_off(&mut self.log_scales, count),
            opacities: split_off(&mut self.opacities, count),
            sh_degree: self.sh_degree,
            sh: split_off(&mut self.sh, count * sh_coefficients(self.sh_degree)),
            temporal: self.temporal.as_mut().map(|temporal| TemporalRows {
                tau: split_off(&mut temporal.tau, count),
                s: split_off(&mut temporal.s, count),
                motion_order: temporal.motion_order,
                motion: split_off(&mut temporal.motion, count * usize::from(temporal.motion_order)),
                rotation_rates: temporal.rotation_rates.as_mut().map(|rates| split_off(rates, count)),
            }),
        }
    }
}

/// Splits off the first `count` entries of a column.
fn split_off<'a, T>(column: &mut &'a mut [T], count: usize) -> &'a mut [T] {
    let (taken, rest) = mem::take(column).split_at_mut(count);
    *column = rest;
    taken
}
