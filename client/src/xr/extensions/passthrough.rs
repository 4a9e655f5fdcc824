//! `XR_FB_passthrough`: the room as a layer below what is drawn, on headsets whose images cannot be
//! blended with it.

#![allow(unsafe_code, reason = "the crate keeps its form of this layer to itself")]

use std::marker::PhantomData;
use std::ops::Deref;

use openxr as xr;
use openxr::sys::Handle as _;

/// The room, which is recorded only while it is seen.
pub(in crate::xr) struct Passthrough {
    // Before what it is part of.
    layer: xr::PassthroughLayerFB,
    _cameras: xr::Passthrough,
    running: bool,
}

impl Passthrough {
    /// Gets it ready, not yet to be seen; `None` where the headset has no cameras for it.
    pub(in crate::xr) fn open(session: &xr::Session<xr::Vulkan>) -> Option<Passthrough> {
        let open = || {
            // The crate's function that starts it later pauses it instead.
            let cameras = session.create_passthrough(xr::PassthroughFlagsFB::IS_RUNNING_AT_CREATION)?;
            let flags = xr::PassthroughFlagsFB::EMPTY;
            let purpose = xr::PassthroughLayerPurposeFB::RECONSTRUCTION;
            let layer = session.create_passthrough_layer(&cameras, flags, purpose)?;
            Ok(Passthrough { layer, _cameras: cameras, running: false })
        };
        open().inspect_err(|code: &xr::sys::Result| log::info!("no passthrough: {code:?}")).ok()
    }

    /// The layer to show first of all in this frame; `None` unless it is `wanted`.
    pub(in crate::xr) fn layer(&mut self, wanted: bool) -> Option<PassthroughLayer<'_>> {
        if wanted != self.running {
            let result = if wanted { self.layer.resume() } else { self.layer.pause() };
            if let Err(code) = result {
                log::warn!("passthrough: {code:?}");
            }
            // Whatever came of it, it is not tried again in every frame.
            self.running = wanted;
        }
        wanted.then(|| PassthroughLayer {
            raw: xr::sys::CompositionLayerPassthroughFB {
                ty: xr::sys::CompositionLayerPassthroughFB::TYPE,
                next: std::ptr::null(),
                flags: xr::CompositionLayerFlags::BLEND_TEXTURE_SOURCE_ALPHA,
                // It fills the view.
                space: xr::sys::Space::NULL,
                layer_handle: self.layer.as_raw(),
            },
            of: PhantomData,
        })
    }
}

/// The room as a layer of a frame.
pub(in crate::xr) struct PassthroughLayer<'a> {
    raw: xr::sys::CompositionLayerPassthroughFB,
    of: PhantomData<&'a Passthrough>,
}

impl<'a> Deref for PassthroughLayer<'a> {
    type Target = xr::CompositionLayerBase<'a, xr::Vulkan>;

    fn deref(&self) -> &Self::Target {
        // SAFETY: every layer begins with the header that the target stands for, and is named by
        // its type; the handle in it outlives `'a`.
        unsafe { &*std::ptr::from_ref(&self.raw).cast() }
    }
}
