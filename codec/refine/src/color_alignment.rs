//! Colour alignment: the affine transform of colours that brings pictures nearest to their photographs, and the error that
//! is left.
//!
//! Least squares needs only sums over pixels, and so does the squared error after a transform. So [`ColorSums`] of many
//! pictures give one transform for all of them, and no picture is kept. The sums are of differences from the picture: where
//! it is exact, no error is left by rounding.

use std::ops::AddAssign;

use glam::{DMat4, DVec4};

/// Weight of the identity per pixel: it decides in pictures of one colour.
const RIDGE: f64 = 1e-6;

/// Sums over pixels of a picture and its photograph.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ColorSums {
    pixels: f64,
    /// Products `x xᵀ` of the picture's colour, with 1 as fourth component.
    products: DMat4,
    /// Products of `x` and the difference of the photograph from the picture, by channel.
    by_channel: [DVec4; 3],
    /// Squares of the differences.
    squares: f64,
}

/// What an affine transform adds to each channel: its product with a colour, with 1 as fourth component.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ColorTransform([DVec4; 3]);

impl ColorSums {
    /// The sums over no pixel.
    pub const ZERO: ColorSums =
        ColorSums { pixels: 0.0, products: DMat4::ZERO, by_channel: [DVec4::ZERO; 3], squares: 0.0 };

    /// Adds a pixel of the picture and of the photograph.
    pub(crate) fn add(&mut self, drawn: &[f64; 4], taken: &[f64; 4]) {
        let x = DVec4::new(drawn[0], drawn[1], drawn[2], 1.0);
        self.pixels += 1.0;
        self.products += DMat4::from_cols(x * x.x, x * x.y, x * x.z, x * x.w);
        let mut squares = 0.0;
        for (c, sum) in self.by_channel.iter_mut().enumerate() {
            let difference = taken[c] - drawn[c];
            *sum += x * difference;
            squares += difference.powi(2);
        }
        self.squares += squares;
    }

    /// The transform that leaves the least squared error.
    ///
    /// A held camera has a response that no fit has learned. The remaining error is the error of the content, as in
    /// the evaluations of RawNeRF (Mildenhall et al. 2022) and gsplat.
    pub(crate) fn transform(&self) -> ColorTransform {
        if self.pixels == 0.0 {
            return ColorTransform([DVec4::ZERO; 3]);
        }
        let inverse = (self.products + RIDGE * self.pixels * DMat4::IDENTITY).inverse();
        ColorTransform(self.by_channel.map(|sum| inverse * sum))
    }

    /// PSNR in dB of the picture as it is; `None` without pixels, `+inf` if it equals the photograph.
    pub fn psnr(&self) -> Option<f64> {
        self.psnr_of(self.squares)
    }

    /// PSNR in dB of the picture after `transform`.
    pub(crate) fn psnr_after(&self, ColorTransform(rows): &ColorTransform) -> Option<f64> {
        let pairs = rows.iter().zip(&self.by_channel);
        let change: f64 = pairs.map(|(row, sum)| row.dot(self.products * *row - 2.0 * *sum)).sum();
        let squares = self.squares + change;
        // Rounding can leave less than nothing. NaN stays.
        self.psnr_of(if squares < 0.0 { 0.0 } else { squares })
    }

    fn psnr_of(&self, squares: f64) -> Option<f64> {
        (self.pixels > 0.0).then(|| -10.0 * (squares / (3.0 * self.pixels)).log10())
    }
}

impl AddAssign<&ColorSums> for ColorSums {
    fn add_assign(&mut self, other: &ColorSums) {
        self.pixels += other.pixels;
        self.products += other.products;
        self.by_channel.iter_mut().zip(&other.by_channel).for_each(|(sum, other)| *sum += *other);
        self.squares += other.squares;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture() -> Vec<[f64; 4]> {
        let color = |i: usize| [0.3, 0.7, 1.9].map(|c: f64| 0.4 + 0.3 * (c * i as f64).sin());
        (0..300).map(color).map(|[r, g, b]| [r, g, b, 1.0]).collect()
    }

    fn sums(picture: &[[f64; 4]], photo: impl Fn([f64; 3]) -> [f64; 3]) -> ColorSums {
        let mut sums = ColorSums::ZERO;
        for pixel @ [r, g, b, _] in picture {
            let [y0, y1, y2] = photo([*r, *g, *b]);
            sums.add(pixel, &[y0, y1, y2, 1.0]);
        }
        sums
    }

    #[test]
    fn the_closed_form_is_the_error_of_transformed_pixels() {
        let photo = |[r, g, b]: [f64; 3]| [(2.0 * r).sin(), 0.9 * g * g, (r + b).cos()];
        let sums = sums(&picture(), photo);
        let error = |ColorTransform(rows): &ColorTransform| {
            let mut squares = 0.0;
            for [r, g, b, _] in picture() {
                let (drawn, taken) = ([r, g, b], photo([r, g, b]));
                let x = DVec4::new(r, g, b, 1.0);
                squares += (0..3).map(|c| (taken[c] - drawn[c] - rows[c].dot(x)).powi(2)).sum::<f64>();
            }
            -10.0 * (squares / 900.0).log10()
        };
        let any = ColorTransform([
            DVec4::new(0.1, -0.2, 0.05, 0.03),
            DVec4::new(0.0, 0.3, -0.1, 0.2),
            DVec4::new(-0.4, 0.1, 0.2, -0.1),
        ]);
        for transform in [any, sums.transform(), ColorTransform([DVec4::ZERO; 3])] {
            let closed = sums.psnr_after(&transform).unwrap();
            assert!((closed - error(&transform)).abs() < 1e-9, "{closed} {}", error(&transform));
        }
        assert_eq!(sums.psnr(), Some(error(&ColorTransform([DVec4::ZERO; 3]))));
        // No transform near the best one is better.
        let best = sums.transform();
        for (channel, axis) in (0..3).flat_map(|c| DVec4::AXES.map(|axis| (c, axis))) {
            for step in [-0.01, 0.01] {
                let mut near = best;
                near.0[channel] += step * axis;
                assert!(sums.psnr_after(&near) < sums.psnr_after(&best));
            }
        }
    }

    #[test]
    fn an_affine_difference_is_taken_away() {
        let sums =
            sums(&picture(), |[r, g, b]| [0.8 * r + 0.1 * g + 0.02, 1.1 * g - 0.01, 0.9 * b + 0.05 * r]);
        let (before, after) = (sums.psnr().unwrap(), sums.psnr_after(&sums.transform()).unwrap());
        assert!(before < 30.0 && after > 80.0, "{before} dB, {after} dB");
    }

    #[test]
    fn pictures_of_one_colour_and_equal_ones_are_finite_or_exact() {
        let gray = vec![[0.5, 0.5, 0.5, 1.0]; 40];
        let offset = sums(&gray, |_| [0.6, 0.4, 0.5]);
        let ColorTransform(rows) = offset.transform();
        assert!(rows.iter().all(|row| row.is_finite()), "{rows:?}");
        assert!(offset.psnr_after(&offset.transform()).unwrap() > 80.0);
        // Nothing but rounding is left to take away, and squares are not negative.
        let shades: Vec<_> =
            (0..40).map(|i| [f64::from(i) / 40.0; 3]).map(|[r, g, b]| [r, g, b, 1.0]).collect();
        let shaded = sums(&shades, |color| color.map(|c| 0.5 * c));
        assert!(shaded.psnr_after(&shaded.transform()).unwrap() > 80.0);
        let equal = sums(&picture(), |color| color);
        assert_eq!(equal.psnr(), Some(f64::INFINITY));
        assert_eq!(equal.psnr_after(&equal.transform()), Some(f64::INFINITY));
        assert_eq!(ColorSums::ZERO.psnr_after(&ColorSums::ZERO.transform()), None);
    }
}
