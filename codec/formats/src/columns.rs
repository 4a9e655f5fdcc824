//! Columns as formats store them: a channel in `[0, 1]` for the constant SH coefficient, SH of a lower degree, three of
//! four components of a quaternion.

use codec::{SH_C0, sh_coefficients};

/// Logarithm of the thickness of a flat Gaussian over its width: thin enough for a disc, and not 0, which has no
/// logarithm.
pub(crate) const LOG_FLAT: f32 = -13.815_511;

/// The constant SH coefficient of a channel with this value in `[0, 1]`.
pub(crate) fn sh_of_rgb(value: f64) -> f32 {
    ((value - 0.5) / SH_C0) as f32
}

/// The value of a channel with this constant SH coefficient; outside `[0, 1]` if it is brighter or darker than that.
pub(crate) fn rgb_of_sh(coefficient: f32) -> f64 {
    0.5 + SH_C0 * f64::from(coefficient)
}

/// The constant SH coefficients and the opacity of bytes r, g, b, a.
pub(crate) fn unpack_rgba([rgb @ .., a]: [u8; 4]) -> ([f32; 3], f32) {
    (rgb.map(|byte| sh_of_rgb(f64::from(byte) / 255.0)), f32::from(a) / 255.0)
}

/// A unit quaternion of the component at `largest`, which is not negative, and the others in their order.
pub(crate) fn with_largest(largest: usize, others: [f64; 3]) -> [f64; 4] {
    let mut q = [0.0; 4];
    for (k, other) in (0..4).filter(|&k| k != largest).zip(others) {
        q[k] = other;
    }
    q[largest] = (1.0 - q.iter().map(|x| x * x).sum::<f64>()).max(0.0).sqrt();
    q
}

/// SH coefficients of degree `from`, `[row][coefficient]` flattened, as coefficients of degree `to`, which is not
/// lower: zeros are added.
pub(crate) fn padded_sh(sh: &[[f32; 3]], from: u8, to: u8) -> Vec<[f32; 3]> {
    let zeros = [[0.0; 3]; 16];
    let added = &zeros[..sh_coefficients(to) - sh_coefficients(from)];
    sh.chunks_exact(sh_coefficients(from)).flat_map(|row| row.iter().chain(added)).copied().collect()
}
