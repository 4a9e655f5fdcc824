//! `XR_EXT_performance_settings`: the performance level of the headset.

#![allow(unsafe_code, reason = "the function has no safe form")]

use openxr as xr;

/// Requests the highest level of the GPU that the headset sustains without overheating, and a low one of the CPU, which
/// shares the heat: a frame of the player took a desktop's CPU 2 of 11 ms. Not measured on a headset.
pub(in crate::xr) fn request(session: &xr::Session<xr::Vulkan>) {
    let Some(settings) = &session.instance().exts().ext_performance_settings else { return };
    for (domain, level) in [
        (xr::PerfSettingsDomainEXT::CPU, xr::PerfSettingsLevelEXT::SUSTAINED_LOW),
        (xr::PerfSettingsDomainEXT::GPU, xr::PerfSettingsLevelEXT::SUSTAINED_HIGH),
    ] {
        // SAFETY: the function was loaded for this instance, and the session lives.
        let code = unsafe { (settings.perf_settings_set_performance_level)(session.as_raw(), domain, level) };
        if code != xr::sys::Result::SUCCESS {
            log::info!("performance level of {domain:?}: {code:?}");
        }
    }
}
