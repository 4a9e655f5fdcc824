//! `XR_EXT_performance_settings`: the performance level of the headset, and how hot it is.

#![allow(unsafe_code, reason = "the function has no safe form")]

use openxr as xr;

use crate::headset::show::quality::Heat;

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

/// How hot each domain of a headset is, CPU and GPU.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::xr) struct Heats([Heat; 2]);

impl Heats {
    /// Takes in a notification; returns how hot the headset is, if it is about heat. The player measures its frames itself.
    pub(in crate::xr) fn on(
        &mut self,
        domain: xr::PerfSettingsDomainEXT,
        sub_domain: xr::PerfSettingsSubDomainEXT,
        level: xr::PerfSettingsNotificationLevelEXT,
    ) -> Option<Heat> {
        if sub_domain != xr::PerfSettingsSubDomainEXT::THERMAL {
            return None;
        }
        let Heats([cpu, gpu]) = self;
        *(if domain == xr::PerfSettingsDomainEXT::CPU { &mut *cpu } else { &mut *gpu }) = match level {
            xr::PerfSettingsNotificationLevelEXT::NORMAL => Heat::Normal,
            xr::PerfSettingsNotificationLevelEXT::WARNING => Heat::Warning,
            _ => Heat::Impaired,
        };
        Some((*cpu).max(*gpu))
    }
}

#[cfg(test)]
mod tests {
    use xr::{
        PerfSettingsDomainEXT as Domain, PerfSettingsNotificationLevelEXT as Level,
        PerfSettingsSubDomainEXT as SubDomain,
    };

    use super::*;

    #[test]
    fn a_headset_is_as_hot_as_its_hotter_part() {
        let mut heats = Heats::default();
        for (domain, level, heat) in [
            (Domain::GPU, Level::WARNING, Heat::Warning),
            (Domain::CPU, Level::IMPAIRED, Heat::Impaired),
            (Domain::GPU, Level::NORMAL, Heat::Impaired),
            (Domain::CPU, Level::NORMAL, Heat::Normal),
        ] {
            assert_eq!(heats.on(domain, SubDomain::THERMAL, level), Some(heat));
        }
        assert_eq!(heats.on(Domain::GPU, SubDomain::RENDERING, Level::IMPAIRED), None);
    }
}
