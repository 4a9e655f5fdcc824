//! [`ViewedClip`]: the properties of a clip that its viewer needs.

use codec::Viewpoint;

use crate::content::OpenTake;

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
    /// No clip, as before the first one is there.
    pub(crate) fn none() -> ViewedClip {
        let up = [0.0, 1.0, 0.0];
        ViewedClip {
            duration_s: 0.0,
            fps: 0.0,
            is_static: true,
            up,
            viewpoints: vec![Viewpoint::framing([[-1.0; 3], [1.0; 3]], up)],
            layers: 1,
        }
    }

    /// The properties of `clip`.
    pub(crate) fn new(clip: &OpenTake) -> ViewedClip {
        let info = clip.info();
        ViewedClip {
            duration_s: clip.duration_s(),
            fps: info.fps.into(),
            is_static: clip.is_static(),
            up: info.up,
            viewpoints: info.viewpoints.clone(),
            layers: clip.layer_count().max(1),
        }
    }
}
