//! [`gains`]: the factors by which a picture is brighter than another of the same scene, channel by channel.

/// Gains between plate and picture are compensated up to this factor and its inverse. Beyond, so little of 8 bits is left of
/// one of the two that noise is all that differs.
pub const GAIN_MAX: f64 = 2.0;

/// Levels in which the darker picture still tells a factor: below, rounding to 8 bits moves the quotient by 1.5 %.
const DARKEST: u8 = 32;

/// Level from which a channel may be clipped.
const BRIGHTEST: u8 = 250;

/// Steps of the histogram for each unit of the quotient, and the largest quotient in it.
const STEPS: usize = 512;
const QUOTIENT_MAX: usize = 8;

/// Deviation from the first median within which quotients count for the second, as a factor. The subject, whose
/// quotients are any, pulls the first one towards them.
const NEAR: f64 = 0.1;

/// Pixels that a factor needs at least.
const PIXELS_MIN: u32 = 16;

/// Medians of the quotients of `picture` and `plate` in each channel; 1 where too few pixels tell.
pub(super) fn gains(picture: &[[u8; 3]], plate: &[[u8; 3]]) -> [f64; 3] {
    let mut counts = vec![[0u32; 3]; STEPS * QUOTIENT_MAX];
    // Quotients of bytes, in steps.
    let inverse: Vec<f32> = (0..256).map(|level| STEPS as f32 / level as f32).collect();
    for (picture, plate) in picture.iter().zip(plate) {
        for c in 0..3 {
            if picture[c].max(plate[c]) < DARKEST || plate[c] == 0 || picture[c].max(plate[c]) >= BRIGHTEST {
                continue;
            }
            let step = (f32::from(picture[c]) * inverse[usize::from(plate[c])]) as usize;
            if let Some(count) = counts.get_mut(step) {
                count[c] += 1;
            }
        }
    }
    std::array::from_fn(|c| {
        let count = |step: usize| counts[step][c];
        let Some(first) = median(0..counts.len(), count) else { return 1.0 };
        let [low, high] = [1.0 - NEAR, 1.0 + NEAR].map(|factor| (first * factor) as usize);
        median(low..(high + 1).min(counts.len()), count).unwrap_or(first) / STEPS as f64
    })
}

/// Median of values in the steps of a histogram, even within a step; none of fewer than [`PIXELS_MIN`].
fn median(steps: std::ops::Range<usize>, count: impl Fn(usize) -> u32) -> Option<f64> {
    let total: u32 = steps.clone().map(&count).sum();
    let mut rest = f64::from(total) / 2.0;
    for step in steps {
        let here = f64::from(count(step));
        if here > 0.0 && rest <= here {
            return (total >= PIXELS_MIN).then_some(step as f64 + rest / here);
        }
        rest -= here;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_factor_is_found_beside_a_subject() {
        let plate: Vec<[u8; 3]> = (0..4000u32).map(|i| [40 + (i * 7 % 150) as u8; 3]).collect();
        for factor in [0.6, 0.97, 1.0, 1.25] {
            let shown = |(i, p): (usize, &[u8; 3])| match i % 3 {
                0 => [33, 200, 90],
                _ => p.map(|level| (f64::from(level) * factor).round() as u8),
            };
            let picture: Vec<[u8; 3]> = plate.iter().enumerate().map(shown).collect();
            let found = gains(&picture, &plate);
            assert!(found.iter().all(|gain| (gain / factor - 1.0).abs() < 0.01), "{factor}: {found:?}");
        }
    }

    #[test]
    fn nothing_is_assumed_of_what_tells_nothing() {
        assert_eq!(gains(&[], &[]), [1.0; 3]);
        assert_eq!(gains(&[[0; 3]; 99], &[[0; 3]; 99]), [1.0; 3]);
        assert_eq!(gains(&[[255; 3]; 99], &[[255; 3]; 99]), [1.0; 3]);
    }
}
