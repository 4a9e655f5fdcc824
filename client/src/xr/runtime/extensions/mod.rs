//! Optional extensions, one file each.

pub(in crate::xr) mod passthrough;
pub(in crate::xr) mod performance;
pub(in crate::xr) mod refresh_rate;

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
    enabled
}
