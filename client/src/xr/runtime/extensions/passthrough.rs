//! `XR_FB_passthrough`: the room as a layer below the images, for headsets without a blend mode for it.

#![allow(unsafe_code, reason = "the crate keeps its type of this layer private")]

use std::marker::PhantomData;
use std::ops::Deref;

use openxr as xr;
use openxr::sys::Handle as _;

/// The room, filmed only while it is visible.
pub(in crate::xr) struct Passthrough {
    // Before the cameras that it belongs to.
    layer: xr::PassthroughLayerFB,
    _cameras: xr::Passthrough,
    running: bool,
}

impl Passthrough {
    /// Creates the layer, hidden; `None` for a headset without cameras.
    pub(in crate::xr) fn open(session: &xr::Session<xr::Vulkan>) -> Option<Passthrough> {
        let open = || {
            // The crate's function to start it later pauses it instead.
            let cameras = session.create_passthrough(xr::PassthroughFlagsFB::IS_RUNNING_AT_CREATION)?;
            let flags = xr::PassthroughFlagsFB::EMPTY;
            let purpose = xr::PassthroughLayerPurposeFB::RECONSTRUCTION;
            let layer = session.create_passthrough_layer(&cameras, flags, purpose)?;
            Ok(Passthrough { layer, _cameras: cameras, running: false })
        };
        open().inspect_err(|code: &xr::sys::Result| log::info!("no passthrough: {code:?}")).ok()
    }

    /// The bottom layer of this frame; `None` unless it is `visible`.
    pub(in crate::xr) fn layer(&mut self, visible: bool) -> Option<PassthroughLayer<'_>> {
        if visible != self.running {
            let result = if visible { self.layer.resume() } else { self.layer.pause() };
            if let Err(code) = result {
                log::warn!("passthrough: {code:?}");
            }
            // After a failure, too: it is not tried again in every frame.
            self.running = visible;
        }
        visible.then(|| PassthroughLayer {
            raw: xr::sys::CompositionLayerPassthroughFB {
                ty: xr::sys::CompositionLayerPassthroughFB::TYPE,
                next: std::ptr::null(),
                flags: xr::CompositionLayerFlags::BLEND_TEXTURE_SOURCE_ALPHA,
                // The layer fills the view.
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
        // SAFETY: every layer begins with the header of the target type, which names the layer's type; the
        // handle in it outlives `'a`.
        unsafe { &*std::ptr::from_ref(&self.raw).cast() }
    }
}
