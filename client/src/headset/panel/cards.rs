//! Cards above the console: a notice, and a page of statistics or of the buttons.

use egui::text::LayoutJob;
use egui::{Align2, Painter, Rect, Ui, pos2, vec2};

use super::console;
use super::quad::SIZE;
use super::state::{Notice, Page, PanelState};
use super::style;
use super::symbols::{Symbol, draw_working, rect};
use super::widgets::{State, card, fitted, symbol_button};
use crate::headset::interaction::{BUTTONS, Command, GESTURES};

/// Gap between cards, and margin of their contents, in points.
const GAP: f32 = 10.0;
const MARGIN: f32 = 24.0;

/// Text size of a notice, and its most lines.
const NOTICE_TEXT: f32 = 22.0;
const NOTICE_LINES: usize = 4;

/// Height of the progress bar.
const BAR: f32 = 10.0;

/// Height of a line of a page and of its title.
const LINE: f32 = 26.0;
const TITLE: f32 = 36.0;

/// Shows the notice directly above the console; returns its area.
pub(super) fn notice(ui: &Ui, notice: &Notice, time_s: f64, commands: &mut Vec<Command>) -> Rect {
    let (text, color, working, part) = match notice {
        Notice::Note(text) => (text, style::TEXT, false, None),
        Notice::Working { text, part } => (text, style::TEXT, true, *part),
        Notice::Error(text) => (text, style::ERROR, false, None),
    };
    let left = MARGIN + if working { 44.0 } else { 0.0 };
    let right = SIZE.x - MARGIN - if working { 0.0 } else { 68.0 };
    let mut job = LayoutJob::simple((*text).into(), style::font(NOTICE_TEXT), color, right - left);
    job.wrap.max_rows = NOTICE_LINES;
    job.wrap.break_anywhere = false;
    let galley = ui.painter().layout_job(job);
    let below = if part.is_some() { BAR + 14.0 } else { 0.0 };
    let height = galley.size().y.max(44.0) + below + 28.0;
    let bottom = console::AREA.top() - GAP;
    let area = Rect::from_min_max(pos2(0.0, bottom - height), pos2(SIZE.x, bottom));

    let painter = ui.painter();
    card(painter, area);
    let center_y = area.center().y - 0.5 * below;
    if working {
        draw_working(painter, pos2(MARGIN + 15.0, center_y), 14.0, time_s, style::ACCENT);
    } else {
        let close = Rect::from_center_size(pos2(SIZE.x - 16.0 - 26.0, center_y), vec2(52.0, 52.0));
        if symbol_button(ui, close, "Close", State::default(), Symbol::Close, 22.0) {
            commands.push(Command::Dismiss);
        }
    }
    let at = pos2(left, center_y - 0.5 * galley.size().y);
    painter.galley(at, galley, color);
    if let Some(part) = part {
        let track = rect(MARGIN, area.bottom() - 16.0 - BAR, SIZE.x - 2.0 * MARGIN, BAR);
        painter.rect_filled(track, 0.5 * BAR, style::BUTTON_HOVERED);
        // A bar narrower than high has no room for round ends.
        let done = (part.clamp(0.0, 1.0) * track.width()).max(BAR);
        painter.rect_filled(track.with_max_x(track.left() + done), 0.5 * BAR, style::ACCENT);
    }
    area
}

/// Shows a page with its lower edge at `bottom`; returns its area.
pub(super) fn page(ui: &Ui, page: Page, state: &PanelState, bottom: f32) -> Rect {
    let painter = ui.painter();
    match page {
        Page::Statistics => {
            let rows = state.statistics;
            // Two columns, each filled from the top.
            let half = rows.len().div_ceil(2);
            let area = page_area(painter, "Statistics", half, bottom);
            for (column, rows) in rows.chunks(half.max(1)).enumerate() {
                let lines = rows.iter().map(|(name, value)| (*name, value.as_str()));
                list(painter, area, column, 0.42, lines, [style::QUIET, style::TEXT]);
            }
            area
        }
        Page::Buttons => {
            let buttons = BUTTONS.iter().filter(|binding| !binding.label.is_empty());
            let buttons = buttons.map(|binding| (binding.label, binding.action));
            let lines = buttons.clone().count().max(GESTURES.len());
            let area = page_area(painter, "What the buttons do", lines, bottom);
            let colors = [style::ACCENT, style::TEXT];
            list(painter, area, 0, 0.44, buttons, colors);
            list(painter, area, 1, 0.53, GESTURES.into_iter(), colors);
            area
        }
    }
}

/// Draws an empty page for `lines` lines.
fn page_area(painter: &Painter, title: &str, lines: usize, bottom: f32) -> Rect {
    let height = 18.0 + TITLE + LINE * lines as f32 + 14.0;
    let area = Rect::from_min_max(pos2(0.0, (bottom - GAP - height).max(0.0)), pos2(SIZE.x, bottom - GAP));
    card(painter, area);
    let at = area.left_top() + vec2(MARGIN, 16.0);
    painter.text(at, Align2::LEFT_TOP, title, style::font(22.0), style::TEXT);
    area
}

/// Draws two columns of text in the left or right half of a page; the first takes the fraction `part` of it.
/// Lines without room are left out.
fn list<'a>(
    painter: &Painter,
    area: Rect,
    half: usize,
    part: f32,
    lines: impl Iterator<Item = (&'a str, &'a str)>,
    [first_color, second_color]: [egui::Color32; 2],
) {
    let width = 0.5 * SIZE.x - MARGIN - 8.0;
    let left = if half == 0 { MARGIN } else { 0.5 * SIZE.x + 8.0 };
    let top = area.top() + 18.0 + TITLE;
    let room = ((area.bottom() - 10.0 - top) / LINE) as usize;
    for (number, (first, second)) in lines.take(room).enumerate() {
        let y = top + LINE * number as f32;
        let column = |x: f32, text: &str, color, width: f32| {
            fitted(painter, pos2(x, y), Align2::LEFT_TOP, text, style::font(18.0), color, width);
        };
        column(left, first, first_color, part * width - 8.0);
        column(left + part * width, second, second_color, (1.0 - part) * width);
    }
}
