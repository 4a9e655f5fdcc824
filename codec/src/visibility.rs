//! [`Visibility`]: what a camera sees of a field, and whether that is enough to compare pictures by.
//!
//! Importers measure it with discs in a picture of a few pixels, rankings with the reference renderer. Both judge by the
//! same bounds.

/// A view is informative if at least this fraction of its pixels is covered ...
const COVERED_MIN: f64 = 0.01;

/// ... by at least so many Gaussians, or half of those alive where there are fewer than twice as many ...
const GAUSSIANS_MIN: usize = 50;

/// ... each with at most this share of the picture.
const SHARE_MAX: f64 = 0.5;

/// Measures of what a camera sees of a field at an instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Visibility {
    /// Number of Gaussians that are alive, in the image or not.
    pub alive: usize,
    /// Number of Gaussians with a blending weight of at least [`ALPHA_MIN`](crate::ALPHA_MIN).
    pub gaussians: usize,
    /// Fraction of the pixels that any Gaussian covers, 0 to 1.
    pub covered: f64,
    /// Largest fraction of the sum of all blending weights that belongs to one Gaussian, 0 to 1.
    pub largest_share: f64,
}

impl Visibility {
    /// Whether the view shows enough of the field to compare pictures by: not empty space, and not the inside of one
    /// Gaussian.
    pub fn is_informative(&self) -> bool {
        let enough = GAUSSIANS_MIN.min(self.alive.div_ceil(2)).max(1);
        let is_alone = self.largest_share > SHARE_MAX && self.alive >= 2 * GAUSSIANS_MIN;
        self.covered >= COVERED_MIN && self.gaussians >= enough && !is_alone
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_view_needs_pixels_and_gaussians_of_which_none_is_alone() {
        let most = Visibility { alive: 400, gaussians: 50, covered: 0.01, largest_share: 0.5 };
        assert!(most.is_informative());
        for less in [
            Visibility { covered: 0.0099, ..most },
            Visibility { gaussians: 49, ..most },
            Visibility { largest_share: 0.51, ..most },
        ] {
            assert!(!less.is_informative(), "{less:?}");
        }
        let few = Visibility { alive: 3, gaussians: 2, covered: 0.2, largest_share: 0.9 };
        assert!(few.is_informative(), "half of a field of few Gaussians, of which one is the largest");
        assert!(!Visibility { gaussians: 1, ..few }.is_informative());
        assert!(!Visibility { alive: 0, gaussians: 0, ..few }.is_informative(), "nothing is alive");
    }
}
