//! Overlays on the picture: statistics, the list of keys, a message, and a hint while a file is dragged over
//! the window.

use egui::{Align2, Area, Color32, Context, Grid, Id, Order, RichText, Spinner, Ui, vec2};

use super::icons::{Symbol, symbol_button};
use super::keys::{CAMERA, PLAYING, WINDOW};
use super::style;
use crate::notes::below;

/// Seconds until a note disappears: to notice it, and to read its characters.
const NOTICE_S: f64 = 3.0;
const READ_S: f64 = 1.0 / 15.0;

/// What is said to the viewer.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Message {
    /// Disappears once it can have been read: at `until_s` of the interface's time, `None` before it is shown.
    Note { text: String, until_s: Option<f64> },
    /// Stays until replaced.
    Working(String),
    /// Stays until dismissed.
    Error(String),
}

impl Message {
    /// A note in place of `shown`. Notes that are being read stay above it; below an error it
    /// stays as the error does.
    pub(crate) fn note(shown: Option<Message>, text: String) -> Message {
        match shown {
            Some(Message::Error(shown)) => Message::Error(below(&shown, &text)),
            Some(Message::Note { text: shown, .. }) => {
                Message::Note { text: below(&shown, &text), until_s: None }
            }
            Some(Message::Working(_)) | None => Message::Note { text, until_s: None },
        }
    }

    /// An error in place of `shown`. Notes that are being read and other errors stay above it.
    pub(crate) fn error(shown: Option<Message>, text: String) -> Message {
        match shown {
            Some(Message::Error(shown) | Message::Note { text: shown, .. }) => {
                Message::Error(below(&shown, &text))
            }
            Some(Message::Working(_)) | None => Message::Error(text),
        }
    }
}

/// Shows the message above the bar; removes it when it expires or is dismissed.
pub(crate) fn message(ctx: &Context, bar_height: f32, message: &mut Option<Message>) {
    let now_s = ctx.input(|input| input.time);
    if let Some(Message::Note { text, until_s }) = message {
        let read_s = NOTICE_S + READ_S * text.chars().count() as f64;
        let until_s = *until_s.get_or_insert(now_s + read_s);
        if now_s >= until_s {
            *message = None;
        } else {
            ctx.request_repaint_after_secs((until_s - now_s) as f32);
        }
    }
    let Some(current) = message.clone() else { return };
    let mut dismissed = false;
    card(ctx, "message", Align2::CENTER_BOTTOM, vec2(0.0, -bar_height - 14.0), |ui| {
        ui.set_max_width((ctx.content_rect().width() - 80.0).clamp(120.0, 620.0));
        ui.horizontal(|ui| {
            let (text, color) = match current {
                Message::Note { text, .. } => (text, ui.visuals().text_color()),
                Message::Working(text) => {
                    ui.add(Spinner::new().size(14.0));
                    (text, ui.visuals().text_color())
                }
                Message::Error(text) => (text, style::ERROR),
            };
            ui.add(egui::Label::new(RichText::new(text).color(color)).wrap());
            dismissed = symbol_button(ui, Symbol::Close, "Close (Esc)").clicked();
        });
    });
    if dismissed {
        *message = None;
    }
}

/// Shows rows of names and values in the top left corner.
pub(crate) fn statistics(ctx: &Context, rows: &[(&str, String)]) {
    card(ctx, "statistics", Align2::LEFT_TOP, vec2(12.0, 12.0), |ui| {
        ui.spacing_mut().interact_size.y = 0.0;
        Grid::new("statistics").num_columns(2).spacing(vec2(14.0, 3.0)).show(ui, |ui| {
            for (name, value) in rows {
                ui.label(RichText::new(*name).size(11.5).color(style::QUIET));
                ui.label(RichText::new(value).monospace().size(11.5));
                ui.end_row();
            }
        });
    });
}

/// Shows the list of keys in the centre.
pub(crate) fn keys(ctx: &Context) {
    card(ctx, "keys", Align2::CENTER_CENTER, vec2(0.0, -24.0), |ui| {
        ui.spacing_mut().interact_size.y = 0.0;
        ui.horizontal_top(|ui| {
            key_list(ui, "Playing", PLAYING.iter().map(|binding| (binding.label, binding.action)));
            ui.add_space(18.0);
            key_list(ui, "Camera", CAMERA.into_iter());
            ui.add_space(18.0);
            key_list(ui, "Window", WINDOW.iter().map(|binding| (binding.label, binding.action)));
        });
    });
}

fn key_list<'a>(ui: &mut Ui, title: &str, lines: impl Iterator<Item = (&'a str, &'a str)>) {
    ui.vertical(|ui| {
        ui.label(RichText::new(title).strong());
        ui.add_space(2.0);
        Grid::new(title).num_columns(2).spacing(vec2(12.0, 4.0)).show(ui, |ui| {
            for (keys, action) in lines {
                ui.label(RichText::new(keys).color(style::ACCENT));
                ui.label(action);
                ui.end_row();
            }
        });
    });
}

/// Shows a hint over the window while a file is dragged over it.
pub(crate) fn drop_hint(ctx: &Context) {
    let layer = egui::LayerId::new(Order::Foreground, Id::unique("drop hint"));
    let (rect, painter) = (ctx.content_rect(), ctx.layer_painter(layer));
    painter.rect_filled(rect, 0.0, Color32::from_black_alpha(150));
    let font = egui::FontId::proportional(22.0);
    painter.text(rect.center(), Align2::CENTER_CENTER, "Drop a clip to play it", font, Color32::WHITE);
}

fn card(ctx: &Context, id: &str, anchor: Align2, offset: egui::Vec2, contents: impl FnOnce(&mut Ui)) {
    Area::new(Id::unique(id)).order(Order::Middle).anchor(anchor, offset).show(ctx, |ui| {
        style::card().show(ui, contents);
    });
}
