//! [`Plate`]: what a still camera shows without the subject.

use rayon::prelude::*;

use super::gain::{GAIN_MAX, gains};

/// Standard deviations of noise per median absolute deviation, of a normal distribution.
const DEVIATIONS: f32 = 1.4826;

/// Smallest noise in levels: rounding alone makes 0.3, and the median of a few small integers is often 0.
const SPREAD_MIN: f32 = 1.5;

/// Spread, in units of the median over the picture, beyond which a pixel shows more than the plate and its noise, and so has the
/// mode of its colours for their median; and the spread that it gets.
const SPREAD_MAX: f32 = 2.0;

/// Luma, in standard deviations of noise, that belongs to one mode: two on each side.
const MODE_WIDTH: f32 = 4.0;

/// Noise in levels that is assumed where one picture tells nothing: the noise of a camera indoors, after compression.
const SPREAD_ASSUMED: f32 = 4.0;

/// Colours that a still camera shows without the subject, and how much they vary.
#[derive(Clone, Debug, PartialEq)]
pub struct Plate {
    pub(super) width: usize,
    /// Colours, row by row from the top left.
    pub(super) colors: Vec<[u8; 3]>,
    /// Standard deviation of each pixel's channels, in levels.
    pub(super) spread: Vec<f32>,
}

impl Plate {
    /// The median over time of `pictures`, which have `width` columns and show the same view at times spread over the
    /// clip, after exposures are made equal; the spread is the median absolute deviation from it. The median of an even
    /// number is the darker of the two in the middle. Where pictures differ by more than noise, their mode takes its place, so
    /// that a subject that keeps its place, but moves, does not become part of the plate; it does where it is of one colour for
    /// longer than the background. One picture is the plate itself, with an assumed spread.
    ///
    /// # Panics
    /// If there is no picture, or sizes differ or are no whole rows.
    pub fn from_pictures(pictures: &[impl AsRef<[[u8; 3]]>], width: usize) -> Plate {
        let pictures: Vec<&[[u8; 3]]> = pictures.iter().map(AsRef::as_ref).collect();
        let len = pictures[0].len();
        assert!(pictures.iter().all(|picture| picture.len() == len), "pictures of one size");
        assert!(len.is_multiple_of(width.max(1)), "whole rows");
        if let [picture] = *pictures {
            return Plate { width, colors: picture.to_vec(), spread: vec![SPREAD_ASSUMED; len] };
        }
        let tables = tables(&pictures);
        let mut plate = Plate { width, colors: vec![[0; 3]; len], spread: vec![0.0; len] };
        plate.each_pixel(|i, color, spread| {
            let mut deviations = 0.0;
            for (c, color) in color.iter_mut().enumerate() {
                let levels = pictures.iter().zip(&tables);
                let mut samples: Vec<f32> =
                    levels.map(|(picture, table)| table[c][usize::from(picture[i][c])]).collect();
                let middle = median(&mut samples);
                *color = middle.round() as u8;
                samples.iter_mut().for_each(|level| *level = (*level - middle).abs());
                deviations += median(&mut samples) / 3.0;
            }
            *spread = (DEVIATIONS * deviations).max(SPREAD_MIN);
        });
        let noise = if len == 0 { SPREAD_MIN } else { median(&mut plate.spread.clone()) };
        plate.each_pixel(|i, color, spread| {
            if *spread > SPREAD_MAX * noise {
                let sample = |(picture, table): (&&[[u8; 3]], &[Vec<f32>; 3])| {
                    std::array::from_fn(|c| table[c][usize::from(picture[i][c])])
                };
                *color = mode(pictures.iter().zip(&tables).map(sample).collect(), MODE_WIDTH * noise);
                *spread = SPREAD_MAX * noise;
            }
        });
        plate
    }

    /// A plate with these colours and standard deviations of their channels in levels, row by row of `width`.
    ///
    /// # Panics
    /// If there are not as many of both, or no whole rows.
    pub fn with_spread(width: usize, colors: Vec<[u8; 3]>, spread: Vec<f32>) -> Plate {
        assert!(colors.len() == spread.len() && colors.len().is_multiple_of(width.max(1)), "whole rows");
        Plate { width, colors, spread: spread.into_iter().map(|spread| spread.max(SPREAD_MIN)).collect() }
    }

    /// Standard deviations of the channels in levels, row by row.
    pub fn spread(&self) -> &[f32] {
        &self.spread
    }

    /// Calls `with` for the number, colour and spread of each pixel, rows in parallel.
    fn each_pixel(&mut self, with: impl Fn(usize, &mut [u8; 3], &mut f32) + Sync) {
        let width = self.width.max(1);
        let rows = self.colors.par_chunks_mut(width).zip(self.spread.par_chunks_mut(width)).enumerate();
        rows.for_each(|(y, (colors, spread))| {
            for (x, (color, spread)) in colors.iter_mut().zip(spread).enumerate() {
                with(y * width + x, color, spread);
            }
        });
    }

    /// The colours, row by row from the top left.
    pub fn colors(&self) -> &[[u8; 3]] {
        &self.colors
    }

    /// Factors by which `picture` is brighter than the plate, in red, green and blue: the median over the picture, so the
    /// subject hardly counts.
    ///
    /// # Panics
    /// If the size differs.
    pub fn gains(&self, picture: &[[u8; 3]]) -> [f64; 3] {
        assert_eq!(picture.len(), self.colors.len(), "a picture of the plate's size");
        gains(picture, &self.colors)
    }

    /// The same, cut to the factors that mattes make up for: [`GAIN_MAX`] and its inverse.
    ///
    /// # Panics
    /// If the size differs.
    pub fn bounded_gains(&self, picture: &[[u8; 3]]) -> [f64; 3] {
        self.gains(picture).map(|gain| gain.clamp(1.0 / GAIN_MAX, GAIN_MAX))
    }
}

/// Levels of the channels of each picture at the median exposure of all.
fn tables(pictures: &[&[[u8; 3]]]) -> Vec<[Vec<f32>; 3]> {
    let first = pictures[0];
    let gains: Vec<[f64; 3]> = pictures.par_iter().map(|picture| gains(picture, first)).collect();
    let middle: [f32; 3] =
        std::array::from_fn(|c| median(&mut gains.iter().map(|gain| gain[c] as f32).collect::<Vec<_>>()));
    let table = |gain: f64, middle: f32| {
        let factor = middle / gain as f32;
        (0..256).map(|level| (level as f32 * factor).min(255.0)).collect()
    };
    gains.into_iter().map(|gain| std::array::from_fn(|c| table(gain[c], middle[c]))).collect()
}

/// The commonest of colours: the median of the colours in the range of luma of this width that has most of them; the
/// darker of two.
fn mode(mut samples: Vec<[f32; 3]>, width: f32) -> [u8; 3] {
    let luma = |[r, g, b]: &[f32; 3]| 0.25 * r + 0.5 * g + 0.25 * b;
    samples.sort_by(|a, b| luma(a).total_cmp(&luma(b)));
    let mut most = 0..0;
    let mut first = 0;
    for last in 0..samples.len() {
        while luma(&samples[last]) - luma(&samples[first]) > width {
            first += 1;
        }
        if last + 1 - first > most.len() {
            most = first..last + 1;
        }
    }
    std::array::from_fn(|c| {
        let mut levels: Vec<f32> = samples[most.clone()].iter().map(|sample| sample[c]).collect();
        median(&mut levels).round() as u8
    })
}

/// Median of numbers, the lower of two.
fn median(values: &mut [f32]) -> f32 {
    let half = (values.len() - 1) / 2;
    *values.select_nth_unstable_by(half, f32::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_there_most_of_the_time_is_the_plate() {
        let shown = |time: usize| -> Vec<[u8; 3]> {
            (0..64).map(|i| if i / 8 == time { [250, 10, 10] } else { [i as u8 + 60, 90, 120] }).collect()
        };
        let pictures: Vec<Vec<[u8; 3]>> = (0..5).map(shown).collect();
        let plate = Plate::from_pictures(&pictures, 8);
        assert!(plate.colors.iter().enumerate().all(|(i, color)| *color == [i as u8 + 60, 90, 120]));
        assert!(plate.spread.iter().all(|spread| *spread == SPREAD_MIN));
    }

    #[test]
    fn what_moves_on_the_spot_is_not_the_plate() {
        // For two thirds of the time, with another colour each time.
        let shown = |time: usize| -> Vec<[u8; 3]> {
            let subject = [(time * 31 % 200) as u8, (time * 57 % 230) as u8, 80];
            (0..400)
                .map(|i| if i < 40 && !time.is_multiple_of(3) { subject } else { [70, 90, 120] })
                .collect()
        };
        let plate = Plate::from_pictures(&(0..33).map(shown).collect::<Vec<_>>(), 20);
        assert!(plate.colors.iter().all(|color| *color == [70, 90, 120]));
    }

    #[test]
    fn spread_is_that_of_noise_and_not_of_exposure() {
        let mut random = fastrand::Rng::with_seed(3);
        let mut shown = |gain: f64| -> Vec<[u8; 3]> {
            // The sum of 12 uniform numbers has a standard deviation of 1.
            let mut noise = || (0..12).map(|_| random.f64()).sum::<f64>() - 6.0;
            (0..2500)
                .map(|i| [0; 3].map(|_| (gain * (60.0 + (i % 120) as f64) + 3.0 * noise()) as u8))
                .collect()
        };
        let pictures: Vec<Vec<[u8; 3]>> = (0..33).map(|i| shown(1.0 + 0.05 * f64::from(i % 3 - 1))).collect();
        let plate = Plate::from_pictures(&pictures, 50);
        let mean = plate.spread.iter().sum::<f32>() / 2500.0;
        assert!((2.6..3.3).contains(&mean), "{mean}");
        let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        assert_eq!(alone.install(|| Plate::from_pictures(&pictures, 50)), plate);
    }
}
