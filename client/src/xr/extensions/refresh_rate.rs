//! `XR_FB_display_refresh_rate`: how often the display shows a new image.

use openxr as xr;

/// What is asked for where it is offered, in images per second: smooth, and reached by headsets
/// that stand alone.
const WANTED_HZ: f32 = 90.0;

/// Asks for the best rate, if there is a choice; the rate asked for, in images per second.
pub(in crate::xr) fn request(session: &xr::Session<xr::Vulkan>) -> Option<f32> {
    let offered = session.enumerate_display_refresh_rates().ok()?;
    let rate_hz = choose(&offered)?;
    if let Err(code) = session.request_display_refresh_rate(rate_hz) {
        log::warn!("the headset refuses {rate_hz} Hz: {code:?}");
        return session.get_display_refresh_rate().ok();
    }
    Some(rate_hz)
}

/// The wanted rate if it is among those `offered`, else the highest.
fn choose(offered: &[f32]) -> Option<f32> {
    let wanted = offered.iter().copied().find(|rate| (rate - WANTED_HZ).abs() < 0.5);
    wanted.or_else(|| offered.iter().copied().max_by(f32::total_cmp))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ninety_or_the_most() {
        assert_eq!(choose(&[60.0, 72.0, 80.0, 90.0, 120.0]), Some(90.0));
        assert_eq!(choose(&[72.0, 89.95, 120.0]), Some(89.95));
        assert_eq!(choose(&[60.0, 72.0]), Some(72.0));
        assert_eq!(choose(&[]), None);
    }
}
