//! Colours and shapes of the controls: dark and translucent, to leave attention to the picture.

use std::num::NonZeroUsize;

use egui::style::HandleShape;
use egui::{Color32, Context, CornerRadius, Frame, Margin, Shadow, Stroke, Theme, Visuals};

/// Colour of selections and of the played part of the timeline.
pub(crate) const ACCENT: Color32 = Color32::from_rgb(242, 142, 72);

/// Colour of secondary text.
pub(crate) const QUIET: Color32 = Color32::from_gray(150);

/// Colour of error messages.
pub(crate) const ERROR: Color32 = Color32::from_rgb(255, 128, 112);

const SURFACE: Color32 = Color32::from_rgb(22, 23, 27);
const TEXT: Color32 = Color32::from_gray(214);

/// Applies the style to an egui context.
pub(crate) fn apply(ctx: &Context) {
    // A pass handles input and advances the player: a second pass would do so twice.
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

/// Background of an overlay.
pub(crate) fn card() -> Frame {
    Frame::new()
        .fill(translucent(SURFACE))
        .corner_radius(CornerRadius::same(8))
        .inner_margin(Margin::symmetric(12, 10))
}

fn translucent(color: Color32) -> Color32 {
    Color32::from_rgba_unmultiplied(color.r(), color.g(), color.b(), 225)
}
