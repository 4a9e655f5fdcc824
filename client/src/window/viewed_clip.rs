//! [`ViewedClip`]: the properties of a clip that its viewer needs.

use codec::{Clip, Viewpoint};

/// The properties of a clip that its viewer needs.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ViewedClip {
    pub(super) duration_s: f64,
    pub(super) fps: f64,
    /// Whether the image is the same at all times.
    pub(super) is_static: bool,
    pub(super) up: [f32; 3],
    /// At least one.
    pub(super) viewpoints: Vec<Viewpoint>,
    /// Number of layers, at least 1.
    pub(super) layers: usize,
}

impl ViewedClip {
    /// The properties of `clip`. A clip without viewpoints gets one that frames its bounds.
    pub(crate) fn new(clip: &Clip) -> ViewedClip {
        let info = &clip.info;
        ViewedClip {
            duration_s: info.duration_s.into(),
            fps: info.fps.into(),
            is_static: clip.dynamic_field.is_empty(),
            up: info.up,
            viewpoints: clip.viewpoints(),
            layers: clip.layers.len().max(1),
        }
    }
}
