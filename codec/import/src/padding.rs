//! [`padded_sh`]: SH coefficients of a lower degree beside coefficients of a higher degree.

use codec::sh_coefficients;

/// SH coefficients of degree `from`, `[row][coefficient]` flattened, as coefficients of degree `to`, which is not
/// lower: zeros are added.
pub(crate) fn padded_sh(sh: &[[f32; 3]], from: u8, to: u8) -> Vec<[f32; 3]> {
    let zeros = [[0.0; 3]; 16];
    let added = &zeros[..sh_coefficients(to) - sh_coefficients(from)];
    sh.chunks_exact(sh_coefficients(from)).flat_map(|row| row.iter().chain(added)).copied().collect()
}
