//! The views of the rate-distortion report, which neither rank nor judge.

use refine::prune::{PosedView, instants, posed_views};

use crate::package::{CODED_SIZE, JUDGING_PLACES, Places, RANKING_PLACES, ranking_views, views_of};
use crate::report::subject::ReportSubject;

/// Width and height in pixels of the images compared.
pub(super) const SIZE: (u32, u32) = (320, 240);

/// Camera positions, other than those that rank or judge.
const PLACES: Places = Places { aside: 8.0, turn: 0.25 };

/// Number of instants. The centres of two equal parts are not instants that rank or judge.
pub(super) const INSTANTS: usize = 2;

/// [`coded_views`] are every nth of the views that judge, at [`SIZE`].
const CODED_STRIDE: usize = 4;

/// [`seen_views`] are every nth of the views from which `package` measures visibility.
const SEEN_STRIDE: usize = 3;

/// Views in which packages are compared with the field.
pub(super) fn reported_views(subject: &ReportSubject) -> Vec<PosedView> {
    let ReportSubject { scene, field, .. } = subject;
    let placed = views_of(scene, field, PLACES, SIZE);
    // The same cameras at other instants.
    let first = placed.first().map(|view| view.t);
    let cameras: Vec<_> =
        placed.into_iter().filter(|view| Some(view.t) == first).map(|view| view.camera).collect();
    let known = ranking_views(scene, field);
    let is_new = |view: &PosedView| {
        !known.iter().any(|known| known.t == view.t && known.camera.position() == view.camera.position())
    };
    posed_views(&cameras, &instants(field, INSTANTS)).into_iter().filter(is_new).collect()
}

/// Views in which the precision of the coder is measured.
pub(in crate::report) fn coded_views(subject: &ReportSubject) -> Vec<PosedView> {
    views_of(&subject.scene, &subject.field, JUDGING_PLACES, SIZE).into_iter().step_by(CODED_STRIDE).collect()
}

/// Views from which visibility is measured for the coder.
pub(in crate::report) fn seen_views(subject: &ReportSubject) -> Vec<PosedView> {
    let views = views_of(&subject.scene, &subject.field, RANKING_PLACES, CODED_SIZE);
    views.into_iter().step_by(SEEN_STRIDE).collect()
}
