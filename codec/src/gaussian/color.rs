//! Transforms of colours and of spherical harmonics to components that correlate less.

use crate::rans::math::{self, Unit};

/// Luma and two colour differences, by a lifting transform.
pub(super) fn luma_chroma([r, g, b]: [f64; 3]) -> [f64; 3] {
    [(r + 2.0 * g + b) * 0.25, r - b, g - (r + b) * 0.5]
}

/// Inverse of [`luma_chroma`].
pub(super) fn rgb([y, red_blue, green]: [f64; 3]) -> [f64; 3] {
    let g = y + green * 0.5;
    let sum = 2.0 * (g - green);
    [(sum + red_blue) * 0.5, g, (sum - red_blue) * 0.5]
}

const SQRT_2: Unit = Unit::new(std::f64::consts::SQRT_2);
const SQRT_3: Unit = Unit::new(1.732_050_807_568_877_2);
const SQRT_6: Unit = Unit::new(2.449_489_742_783_178);

/// Sum and two differences of the channels, by an orthonormal transform.
pub(super) fn opponents([r, g, b]: [f64; 3]) -> [f64; 3] {
    [(r + g + b) / SQRT_3.size, (r - b) / SQRT_2.size, (r - 2.0 * g + b) / SQRT_6.size]
}

/// Inverse of [`opponents`].
pub(super) fn channels([sum, red_blue, green]: [f64; 3]) -> [f64; 3] {
    let (s, d, e) =
        (math::in_units(sum, SQRT_3), math::in_units(red_blue, SQRT_2), math::in_units(green, SQRT_6));
    [s + d + e, s - 2.0 * e, s - d + e]
}
