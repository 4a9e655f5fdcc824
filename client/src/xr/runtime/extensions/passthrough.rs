//! `XR_FB_passthrough`: the room as a layer below the images, for headsets without a blend mode for it.

#![allow(unsafe_code, reason = "the crate keeps its type of this layer private")]

use std::marker::PhantomData;
use std::ops::Deref;

use openxr as xr;
use openxr::sys::Handle as _;

/// The room, filmed as long as this exists.
pub(in crate::xr) struct Passthrough {
    // Before the cameras that it belongs to.
    layer: xr::PassthroughLayerFB,
    _cameras: xr::Passthrough,
}

impl Passthrough {
    /// Starts the cameras; `None` for a headset without any.
    pub(in crate::xr) fn open(session: &xr::Session<xr::Vulkan>) -> Option<Passthrough> {
        let open = || {
            let running = xr::PassthroughFlagsFB::IS_RUNNING_AT_CREATION;
            let cameras = session.create_passthrough(running)?;
            let purpose = xr::PassthroughLayerPurposeFB::RECONSTRUCTION;
            let layer = session.create_passthrough_layer(&cameras, running, purpose)?;
            Ok(Passthrough { layer, _cameras: cameras })
        };
        open().inspect_err(|code: &xr::sys::Result| log::info!("no passthrough: {code:?}")).ok()
    }

    /// The bottom layer of this frame.
    pub(in crate::xr) fn layer(&self) -> PassthroughLayer<'_> {
        PassthroughLayer {
            raw: xr::sys::CompositionLayerPassthroughFB {
                ty: xr::sys::CompositionLayerPassthroughFB::TYPE,
                next: std::ptr::null(),
                flags: xr::CompositionLayerFlags::BLEND_TEXTURE_SOURCE_ALPHA,
                // The layer fills the view.
                space: xr::sys::Space::NULL,
                layer_handle: self.layer.as_raw(),
            },
            lifetime: PhantomData,
        }
    }
}

/// The room as a layer of a frame.
pub(in crate::xr) struct PassthroughLayer<'a> {
    raw: xr::sys::CompositionLayerPassthroughFB,
    lifetime: PhantomData<&'a Passthrough>,
}

impl<'a> Deref for PassthroughLayer<'a> {
    type Target = xr::CompositionLayerBase<'a, xr::Vulkan>;

    fn deref(&self) -> &Self::Target {
        // SAFETY: every layer begins with the header of the target type, which names the layer's type; the
        // handle in it outlives `'a`.
        unsafe { &*std::ptr::from_ref(&self.raw).cast() }
    }
}
