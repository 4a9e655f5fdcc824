//! [`Texture`]: procedural colours in the axes of a part, so that they move with the part.
//!
//! Every texture has noise over its pattern: no two points look alike, which matching between cameras needs.

use glam::{DVec3, dvec3};

/// Red, green, blue from 0 to 1, as displayed.
type Color = [f64; 3];

/// Colours as a function of the point in the part's own axes, in metres.
#[derive(Clone, Copy, Debug)]
pub(super) enum Texture {
    /// Cubes with this side, in alternating colours.
    Checks { side: f64, colors: [Color; 2] },
    /// Stripes around the y axis, each this wide.
    Stripes { width: f64, colors: [Color; 2] },
    /// Spots of the second colour on the first, about this wide.
    Spots { width: f64, colors: [Color; 2] },
    /// A head that faces +z: hair, face and eyes.
    Face,
}

/// Wavelength of the noise in metres, and its largest darkening.
const GRAIN: f64 = 0.035;
const GRAIN_DEPTH: f64 = 0.4;

const SKIN: Color = [0.87, 0.64, 0.50];
const HAIR: Color = [0.30, 0.16, 0.08];
const EYE: Color = [0.08, 0.10, 0.20];

impl Texture {
    /// The colour of the part with index `part` at `point`.
    pub(super) fn color(self, part: usize, point: DVec3) -> Color {
        // Parts with the same texture differ.
        let place = point + dvec3(part as f64 * 7.3, 0.0, 0.0);
        let odd = |number: f64| number.rem_euclid(2.0) as usize;
        let flat = match self {
            Texture::Checks { side, colors } => {
                // Shifted by half a cube, because thin parts lie around the axes.
                let [x, y, z] = (point / side + 0.5).floor().to_array();
                colors[odd(x + y + z)]
            }
            Texture::Stripes { width, colors } => colors[odd((point.y / width).floor())],
            Texture::Spots { width, colors } => colors[usize::from(noise(place / width) > 0.55)],
            Texture::Face => face(point),
        };
        let shade = 1.0 - GRAIN_DEPTH * noise(place / GRAIN);
        flat.map(|c| c * shade)
    }
}

/// The colour by direction from the centre, independent of the head's size.
fn face(point: DVec3) -> Color {
    let at = point.normalize();
    let eye = |side: f64| at.distance(dvec3(0.36 * side, 0.12, 0.925)) < 0.17;
    if eye(1.0) || eye(-1.0) {
        EYE
    } else if at.y > 0.55 || at.z < -0.1 {
        HAIR
    } else {
        SKIN
    }
}

/// Smooth noise in `[0, 1]`: random numbers at integer points, interpolated between them.
pub(in crate::synth) fn noise(point: DVec3) -> f64 {
    let cell = point.floor();
    let u = point - cell;
    let u = u * u * (3.0 - 2.0 * u);
    let [x, y, z] = cell.to_array().map(|c| c as i64 as u64);
    let mut sum = 0.0;
    for corner in 0..8u64 {
        let step = [corner & 1, corner >> 1 & 1, corner >> 2];
        let weight = |axis: usize| if step[axis] == 1 { u[axis] } else { 1.0 - u[axis] };
        let at = [x, y, z].into_iter().zip(step).map(|(c, step)| c.wrapping_add(step));
        let number = at.fold(0, |hash, c| split_mix(hash ^ c));
        sum += weight(0) * weight(1) * weight(2) * unit(number);
    }
    sum
}

/// From 0 to 1, evenly for pseudorandom numbers.
pub(in crate::synth) fn unit(number: u64) -> f64 {
    (number >> 11) as f64 / (1u64 << 53) as f64
}

/// A pseudorandom number (the finaliser of SplitMix64).
pub(in crate::synth) fn split_mix(number: u64) -> u64 {
    let mut z = number.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ z >> 31
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_smooth_and_fills_its_range() {
        let at = |i: usize| noise(dvec3(i as f64 * 0.01, 3.2 - i as f64 * 0.004, -7.7));
        let values: Vec<f64> = (0..20_000).map(at).collect();
        let (low, high) = values.iter().fold((1.0f64, 0.0f64), |(l, h), &x| (l.min(x), h.max(x)));
        assert!((0.0..0.15).contains(&low) && (0.85..=1.0).contains(&high), "{low} {high}");
        let jump = values.windows(2).map(|pair| (pair[1] - pair[0]).abs()).fold(0.0, f64::max);
        assert!(jump < 0.03, "{jump}");
    }

    #[test]
    fn patterns_repeat_and_noise_does_not() {
        let colors = [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]];
        let stripes = Texture::Stripes { width: 0.1, colors };
        let is_red = |y: f64| stripes.color(0, dvec3(0.3, y, 0.1))[0] > 0.0;
        assert_eq!([0.05, 0.15, 0.25, -0.05, -0.15].map(is_red), [true, false, true, false, true]);
        let checks = Texture::Checks { side: 0.1, colors };
        let is_red = |p: [f64; 3]| checks.color(0, DVec3::from(p))[0] > 0.0;
        assert_ne!(is_red([0.0, 0.0, 0.0]), is_red([0.1, 0.0, 0.0]));
        assert_eq!(is_red([0.0, 0.0, 0.0]), is_red([0.1, 0.1, 0.0]));
        assert_ne!(checks.color(0, DVec3::ZERO), checks.color(0, dvec3(0.2, 0.0, 0.0)));
        assert_ne!(checks.color(0, DVec3::ZERO), checks.color(1, DVec3::ZERO));
        assert!(Texture::Face.color(0, dvec3(0.36, 0.12, 0.925) * 0.1)[0] < 0.1, "an eye");
    }
}
