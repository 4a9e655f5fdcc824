//! The views of the rate-distortion report, which neither rank nor judge.

use refine::reference::PosedView;

use crate::package::{Places, views_of};
use crate::report::subject::ReportSubject;

/// Default width and height in pixels of the images compared.
pub(super) const SIZE: [u32; 2] = [320, 240];

/// Camera positions, other than those that rank or judge.
const PLACES: Places = Places { aside: 8.0, viewpoint: false, turn: 0.25 };

/// Number of images compared. A dynamic field gets an instant for each; the instants of 16 equal parts do not rank
/// or judge.
pub(super) const COUNT: usize = 16;

/// Views in which packages are compared with the field, in images of this `size`.
pub(super) fn reported_views(subject: &ReportSubject, size: [u32; 2]) -> Vec<PosedView> {
    views_of(&subject.scene, &subject.field, PLACES, size.into(), COUNT)
}
