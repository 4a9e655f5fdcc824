//! [`PassthroughMode`]: how the headset shows the room behind the clip: the runtime blends images with it,
//! or shows it as a layer below them.

use openxr as xr;

use crate::xr::runtime::Runtime;
use crate::xr::runtime::extensions::passthrough::{Passthrough, PassthroughLayer};

/// How a session shows the room.
pub(in crate::xr) enum PassthroughMode {
    /// It cannot.
    Never,
    /// By an environment blend mode.
    Blend,
    /// By a layer of the runtime.
    Layer(OnDemand),
}

/// The layer, while the room is visible: cameras take power and time of the GPU.
pub(in crate::xr) struct OnDemand {
    room: Option<Passthrough>,
    session: xr::Session<xr::Vulkan>,
    /// Whether the cameras failed to start, which is not tried again in every frame.
    failed: bool,
}

/// What a runtime offers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Offer {
    Never,
    Blend,
    Layer,
}

/// The best offer: blending needs no extension.
fn choose(blends: bool, has_layer: bool) -> Offer {
    match (blends, has_layer) {
        (true, _) => Offer::Blend,
        (false, true) => Offer::Layer,
        (false, false) => Offer::Never,
    }
}

impl PassthroughMode {
    /// The best mode that `runtime` offers to a session.
    pub(in crate::xr) fn open(runtime: &Runtime, session: &xr::Session<xr::Vulkan>) -> PassthroughMode {
        match choose(runtime.blends.has_passthrough(), runtime.extensions.fb_passthrough) {
            Offer::Never => PassthroughMode::Never,
            Offer::Blend => PassthroughMode::Blend,
            // Headsets without cameras offer the extension, too.
            Offer::Layer => Passthrough::open(session).map_or(PassthroughMode::Never, |_| {
                PassthroughMode::Layer(OnDemand { room: None, session: session.clone(), failed: false })
            }),
        }
    }

    /// Whether the session can show the room.
    pub(in crate::xr) fn is_possible(&self) -> bool {
        !matches!(self, PassthroughMode::Never)
    }

    /// The layer to show below all others, if this mode has one and the room is `visible`.
    pub(in crate::xr) fn layer(&mut self, visible: bool) -> Option<PassthroughLayer<'_>> {
        match self {
            PassthroughMode::Never | PassthroughMode::Blend => None,
            PassthroughMode::Layer(on_demand) => on_demand.layer(visible),
        }
    }
}

impl OnDemand {
    /// The layer of this frame; starts and stops the cameras.
    fn layer(&mut self, visible: bool) -> Option<PassthroughLayer<'_>> {
        if !visible {
            (self.room, self.failed) = (None, false);
        } else if self.room.is_none() && !self.failed {
            self.room = Passthrough::open(&self.session);
            self.failed = self.room.is_none();
        }
        self.room.as_ref().map(Passthrough::layer)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blending_comes_before_a_layer() {
        assert_eq!(choose(true, false), Offer::Blend);
        assert_eq!(choose(true, true), Offer::Blend, "never both: the room would be seen twice");
        assert_eq!(choose(false, true), Offer::Layer);
        assert_eq!(choose(false, false), Offer::Never);
    }
}
