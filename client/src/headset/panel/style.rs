//! Colours and shapes of the panel: large and dark, with text that is legible at 1.5 arm's lengths.

use std::num::NonZeroUsize;

use egui::{Color32, Context, FontId, Theme};

/// Accent of the selection and of the played part.
pub(super) const ACCENT: Color32 = Color32::from_rgb(242, 142, 72);
/// Background of the selection: small areas, so that the clip stays the brightest.
pub(super) const CHOSEN: Color32 = Color32::from_rgb(84, 56, 38);
/// Text and symbols.
pub(super) const TEXT: Color32 = Color32::from_gray(228);
/// Secondary text.
pub(super) const QUIET: Color32 = Color32::from_gray(158);
/// Text of an error.
pub(super) const ERROR: Color32 = Color32::from_rgb(255, 138, 122);
/// Disabled controls.
pub(super) const DISABLED: Color32 = Color32::from_gray(92);
/// Background of the panel.
pub(super) const SURFACE: Color32 = Color32::from_rgb(22, 23, 27);
/// Background of a button: at rest, pointed at, pressed.
pub(super) const BUTTON: Color32 = Color32::from_rgb(42, 44, 50);
pub(super) const BUTTON_HOVERED: Color32 = Color32::from_rgb(66, 69, 78);
pub(super) const BUTTON_PRESSED: Color32 = Color32::from_rgb(92, 96, 108);

/// Radius of corners, in points.
pub(super) const CARD_RADIUS: f32 = 28.0;
pub(super) const BUTTON_RADIUS: f32 = 16.0;

/// Largest drift of a hand during a click, in points: pulling a trigger moves the ray.
const CLICK_DRIFT: f32 = 60.0;

/// Longest click in seconds.
const CLICK_S: f64 = 3.0;

/// Proportional text of a size in points.
pub(super) fn font(size: f32) -> FontId {
    FontId::proportional(size)
}

/// Text whose digits have one width.
pub(super) fn digits(size: f32) -> FontId {
    FontId::monospace(size)
}

/// Sets up a context for a panel.
pub(super) fn apply(ctx: &Context) {
    ctx.options_mut(|options| {
        // A pass consumes input and emits commands: one pass a frame.
        options.max_passes = NonZeroUsize::MIN;
        options.input_options.max_click_dist = CLICK_DRIFT;
        options.input_options.max_click_duration = CLICK_S;
    });
    ctx.set_theme(Theme::Dark);
    #[cfg(not(target_os = "android"))]
    crate::fonts::add_fallback(ctx);
}
