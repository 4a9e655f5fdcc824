//! [`SeeThrough`]: how the room is shown behind the clip: the runtime blends images with it, or puts
//! it below them as a layer of its own.

use openxr as xr;

use super::extensions::passthrough::{Passthrough, PassthroughLayer};
use super::runtime::Runtime;

/// The way to show the room, in a session.
pub(super) enum SeeThrough {
    /// There is none.
    Never,
    /// An environment blend mode.
    Blend,
    /// A layer of the runtime's.
    Layer(Passthrough),
}

/// The ways that a runtime may offer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Way {
    Never,
    Blend,
    Layer,
}

/// The best way: blending is part of every runtime's interface, where it has it.
fn choose(blends: bool, has_layer: bool) -> Way {
    match (blends, has_layer) {
        (true, _) => Way::Blend,
        (false, true) => Way::Layer,
        (false, false) => Way::Never,
    }
}

impl SeeThrough {
    /// What `runtime` offers to a session.
    pub(super) fn open(runtime: &Runtime, session: &xr::Session<xr::Vulkan>) -> SeeThrough {
        match choose(runtime.blends.can_see_through(), runtime.extensions.fb_passthrough) {
            Way::Never => SeeThrough::Never,
            Way::Blend => SeeThrough::Blend,
            Way::Layer => Passthrough::open(session).map_or(SeeThrough::Never, SeeThrough::Layer),
        }
    }

    /// Whether the room can be shown.
    pub(super) fn is_possible(&self) -> bool {
        !matches!(self, SeeThrough::Never)
    }

    /// What must be shown below everything for the room to be seen, if it is `wanted`.
    pub(super) fn layer(&mut self, wanted: bool) -> Option<PassthroughLayer<'_>> {
        match self {
            SeeThrough::Never | SeeThrough::Blend => None,
            SeeThrough::Layer(passthrough) => passthrough.layer(wanted),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_room_is_blended_else_a_layer_else_not_there() {
        assert_eq!(choose(true, false), Way::Blend);
        assert_eq!(choose(true, true), Way::Blend, "never both: the room would be seen twice");
        assert_eq!(choose(false, true), Way::Layer);
        assert_eq!(choose(false, false), Way::Never);
    }
}
