//! [`TemporalMedian`]: what a camera shows most of the time.

use crate::capture::Photo;

/// Levels of 255 by which a channel must differ from its median over time to be moving: several times the noise of a
/// camera indoors.
const MOVING: f32 = 25.0;

/// What a camera shows most of the time: the median over its photographs of each channel of each pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct TemporalMedian {
    /// Levels from 0 to 255, three a pixel. That of an even number of photographs is the mean of the two in the middle.
    levels: Vec<f32>,
}

impl TemporalMedian {
    /// The median of pictures in 8 bits, three bytes a pixel; `None` for fewer than two, in which nothing moves.
    ///
    /// # Panics
    /// If sizes differ.
    pub fn from_pictures(pictures: &[Vec<u8>]) -> Option<TemporalMedian> {
        let [first, _, ..] = pictures else { return None };
        assert!(pictures.iter().all(|picture| picture.len() == first.len()), "pictures of one size");
        let half = pictures.len() / 2;
        let mut samples = vec![0; pictures.len()];
        let level = |i: usize| {
            samples.iter_mut().zip(pictures).for_each(|(sample, picture)| *sample = picture[i]);
            let (below, upper, _) = samples.select_nth_unstable(half);
            let lower = match pictures.len().is_multiple_of(2) {
                true => *below.iter().max().expect("half of at least two"),
                false => *upper,
            };
            0.5 * (f32::from(lower) + f32::from(*upper))
        };
        Some(TemporalMedian { levels: (0..first.len()).map(level).collect() })
    }

    /// Whether each pixel of a photograph is valid and moves: any of its channels differs from the median by more than 25 of
    /// 255 levels.
    ///
    /// # Panics
    /// If the size differs.
    pub fn moving(&self, photo: &Photo) -> Vec<bool> {
        let levels = photo.image.to_rgb8();
        assert_eq!(levels.len(), self.levels.len(), "a photograph of the median's size");
        let differs = |(level, median): (&u8, &f32)| (f32::from(*level) - median).abs() > MOVING;
        let pixels = levels.chunks(3).zip(self.levels.chunks(3)).zip(&photo.seen);
        pixels.map(|((levels, medians), seen)| *seen && levels.iter().zip(medians).any(differs)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Image;

    /// A photograph of gray levels.
    fn photo(levels: &[u8]) -> Photo {
        let pixel = |level: &u8| [f64::from(*level) / 255.0; 3];
        let pixels = levels.iter().map(pixel).map(|[r, g, b]| [r, g, b, 1.0]).collect();
        let image = Image { width: levels.len() as u32, height: 1, pixels };
        Photo { image, seen: vec![true; levels.len()] }
    }

    fn median_of(photos: &[Photo]) -> Option<TemporalMedian> {
        TemporalMedian::from_pictures(&photos.iter().map(|photo| photo.image.to_rgb8()).collect::<Vec<_>>())
    }

    #[test]
    fn what_leaves_the_median_moves() {
        let mut photos = [[100, 10, 0], [100, 200, 25], [125, 10, 26]].map(|levels| photo(&levels));
        let median = median_of(&photos).unwrap();
        assert_eq!(median.levels, [100.0, 100.0, 100.0, 10.0, 10.0, 10.0, 25.0, 25.0, 25.0]);
        let moving = |photo: &Photo| median.moving(photo);
        // A difference of 25 is not enough.
        assert_eq!(moving(&photos[0]), [false, false, false]);
        assert_eq!(moving(&photos[1]), [false, true, false]);
        photos[2].image.pixels[0][1] = 126.0 / 255.0;
        assert_eq!(moving(&photos[2]), [true, false, false], "one channel is enough");
        photos[2].seen[0] = false;
        assert_eq!(moving(&photos[2]), [false, false, false]);
    }

    #[test]
    fn two_photographs_share_their_median_and_one_has_none() {
        let photos = [photo(&[10, 0]), photo(&[70, 20])];
        let median = median_of(&photos).unwrap();
        assert_eq!(photos.each_ref().map(|photo| median.moving(photo)), [[true, false]; 2]);
        assert_eq!(median_of(&photos[..1]), None);
        assert_eq!(median_of(&[]), None);
    }
}
