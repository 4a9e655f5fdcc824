//! `XR_FB_display_refresh_rate`: the refresh rate of the display.

use openxr as xr;

/// Preferred rate in Hz: smooth, and within the power of standalone headsets.
const PREFERRED_HZ: f32 = 90.0;

/// Requests the best rate, if there is a choice; returns the requested rate in Hz.
pub(in crate::xr) fn request(session: &xr::Session<xr::Vulkan>) -> Option<f32> {
    let offered = session.enumerate_display_refresh_rates().ok()?;
    let rate_hz = choose(&offered)?;
    if let Err(code) = session.request_display_refresh_rate(rate_hz) {
        log::warn!("the headset refuses {rate_hz} Hz: {code:?}");
        return session.get_display_refresh_rate().ok();
    }
    Some(rate_hz)
}

/// The preferred rate if it is among the `offered` ones, else the highest.
fn choose(offered: &[f32]) -> Option<f32> {
    let preferred = offered.iter().copied().find(|rate| (rate - PREFERRED_HZ).abs() < 0.5);
    preferred.or_else(|| offered.iter().copied().max_by(f32::total_cmp))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ninety_else_the_highest() {
        assert_eq!(choose(&[60.0, 72.0, 80.0, 90.0, 120.0]), Some(90.0));
        assert_eq!(choose(&[72.0, 89.95, 120.0]), Some(89.95));
        assert_eq!(choose(&[60.0, 72.0]), Some(72.0));
        assert_eq!(choose(&[]), None);
    }
}
