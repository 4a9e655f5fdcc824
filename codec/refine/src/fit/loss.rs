//! [`loss`]: how far a picture is from its photograph (the paper's objective, Eq. 9), and which way
//! each of its pixels should go.
//!
//! `0.8 L1 + 0.2 (1 - SSIM) + 0.1 LPIPS`, means over all pixels and three channels; without weights
//! for LPIPS that term is left out. The photograph is cut out by its mask and lies over black, as
//! the picture does.

use super::lpips::Lpips;
use super::ssim::ssim_and_gradient;
use super::{Photograph, Real};

/// Weight of structural dissimilarity `1 - SSIM` against that of absolute differences (the paper's
/// lambda).
pub(super) const LAMBDA: f64 = 0.2;

/// Weight of LPIPS (the paper's gamma).
const GAMMA: f64 = 0.1;

/// A picture's distance from its photograph.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Loss<T> {
    /// The objective, 0 where they are equal. Not finite where the picture is not.
    pub(super) value: f64,
    /// Its derivative by each colour of the picture; alpha, which it does not look at, has none.
    pub(super) gradient: Vec<[T; 4]>,
}

/// Compares a picture, its colours premultiplied over black, with its photograph. Pixels that the
/// photograph does not show count as equal and carry no gradient.
///
/// # Panics
/// If the sizes differ, or are too small for `lpips`, see [`Lpips::check_size`].
pub(super) fn loss<T: Real>(
    picture: &[[T; 4]],
    photograph: &Photograph,
    lpips: Option<&Lpips<T>>,
) -> Loss<T> {
    assert_eq!(picture.len(), photograph.pixels.len(), "a picture of the photograph's size");
    let width = photograph.width as usize;
    let seen = |i: usize| photograph.is_seen(i);
    let [picture, target] = compared(picture, photograph);

    let channels = 3 * picture.len().max(1);
    let mut absolute = 0.0;
    let (similarity, structure) = ssim_and_gradient(&picture, &target, width);
    let pull = T::of((1.0 - LAMBDA) / channels as f64);
    let difference = |((a, b), by_ssim): ((&[T; 4], &[T; 4]), &[T; 3])| {
        let mut pixel = [T::zero(); 4];
        for c in 0..3 {
            let difference = a[c] - b[c];
            absolute += difference.abs().to_double();
            // Its sign, but 0 for 0.
            let sign = if difference == T::zero() { difference } else { difference.signum() };
            pixel[c] = pull * sign - T::of(LAMBDA) * by_ssim[c];
        }
        pixel
    };
    let mut gradient: Vec<[T; 4]> = picture.iter().zip(&target).zip(&structure).map(difference).collect();
    let mut value = (1.0 - LAMBDA) * absolute / channels as f64 + LAMBDA * (1.0 - similarity);

    if let Some(lpips) = lpips {
        let part = perceptual(lpips, &picture, &target, width);
        value += part.value;
        for (pixel, by_lpips) in gradient.iter_mut().zip(part.gradient) {
            for (sum, by) in pixel.iter_mut().zip(by_lpips) {
                *sum += by;
            }
        }
    }
    for (_, pixel) in gradient.iter_mut().enumerate().filter(|(i, _)| !seen(*i)) {
        *pixel = [T::zero(); 4];
    }
    Loss { value, gradient }
}

/// The part of the loss that is due to LPIPS alone, for who computes the others elsewhere. Pixels that
/// the photograph does not show have a gradient here.
///
/// # Panics
/// As [`loss`] does.
#[cfg(feature = "gpu")]
pub(super) fn perceptual_loss(
    picture: &[[f32; 4]],
    photograph: &Photograph,
    lpips: &Lpips<f32>,
) -> Loss<f32> {
    let [picture, target] = compared(picture, photograph);
    perceptual(lpips, &picture, &target, photograph.width as usize)
}

/// What is compared: the picture, with the photograph where that does not show what is there, and the
/// photograph.
fn compared<T: Real>(picture: &[[T; 4]], photograph: &Photograph) -> [Vec<[T; 4]>; 2] {
    let target: Vec<[T; 4]> =
        photograph.pixels.iter().map(|p| p.map(|byte| T::of(f64::from(byte) / 255.0))).collect();
    let drawn = |i: usize| if photograph.is_seen(i) { picture[i] } else { target[i] };
    [(0..picture.len()).map(drawn).collect(), target]
}

fn perceptual<T: Real>(lpips: &Lpips<T>, picture: &[[T; 4]], target: &[[T; 4]], width: usize) -> Loss<T> {
    let (distance, by_lpips) = lpips.distance_and_gradient(picture, target, width);
    let weighted = |[r, g, b]: [T; 3]| [T::of(GAMMA) * r, T::of(GAMMA) * g, T::of(GAMMA) * b, T::zero()];
    Loss { value: GAMMA * distance, gradient: by_lpips.into_iter().map(weighted).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Image;

    const SIZE: [u32; 2] = [14, 12];

    fn photograph() -> Photograph {
        let [width, height] = SIZE;
        let byte = |i: u32, step: u32| ((i * step) % 251) as u8;
        let pixels = (0..width * height).map(|i| [byte(i, 7), byte(i, 31), byte(i, 113), 255]).collect();
        Photograph { width, height, pixels, seen: Vec::new() }
    }

    /// Off the photograph's levels, where the absolute difference has a kink.
    fn picture() -> Vec<[f64; 4]> {
        (0..photograph().pixels.len())
            .map(|i| [0.0, 1.0, 2.0, 3.0].map(|c: f64| 0.5003 + 0.45 * (0.3 * i as f64 + c).sin()))
            .collect()
    }

    fn check_gradient(photograph: &Photograph, pixels: &[usize]) {
        let found = loss(&picture(), photograph, None).gradient;
        for &pixel in pixels {
            for c in 0..4 {
                let moved = |by: f64| {
                    let mut moved = picture();
                    moved[pixel][c] += by;
                    loss(&moved, photograph, None).value
                };
                let expected = (moved(1e-7) - moved(-1e-7)) / 2e-7;
                let found = found[pixel][c];
                assert!((found - expected).abs() < 1e-8, "{pixel} {c}: {found} {expected}");
            }
        }
    }

    #[test]
    fn the_gradient_is_that_of_finite_differences() {
        check_gradient(&photograph(), &[0, 13, 50, 91, 167]);
    }

    #[test]
    fn what_is_not_seen_neither_counts_nor_pulls() {
        let mut photograph = photograph();
        photograph.seen = (0..photograph.pixels.len()).map(|i| i % 14 < 9).collect();
        check_gradient(&photograph, &[0, 8, 9, 13, 50, 91]);
        let Loss { value, gradient } = loss(&picture(), &photograph, None);
        let mut unseen_changed = picture();
        unseen_changed[9] = [7.0, f64::NAN, -3.0, 0.0];
        assert_eq!(loss(&unseen_changed, &photograph, None), Loss { value, gradient: gradient.clone() });
        assert_eq!(gradient[9], [0.0; 4]);
    }

    /// The same objective from the measures of the evaluation.
    #[test]
    fn the_value_is_the_papers() {
        let [width, height] = SIZE;
        let photograph = photograph();
        let drawn = Image { width, height, pixels: picture() };
        let pixels = photograph.pixels.iter().map(|p| p.map(|byte| f64::from(byte) / 255.0)).collect();
        let taken = Image { width, height, pixels };
        let differences = drawn.pixels.iter().zip(&taken.pixels);
        let absolute: f64 = differences.flat_map(|(a, b)| [0, 1, 2].map(|c| (a[c] - b[c]).abs())).sum();
        let expected =
            0.8 * absolute / (3 * width * height) as f64 + 0.2 * (1.0 - crate::metrics::ssim(&drawn, &taken));
        assert!((loss(&drawn.pixels, &photograph, None).value - expected).abs() < 1e-12);
    }

    #[test]
    fn a_perfect_picture_is_left_alone() {
        let photograph = photograph();
        let perfect: Vec<[f32; 4]> =
            photograph.pixels.iter().map(|p| p.map(|b| f32::from(b) / 255.0)).collect();
        let Loss { value, gradient } = loss(&perfect, &photograph, None);
        assert!(value.abs() < 1e-6, "{value}");
        assert!(gradient.as_flattened().iter().all(|g| g.abs() < 1e-6));
    }

    #[test]
    fn broken_pixels_make_a_loss_that_says_so() {
        let mut broken = picture();
        broken[3][1] = f64::NAN;
        assert!(loss(&broken, &photograph(), None).value.is_nan());
        let empty = Photograph { width: 0, height: 0, pixels: Vec::new(), seen: Vec::new() };
        assert_eq!(loss::<f32>(&[], &empty, None).gradient, Vec::<[f32; 4]>::new());
    }
}
