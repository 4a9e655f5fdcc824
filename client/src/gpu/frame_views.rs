//! [`FrameViews`]: the views of a frame: of one eye or two, divided if the frame is foveated.

use shaders::filter_variance;

use super::division::Division;
use crate::view::View;

/// Most eyes that one frame has.
pub(super) const EYES_MAX: usize = 2;

/// The views of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct FrameViews {
    eyes: usize,
    /// What the viewer sees.
    full: [View; EYES_MAX],
    /// What the passes that show everything draw: the wide views of a foveated frame.
    drawn: [View; EYES_MAX],
    divisions: Option<[Division; EYES_MAX]>,
}

impl FrameViews {
    /// The views of one eye or two, with images of the same size. `inset` is as in
    /// [`RenderSettings`](super::RenderSettings::inset).
    pub(super) fn new(views: &[View], inset: Option<f32>) -> FrameViews {
        let eyes = views.len();
        let full = std::array::from_fn(|eye| views[eye.min(eyes - 1)]);
        let divisions = inset.map(|side| full.map(|view| Division::new(&view, side)));
        let drawn = divisions.map_or(full, |divisions| divisions.map(|division| division.wide));
        FrameViews { eyes, full, drawn, divisions }
    }

    /// What the viewer sees with each eye.
    pub(super) fn full(&self) -> &[View] {
        &self.full[..self.eyes]
    }

    /// What the passes that show everything draw.
    pub(super) fn drawn(&self) -> &[View] {
        &self.drawn[..self.eyes]
    }

    /// How the views are divided, if they are.
    pub(super) fn divisions(&self) -> Option<&[Division]> {
        self.divisions.as_ref().map(|divisions| &divisions[..self.eyes])
    }

    /// Variance of the field's blur in px^2 of the views that are drawn.
    pub(super) fn blur(&self) -> f32 {
        self.divisions.map_or(filter_variance(false), |divisions| divisions[0].wide_blur())
    }
}
