//! Optional extensions, one file each.
//!
//! Three are left out. `XR_KHR_visibility_mask`: the hidden pixels are corners and the rest touches all sides, so a
//! scissor saves nothing, and a stencil costs every pass an attachment for 2.5 to 7.5 % of a foveated frame's pixels.
//! `XR_META_recommended_layer_resolution`: it and the player's quality would be two controllers of one quantity.
//! `XR_FB_space_warp`: a pixel blends dozens of Gaussians with different motions and depths, so it has neither.

pub(in crate::xr) mod passthrough;
pub(in crate::xr) mod performance;
pub(in crate::xr) mod refresh_rate;
pub(in crate::xr) mod sharpening;
#[cfg(any(target_os = "android", test))]
pub(in crate::xr) mod threads;

use openxr as xr;

/// The extensions to enable among the `offered` ones.
pub(super) fn supported(offered: &xr::ExtensionSet) -> xr::ExtensionSet {
    let mut enabled = xr::ExtensionSet::default();
    enabled.khr_vulkan_enable2 = offered.khr_vulkan_enable2;
    enabled.ext_local_floor = offered.ext_local_floor;
    enabled.ext_hand_interaction = offered.ext_hand_interaction;
    enabled.meta_touch_controller_plus = offered.meta_touch_controller_plus;
    enabled.fb_display_refresh_rate = offered.fb_display_refresh_rate;
    enabled.ext_performance_settings = offered.ext_performance_settings;
    enabled.fb_passthrough = offered.fb_passthrough;
    enabled.fb_composition_layer_settings = offered.fb_composition_layer_settings;
    #[cfg(target_os = "android")]
    {
        enabled.khr_android_thread_settings = offered.khr_android_thread_settings;
    }
    enabled
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_is_offered_and_used_is_enabled() {
        let mut offered = xr::ExtensionSet::default();
        assert_eq!(supported(&offered), offered);
        offered.fb_composition_layer_settings = true;
        assert_eq!(supported(&offered), offered);
        offered.khr_opengl_enable = true;
        assert!(!supported(&offered).khr_opengl_enable);
    }
}
