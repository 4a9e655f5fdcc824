//! Symbols of the panel, drawn as shapes, so that no font has to contain them.

use std::f32::consts::TAU;

use egui::{Color32, Painter, Pos2, Rect, Shape, Stroke, StrokeKind, Vec2, pos2, vec2};

/// Symbol of a button.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Symbol {
    Play,
    Pause,
    StepBack,
    StepForward,
    Less,
    More,
    Loop,
    Reverse,
    Next,
    Statistics,
    Room,
    Recentre,
    Buttons,
    Exit,
    Close,
    Sound,
    Muted,
}

/// Draws `symbol` about `center`, in a square of side `size` points.
// Long: one arm a symbol.
pub(super) fn draw(painter: &Painter, symbol: Symbol, center: Pos2, size: f32, color: Color32) {
    // Coordinates from -1 to 1, y down.
    let at = |x: f32, y: f32| center + 0.5 * size * vec2(x, y);
    let stroke = Stroke::new(0.09 * size, color);
    let polygon = |corners: &[[f32; 2]]| {
        let corners = corners.iter().map(|&[x, y]| at(x, y)).collect();
        painter.add(Shape::convex_polygon(corners, color, Stroke::NONE));
    };
    let bar = |[x0, y0]: [f32; 2], [x1, y1]: [f32; 2]| {
        painter.rect_filled(Rect::from_min_max(at(x0, y0), at(x1, y1)), 0.05 * size, color);
    };
    let line = |points: &[[f32; 2]]| {
        painter.add(Shape::line(points.iter().map(|&[x, y]| at(x, y)).collect(), stroke));
    };
    // Arc about the center, angles clockwise from the right.
    let arc = |radius: f32, from: f32, to: f32| {
        let points = (0..=24).map(|i| {
            let angle = from + (to - from) * i as f32 / 24.0;
            center + 0.5 * size * radius * Vec2::angled(angle)
        });
        painter.add(Shape::line(points.collect(), stroke));
    };
    match symbol {
        Symbol::Play => polygon(&[[-0.6, -0.85], [0.85, 0.0], [-0.6, 0.85]]),
        Symbol::Pause => {
            bar([-0.65, -0.8], [-0.2, 0.8]);
            bar([0.2, -0.8], [0.65, 0.8]);
        }
        Symbol::StepBack => {
            bar([-0.8, -0.7], [-0.5, 0.7]);
            polygon(&[[0.75, -0.75], [0.75, 0.75], [-0.4, 0.0]]);
        }
        Symbol::StepForward => {
            polygon(&[[-0.75, -0.75], [0.4, 0.0], [-0.75, 0.75]]);
            bar([0.5, -0.7], [0.8, 0.7]);
        }
        Symbol::Less => bar([-0.65, -0.11], [0.65, 0.11]),
        Symbol::More => {
            bar([-0.65, -0.11], [0.65, 0.11]);
            bar([-0.11, -0.65], [0.11, 0.65]);
        }
        Symbol::Loop => {
            arc(0.72, 0.08 * TAU, 0.92 * TAU);
            polygon(&[[0.25, -0.5], [0.95, -0.78], [0.9, -0.05]]);
        }
        Symbol::Reverse => {
            polygon(&[[0.9, -0.65], [0.0, 0.0], [0.9, 0.65]]);
            polygon(&[[0.1, -0.65], [-0.8, 0.0], [0.1, 0.65]]);
        }
        Symbol::Next => {
            polygon(&[[-0.9, -0.65], [0.0, 0.0], [-0.9, 0.65]]);
            polygon(&[[-0.1, -0.65], [0.8, 0.0], [-0.1, 0.65]]);
        }
        Symbol::Statistics => {
            bar([-0.8, 0.05], [-0.4, 0.8]);
            bar([-0.2, -0.8], [0.2, 0.8]);
            bar([0.4, -0.35], [0.8, 0.8]);
        }
        Symbol::Room => {
            // An eye.
            let lid = |side: f32| -> Vec<Pos2> {
                (0..=16)
                    .map(|i| {
                        let x = -1.0 + i as f32 / 8.0;
                        at(x, side * 0.62 * (1.0 - x * x))
                    })
                    .collect()
            };
            painter.add(Shape::line(lid(-1.0), stroke));
            painter.add(Shape::line(lid(1.0), stroke));
            painter.circle_filled(center, 0.14 * size, color);
        }
        Symbol::Recentre => {
            arc(0.5, 0.0, TAU);
            for (x, y) in [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)] {
                line(&[[0.5 * x, 0.5 * y], [x, y]]);
            }
        }
        Symbol::Buttons => {
            // A controller's face: a stick and two buttons.
            let body = Rect::from_center_size(center, size * vec2(1.0, 0.78));
            painter.rect_stroke(body, 0.32 * size, stroke, StrokeKind::Inside);
            painter.circle_filled(at(-0.42, 0.0), 0.12 * size, color);
            painter.circle_filled(at(0.25, 0.22), 0.07 * size, color);
            painter.circle_filled(at(0.55, -0.22), 0.07 * size, color);
        }
        Symbol::Exit => {
            // A door with an arrow out of it.
            line(&[[0.05, -0.8], [-0.75, -0.8], [-0.75, 0.8], [0.05, 0.8]]);
            line(&[[-0.25, 0.0], [0.6, 0.0]]);
            polygon(&[[0.45, -0.42], [0.95, 0.0], [0.45, 0.42]]);
        }
        Symbol::Sound | Symbol::Muted => {
            // A loudspeaker, with waves or a cross.
            polygon(&[[-0.9, -0.3], [-0.5, -0.3], [-0.5, 0.3], [-0.9, 0.3]]);
            polygon(&[[-0.5, -0.3], [0.0, -0.75], [0.0, 0.75], [-0.5, 0.3]]);
            match symbol {
                Symbol::Muted => {
                    line(&[[0.3, -0.3], [0.9, 0.3]]);
                    line(&[[0.3, 0.3], [0.9, -0.3]]);
                }
                _ => {
                    arc(0.45, -0.12 * TAU, 0.12 * TAU);
                    arc(0.85, -0.12 * TAU, 0.12 * TAU);
                }
            }
        }
        Symbol::Close => {
            line(&[[-0.6, -0.6], [0.6, 0.6]]);
            line(&[[-0.6, 0.6], [0.6, -0.6]]);
        }
    }
}

/// Draws a turning arc about `center`, for work under way.
pub(super) fn draw_working(painter: &Painter, center: Pos2, radius: f32, time_s: f64, color: Color32) {
    let start = (time_s * 0.9).fract() as f32 * TAU;
    let points = (0..=24).map(|i| center + radius * Vec2::angled(start + 0.7 * TAU * i as f32 / 24.0));
    painter.add(Shape::line(points.collect(), Stroke::new(0.24 * radius, color)));
}

/// A `Rect` of `width` x `height` with its upper left corner at `(x, y)`.
pub(super) fn rect(x: f32, y: f32, width: f32, height: f32) -> Rect {
    Rect::from_min_size(pos2(x, y), vec2(width, height))
}
