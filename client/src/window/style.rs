//! Colours and shapes of the controls: dark and translucent, so that the picture stays in charge.

use std::num::NonZeroUsize;

use egui::style::HandleShape;
use egui::{Color32, Context, CornerRadius, Frame, Margin, Shadow, Stroke, Theme, Visuals};

/// Marks what is chosen or already played.
pub(crate) const ACCENT: Color32 = Color32::from_rgb(242, 142, 72);

/// Text that is there to be looked up, not read.
pub(crate) const QUIET: Color32 = Color32::from_gray(150);

/// Text of an error.
pub(crate) const ERROR: Color32 = Color32::from_rgb(255, 128, 112);

const SURFACE: Color32 = Color32::from_rgb(22, 23, 27);
const TEXT: Color32 = Color32::from_gray(214);

/// Sets the look of everything that egui draws.
pub(crate) fn apply(ctx: &Context) {
    // A pass takes the input in and moves the clock: never two of them for a frame.
    ctx.options_mut(|options| options.max_passes = NonZeroUsize::MIN);
    ctx.set_theme(Theme::Dark);
    ctx.style_mut_of(Theme::Dark, |style| {
        style.visuals = visuals();
        style.spacing.item_spacing = egui::vec2(8.0, 6.0);
        style.spacing.button_padding = egui::vec2(8.0, 4.0);
        style.spacing.interact_size.y = 26.0;
        style.interaction.selectable_labels = false;
        style.interaction.tooltip_delay = 0.4;
    });
}

fn visuals() -> Visuals {
    let mut visuals = Visuals::dark();
    visuals.panel_fill = translucent(SURFACE);
    visuals.window_fill = SURFACE;
    visuals.window_stroke = Stroke::new(1.0, Color32::from_gray(52));
    visuals.window_shadow =
        Shadow { offset: [0, 4], blur: 16, spread: 0, color: Color32::from_black_alpha(110) };
    visuals.popup_shadow = visuals.window_shadow;
    visuals.selection.bg_fill = ACCENT.gamma_multiply(0.8);
    visuals.selection.stroke.color = Color32::WHITE;
    visuals.slider_trailing_fill = true;
    visuals.handle_shape = HandleShape::Circle;
    let widgets = &mut visuals.widgets;
    widgets.noninteractive.fg_stroke.color = TEXT;
    widgets.inactive.fg_stroke.color = TEXT;
    widgets.inactive.bg_fill = Color32::from_gray(62);
    widgets.inactive.weak_bg_fill = Color32::from_gray(40);
    widgets.hovered.weak_bg_fill = Color32::from_gray(58);
    widgets.hovered.bg_stroke = Stroke::NONE;
    widgets.active.bg_stroke = Stroke::NONE;
    for widget in [&mut widgets.inactive, &mut widgets.hovered, &mut widgets.active, &mut widgets.open] {
        widget.corner_radius = CornerRadius::same(5);
        widget.expansion = 0.0;
    }
    visuals
}

/// Background of what lies over the picture.
pub(crate) fn card() -> Frame {
    Frame::new()
        .fill(translucent(SURFACE))
        .corner_radius(CornerRadius::same(8))
        .inner_margin(Margin::symmetric(12, 10))
}

fn translucent(color: Color32) -> Color32 {
    Color32::from_rgba_unmultiplied(color.r(), color.g(), color.b(), 225)
}
