//! [`Difference`]: which pixels of a picture differ from the plate, and which of these only lie in a shadow.
//!
//! A shadow multiplies the plate by a factor, so that both its hue and its texture stay. A single pixel knows its hue only,
//! and a grey jacket before a grey wall has the hue of a shadow. So squares of the picture are compared with the plate
//! by the factor that fits best: the square lies in a shadow, or in the open, if the remaining difference is noise, and
//! the factor is one of a shadow. A pixel counts as shaded if it lies in such a square, and by itself has the hue of
//! the plate.

use super::box_mean::{box_mean, radius_of};
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

/// Factors of shadows, and of what the gain leaves in the open. Rooms have light from everywhere, so most shadows are above 0.7.
/// IoU is 0.984 with 0.55, and 0.982 with 0.5, where a grey helmet before a wall twice as bright is taken for a shadow.
const SHADES: [f32; 2] = [0.55, 1.05];

/// How much further a single pixel may go, because of noise.
const SHADE_SLACK: f32 = 0.1;

/// Radii of the squares, 23 and 12 pixels of 1080p, and the variance of the difference that a factor leaves in them, in
/// units of the variance of noise, up to which the difference is noise. Large squares resemble a shadow less often
/// where they show a subject. Small ones fit into the shadows of limbs, and so have to be smoother. IoU of the knights
/// is 0.983 with large squares alone and 0.983 with both; of a figure of 160x120 whose limbs cast shadows, 0.80 and
/// 0.84.
const SQUARES: [(f64, f32); 2] = [(0.016, 1.4), (0.008, 1.2)];

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
    pub(super) fn new(plate: &Plate, picture: &[[u8; 3]], gains: [f64; 3]) -> Difference {
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
        let deviation = |((color, plate), spread): ((&[u8; 3], &[u8; 3]), &f32)| {
            let level = gain * f32::from(plate[c]);
            (f32::from(color[c]) - level) / variance(*spread, level).sqrt()
        };
        let deviations: Vec<f32> =
            picture.iter().zip(&plate.colors).zip(&plate.spread).map(deviation).collect();
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
    fn new(color: [u8; 3], plate: [u8; 3], spread: f32, gains: [f32; 3]) -> Products {
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
    let products = |i: usize| Products::new(picture[i], plate.colors[i], plate.spread[i], gains);
    let mut planes: [Vec<f32>; 3] = std::array::from_fn(|_| Vec::with_capacity(picture.len()));
    for i in 0..picture.len() {
        planes.iter_mut().zip(products(i).0).for_each(|(plane, sum)| plane.push(sum));
    }
    let [large, small] = SQUARES.map(|(part, variance_max)| {
        in_squares(&planes, plate.width, radius_of(picture.len(), part), variance_max)
    });
    let is_shade = |i: usize| (large[i] || small[i]) && products(i).is_shade(SHADE_SLACK, PIXEL_VARIANCE);
    (0..picture.len()).map(is_shade).collect()
}

/// Whether each pixel is in a square that shows the plate, in the open or in a shadow, by planes of [`Products`].
fn in_squares(planes: &[Vec<f32>; 3], width: usize, radius: usize, variance_max: f32) -> Vec<bool> {
    let [plates, both, pictures] = planes.each_ref().map(|plane| box_mean(plane, width, radius));
    let is_shade = |i: usize| Products([plates[i], both[i], pictures[i]]).is_shade(0.0, 3.0 * variance_max);
    let centers: Vec<f32> = (0..plates.len()).map(|i| f32::from(u8::from(is_shade(i)))).collect();
    let shares = box_mean(&centers, width, radius);
    // Running sums leave less than the share of one pixel.
    let least = 0.5 / (2 * radius + 1).pow(2) as f32;
    shares.into_iter().map(|share| share > least).collect()
}
