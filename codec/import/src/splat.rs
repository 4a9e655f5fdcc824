//! The `.splat` file: 32 bytes per static Gaussian, no header.
//!
//! Three `f32` centre, three `f32` standard deviations, RGB and opacity as bytes, quaternion
//! w, x, y, z as bytes around 128.

use crate::budget::ImportBudget;
use crate::imported::{Hints, Imported, Repairs, TRUNCATED, log_of_scales, sh_of_rgb};

/// Bytes per Gaussian.
const ROW: usize = 32;

/// Reads the rows of a static field.
pub(crate) fn read(bytes: &[u8], budget: &mut ImportBudget) -> Result<Imported, String> {
    let (rows, rest) = bytes.as_chunks::<ROW>();
    let mut repairs = Repairs::default();
    repairs.drop_rows(TRUNCATED, usize::from(!rest.is_empty()));
    let mut field = budget.field(rows.len(), 0)?;
    for row in rows {
        let float =
            |k: usize| f32::from_le_bytes([row[4 * k], row[4 * k + 1], row[4 * k + 2], row[4 * k + 3]]);
        field.centers.push([float(0), float(1), float(2)]);
        field.log_scales.push(log_of_scales([3, 4, 5].map(float), &mut repairs));
        field.sh.push([24, 25, 26].map(|k| sh_of_rgb(f64::from(row[k]) / 255.0)));
        field.opacities.push(f32::from(row[27]) / 255.0);
        field.rotations.push([28, 29, 30, 31].map(|k| (f32::from(row[k]) - 128.0) / 128.0));
    }
    Ok(Imported { field, hints: Hints::default(), repairs, format: ".splat", notes: Vec::new() })
}
