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
    Layer(OnDemand<Passthrough>, xr::Session<xr::Vulkan>),
}

/// The layer, while the room is visible: cameras take power and time of the GPU.
pub(in crate::xr) struct OnDemand<R> {
    room: Option<R>,
    /// Whether the cameras failed, which are not started again in every frame.
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
                PassthroughMode::Layer(OnDemand { room: None, failed: false }, session.clone())
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
            PassthroughMode::Layer(on_demand, session) => {
                on_demand.update(visible, || Passthrough::open(session)).map(Passthrough::layer)
            }
        }
    }

    /// Takes in that the state of the cameras has changed.
    pub(in crate::xr) fn on_change(&mut self, flags: xr::PassthroughStateChangedFlagsFB) {
        if let PassthroughMode::Layer(on_demand, _) = self {
            on_demand.on_change(flags);
        }
    }
}

impl<R> OnDemand<R> {
    /// The room in this frame; starts the cameras by `open`, and stops them.
    fn update(&mut self, visible: bool, open: impl FnOnce() -> Option<R>) -> Option<&R> {
        if !visible {
            (self.room, self.failed) = (None, false);
        } else if self.room.is_none() && !self.failed {
            self.room = open();
            self.failed = self.room.is_none();
        }
        self.room.as_ref()
    }

    /// Takes in that the state of the cameras has changed. From what the runtime recovers by itself, the layer recovers.
    fn on_change(&mut self, flags: xr::PassthroughStateChangedFlagsFB) {
        use xr::PassthroughStateChangedFlagsFB as Flags;
        let is_over = flags.contains(Flags::NON_RECOVERABLE_ERROR);
        if is_over || flags.contains(Flags::REINIT_REQUIRED) {
            (self.room, self.failed) = (None, is_over);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cameras_start_again_when_they_have_to_and_can() {
        use xr::PassthroughStateChangedFlagsFB as Flags;
        let mut opened = 0;
        let mut room = OnDemand { room: None, failed: false };
        let mut update = |room: &mut OnDemand<u32>, visible| {
            let open = || {
                opened += 1;
                Some(opened)
            };
            room.update(visible, open).copied()
        };
        assert_eq!([false, true, true].map(|visible| update(&mut room, visible)), [None, Some(1), Some(1)]);
        for (flags, expected) in [
            (Flags::RECOVERABLE_ERROR, Some(1)),
            (Flags::RESTORED_ERROR, Some(1)),
            (Flags::REINIT_REQUIRED, Some(2)),
            (Flags::REINIT_REQUIRED | Flags::NON_RECOVERABLE_ERROR, None),
        ] {
            room.on_change(flags);
            assert_eq!([(); 2].map(|()| update(&mut room, true)), [expected; 2], "{flags:?}");
        }
        assert_eq!(
            [false, true].map(|visible| update(&mut room, visible)),
            [None, Some(3)],
            "asked for again"
        );
    }

    #[test]
    fn blending_comes_before_a_layer() {
        assert_eq!(choose(true, false), Offer::Blend);
        assert_eq!(choose(true, true), Offer::Blend, "never both: the room would be seen twice");
        assert_eq!(choose(false, true), Offer::Layer);
        assert_eq!(choose(false, false), Offer::Never);
    }
}
