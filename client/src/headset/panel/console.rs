//! The lower part of the panel: timeline, transport, quality, and tiles for the rest.

use egui::{Align2, Color32, Painter, Rect, Sense, Ui, WidgetInfo, pos2, vec2};

use super::quad::{CONSOLE_HEIGHT, SIZE};
use super::state::{Page, PanelState};
use super::style;
use super::symbols::{Symbol, rect};
use super::widgets::{GAP, State, button, captioned_tile, card, fitted, id, symbol_button, tile};
use crate::clock::Clock;
use crate::headset::interaction::Command;

/// Margin of the card in points.
const MARGIN: f32 = 24.0;
const INNER: f32 = SIZE.x - 2.0 * MARGIN;

/// Upper edges of the rows, from the upper edge of the card.
const TITLE_Y: f32 = 18.0;
const TIMELINE_Y: f32 = 58.0;
const TIMES_Y: f32 = 116.0;
const TRANSPORT_Y: f32 = 156.0;
const TILES_Y: f32 = 248.0;

const ROW: f32 = 80.0;
const TILE_WIDTH: f32 = 88.0;

/// The area that the console covers.
pub(super) const AREA: Rect = Rect { min: pos2(0.0, SIZE.y - CONSOLE_HEIGHT), max: pos2(SIZE.x, SIZE.y) };

/// The open page, and whether "Exit" waits for its second press.
#[derive(Clone, Copy, Debug)]
pub(super) struct OpenParts {
    pub(super) page: Option<Page>,
    /// The next press of "Exit" leaves.
    pub(super) leaving: bool,
}

/// Effects of a frame of the console besides commands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Done {
    /// A hand holds the timeline.
    pub(super) scrubbing: bool,
    pub(super) exit_pressed: bool,
}

/// Shows the console; its buttons append to `commands`.
pub(super) fn show(ui: &Ui, state: &PanelState, open: OpenParts, commands: &mut Vec<Command>) -> Done {
    card(ui.painter(), AREA);
    let top = AREA.top();
    let at = pos2(MARGIN, top + TITLE_Y);
    fitted(ui.painter(), at, Align2::LEFT_TOP, state.title, style::font(25.0), style::TEXT, INNER);
    let scrubbing =
        timeline(ui, rect(MARGIN, top + TIMELINE_Y, INNER, TIMES_Y - TIMELINE_Y), state, commands);
    if state.has_timeline() {
        times(ui.painter(), top + TIMES_Y, state.clock);
    }
    transport(ui, top + TRANSPORT_Y, state, commands);
    let exit_pressed = tiles(ui, top + TILES_Y, state, open, commands);
    Done { scrubbing, exit_pressed }
}

/// Shows the track over the whole clip; returns whether a hand holds it.
fn timeline(ui: &Ui, area: Rect, state: &PanelState, commands: &mut Vec<Command>) -> bool {
    let (clock, is_static) = (state.clock, !state.has_timeline());
    let response = ui.interact(area, id("Timeline"), if is_static { Sense::hover() } else { Sense::drag() });
    response.widget_info(|| WidgetInfo::slider(!is_static, clock.position_s(), "Timeline"));
    let held = response.is_pointer_button_down_on();
    let radius = if held { 20.0 } else { 16.0 };
    // The handle stays on the track at both ends.
    let (left, right) = (area.left() + 16.0, area.right() - 16.0);
    let mut part = clock.clip_time() as f32;
    if let (true, Some(pointer)) = (held, response.interact_pointer_pos()) {
        part = ((pointer.x - left) / (right - left)).clamp(0.0, 1.0);
        commands.push(Command::Seek(f64::from(part) * clock.duration_s()));
    }
    let (painter, y) = (ui.painter(), area.center().y);
    let handle = pos2(left + part * (right - left), y);
    let track = Rect::from_x_y_ranges(left - 8.0..=right + 8.0, y - 7.0..=y + 7.0);
    let hovered = response.hovered() || held;
    painter.rect_filled(track, 7.0, if hovered { style::BUTTON_PRESSED } else { style::BUTTON_HOVERED });
    let x = |seconds: f64| left + (right - left) * (seconds / clock.duration_s()) as f32;
    for &(from_s, to_s) in state.buffered.iter().filter(|_| !is_static) {
        let mark = Rect::from_x_y_ranges(x(from_s)..=x(to_s), track.bottom() + 4.0..=track.bottom() + 8.0);
        painter.rect_filled(mark, 2.0, style::ACCENT.gamma_multiply(0.6));
    }
    if !is_static {
        painter.rect_filled(track.with_max_x(handle.x), 7.0, style::ACCENT);
        painter.circle_filled(handle, radius, if hovered { Color32::WHITE } else { style::TEXT });
    }
    held
}

/// Position, frame and length below the ends of the track.
fn times(painter: &Painter, y: f32, clock: &Clock) {
    let long = clock.duration_s() >= 60.0;
    let (left, right) = (MARGIN + 8.0, SIZE.x - MARGIN - 8.0);
    let text = |x, anchor, text: String, color| {
        painter.text(pos2(x, y), anchor, text, style::digits(21.0), color);
    };
    text(left, Align2::LEFT_TOP, time_text(clock.position_s(), long), style::TEXT);
    text(right, Align2::RIGHT_TOP, time_text(clock.duration_s(), long), style::QUIET);
    let frames = format!("frame {} / {}", clock.frame(), clock.last_frame());
    text(0.5 * SIZE.x, Align2::CENTER_TOP, frames, style::QUIET);
}

/// Formats hundredths of a second, with minutes if the clip has some: `1.25 s`, `0:59.20`.
pub(super) fn time_text(seconds: f64, minutes: bool) -> String {
    if !minutes {
        return format!("{seconds:.2} s");
    }
    let hundredths = (seconds * 100.0).round() as u64;
    format!("{}:{:02}.{:02}", hundredths / 6000, hundredths / 100 % 60, hundredths % 100)
}

fn transport(ui: &Ui, y: f32, state: &PanelState, commands: &mut Vec<Command>) {
    let clock = state.clock;
    let is_static = !state.has_timeline();
    let plain = State { disabled: is_static, ..State::default() };
    let mut press = |pressed: bool, command: Command| {
        if pressed {
            commands.push(command);
        }
    };

    let slower = rect(MARGIN, y, 64.0, ROW);
    let speed = rect(slower.right() + GAP, y, 80.0, ROW);
    let faster = rect(speed.right() + GAP, y, 64.0, ROW);
    press(symbol_button(ui, slower, "Slower", plain, Symbol::Less, 28.0), Command::Slower);
    let normal = button(ui, speed, "Speed", plain, |painter, color| {
        let text = format!("{}x", clock.speed());
        painter.text(speed.center() - vec2(0.0, 10.0), Align2::CENTER_CENTER, text, style::font(24.0), color);
        let at = speed.center_bottom() - vec2(0.0, 20.0);
        painter.text(at, Align2::CENTER_CENTER, "Speed", style::font(16.0), color);
    });
    press(normal, Command::NormalSpeed);
    press(symbol_button(ui, faster, "Faster", plain, Symbol::More, 28.0), Command::Faster);

    let play = Rect::from_center_size(pos2(0.5 * SIZE.x, y + 0.5 * ROW), vec2(116.0, ROW));
    let back = rect(play.left() - GAP - 72.0, y, 72.0, ROW);
    let on = rect(play.right() + GAP, y, 72.0, ROW);
    press(symbol_button(ui, back, "Frame back", plain, Symbol::StepBack, 32.0), Command::StepBack);
    let symbol = if clock.is_playing() { Symbol::Pause } else { Symbol::Play };
    let primary = State { primary: true, ..plain };
    press(symbol_button(ui, play, "Play", primary, symbol, 44.0), Command::TogglePlaying);
    press(symbol_button(ui, on, "Frame on", plain, Symbol::StepForward, 32.0), Command::StepForward);

    let mut right = SIZE.x - MARGIN;
    let [next, repeat, reverse] = [(); 3].map(|()| {
        let area = rect(right - 76.0, y, 76.0, ROW);
        right = area.left() - GAP;
        area
    });
    let reversed = State { chosen: clock.is_reversed() && !is_static, ..plain };
    press(tile(ui, reverse, "Reverse", reversed, Symbol::Reverse), Command::ToggleReverse);
    let looping = State { chosen: clock.is_looping() && !is_static, ..plain };
    press(tile(ui, repeat, "Loop", looping, Symbol::Loop), Command::ToggleLoop);
    let has_next = State { disabled: !state.has_next, ..State::default() };
    press(tile(ui, next, "Next clip", has_next, Symbol::Next), Command::NextClip);
}

/// Shows the quality on the left and tiles on the right; returns whether "Exit" was pressed.
fn tiles(ui: &Ui, y: f32, state: &PanelState, open: OpenParts, commands: &mut Vec<Command>) -> bool {
    let mut x = SIZE.x - MARGIN;
    let mut place = || {
        x -= TILE_WIDTH;
        let area = rect(x, y, TILE_WIDTH, ROW);
        x -= GAP;
        area
    };
    let chosen = |chosen: bool| State { chosen, ..State::default() };
    let leaving = State { warning: open.leaving, ..State::default() };
    let caption = if open.leaving { "Sure?" } else { "Exit" };
    let exit = captioned_tile(ui, place(), "Exit", caption, leaving, Symbol::Exit);
    let mut toggle = |area: Rect, name: &str, symbol: Symbol, on: bool, command: Command| {
        if tile(ui, area, name, chosen(on), symbol) {
            commands.push(command);
        }
    };
    toggle(place(), "Recentre", Symbol::Recentre, false, Command::Recentre);
    if let Some((_, is_muted)) = state.volume {
        let symbol = if is_muted { Symbol::Muted } else { Symbol::Sound };
        toggle(place(), "Sound", symbol, !is_muted, Command::ToggleMuted);
    }
    if let Some(on) = state.passthrough {
        toggle(place(), "Room", Symbol::Room, on, Command::TogglePassthrough);
    }
    let page = |page| open.page == Some(page);
    toggle(place(), "Buttons", Symbol::Buttons, page(Page::Buttons), Command::ToggleButtons);
    toggle(place(), "Statistics", Symbol::Statistics, page(Page::Statistics), Command::ToggleStatistics);
    quality(ui, Rect::from_min_max(pos2(MARGIN, y), pos2(x - GAP, y + ROW)), state, commands);
    exit
}

/// Shows the quality in use between the buttons that lower and raise it.
fn quality(ui: &Ui, area: Rect, state: &PanelState, commands: &mut Vec<Command>) {
    let Some(name) = state.qualities.get(state.quality) else { return };
    let coarser = rect(area.left(), area.top(), 64.0, ROW);
    let better = rect(area.right() - 64.0, area.top(), 64.0, ROW);
    let at_bottom = State { disabled: state.quality + 1 == state.qualities.len(), ..State::default() };
    let at_top = State { disabled: state.quality == 0, ..State::default() };
    if symbol_button(ui, coarser, "Coarser", at_bottom, Symbol::Less, 28.0) {
        commands.push(Command::Coarser);
    }
    if symbol_button(ui, better, "Better", at_top, Symbol::More, 28.0) {
        commands.push(Command::Better);
    }

    let painter = ui.painter();
    let field = Rect::from_min_max(coarser.right_top(), better.left_bottom()).shrink2(vec2(GAP, 0.0));
    painter.rect_filled(field, style::BUTTON_RADIUS, style::BUTTON.gamma_multiply(0.5));
    let place = |y: f32| pos2(field.center().x, field.top() + y);
    let width = field.width() - 16.0;
    fitted(painter, place(24.0), Align2::CENTER_CENTER, name, style::font(24.0), style::TEXT, width);
    // One mark for each level, lit up to the level in use.
    let (count, lit) = (state.qualities.len(), state.qualities.len() - state.quality);
    for number in 0..count {
        let x = 14.0 * (number as f32 - 0.5 * (count - 1) as f32);
        let color = if number < lit { style::ACCENT } else { style::BUTTON_HOVERED };
        painter.circle_filled(place(45.0) + vec2(x, 0.0), 4.0, color);
    }
    let (caption, color) =
        if state.lowered { ("Lowered for speed", style::TEXT) } else { ("Quality", style::QUIET) };
    fitted(painter, place(64.0), Align2::CENTER_CENTER, caption, style::font(16.0), color, width);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_have_minutes_where_the_clip_has() {
        assert_eq!(time_text(1.254, false), "1.25 s");
        assert_eq!(time_text(0.0, true), "0:00.00");
        assert_eq!(time_text(59.999, true), "1:00.00");
        assert_eq!(time_text(83.5, true), "1:23.50");
    }
}
