//! Random poses and placements for tests that hold for all of them; the same ones in every run.

use glam::{DVec3, Quat, dvec3};

use super::hands::Pose;
use super::placement::Placement;

/// A generator after Steele, Lea and Flood (SplitMix64).
pub(super) struct Random(u64);

impl Random {
    pub(super) fn new(seed: u64) -> Random {
        Random(seed)
    }

    /// From -1 to 1.
    pub(super) fn signed(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    /// Within 3 m of the origin along each axis.
    pub(super) fn point(&mut self) -> DVec3 {
        3.0 * dvec3(self.signed(), self.signed(), self.signed())
    }

    pub(super) fn pose(&mut self) -> Pose {
        let position = self.point().as_vec3();
        let [x, y, z, w] = [(); 4].map(|()| self.signed() as f32);
        let orientation = Quat::from_xyzw(x, y, z, w);
        // As good as never so short.
        let short = orientation.length() < 1e-3;
        Pose { position, orientation: if short { Quat::IDENTITY } else { orientation.normalize() } }
    }

    /// Between a tenth of life size and ten times.
    pub(super) fn placement(&mut self) -> Placement {
        Placement::new(10f64.powf(self.signed()), 3.0 * self.signed(), self.point())
    }
}
