//! [`respond`]: a rendered image as a camera shows it, and the way back.
//!
//! The image is premultiplied by alpha over black, and so is the result: what a [`Response`] adds to a colour counts by
//! alpha.

use rayon::prelude::*;

use super::numbers::RESPONSE_NUMBERS;
use crate::capture::Response;
use crate::fit::views::RenderedImage;
use crate::raster::Real;

/// Pixels per parallel task.
const CHUNK: usize = 4096;

/// The pixels of `image` as a camera with `response` shows them.
pub(in crate::fit) fn respond<T: Real>(image: &RenderedImage<T>, response: &Response) -> Vec<[T; 4]> {
    let stage = Stage::new(image, response);
    let mut seen = image.pixels.clone();
    seen.par_chunks_mut(CHUNK).enumerate().for_each(|(chunk, pixels)| {
        for (i, pixel) in pixels.iter_mut().enumerate() {
            let [r, g, b] = stage.color(*pixel);
            let factor = stage.factor(stage.square(chunk * CHUNK + i));
            *pixel = [factor * r, factor * g, factor * b, pixel[3]];
        }
    });
    seen
}

/// Turns `d_seen`, the gradient of a loss with respect to what [`respond`] returns, into the gradient with respect to the
/// pixels of `image`. Returns the gradient with respect to the response: its colours row by row, then its vignette. A pixel
/// whose gradient is not finite makes that not finite.
pub(in crate::fit) fn respond_backward<T: Real>(
    image: &RenderedImage<T>,
    response: &Response,
    d_seen: &mut [[T; 4]],
) -> [f64; RESPONSE_NUMBERS] {
    let stage = Stage::new(image, response);
    let chunks = d_seen.par_chunks_mut(CHUNK).zip(image.pixels.par_chunks(CHUNK)).enumerate();
    let sums: Vec<[T; RESPONSE_NUMBERS]> = chunks
        .map(|(chunk, (d_seen, pixels))| {
            let mut sums = [T::zero(); RESPONSE_NUMBERS];
            for (i, (d_pixel, pixel)) in d_seen.iter_mut().zip(pixels).enumerate() {
                let square = stage.square(chunk * CHUNK + i);
                *d_pixel = stage.backward(*pixel, square, *d_pixel, &mut sums);
            }
            sums
        })
        .collect();
    let mut total = [0.0; RESPONSE_NUMBERS];
    for sums in &sums {
        total.iter_mut().zip(sums).for_each(|(total, sum)| *total += sum.to_double());
    }
    total
}

/// A response in the precision of an image, with the size of the image.
struct Stage<T> {
    color: [[T; 4]; 3],
    vignette: T,
    width: usize,
    /// Coordinates of the centre, in pixels from the middle of the first one.
    center: [T; 2],
    /// 1 over the square of the distance of a corner from the centre.
    scale: T,
}

impl<T: Real> Stage<T> {
    fn new(image: &RenderedImage<T>, response: &Response) -> Stage<T> {
        let [width, height] = [image.width, image.height].map(f64::from);
        Stage {
            color: response.color.map(|row| row.map(T::from_f64)),
            vignette: T::from_f64(response.vignette),
            width: image.width as usize,
            center: [0.5 * (width - 1.0), 0.5 * (height - 1.0)].map(T::from_f64),
            scale: T::from_f64(4.0 / (width * width + height * height)),
        }
    }

    /// Square of the distance of a pixel from the centre, 1 in the corners.
    fn square(&self, pixel: usize) -> T {
        let x = T::from_f64((pixel % self.width) as f64) - self.center[0];
        let y = T::from_f64((pixel / self.width) as f64) - self.center[1];
        (x * x + y * y) * self.scale
    }

    /// Factor of the vignette.
    fn factor(&self, square: T) -> T {
        T::one() + square * self.vignette
    }

    /// The colour without the vignette.
    fn color(&self, [r, g, b, alpha]: [T; 4]) -> [T; 3] {
        self.color.map(|[by_r, by_g, by_b, added]| by_r * r + by_g * g + by_b * b + added * alpha)
    }

    /// The gradient with respect to a pixel; adds the gradient with respect to the response to `sums`.
    fn backward(&self, pixel: [T; 4], square: T, d_seen: [T; 4], sums: &mut [T; RESPONSE_NUMBERS]) -> [T; 4] {
        let factor = self.factor(square);
        let color = self.color(pixel);
        let mut d_pixel = [T::zero(), T::zero(), T::zero(), d_seen[3]];
        let mut d_factor = T::zero();
        for channel in 0..3 {
            let d_color = factor * d_seen[channel];
            for (k, by) in self.color[channel].iter().enumerate() {
                d_pixel[k] += d_color * *by;
                sums[4 * channel + k] += d_color * pixel[k];
            }
            d_factor += d_seen[channel] * color[channel];
        }
        sums[12] += d_factor * square;
        d_pixel
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::fixtures::weights;

    const RESPONSE: Response = Response {
        color: [[0.9, 0.05, -0.02, 0.03], [0.01, 1.1, 0.04, -0.02], [-0.03, 0.02, 0.8, 0.05]],
        vignette: -0.3,
    };

    fn image(width: u32, height: u32) -> RenderedImage<f64> {
        let pixel = |i: u32| [0.3, 0.9, 2.0, 3.0].map(|c: f64| 0.5 + 0.4 * (c * f64::from(i)).sin());
        RenderedImage { width, height, pixels: (0..width * height).map(pixel).collect() }
    }

    #[test]
    fn a_neutral_response_changes_nothing() {
        let image = image(7, 5);
        assert_eq!(respond(&image, &Response::NEUTRAL), image.pixels);
    }

    #[test]
    fn corners_have_the_whole_vignette_and_black_stays_black() {
        let mut image = image(301, 201);
        let bright = Response { vignette: -0.25, ..Response::NEUTRAL };
        let (seen, last) = (respond(&image, &bright), image.pixels.len() - 1);
        let ratio = |pixel: usize| seen[pixel][1] / image.pixels[pixel][1];
        assert!((ratio(last) - 0.75).abs() < 0.01 && (ratio(last / 2) - 1.0).abs() < 1e-9, "{}", ratio(last));
        image.pixels.fill([0.0; 4]);
        assert_eq!(respond(&image, &RESPONSE), image.pixels);
    }

    #[test]
    fn gradients_match_finite_differences() {
        let image = image(90, 61);
        let weights: Vec<[f64; 4]> = weights(image.pixels.len());
        let loss = |image: &RenderedImage<f64>, response: &Response| -> f64 {
            let seen = respond(image, response);
            seen.iter().flatten().zip(weights.iter().flatten()).map(|(a, b)| a * b).sum()
        };
        let mut d_image = weights.clone();
        let by_response = respond_backward(&image, &RESPONSE, &mut d_image);
        let step = 1e-5;
        for (pixel, channel) in [(0, 0), (47, 1), (2045, 2), (5400, 3)] {
            let at = |offset: f64| {
                let mut moved = image.clone();
                moved.pixels[pixel][channel] += offset;
                loss(&moved, &RESPONSE)
            };
            let expected = (at(step) - at(-step)) / (2.0 * step);
            let found = d_image[pixel][channel];
            assert!((found - expected).abs() < 1e-6, "{pixel} {channel}: {found} for {expected}");
        }
        for (number, found) in by_response.into_iter().enumerate() {
            let at = |offset: f64| {
                let mut moved = RESPONSE;
                match number {
                    0..12 => moved.color[number / 4][number % 4] += offset,
                    _ => moved.vignette += offset,
                }
                loss(&image, &moved)
            };
            let expected = (at(step) - at(-step)) / (2.0 * step);
            assert!((found - expected).abs() < 1e-5, "{number}: {found} for {expected}");
        }
    }
}
