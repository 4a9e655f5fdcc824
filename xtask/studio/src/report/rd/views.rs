//! The views of the rate-distortion report: neither those that rank nor those that judge.

use refine::prune::{PosedView, instants, posed_views};

use crate::package::{CODED_SIZE, JUDGING_PLACES, Places, RANKING_PLACES, ranking_views, views_of};
use crate::report::subject::ReportSubject;

/// Size in pixels of the pictures that are reported on.
pub(super) const SIZE: (u32, u32) = (320, 240);

/// Where they are taken from: not where pictures rank, and not where they judge.
const PLACES: Places = Places { aside: 8.0, turn: 0.25 };

/// Number of instants at which they are taken. Their middles of equal parts are not those of the
/// pictures that rank and judge.
pub(super) const INSTANTS: usize = 2;

/// Pictures that tell how exactly a package is coded: one of this many of the places and times that
/// judge, in the size that is reported on.
const CODED_STRIDE: usize = 4;

/// Pictures that tell the coder what is visible: one of this many of those that tell `package`.
const SEEN_STRIDE: usize = 3;

pub(super) fn reported_views(subject: &ReportSubject) -> Vec<PosedView> {
    let ReportSubject { scene, field, .. } = subject;
    let placed = views_of(scene, field, PLACES, SIZE);
    // The same cameras at other instants.
    let first = placed.first().map(|view| view.t);
    let cameras: Vec<_> = placed.into_iter().filter(|view| Some(view.t) == first).map(|s| s.camera).collect();
    let known = ranking_views(scene, field);
    let is_new = |view: &PosedView| {
        !known.iter().any(|known| known.t == view.t && known.camera.position() == view.camera.position())
    };
    posed_views(&cameras, &instants(field, INSTANTS)).into_iter().filter(is_new).collect()
}

/// Pictures that tell how exactly a package is coded.
pub(in crate::report) fn coded_views(subject: &ReportSubject) -> Vec<PosedView> {
    views_of(&subject.scene, &subject.field, JUDGING_PLACES, SIZE).into_iter().step_by(CODED_STRIDE).collect()
}

/// Pictures that tell the coder what is visible.
pub(in crate::report) fn seen_views(subject: &ReportSubject) -> Vec<PosedView> {
    let views = views_of(&subject.scene, &subject.field, RANKING_PLACES, CODED_SIZE);
    views.into_iter().step_by(SEEN_STRIDE).collect()
}
