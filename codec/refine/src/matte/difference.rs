//! [`Difference`]: which pixels of a picture differ from the plate, and which of these only lie in a shadow.
//!
//! A shadow multiplies the plate by a factor, so that both its hue and its texture stay. A single pixel knows its hue only,
//! and a grey jacket before a grey wall has that of a shadow. So squares of the picture are compared with the plate by the
//! factor that fits best: the square lies in a shadow, or in the open, if what is left is noise, and the factor is one of
//! a shadow. A pixel counts as shaded if it lies in such a square, and by itself has the hue of the plate.

use super::box_mean::box_mean;
use super::part_of;
use super::plate::Plate;

/// Deviation that is never the subject, as a part of the plate's level, besides noise: of flicker and of reflected light.
/// IoU without real shadows is highest from 0.010 to 0.020.
const TOLERANCE: f32 = 0.015;

/// Standard deviations of the mean of 3x3 pixels from which on a pixel may be the subject, and from which on it is.
/// Compression makes neighbours differ together, else a third would do.
const LIKELY: f32 = 2.5;
const SURE: f32 = 7.0;

/// Radius of means in pixels; IoU 0.973 with 0, 0.977 with 1.
const MEAN_RADIUS: usize = 1;

/// Factors of shadows, and of what the gain leaves in the open. Rooms have light from everywhere: 0.7 is a dark shadow.
const SHADES: [f32; 2] = [0.6, 1.05];

/// How much further a single pixel may go, because of noise.
const SHADE_SLACK: f32 = 0.1;

/// Radius of the squares: 23 pixels of 1080p. The larger, the less of the subject resembles a shadow; the
/// smaller, the more shadows are found that reach between legs. IoU 0.969 with 0.006, 0.973 with 0.016.
const SQUARE_RADIUS: f64 = 0.016;

/// Variance of what a factor leaves in a square, in units of that of noise, up to which it is noise. Texture of 0.6
/// standard deviations of noise is enough to tell a subject.
const SQUARE_VARIANCE: f32 = 1.4;

/// Squared deviation of a pixel's colour from the plate's hue, in units of noise, up to which it has that hue: 3 standard
/// deviations.
const PIXEL_VARIANCE: f32 = 9.0;

/// Pixels that differ.
pub(super) struct Difference {
    /// Those that may be the subject: they differ, and are no shadow.
    pub(super) likely: Vec<bool>,
    /// Those of them that are.
    pub(super) sure: Vec<bool>,
    /// Those that differ and look like a shadow.
    pub(super) shaded: Vec<bool>,
}

impl Difference {
    /// Compares `picture` with `plate`, which it shows brighter by `gains`.
    pub(super) fn of(plate: &Plate, picture: &[[u8; 3]], gains: [f64; 3]) -> Difference {
        let gains = gains.map(|gain| gain as f32);
        let strengths = strengths(plate, picture, gains);
        let is_shade = shades(plate, picture, gains);
        let differs = |limit: f32, shade: bool| -> Vec<bool> {
            let pixels = strengths.iter().zip(&is_shade);
            pixels.map(|(strength, is_shade)| *strength > limit * limit && *is_shade == shade).collect()
        };
        Difference {
            likely: differs(LIKELY, false),
            sure: differs(SURE, false),
            shaded: differs(LIKELY, true),
        }
    }
}

/// Variance of a channel in a pixel of the plate at this level.
fn variance(spread: f32, level: f32) -> f32 {
    spread * spread + TOLERANCE * TOLERANCE * level * level
}

/// Squared mean deviations around each pixel, in units of noise, summed over channels.
fn strengths(plate: &Plate, picture: &[[u8; 3]], gains: [f32; 3]) -> Vec<f32> {
    let mut strengths = vec![0.0; picture.len()];
    for (c, gain) in gains.into_iter().enumerate() {
        let of = |((color, plate), spread): ((&[u8; 3], &[u8; 3]), &f32)| {
            let level = gain * f32::from(plate[c]);
            (f32::from(color[c]) - level) / variance(*spread, level).sqrt()
        };
        let deviations: Vec<f32> = picture.iter().zip(&plate.colors).zip(&plate.spread).map(of).collect();
        let means = box_mean(&deviations, plate.width, MEAN_RADIUS);
        strengths.iter_mut().zip(means).for_each(|(strength, mean)| *strength += mean * mean);
    }
    strengths
}

/// Sums of products of a picture and its plate, weighted by the inverse of the noise: plate and plate, picture and plate,
/// picture and picture.
#[derive(Clone, Copy)]
struct Products([f32; 3]);

impl Products {
    fn of(color: [u8; 3], plate: [u8; 3], spread: f32, gains: [f32; 3]) -> Products {
        let mut sums = [0.0; 3];
        for c in 0..3 {
            let (shown, level) = (f32::from(color[c]), gains[c] * f32::from(plate[c]));
            let weight = 1.0 / variance(spread, level);
            sums[0] += weight * level * level;
            sums[1] += weight * shown * level;
            sums[2] += weight * shown * shown;
        }
        Products(sums)
    }

    /// Whether the plate times a factor of a shadow, with some slack, leaves at most this variance.
    fn is_shade(self, slack: f32, left_max: f32) -> bool {
        let Products([plate, both, picture]) = self;
        // A black plate has any factor.
        let factor = if plate > 0.0 { both / plate } else { 1.0 };
        let [low, high] = SHADES;
        (low * (1.0 - slack)..=high * (1.0 + slack)).contains(&factor) && picture - factor * both <= left_max
    }
}

/// Whether each pixel shows the plate, in the open or in a shadow.
fn shades(plate: &Plate, picture: &[[u8; 3]], gains: [f32; 3]) -> Vec<bool> {
    let width = plate.width;
    let radius = part_of(picture.len(), SQUARE_RADIUS);
    let products = |i: usize| Products::of(picture[i], plate.colors[i], plate.spread[i], gains);
    let mut planes: [Vec<f32>; 3] = std::array::from_fn(|_| Vec::with_capacity(picture.len()));
    for i in 0..picture.len() {
        planes.iter_mut().zip(products(i).0).for_each(|(plane, sum)| plane.push(sum));
    }
    let [plates, both, pictures] = planes.map(|plane| box_mean(&plane, width, radius));
    let is_square =
        |i: usize| Products([plates[i], both[i], pictures[i]]).is_shade(0.0, 3.0 * SQUARE_VARIANCE);
    let squares: Vec<f32> = (0..picture.len()).map(|i| f32::from(u8::from(is_square(i)))).collect();
    // Above 0 in the squares around these.
    let covered = box_mean(&squares, width, radius);
    // Running sums leave less than the share of one pixel.
    let least = 0.5 / (2 * radius + 1).pow(2) as f32;
    let of = |i: usize| covered[i] > least && products(i).is_shade(SHADE_SLACK, PIXEL_VARIANCE);
    (0..picture.len()).map(of).collect()
}
