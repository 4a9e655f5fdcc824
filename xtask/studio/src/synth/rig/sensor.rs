//! What a camera makes of the light: exposure, white balance, noise, bytes; and how it stores a picture if it stands on
//! its side.

use super::draws::normal;
use crate::synth::stage::split_mix;

/// The sensor of a camera.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sensor {
    /// Factors of red, green and blue, as displayed.
    pub(super) gains: [f64; 3],
    /// Standard deviation of the noise, in 255ths.
    pub(super) noise: f64,
    /// Seed of the noise.
    pub(super) key: u64,
}

impl Sensor {
    /// The bytes of a picture of colours from 0 to 1. Each frame has noise of its own.
    pub(super) fn expose(&self, colors: &[[f64; 3]], frame: usize) -> Vec<u8> {
        let key = split_mix(self.key ^ split_mix(frame as u64));
        let byte = |(number, color): (usize, &f64)| {
            let noise = match self.noise > 0.0 {
                true => self.noise * normal(key.wrapping_add(number as u64)),
                false => 0.0,
            };
            (color * self.gains[number % 3] * 255.0 + noise).round().clamp(0.0, 255.0) as u8
        };
        colors.as_flattened().iter().enumerate().map(byte).collect()
    }
}

/// The picture, 3 bytes a pixel, as a camera stores it that is turned so that a quarter turn clockwise makes the picture
/// upright.
pub(super) fn on_its_side(upright: &[u8], [width, height]: [u32; 2]) -> Vec<u8> {
    let [width, height] = [width, height].map(|side| side as usize);
    let mut stored = Vec::with_capacity(upright.len());
    for row in 0..width {
        let x = width - 1 - row;
        (0..height).for_each(|y| stored.extend_from_slice(&upright[3 * (y * width + x)..][..3]));
    }
    stored
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_is_exposed_and_clipped() {
        let sensor = Sensor { gains: [1.2, 1.0, 0.5], noise: 0.0, key: 1 };
        let bytes = sensor.expose(&[[0.5, 0.5, 0.5], [0.9, 1.0, 0.0]], 0);
        assert_eq!(bytes, [153, 128, 64, 255, 255, 0]);
    }

    #[test]
    fn noise_differs_between_pixels_and_frames() {
        let sensor = Sensor { gains: [1.0; 3], noise: 2.0, key: 1 };
        let colors = vec![[0.5; 3]; 10_000];
        let [first, second] = [0, 1].map(|frame| sensor.expose(&colors, frame));
        assert_ne!(first, second);
        assert_eq!(first, sensor.expose(&colors, 0));
        let deviations = first.iter().map(|byte| (f64::from(*byte) - 127.5).powi(2));
        let deviation = (deviations.sum::<f64>() / 30_000.0).sqrt();
        assert!((deviation - 2.0).abs() < 0.1, "{deviation}");
    }

    #[test]
    fn a_quarter_turn_clockwise_makes_it_upright() {
        // Two rows of three: 1 2 3 above 4 5 6.
        let upright: Vec<u8> = (1..=6).flat_map(|pixel| [pixel; 3]).collect();
        let stored: Vec<u8> = on_its_side(&upright, [3, 2]).into_iter().step_by(3).collect();
        assert_eq!(stored, [3, 6, 2, 5, 1, 4]);
    }
}
