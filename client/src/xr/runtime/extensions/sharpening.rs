//! `XR_FB_composition_layer_settings`: sharpening by the compositor, for eyes that are drawn with fewer pixels than the
//! display has.

#![allow(unsafe_code, reason = "the crate does not chain these settings")]

use openxr as xr;
use openxr::sys;

/// Settings of a layer; must outlive the frame's end.
pub(in crate::xr) struct Sharpening(sys::CompositionLayerSettingsFB);

impl Sharpening {
    /// For a layer whose images have fewer pixels than the display if `is_scaled`. `None` if it needs no sharpening, or
    /// the runtime has none.
    pub(in crate::xr) fn new(instance: &xr::Instance, is_scaled: bool) -> Option<Sharpening> {
        let is_offered = instance.exts().fb_composition_layer_settings.is_some();
        (is_scaled && is_offered).then(Sharpening::quality)
    }

    fn quality() -> Sharpening {
        Sharpening(sys::CompositionLayerSettingsFB {
            ty: sys::CompositionLayerSettingsFB::TYPE,
            next: std::ptr::null(),
            layer_flags: xr::CompositionLayerSettingsFlagsFB::QUALITY_SHARPENING,
        })
    }

    /// `layer` with these settings.
    pub(in crate::xr) fn apply<'a>(
        &'a self,
        layer: xr::CompositionLayerProjection<'a, xr::Vulkan>,
    ) -> xr::CompositionLayerProjection<'a, xr::Vulkan> {
        let mut raw = layer.into_raw();
        raw.next = std::ptr::from_ref(&self.0).cast();
        // SAFETY: everything that the layer points to, these settings included, outlives `'a`.
        unsafe { xr::CompositionLayerProjection::from_raw(raw) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_settings_are_chained_and_nothing_else_changes() {
        let flags = xr::CompositionLayerFlags::BLEND_TEXTURE_SOURCE_ALPHA;
        let plain = xr::CompositionLayerProjection::<xr::Vulkan>::new().layer_flags(flags);
        let sharpening = Sharpening::quality();
        let layer = sharpening.apply(plain);
        let raw = layer.as_raw();
        assert_eq!(raw.next, std::ptr::from_ref(&sharpening.0).cast());
        assert_eq!(
            (raw.ty, raw.layer_flags, raw.view_count),
            (sys::CompositionLayerProjection::TYPE, flags, 0)
        );
        assert_eq!(sharpening.0.ty, sys::CompositionLayerSettingsFB::TYPE);
        assert_eq!(sharpening.0.layer_flags, xr::CompositionLayerSettingsFlagsFB::QUALITY_SHARPENING);
    }
}
