//! What is too near to an eye: Gaussians fade out before it.
//!
//! A camera of a capture often stands inside what was fitted, such as the wall that carries it. Gaussians right before an
//! eye would cover its whole picture as haze. How near that is belongs to the scene: it is a share of the distance to what
//! people look at, so it has no unit.

/// [`Field::near`](crate::Field::near) as a share of the distance at which the content is seen. On a dome of cameras with
/// a radius of 2.75 units, held cameras see 11.5 dB at 0.004, 27.1 at 0.07, and 28.5 at 0.18 and 0.36: nearer, each camera
/// uses what stands before it alone as a filter of its own.
pub const NEAR_SHARE: f64 = 0.2;

/// [`Field::near`](crate::Field::near) as a share of the size of the content, twice
/// [`Surroundings::content_radius`](crate::Surroundings::content_radius), for a field of another program, which states none:
/// the distance of its cameras is unknown. It is 0.01 units in a field of unit size, the near plane of other renderers.
pub const NEAR_OF_SIZE: f64 = 0.01;

/// Share of [`Field::near`](crate::Field::near) up to which nothing is drawn.
pub const FADE_START: f64 = 0.5;

/// Factor of the opacity of a Gaussian whose centre is `depth` in front of an eye: 0 up to half of `near`, 1 from `near`
/// on, linear between. Nothing behind the eye is drawn at any `near`. 0 for NaN.
pub fn near_fade(depth: f64, near: f64) -> f64 {
    match depth >= near {
        true if depth > 0.0 => 1.0,
        false if depth > 0.0 => ((depth / near - FADE_START) / (1.0 - FADE_START)).max(0.0),
        _ => 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_near_fades() {
        let near = 0.5;
        for (depth, expected) in [(-1.0, 0.0), (0.0, 0.0), (0.25, 0.0), (0.375, 0.5), (0.5, 1.0), (9.0, 1.0)]
        {
            assert_eq!(near_fade(depth, near), expected, "{depth}");
        }
        assert_eq!(near_fade(f64::NAN, near), 0.0);
    }

    #[test]
    fn without_a_distance_all_before_the_eye_is_drawn() {
        for (depth, expected) in [(-1.0, 0.0), (0.0, 0.0), (1e-30, 1.0), (1.0, 1.0)] {
            assert_eq!(near_fade(depth, 0.0), expected, "{depth}");
        }
    }

    #[test]
    fn the_unit_of_length_does_not_matter() {
        for unit in [1e-3, 1e6] {
            assert!((near_fade(0.4 * unit, 0.5 * unit) - near_fade(0.4, 0.5)).abs() < 1e-12);
        }
    }
}
