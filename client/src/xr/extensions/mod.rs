//! What runtimes offer beyond the core, each used where it is there and done without where not.

pub(super) mod passthrough;
pub(super) mod performance;
pub(super) mod refresh_rate;

use openxr as xr;

/// The extensions to enable, of those `offered`.
pub(super) fn wanted(offered: &xr::ExtensionSet) -> xr::ExtensionSet {
    let mut wanted = xr::ExtensionSet::default();
    wanted.khr_vulkan_enable2 = offered.khr_vulkan_enable2;
    wanted.ext_local_floor = offered.ext_local_floor;
    wanted.ext_hand_interaction = offered.ext_hand_interaction;
    wanted.meta_touch_controller_plus = offered.meta_touch_controller_plus;
    wanted.fb_display_refresh_rate = offered.fb_display_refresh_rate;
    wanted.ext_performance_settings = offered.ext_performance_settings;
    wanted.fb_passthrough = offered.fb_passthrough;
    wanted
}
