//! `XR_EXT_performance_settings`: the performance level of the headset.

#![allow(unsafe_code, reason = "the function has no safe form")]

use openxr as xr;

/// Requests the highest level that the headset sustains without overheating.
pub(in crate::xr) fn request(session: &xr::Session<xr::Vulkan>) {
    let Some(settings) = &session.instance().exts().ext_performance_settings else { return };
    for domain in [xr::PerfSettingsDomainEXT::CPU, xr::PerfSettingsDomainEXT::GPU] {
        // SAFETY: the function was loaded for this instance, and the session lives.
        let code = unsafe {
            let level = xr::PerfSettingsLevelEXT::SUSTAINED_HIGH;
            (settings.perf_settings_set_performance_level)(session.as_raw(), domain, level)
        };
        if code != xr::sys::Result::SUCCESS {
            log::info!("performance level of {domain:?}: {code:?}");
        }
    }
}
