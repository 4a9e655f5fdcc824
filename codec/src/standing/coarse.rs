//! [`CoarseField`]: whether a camera shows enough of a field to compare pictures by, and which rows cameras show at all.

use super::discs::Discs;
use super::glance::{SIZE, glance};
use crate::{Camera, Field};

/// Rows that tell whether a view is informative, at most.
const ROWS: usize = 100_000;

/// A view is informative if at least this share of its pixels is covered ...
const COVERED_MIN: f64 = 0.01;

/// ... by at least so many Gaussians, or half of those alive where there are fewer than twice as many ...
const GAUSSIANS_MIN: usize = 50;

/// ... each with at most this share of all that is seen.
const SHARE_MAX: f64 = 0.5;

/// A field at an instant, in pictures of 48x36 pixels.
#[derive(Clone, Debug)]
pub struct CoarseField(Discs);

/// What cameras show of a row. Over several instants, the largest counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Sight {
    /// It is not alive.
    Absent,
    /// It is alive, and no camera shows it; rims of such rows may show in larger pictures.
    Hidden,
    /// A camera shows it.
    Seen,
}

impl CoarseField {
    /// `field` and its `plate` at clip time `t`; of many rows a selection.
    pub fn new(field: &Field, plate: Option<&Field>, t: f64) -> CoarseField {
        CoarseField(Discs::at(field, plate, t, ROWS))
    }

    /// What `cameras` show of each row of `field` and then of its `plate`, at clip time `t`.
    pub fn sights(field: &Field, plate: Option<&Field>, t: f64, cameras: &[Camera]) -> Vec<Sight> {
        let discs = Discs::at(field, plate, t, usize::MAX);
        let mut sights = vec![Sight::Absent; discs.rows];
        discs.instants.iter().flatten().for_each(|disc| sights[disc.row] = Sight::Hidden);
        for camera in cameras {
            let seen = glance(&discs, &camera.resized(SIZE.0, SIZE.1), 0.0, discs.near).seen;
            let rows = sights.iter_mut().zip(seen).filter(|(_, is_seen)| *is_seen);
            rows.for_each(|(sight, _)| *sight = Sight::Seen);
        }
        sights
    }

    /// Whether the picture of `camera` shows enough of the field to compare pictures by: not empty space, and not the inside
    /// of one Gaussian. A camera that fails [`Camera::check`] shows nothing.
    pub fn is_informative(&self, camera: &Camera) -> bool {
        let camera = camera.resized(SIZE.0, SIZE.1);
        if camera.check().is_err() {
            return false;
        }
        let glance = glance(&self.0, &camera, 0.0, self.0.near);
        let alive = self.0.instants.iter().map(Vec::len).sum::<usize>();
        let gaussians = glance.seen.iter().filter(|is_seen| **is_seen).count();
        let is_alone = glance.largest_share > SHARE_MAX && alive >= 2 * GAUSSIANS_MIN;
        let enough = GAUSSIANS_MIN.min(alive.div_ceil(2)).max(1);
        glance.covered >= COVERED_MIN && gaussians >= enough && !is_alone
    }
}
