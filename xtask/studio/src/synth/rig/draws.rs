//! Pseudorandom numbers that depend on the seed, the camera and the quantity alone.

use crate::synth::stage::{split_mix, unit};

/// A quantity that is drawn.
#[derive(Clone, Copy, Debug)]
pub(super) enum Draw {
    Start,
    End,
    Drift,
    Exposure,
    Red,
    Blue,
    Skew,
    /// Coordinate of the place of the sound.
    Place(usize),
    /// Deviation of the frame of a variable rate with this number in the pattern.
    Jitter(usize),
    /// The missing frame of a part of the pattern.
    Drop(usize),
}

impl Draw {
    /// A different number for each quantity.
    fn number(self) -> u64 {
        let key = |kind: u64, index: usize| kind << 32 | index as u64;
        match self {
            Draw::Start => key(0, 0),
            Draw::End => key(1, 0),
            Draw::Drift => key(2, 0),
            Draw::Exposure => key(3, 0),
            Draw::Red => key(4, 0),
            Draw::Blue => key(5, 0),
            Draw::Skew => key(6, 0),
            Draw::Place(axis) => key(7, axis),
            Draw::Jitter(slot) => key(8, slot),
            Draw::Drop(part) => key(9, part),
        }
    }
}

/// A number from -1 to 1, evenly distributed.
pub(super) fn draw(seed: u64, camera: usize, quantity: Draw) -> f64 {
    let key = split_mix(split_mix(seed) ^ camera as u64);
    2.0 * unit(split_mix(key ^ split_mix(quantity.number()))) - 1.0
}

/// A number that follows a normal distribution with variance 1 but for its tails: none is above 3.5.
pub(super) fn normal(key: u64) -> f64 {
    let bits = split_mix(key);
    // The sum of four even distributions, each of variance 1/12 over 2^16.
    let sum: u64 = (0..4).map(|i| bits >> (16 * i) & 0xffff).sum();
    (sum as f64 / 65535.0 - 2.0) * 3f64.sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_has_mean_0_and_variance_1() {
        let numbers: Vec<f64> = (0..100_000).map(normal).collect();
        let mean = numbers.iter().sum::<f64>() / 1e5;
        let variance = numbers.iter().map(|x| x * x).sum::<f64>() / 1e5;
        assert!(mean.abs() < 0.02 && (variance - 1.0).abs() < 0.02, "{mean} {variance}");
        let beyond_2 = numbers.iter().filter(|x| x.abs() > 2.0).count();
        assert!((3800..4800).contains(&beyond_2), "{beyond_2}");
    }

    #[test]
    fn draws_depend_on_seed_camera_and_quantity() {
        let one = draw(1, 2, Draw::Red);
        assert_eq!(one, draw(1, 2, Draw::Red));
        for other in [draw(2, 2, Draw::Red), draw(1, 3, Draw::Red), draw(1, 2, Draw::Blue)] {
            assert_ne!(one, other);
        }
        let mean = (0..10_000).map(|camera| draw(0, camera, Draw::Start)).sum::<f64>() / 1e4;
        assert!(mean.abs() < 0.03, "{mean}");
    }
}
