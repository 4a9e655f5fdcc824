//! Structural similarity (SSIM; Wang et al., "Image quality assessment", 2004) and its gradient.
//!
//! Gaussian window of 11 pixels with a standard deviation of 1.5, zeros beyond the edges as in 3D
//! Gaussian Splatting. The window is separable, so there are three parallel passes over the rows: blur
//! the moments along rows; blur them across rows, compare, and blur the derivatives along rows; blur the
//! derivatives across rows.

use pulp::{Arch, NullaryFnOnce};
use rayon::prelude::*;

use crate::raster::Real;

/// Size and standard deviation of the window in pixels; the constants K1 and K2 squared, for colours of
/// range 1.
const WINDOW: usize = 11;
pub(super) const HALF: usize = WINDOW / 2;
const SIGMA: f64 = 1.5;
const C1: f64 = 0.01 * 0.01;
const C2: f64 = 0.03 * 0.03;

/// Moments per channel: means of both images, of the sum of their squares, of their product.
const MOMENTS: usize = 4;
/// Derivatives per channel: with respect to the first mean, the mean sum of squares, the mean product.
const DERIVATIVES: usize = 3;

/// Mean structural similarity of the colours of two images, over all pixels and three channels, and its
/// gradient with respect to the colours of the first.
///
/// # Panics
/// If the sizes differ or are no multiple of `width` pixels.
pub(crate) fn ssim_and_gradient<T: Real>(a: &[[T; 4]], b: &[[T; 4]], width: usize) -> (f64, Vec<[T; 3]>) {
    assert!(a.len() == b.len() && a.len().is_multiple_of(width.max(1)), "images of one size");
    if a.is_empty() {
        return (1.0, Vec::new());
    }
    let window = window::<T>();
    let arch = Arch::new();
    let moments_length = 3 * MOMENTS * width;
    let mut moments = vec![T::zero(); a.len() / width * moments_length];
    moments.par_chunks_mut(moments_length).enumerate().for_each(|(y, row)| {
        let (a, b) = (&a[y * width..][..width], &b[y * width..][..width]);
        arch.dispatch(MomentRow { a, b, window: &window, row });
    });

    let derivatives_length = 3 * DERIVATIVES * width;
    let mut derivatives = vec![T::zero(); a.len() / width * derivatives_length];
    let rows = derivatives.par_chunks_mut(derivatives_length).enumerate();
    let moments = &moments[..];
    let compare = |(y, row)| arch.dispatch(CompareRow { moments, y, width, window: &window, row });
    let sums: Vec<f64> = rows.map(compare).collect();

    let count = (3 * a.len()) as f64;
    let scale = T::from_f64(1.0 / count);
    let mut gradient = vec![[T::zero(); 3]; a.len()];
    gradient.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        let (a, b) = (&a[y * width..][..width], &b[y * width..][..width]);
        arch.dispatch(GradientRow { derivatives: &derivatives, y, a, b, scale, window: &window, row });
    });
    (sums.iter().sum::<f64>() / count, gradient)
}

/// The moments of a row, blurred along it: `[moment][channel][x]`.
struct MomentRow<'a, T> {
    a: &'a [[T; 4]],
    b: &'a [[T; 4]],
    window: &'a [T; WINDOW],
    row: &'a mut [T],
}

impl<T: Real> NullaryFnOnce for MomentRow<'_, T> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let MomentRow { a, b, window, row } = self;
        let width = a.len();
        let [mut channels_a, mut channels_b] = [vec![T::zero(); 3 * width], vec![T::zero(); 3 * width]];
        split_channels(a, &mut channels_a);
        split_channels(b, &mut channels_b);
        let mut padded = vec![T::zero(); width + 2 * HALF];
        for c in 0..3 {
            let (a, b) = (&channels_a[c * width..][..width], &channels_b[c * width..][..width]);
            for moment in 0..MOMENTS {
                let inner = &mut padded[HALF..][..width];
                for x in 0..width {
                    inner[x] = match moment {
                        0 => a[x],
                        1 => b[x],
                        2 => a[x] * a[x] + b[x] * b[x],
                        _ => a[x] * b[x],
                    };
                }
                blur_along(&padded, window, &mut row[(3 * moment + c) * width..][..width]);
            }
        }
    }
}

/// Copies the colours of pixels to `[channel][x]`.
#[inline(always)]
fn split_channels<T: Real>(pixels: &[[T; 4]], channels: &mut [T]) {
    let (red, rest) = channels.split_at_mut(pixels.len());
    let (green, blue) = rest.split_at_mut(pixels.len());
    for (x, pixel) in pixels.iter().enumerate() {
        red[x] = pixel[0];
        green[x] = pixel[1];
        blue[x] = pixel[2];
    }
}

/// The derivatives of a row, blurred along it: `[derivative][channel][x]`.
struct CompareRow<'a, T> {
    /// Those of all rows.
    moments: &'a [T],
    y: usize,
    width: usize,
    window: &'a [T; WINDOW],
    row: &'a mut [T],
}

impl<T: Real> NullaryFnOnce for CompareRow<'_, T> {
    /// Sum of the similarities over pixels and channels.
    type Output = f64;

    #[inline(always)]
    fn call(self) -> f64 {
        let CompareRow { moments, y, width, window, row } = self;
        let at = blur_across(moments, y, 3 * MOMENTS * width, window);
        let mut similarities = vec![T::zero(); width];
        let mut padded = vec![T::zero(); DERIVATIVES * (width + 2 * HALF)];
        let mut sum = 0.0;
        for c in 0..3 {
            let [mean_a, mean_b, squares, product] =
                [0, 1, 2, 3].map(|moment| &at[(3 * moment + c) * width..][..width]);
            let (by_mean, rest) = padded.split_at_mut(width + 2 * HALF);
            let (by_square, by_product) = rest.split_at_mut(width + 2 * HALF);
            let [inner_mean, inner_square, inner_product] =
                [&mut *by_mean, &mut *by_square, &mut *by_product].map(|padded| &mut padded[HALF..][..width]);
            for x in 0..width {
                let (similarity, by) = compare([mean_a[x], mean_b[x], squares[x], product[x]]);
                similarities[x] = similarity;
                [inner_mean[x], inner_square[x], inner_product[x]] = by;
            }
            for similarity in &similarities {
                sum += similarity.to_double();
            }
            blur_along(by_mean, window, &mut row[c * width..][..width]);
            blur_along(by_square, window, &mut row[(3 + c) * width..][..width]);
            blur_along(by_product, window, &mut row[(6 + c) * width..][..width]);
        }
        sum
    }
}

/// The gradient of a row.
struct GradientRow<'a, T> {
    /// Those of all rows.
    derivatives: &'a [T],
    y: usize,
    a: &'a [[T; 4]],
    b: &'a [[T; 4]],
    scale: T,
    window: &'a [T; WINDOW],
    row: &'a mut [[T; 3]],
}

impl<T: Real> NullaryFnOnce for GradientRow<'_, T> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let GradientRow { derivatives, y, a, b, scale, window, row } = self;
        let width = row.len();
        let at = blur_across(derivatives, y, 3 * DERIVATIVES * width, window);
        let two = T::from_f64(2.0);
        let [of_mean, of_square, of_product] = [0, 1, 2].map(|i| &at[3 * i * width..][..3 * width]);
        for x in 0..width {
            for c in 0..3 {
                let i = c * width + x;
                row[x][c] = scale * (of_mean[i] + two * a[x][c] * of_square[i] + b[x][c] * of_product[i]);
            }
        }
    }
}

/// Similarity of two windows by their moments, and its [`DERIVATIVES`].
#[inline(always)]
fn compare<T: Real>([mean_a, mean_b, squares, product]: [T; MOMENTS]) -> (T, [T; DERIVATIVES]) {
    let (c1, c2, two) = (T::from_f64(C1), T::from_f64(C2), T::from_f64(2.0));
    let (aa, bb, ab) = (mean_a * mean_a, mean_b * mean_b, mean_a * mean_b);
    let (luminance, structure) = (two * ab + c1, two * (product - ab) + c2);
    let (luminances, structures) = (aa + bb + c1, (squares - (aa + bb)) + c2);
    let scale = T::one() / (luminances * structures);
    let similarity = luminance * structure * scale;
    let by_mean = two * mean_b * (structure - luminance) * scale
        - two * mean_a * similarity * (T::one() / luminances - T::one() / structures);
    (similarity, [by_mean, -similarity / structures, two * luminance * scale])
}

/// The normalised Gaussian window.
fn window<T: Real>() -> [T; WINDOW] {
    let weight = |i: usize| libm::exp(-0.5 * ((i as f64 - HALF as f64) / SIGMA).powi(2));
    let sum: f64 = (0..WINDOW).map(weight).sum();
    std::array::from_fn(|i| T::from_f64(weight(i) / sum))
}

/// Convolves a row that has `HALF` zeros at either end.
#[inline(always)]
fn blur_along<T: Real>(padded: &[T], window: &[T; WINDOW], blurred: &mut [T]) {
    for (blurred, values) in blurred.iter_mut().zip(padded.array_windows::<WINDOW>()) {
        let mut sum = T::zero();
        for i in 0..WINDOW {
            sum += window[i] * values[i];
        }
        *blurred = sum;
    }
}

/// Numbers that are summed in registers.
const LANES: usize = 32;

/// Row `y`, convolved across rows of `length` numbers.
#[inline(always)]
fn blur_across<T: Real>(rows: &[T], y: usize, length: usize, window: &[T; WINDOW]) -> Vec<T> {
    let first = y.saturating_sub(HALF);
    let rows = &rows[first * length..rows.len().min((y + HALF + 1) * length)];
    let window = &window[HALF.saturating_sub(y)..];
    let mut blurred = vec![T::zero(); length];
    let (chunks, rest) = blurred.as_chunks_mut::<LANES>();
    for (chunk, sums) in chunks.iter_mut().enumerate() {
        let mut kept = [T::zero(); LANES];
        for (row, weight) in rows.chunks_exact(length).zip(window) {
            let values: &[T; LANES] = row[chunk * LANES..][..LANES].try_into().expect("as many");
            for x in 0..LANES {
                kept[x] += *weight * values[x];
            }
        }
        *sums = kept;
    }
    let start = length - rest.len();
    for (row, weight) in rows.chunks_exact(length).zip(window) {
        for (sum, value) in rest.iter_mut().zip(&row[start..]) {
            *sum += *weight * *value;
        }
    }
    blurred
}

#[cfg(test)]
mod tests {
    use super::*;

    fn waves(phase: f64) -> Vec<[f64; 4]> {
        let wave = |i: usize, c: f64| 0.5 + 0.4 * (0.7 * (i % 9) as f64 + c * (i / 9) as f64 + phase).sin();
        (0..9 * 13).map(|i| [wave(i, 0.3), wave(i, -0.9), wave(i, 2.0), 1.0]).collect()
    }

    #[test]
    fn the_gradient_matches_finite_differences() {
        let (a, b) = (waves(0.0), waves(0.4));
        let (_, gradient) = ssim_and_gradient(&a, &b, 9);
        // Corners, edges and the middle.
        for pixel in [0, 8, 40, 58, 108, 116] {
            for c in 0..3 {
                let moved = |by: f64| {
                    let mut moved = a.clone();
                    moved[pixel][c] += by;
                    ssim_and_gradient(&moved, &b, 9).0
                };
                let expected = (moved(1e-6) - moved(-1e-6)) / 2e-6;
                let found = gradient[pixel][c];
                assert!((found - expected).abs() < 1e-9, "{pixel} {c}: {found} {expected}");
            }
        }
    }

    #[test]
    fn equal_images_have_no_gradient() {
        let (value, gradient) = ssim_and_gradient(&waves(0.0), &waves(0.0), 9);
        assert!((value - 1.0).abs() < 1e-12);
        assert!(gradient.as_flattened().iter().all(|g| g.abs() < 1e-12));
    }

    #[test]
    fn single_precision_is_enough() {
        let single = |image: Vec<[f64; 4]>| image.iter().map(|p| p.map(|c| c as f32)).collect::<Vec<_>>();
        let (exact, exact_gradient) = ssim_and_gradient(&waves(0.0), &waves(0.4), 9);
        let (value, gradient) = ssim_and_gradient(&single(waves(0.0)), &single(waves(0.4)), 9);
        assert!((value - exact).abs() < 1e-5);
        let largest = exact_gradient.as_flattened().iter().fold(0.0, |m: f64, g| m.max(g.abs()));
        for (a, b) in gradient.as_flattened().iter().zip(exact_gradient.as_flattened()) {
            assert!((f64::from(*a) - b).abs() < 1e-4 * largest);
        }
    }

    #[test]
    fn images_smaller_than_the_window() {
        let (value, gradient) = ssim_and_gradient(&[[0.2, 0.4, 0.6, 1.0]], &[[0.3, 0.4, 0.5, 1.0]], 1);
        assert!(value < 1.0 && gradient.len() == 1);
        assert_eq!(ssim_and_gradient::<f32>(&[], &[], 0).0, 1.0);
    }
}
