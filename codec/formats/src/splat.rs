//! The `.splat` file: 32 bytes per static Gaussian, no header.
//!
//! Three `f32` centre, three `f32` standard deviations, RGB and opacity as bytes, quaternion
//! w, x, y, z as bytes around 128.

use crate::account::Repairs;
use crate::bytes::f32_at;
use crate::columns::{log_of_scales, unpack_rgba};
use crate::imported::Imported;
use crate::limits::ImportBudget;

/// Bytes per Gaussian.
const ROW: usize = 32;

/// Reads the rows of a static field.
pub(crate) fn read(bytes: &[u8], budget: &mut ImportBudget) -> Result<Imported, String> {
    let (rows, rest) = bytes.as_chunks::<ROW>();
    let mut repairs = Repairs::truncated(usize::from(!rest.is_empty()));
    let mut field = budget.field(rows.len(), 0)?;
    for row in rows {
        let float = |k: usize| f32_at(row, 4 * k);
        field.centers.push([0, 1, 2].map(float));
        field.log_scales.push(log_of_scales([3, 4, 5].map(float), &mut repairs));
        let (color, opacity) = unpack_rgba([24, 25, 26, 27].map(|k| row[k]));
        field.sh.push(color);
        field.opacities.push(opacity);
        field.rotations.push([28, 29, 30, 31].map(|k| (f32::from(row[k]) - 128.0) / 128.0));
    }
    Ok(Imported::new(".splat", field, repairs))
}
