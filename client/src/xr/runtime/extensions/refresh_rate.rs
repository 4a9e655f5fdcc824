//! `XR_FB_display_refresh_rate`: the refresh rate of the display.

use openxr as xr;

/// Preferred rate in Hz: smooth, and within the power of standalone headsets; and the rate below it.
const PREFERRED_HZ: f32 = 90.0;
const SLOW_HZ: f32 = 72.0;

/// The rates that a display may have, in Hz.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::xr) struct Rates {
    pub(in crate::xr) full: f32,
    /// Below `full`, if there is one.
    pub(in crate::xr) slow: Option<f32>,
}

/// The rates to use among those that the display of `session` offers; `None` if it offers none.
pub(in crate::xr) fn rates(session: &xr::Session<xr::Vulkan>) -> Option<Rates> {
    choose(&session.enumerate_display_refresh_rates().ok()?)
}

/// Requests `hz`; returns the rate that the display then has, if it says so.
pub(in crate::xr) fn request(session: &xr::Session<xr::Vulkan>, hz: f32) -> Option<f32> {
    if let Err(code) = session.request_display_refresh_rate(hz) {
        log::warn!("the headset refuses {hz} Hz: {code:?}");
        return session.get_display_refresh_rate().ok();
    }
    Some(hz)
}

/// The preferred rate if it is among the `offered` ones, else the highest; and the slower one below it.
fn choose(offered: &[f32]) -> Option<Rates> {
    let at = |hz: f32| offered.iter().copied().find(|rate| (rate - hz).abs() < 0.5);
    let full = at(PREFERRED_HZ).or_else(|| offered.iter().copied().max_by(f32::total_cmp))?;
    Some(Rates { full, slow: at(SLOW_HZ).filter(|slow| *slow < full - 1.0) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ninety_else_the_highest_and_seventy_two_below_it() {
        let rates = |full, slow| Some(Rates { full, slow });
        assert_eq!(choose(&[60.0, 72.0, 80.0, 90.0, 120.0]), rates(90.0, Some(72.0)));
        assert_eq!(choose(&[72.0, 89.95, 120.0]), rates(89.95, Some(72.0)));
        assert_eq!(choose(&[60.0, 72.0]), rates(72.0, None));
        assert_eq!(choose(&[120.0]), rates(120.0, None));
        assert_eq!(choose(&[]), None);
    }
}
