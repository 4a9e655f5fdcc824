//! The views of the rate-distortion report, which choose nothing.

use refine::reference::PosedView;

use crate::package::rate_views;
use crate::report::subject::ReportSubject;

/// Default width and height in pixels of the images compared.
pub(super) const SIZE: [u32; 2] = [320, 240];

/// Number of images compared. A dynamic field gets an instant for each.
pub(super) const COUNT: usize = 16;

/// Views in which packages are compared with the field, in images of this `size`.
pub(super) fn reported_views(subject: &ReportSubject, size: [u32; 2]) -> Vec<PosedView> {
    rate_views(&subject.scene, &subject.field, size.into(), COUNT)
}
