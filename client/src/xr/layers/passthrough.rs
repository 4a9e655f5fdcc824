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
    Layer(Passthrough),
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
            Offer::Layer => Passthrough::open(session).map_or(PassthroughMode::Never, PassthroughMode::Layer),
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
            PassthroughMode::Layer(passthrough) => passthrough.layer(visible),
        }
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
