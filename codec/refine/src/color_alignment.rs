//! [`align_colors`]: a picture in the colours of its photograph.

use glam::{DMat4, DVec4};

use crate::capture::Photo;
use crate::image::Image;

/// Weight of the identity per pixel: it decides in pictures of one colour.
const RIDGE: f64 = 1e-6;

/// `picture` after the affine transform of its colours that is nearest to the subject of `photo` by least
/// squares; without a subject, as it is.
///
/// A held camera has a response that no fit has learned. The difference that is left is that of what the picture shows,
/// as in the evaluations of RawNeRF (Mildenhall et al. 2022) and gsplat.
///
/// # Panics
/// If the sizes differ.
pub(crate) fn align_colors(picture: &Image, photo: &Photo) -> Image {
    let taken = &photo.image.pixels;
    assert_eq!(picture.pixels.len(), taken.len(), "images of one size");
    let (mut products, mut by_channel) = (DMat4::ZERO, [DVec4::ZERO; 3]);
    let mut pixels = 0.0;
    for (i, (drawn, taken)) in picture.pixels.iter().zip(taken).enumerate() {
        if photo.is_subject(i) {
            let drawn = affine(drawn);
            products += DMat4::from_cols(drawn * drawn.x, drawn * drawn.y, drawn * drawn.z, drawn * drawn.w);
            by_channel.iter_mut().zip(taken).for_each(|(sum, taken)| *sum += drawn * *taken);
            pixels += 1.0;
        }
    }
    if pixels == 0.0 {
        return picture.clone();
    }
    let ridge = RIDGE * pixels;
    let inverse = (products + ridge * DMat4::IDENTITY).inverse();
    let axes = [DVec4::X, DVec4::Y, DVec4::Z];
    let rows: [DVec4; 3] = std::array::from_fn(|c| inverse * (by_channel[c] + ridge * axes[c]));
    let mut aligned = picture.clone();
    for pixel in &mut aligned.pixels {
        let drawn = affine(pixel);
        (0..3).for_each(|c| pixel[c] = rows[c].dot(drawn));
    }
    aligned
}

/// A colour, and 1 for what is added to it.
fn affine([r, g, b, _]: &[f64; 4]) -> DVec4 {
    DVec4::new(*r, *g, *b, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture() -> Image {
        let mut image = Image::new(20, 15);
        for (i, pixel) in image.pixels.iter_mut().enumerate() {
            let [r, g, b] = [0.3, 0.7, 1.9].map(|c: f64| 0.4 + 0.3 * (c * i as f64).sin());
            *pixel = [r, g, b, 1.0];
        }
        image
    }

    fn photo_of(color: impl Fn([f64; 3]) -> [f64; 3]) -> Photo {
        let mut image = picture();
        for pixel in &mut image.pixels {
            let [r, g, b] = color([pixel[0], pixel[1], pixel[2]]);
            *pixel = [r, g, b, 1.0];
        }
        let seen = vec![true; image.pixels.len()];
        Photo { image, seen }
    }

    #[test]
    fn an_affine_difference_is_taken_away() {
        let photo = photo_of(|[r, g, b]| [0.8 * r + 0.1 * g + 0.02, 1.1 * g - 0.01, 0.9 * b + 0.05 * r]);
        let aligned = align_colors(&picture(), &photo);
        let pairs = aligned.pixels.iter().flatten().zip(photo.image.pixels.iter().flatten());
        let worst = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(worst < 1e-4, "{worst}");
    }

    #[test]
    fn a_picture_without_colours_or_without_a_subject_stays() {
        let mut gray = picture();
        gray.pixels.fill([0.5, 0.5, 0.5, 1.0]);
        let photo = photo_of(|_| [0.5, 0.5, 0.5]);
        let aligned = align_colors(&gray, &photo);
        assert!(aligned.pixels.iter().flatten().all(|x| x.is_finite()));
        assert!((aligned.pixels[7][1] - 0.5).abs() < 1e-6, "{:?}", aligned.pixels[7]);
        let mut empty = photo;
        empty.image.pixels.fill([0.0; 4]);
        assert_eq!(align_colors(&picture(), &empty), picture());
    }
}
