//! Widgets of the panel: cards, fitted text, and buttons with a symbol and a caption.

use egui::text::{LayoutJob, TextWrapping};
use egui::{Align2, Color32, FontId, Id, Painter, Pos2, Rect, Role, Sense, Ui, WidgetInfo, vec2};

use super::style;
use super::symbols::{self, Symbol};

/// Distance between neighbouring buttons, in points.
pub(super) const GAP: f32 = 6.0;

/// State of a button.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct State {
    /// Drawn as the present choice.
    pub(super) chosen: bool,
    /// Drawn as the main button.
    pub(super) primary: bool,
    /// Drawn as a warning.
    pub(super) warning: bool,
    /// Takes no presses.
    pub(super) disabled: bool,
}

/// Identifier of a button.
pub(super) fn id(name: &str) -> Id {
    Id::unique(("panel", name))
}

/// Draws a card with round corners.
pub(super) fn card(painter: &Painter, rect: Rect) {
    painter.rect_filled(rect, style::CARD_RADIUS, style::SURFACE.gamma_multiply(0.94));
}

/// Shows a button with the given `contents`, which draw in the colour that they are passed; returns whether it
/// was clicked.
pub(super) fn button(
    ui: &Ui,
    rect: Rect,
    name: &str,
    state: State,
    contents: impl FnOnce(&Painter, Color32),
) -> bool {
    let sense = if state.disabled { Sense::hover() } else { Sense::click() };
    let response = ui.interact(rect, id(name), sense);
    response.widget_info(|| WidgetInfo::selected(Role::Button, !state.disabled, state.chosen, name));
    let (fill, color) = match state {
        State { disabled: true, .. } => (style::BUTTON.gamma_multiply(0.5), style::DISABLED),
        _ if response.is_pointer_button_down_on() => (style::BUTTON_PRESSED, Color32::WHITE),
        State { warning: true, .. } => (style::ERROR, style::SURFACE),
        State { primary: true, .. } => (style::ACCENT, style::SURFACE),
        State { chosen: true, .. } => (style::CHOSEN, style::ACCENT),
        _ if response.hovered() => (style::BUTTON_HOVERED, Color32::WHITE),
        _ => (style::BUTTON, style::TEXT),
    };
    ui.painter().rect_filled(rect, style::BUTTON_RADIUS, fill);
    if response.hovered() && !state.disabled {
        let stroke = egui::Stroke::new(3.0, Color32::WHITE.gamma_multiply(0.8));
        ui.painter().rect_stroke(rect, style::BUTTON_RADIUS, stroke, egui::StrokeKind::Inside);
    }
    contents(ui.painter(), color);
    response.clicked()
}

/// A button with a symbol of `size` points.
pub(super) fn symbol_button(
    ui: &Ui,
    rect: Rect,
    name: &str,
    state: State,
    symbol: Symbol,
    size: f32,
) -> bool {
    button(ui, rect, name, state, |painter, color| symbols::draw(painter, symbol, rect.center(), size, color))
}

/// A button with a symbol above its name.
pub(super) fn tile(ui: &Ui, rect: Rect, name: &str, state: State, symbol: Symbol) -> bool {
    captioned_tile(ui, rect, name, name, state, symbol)
}

/// A tile with a caption that may change while its identity stays the same.
pub(super) fn captioned_tile(
    ui: &Ui,
    rect: Rect,
    name: &str,
    caption: &str,
    state: State,
    symbol: Symbol,
) -> bool {
    button(ui, rect, name, state, |painter, color| {
        symbols::draw(painter, symbol, rect.center() - vec2(0.0, 12.0), 28.0, color);
        let at = rect.center_bottom() - vec2(0.0, 20.0);
        fitted(painter, at, Align2::CENTER_CENTER, caption, style::font(16.0), color, rect.width() - 8.0);
    })
}

/// Draws one line of text, shrunk to `width`, but to three quarters of its size at most; beyond that it ends in
/// an ellipsis.
pub(super) fn fitted(
    painter: &Painter,
    at: Pos2,
    anchor: Align2,
    text: &str,
    font: FontId,
    color: Color32,
    width: f32,
) {
    let text = text.replace(char::is_control, " ");
    let mut galley = painter.layout_no_wrap(text.clone(), font.clone(), color);
    if galley.size().x > width {
        let size = font.size * (width / galley.size().x).max(0.75);
        let mut job = LayoutJob::simple_singleline(text, FontId { size, ..font }, color);
        job.wrap = TextWrapping::truncate_at_width(width);
        galley = painter.layout_job(job);
    }
    let rect = anchor.anchor_size(at, galley.size());
    painter.galley(rect.min, galley, color);
}
