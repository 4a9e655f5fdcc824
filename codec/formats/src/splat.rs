//! The `.splat` file: 32 bytes per static Gaussian, no header, so that it is recognised by its values.
//!
//! Three `f32` centre, three `f32` standard deviations, RGB and opacity as bytes, quaternion
//! w, x, y, z as bytes around 128.

use crate::account::Repairs;
use crate::bytes::f32_at;
use crate::columns::unpack_rgba;
use crate::imported::Imported;
use crate::limits::ImportBudget;
use crate::statements::{Statement, honoured};

/// Bytes per Gaussian.
const ROW: usize = 32;

/// Largest difference of a quaternion's length from 1: the rounding of four bytes, several times.
const LENGTH_ERROR_MAX: f32 = 0.1;

/// What a file says.
pub(crate) const STATEMENTS: &[Statement] = &[honoured("all columns", "there is no header")];

/// Reads the rows of a static field.
pub(crate) fn read(bytes: &[u8], budget: &mut ImportBudget) -> Result<Imported, String> {
    let (rows, rest) = bytes.as_chunks::<ROW>();
    let repairs = Repairs::truncated(usize::from(!rest.is_empty()));
    let wrong = rows.iter().filter(|row| !may_be_gaussian(row)).count();
    if 2 * wrong > rows.len() {
        let all = rows.len();
        return Err(format!(
            "{wrong} of its {all} rows cannot be Gaussians, so it is no .splat file, whatever its name"
        ));
    }
    let mut field = budget.field(rows.len(), 0)?;
    for row in rows {
        let float = |k: usize| f32_at(row, 4 * k);
        field.centers.push([0, 1, 2].map(float));
        field.log_scales.push([3, 4, 5].map(|k| float(k).ln()));
        let (color, opacity) = unpack_rgba([24, 25, 26, 27].map(|k| row[k]));
        field.sh.push(color);
        field.opacities.push(opacity);
        field.rotations.push([28, 29, 30, 31].map(|k| (f32::from(row[k]) - 128.0) / 128.0));
    }
    Ok(Imported::new(".splat", field, repairs))
}

/// The bytes of the quaternion that antimatter15's converter writes for a PLY without rotations.
const WITHOUT_ROTATION: [u8; 4] = [255, 0, 0, 0];

/// Whether the values of a row can be of a Gaussian: finite, scales not below zero, and the quaternion of length 1, as
/// writers make it, 0, or [`WITHOUT_ROTATION`]. One row in a thousand of random bytes is like that.
fn may_be_gaussian(row: &[u8; ROW]) -> bool {
    let floats = [0, 1, 2, 3, 4, 5].map(|k| f32_at(row, 4 * k));
    let norm = row[28..].iter().map(|&byte| ((f32::from(byte) - 128.0) / 128.0).powi(2)).sum::<f32>().sqrt();
    floats.iter().all(|x| x.is_finite())
        && floats[3..].iter().all(|&scale| scale >= 0.0)
        && (norm == 0.0 || row[28..] == WITHOUT_ROTATION || (norm - 1.0).abs() < LENGTH_ERROR_MAX)
}
