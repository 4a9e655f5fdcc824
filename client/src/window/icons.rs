//! Buttons with symbols that are drawn, independent of fonts.

use egui::{Color32, Painter, Pos2, Rect, Response, Role, Sense, Ui, WidgetInfo, pos2, vec2};

/// The symbol of a button.
#[derive(Clone, Copy)]
pub(crate) enum Symbol {
    Play,
    Pause,
    StepBack,
    StepForward,
    PreviousClip,
    NextClip,
    Close,
    Sound,
    Muted,
}

/// A button with a symbol. `hint` is its tooltip and its label for screen readers.
pub(crate) fn symbol_button(ui: &mut Ui, symbol: Symbol, hint: &str) -> Response {
    let size = vec2(30.0, ui.spacing().interact_size.y);
    let (rect, response) = ui.allocate_exact_size(size, Sense::click());
    response.widget_info(|| WidgetInfo::labeled(Role::Button, ui.is_enabled(), hint));
    let visuals = ui.style().interact(&response);
    if response.hovered() || response.has_focus() {
        ui.painter().rect_filled(rect, visuals.corner_radius, visuals.weak_bg_fill);
    }
    draw(ui.painter(), symbol, rect.center(), visuals.fg_stroke.color);
    response.on_hover_text(hint)
}

fn draw(painter: &Painter, symbol: Symbol, center: Pos2, color: Color32) {
    let at = |x: f32, y: f32| pos2(center.x + x, center.y + y);
    let triangle = |from: f32, tip: f32| {
        let mut corners = vec![at(from, -7.0), at(tip, 0.0), at(from, 7.0)];
        if tip < from {
            corners.reverse();
        }
        painter.add(egui::Shape::convex_polygon(corners, color, egui::Stroke::NONE));
    };
    let bar = |x: f32, width: f32| {
        painter.rect_filled(Rect::from_center_size(at(x, 0.0), vec2(width, 14.0)), 1.0, color);
    };
    match symbol {
        Symbol::Play => triangle(-5.0, 8.0),
        Symbol::Pause => {
            bar(-4.0, 4.0);
            bar(4.0, 4.0);
        }
        Symbol::StepBack => {
            bar(-6.0, 3.0);
            triangle(6.0, -4.0);
        }
        Symbol::StepForward => {
            triangle(-6.0, 4.0);
            bar(6.0, 3.0);
        }
        Symbol::PreviousClip => {
            bar(-8.0, 2.0);
            triangle(0.0, -7.0);
            triangle(8.0, 1.0);
        }
        Symbol::NextClip => {
            triangle(-8.0, -1.0);
            triangle(0.0, 7.0);
            bar(8.0, 2.0);
        }
        Symbol::Sound | Symbol::Muted => loudspeaker(painter, matches!(symbol, Symbol::Muted), center, color),
        Symbol::Close => {
            let stroke = egui::Stroke::new(1.5, color);
            painter.line_segment([at(-4.0, -4.0), at(4.0, 4.0)], stroke);
            painter.line_segment([at(-4.0, 4.0), at(4.0, -4.0)], stroke);
        }
    }
}

/// A loudspeaker, with waves or a cross.
fn loudspeaker(painter: &Painter, is_muted: bool, center: Pos2, color: Color32) {
    let at = |x: f32, y: f32| pos2(center.x + x, center.y + y);
    let polygon = |corners: Vec<Pos2>| {
        painter.add(egui::Shape::convex_polygon(corners, color, egui::Stroke::NONE));
    };
    polygon(vec![at(-8.0, -3.0), at(-5.0, -3.0), at(-5.0, 3.0), at(-8.0, 3.0)]);
    polygon(vec![at(-5.0, -3.0), at(0.0, -7.0), at(0.0, 7.0), at(-5.0, 3.0)]);
    let stroke = egui::Stroke::new(1.5, color);
    if is_muted {
        painter.line_segment([at(3.0, -3.0), at(9.0, 3.0)], stroke);
        painter.line_segment([at(3.0, 3.0), at(9.0, -3.0)], stroke);
        return;
    }
    for radius in [4.0f32, 8.0] {
        let point = |i: i16| {
            let angle = f32::from(i) * 0.14;
            at(1.0 + radius * angle.cos(), radius * angle.sin())
        };
        painter.add(egui::Shape::line((-6..=6).map(point).collect(), stroke));
    }
}
