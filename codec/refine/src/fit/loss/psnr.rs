//! [`subject_psnr`]: the measure of a fit while it runs.

use crate::fit::views::{Photograph, RenderedImage};

/// PSNR in dB over the pixels that show the subject, at most 54; `None` without any.
pub fn subject_psnr(image: &RenderedImage<f32>, photograph: &Photograph) -> Option<f64> {
    let mut squares = 0.0;
    let mut pixels = 0;
    for (i, (rendered, target)) in image.pixels.iter().zip(&photograph.pixels).enumerate() {
        if photograph.is_subject(i) {
            let error = |c: usize| f64::from(rendered[c].clamp(0.0, 1.0)) - f64::from(target[c]) / 255.0;
            squares += (0..3).map(|c| error(c).powi(2)).sum::<f64>();
            pixels += 1;
        }
    }
    // Half a quantisation step is the error of an 8-bit photograph; equal pixels would give infinity.
    let least = 0.25 / (255.0 * 255.0) * (3 * pixels) as f64;
    (pixels > 0).then(|| crate::image::psnr(squares.max(least), pixels))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_subject_counts() {
        let pixels = vec![[0.5, 0.5, 0.5, 1.0], [1.0; 4], [0.0; 4]];
        let image = RenderedImage { width: 3, height: 1, pixels };
        let pixels = vec![[102, 102, 102, 255], [0, 0, 0, 0], [255, 255, 255, 255]];
        let photograph = Photograph { width: 3, height: 1, pixels, valid: vec![true, true, false] };
        // 0.5 against 0.4; masked and invalid pixels do not count.
        let psnr = subject_psnr(&image, &photograph).unwrap();
        assert!((psnr - 20.0).abs() < 1e-6, "{psnr}");
        let empty = Photograph { pixels: vec![[0; 4]; 3], ..photograph };
        assert_eq!(subject_psnr(&image, &empty), None);
    }
}
