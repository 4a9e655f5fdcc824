//! Structural similarity (SSIM; Wang et al., "Image quality assessment", 2004) and its gradient.
//!
//! Gaussian window of 11 pixels with a standard deviation of 1.5, zeros beyond the edges as in 3D
//! Gaussian Splatting. The window is separable, so there are three parallel passes over the rows: blur
//! the moments along rows; blur them across rows, compare, and blur the derivatives along rows; blur the
//! derivatives across rows.

use rayon::prelude::*;

use crate::fit::precision::Real;

/// Size and standard deviation of the window in pixels; the constants K1 and K2 squared, for colours of
/// range 1.
const WINDOW: usize = 11;
pub(super) const HALF: usize = WINDOW / 2;
const SIGMA: f64 = 1.5;
const C1: f64 = 0.01 * 0.01;
const C2: f64 = 0.03 * 0.03;

/// Moments per channel: means of both images, of their squares, of their product.
const MOMENTS: usize = 5;
/// Derivatives per channel: with respect to the first mean, the first mean square, the mean product.
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
    let moments = blurred_moments(a, b, width, &window);
    let (sum, derivatives) = compare_rows(&moments, a.len() / width, width, &window);

    let count = (3 * a.len()) as f64;
    let scale = T::from_f64(1.0 / count);
    let mut gradient = vec![[T::zero(); 3]; a.len()];
    gradient.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        let at = blur_across(&derivatives, y, 3 * DERIVATIVES * width, &window);
        for (x, pixel) in row.iter_mut().enumerate() {
            let (a, b) = (a[y * width + x], b[y * width + x]);
            for (c, value) in pixel.iter_mut().enumerate() {
                let by = |i: usize| at[(3 * i + c) * width + x];
                *value = scale * (by(0) + T::from_f64(2.0) * a[c] * by(1) + b[c] * by(2));
            }
        }
    });
    (sum / count, gradient)
}

/// The moments, blurred along rows: `[y][moment][channel][x]`.
fn blurred_moments<T: Real>(a: &[[T; 4]], b: &[[T; 4]], width: usize, window: &[T; WINDOW]) -> Vec<T> {
    let row_length = 3 * MOMENTS * width;
    let mut moments = vec![T::zero(); a.len() / width * row_length];
    moments.par_chunks_mut(row_length).enumerate().for_each(|(y, row)| {
        let (a, b) = (&a[y * width..][..width], &b[y * width..][..width]);
        blur_channels(row, width, window, |c, x| {
            let (a, b) = (a[x][c], b[x][c]);
            [a, b, a * a, b * b, a * b]
        });
    });
    moments
}

/// Sum of the similarities over pixels and channels, and the derivatives, blurred along rows:
/// `[y][derivative][channel][x]`.
fn compare_rows<T: Real>(moments: &[T], height: usize, width: usize, window: &[T; WINDOW]) -> (f64, Vec<T>) {
    let row_length = 3 * DERIVATIVES * width;
    let mut derivatives = vec![T::zero(); height * row_length];
    let rows = derivatives.par_chunks_mut(row_length).enumerate();
    let sums: Vec<f64> = rows
        .map(|(y, row)| {
            let at = blur_across(moments, y, 3 * MOMENTS * width, window);
            let mut sum = 0.0;
            blur_channels(row, width, window, |c, x| {
                let (similarity, by) = compare(std::array::from_fn(|i| at[(3 * i + c) * width + x]));
                sum += similarity.to_double();
                by
            });
            sum
        })
        .collect();
    (sums.iter().sum(), derivatives)
}

/// Blurs `N` quantities per channel along a row, given by `quantities(channel, x)`:
/// `[quantity][channel][x]`.
fn blur_channels<T: Real, const N: usize>(
    row: &mut [T],
    width: usize,
    window: &[T; WINDOW],
    mut quantities: impl FnMut(usize, usize) -> [T; N],
) {
    let mut padded = vec![vec![T::zero(); width + 2 * HALF]; N];
    for c in 0..3 {
        for x in 0..width {
            for (padded, value) in padded.iter_mut().zip(quantities(c, x)) {
                padded[HALF + x] = value;
            }
        }
        for (i, padded) in padded.iter().enumerate() {
            blur_along(padded, window, &mut row[(3 * i + c) * width..][..width]);
        }
    }
}

/// Similarity of two windows by their moments, and its [`DERIVATIVES`].
fn compare<T: Real>([mean_a, mean_b, square_a, square_b, product]: [T; MOMENTS]) -> (T, [T; DERIVATIVES]) {
    let (c1, c2, two) = (T::from_f64(C1), T::from_f64(C2), T::from_f64(2.0));
    let (aa, bb, ab) = (mean_a * mean_a, mean_b * mean_b, mean_a * mean_b);
    let (luminance, structure) = (two * ab + c1, two * (product - ab) + c2);
    let (luminances, structures) = (aa + bb + c1, (square_a - aa) + (square_b - bb) + c2);
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
fn blur_along<T: Real>(padded: &[T], window: &[T; WINDOW], blurred: &mut [T]) {
    blurred.fill(T::zero());
    for (offset, weight) in window.iter().enumerate() {
        add(blurred, &padded[offset..], *weight);
    }
}

/// Row `y`, convolved across rows of `length` numbers.
fn blur_across<T: Real>(rows: &[T], y: usize, length: usize, window: &[T; WINDOW]) -> Vec<T> {
    let mut blurred = vec![T::zero(); length];
    for (row, weight) in
        rows.chunks(length).skip(y.saturating_sub(HALF)).zip(&window[HALF.saturating_sub(y)..])
    {
        add(&mut blurred, row, *weight);
    }
    blurred
}

fn add<T: Real>(sum: &mut [T], values: &[T], weight: T) {
    for (sum, value) in sum.iter_mut().zip(values) {
        *sum += weight * *value;
    }
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
