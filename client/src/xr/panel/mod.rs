//! [`Panel`]: the controls in the headset, on a quad that controllers point at.
//!
//! It knows the interface library but neither runtime nor GPU: hands come in, commands and
//! triangles go out, so that its tests point at buttons and look at the clock. The quad is shown
//! as a quad layer with its [`PanelQuad::pose`] and size; its image has display-referred, premultiplied
//! colours and begins as nothing, all zeros.

mod cards;
mod console;
mod pointer;
mod quad;
mod ray;
mod style;
mod symbols;
mod widgets;

use std::hash::{DefaultHasher, Hash, Hasher};

use egui::epaint::ClippedPrimitive;
use egui::{
    Color32, Context, Event, Pos2, RawInput, Rect, Stroke, TexturesDelta, Ui, ViewportId, ViewportInfo,
};

pub use quad::{PIXELS_PER_POINT, PanelQuad, SIZE};
pub use ray::PointerRay;

use super::interaction::{Command, Haptics, Inputs, Pose, Side};
use crate::player::Player;
use pointer::Pointer;

/// Seconds for which "Exit" waits to be pressed again.
const LEAVING_S: f64 = 4.0;

/// Pictures of the timeline per second: more would be drawn for the eye of a needle.
const TIMELINE_RATE: f64 = 30.0;

/// One line, or a few, for the viewer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Notice<'a> {
    /// Something to know.
    Note(&'a str),
    /// Something takes a while.
    Working {
        /// What it is.
        text: &'a str,
        /// How much of it is done, 0 to 1, if that is known.
        part: Option<f32>,
    },
    /// Something went wrong.
    Error(&'a str),
}

/// What the panel shows.
#[derive(Clone, Copy, Debug)]
pub struct PanelState<'a> {
    /// Name of the clip.
    pub title: &'a str,
    /// Its clock.
    pub player: &'a Player,
    /// Names of the qualities to choose from, the best one first; may be empty.
    pub qualities: &'a [&'a str],
    /// Number of the present one.
    pub quality: usize,
    /// Whether the GPU does not keep up with the one that was chosen.
    pub lowered: bool,
    /// Whether the room is seen; `None` where the headset cannot show it.
    pub passthrough: Option<bool>,
    /// Whether there is another clip to play.
    pub has_next: bool,
    /// Rows of names and values.
    pub statistics: &'a [(&'a str, String)],
    /// Something to tell.
    pub notice: Option<Notice<'a>>,
}

/// What lies above the console.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Page {
    Statistics,
    Buttons,
}

/// A picture of the panel.
#[must_use = "later ones draw with what this one says of textures"]
pub struct Painting {
    triangles: Vec<ClippedPrimitive>,
    textures: TexturesDelta,
}

impl Painting {
    /// Size of the image in pixels.
    pub const SIZE: [u32; 2] = [(SIZE.x * PIXELS_PER_POINT) as u32, (SIZE.y * PIXELS_PER_POINT) as u32];

    /// What to draw, and what changed in the textures since the painting before, which must be
    /// brought up to date first.
    pub fn into_parts(mut self) -> (Vec<ClippedPrimitive>, TexturesDelta) {
        (std::mem::take(&mut self.triangles), std::mem::take(&mut self.textures))
    }
}

impl Drop for Painting {
    /// One that an error kept from being drawn was the panel's last: its textures go with it.
    fn drop(&mut self) {
        self.textures.clear();
    }
}

/// The panel.
pub struct Panel {
    ctx: Context,
    quad: PanelQuad,
    pointer: Pointer,
    /// For the next frame of the interface.
    events: Vec<Event>,
    /// A press ended without being meant since then.
    press_lost: bool,
    shown: bool,
    page: Option<Page>,
    /// When "Exit" no longer waits, if it does.
    leaving_until_s: Option<f64>,
    scrubbing: bool,
    /// Where something is drawn.
    occupied: Vec<Rect>,
    time_s: f64,
    /// What the last painting depended on; `None` where the next frame differs anyway.
    painted: Option<u64>,
}

impl Panel {
    /// A panel that is shown, in front of a viewer whose head is at `head`.
    pub fn new(head: &Pose) -> Panel {
        let ctx = Context::default();
        style::apply(&ctx);
        Panel {
            ctx,
            quad: PanelQuad::before(head),
            pointer: Pointer::default(),
            events: Vec::new(),
            press_lost: false,
            shown: true,
            page: None,
            leaving_until_s: None,
            scrubbing: false,
            occupied: vec![console::AREA],
            time_s: 0.0,
            painted: None,
        }
    }

    /// Takes in where the hands point; which of them, left then right, point at the panel.
    pub fn point(&mut self, inputs: &Inputs, haptics: &mut Haptics) -> [bool; 2] {
        if !self.shown {
            return [false; 2];
        }
        let pointing = self.pointer.update(inputs, &self.quad, &self.occupied, &mut self.events, haptics);
        self.press_lost |= pointing.lost;
        pointing.on_panel
    }

    /// The rays of the hands, left then right, for eyes at the pose `head`: to the panel where they
    /// meet it. None while it is not shown.
    pub fn rays(&self, inputs: &Inputs, head: &Pose) -> [Option<PointerRay>; 2] {
        Side::BOTH.map(|side| {
            let aim = inputs.aim(side).filter(|_| self.shown)?;
            let on_panel = |at: Pos2| self.occupied.iter().any(|area| area.contains(at));
            let hit = self.quad.hit(&aim).filter(|hit| on_panel(hit.at));
            PointerRay::new(&aim, hit.map(|hit| hit.distance_m), head.position)
        })
    }

    /// Lets the panel see a command, its own or that of a button; whether it was for it alone.
    pub fn apply(&mut self, command: Command, head: &Pose) -> bool {
        let toggled = |page| if self.page == Some(page) { None } else { Some(page) };
        match command {
            Command::TogglePanel => {
                self.shown = !self.shown;
                self.place(head);
                if !self.shown {
                    self.pointer.leave(&mut self.events);
                    self.press_lost = true;
                    self.scrubbing = false;
                    self.leaving_until_s = None;
                }
            }
            Command::ToggleStatistics => self.page = toggled(Page::Statistics),
            Command::ToggleButtons => self.page = toggled(Page::Buttons),
            Command::Recentre => {
                self.place(head);
                return false;
            }
            _ => return false,
        }
        true
    }

    /// Puts it in front of a viewer whose head is at `head`.
    pub fn place(&mut self, head: &Pose) {
        self.quad = PanelQuad::before(head);
    }

    /// Where it is.
    pub fn quad(&self) -> &PanelQuad {
        &self.quad
    }

    /// Whether it is to be seen.
    pub fn is_shown(&self) -> bool {
        self.shown
    }

    /// Whether the timeline is held: the clock must then not advance by itself.
    pub fn is_scrubbing(&self) -> bool {
        self.scrubbing
    }

    /// A frame of the interface, `elapsed_s` seconds after the one before: what was pressed goes to
    /// `commands`. Gives a new picture where something on it changed.
    pub fn frame(
        &mut self,
        state: &PanelState,
        elapsed_s: f64,
        commands: &mut Vec<Command>,
    ) -> Option<Painting> {
        self.time_s += if elapsed_s.is_finite() { elapsed_s.max(0.0) } else { 0.0 };
        self.leaving_until_s = self.leaving_until_s.filter(|&until_s| self.time_s < until_s);
        let depends_on = self.depends_on(state);
        if !self.shown || self.events.is_empty() && self.painted == Some(depends_on) {
            return None;
        }

        let viewport = ViewportInfo { native_pixels_per_point: Some(PIXELS_PER_POINT), ..Default::default() };
        let input = RawInput {
            viewports: [(ViewportId::ROOT, viewport)].into_iter().collect(),
            screen_rect: Some(Rect::from_min_size(Pos2::ZERO, SIZE)),
            time: Some(self.time_s),
            focused: true,
            events: std::mem::take(&mut self.events),
            ..RawInput::default()
        };
        let (ctx, pressed) = (self.ctx.clone(), commands.len());
        let output = ctx.run_ui(input, |ui| self.contents(ui, state, commands));
        if std::mem::take(&mut self.press_lost) {
            // The hand went away in the middle of a press: nothing was meant by its end.
            commands.truncate(pressed);
            self.leaving_until_s = None;
        }
        let animated = output
            .viewport_output
            .get(&ViewportId::ROOT)
            .is_some_and(|viewport| viewport.repaint_delay.is_zero());
        self.painted = (!animated && commands.len() == pressed).then_some(depends_on);
        let triangles = ctx.tessellate(output.shapes, output.pixels_per_point);
        Some(Painting { triangles, textures: output.textures_delta })
    }

    fn contents(&mut self, ui: &mut Ui, state: &PanelState, commands: &mut Vec<Command>) {
        self.occupied.clear();
        self.occupied.push(console::AREA);
        let mut top = console::AREA.top();
        if let Some(notice) = &state.notice {
            let area = cards::notice(ui, notice, self.time_s, commands);
            top = area.top();
            self.occupied.push(area);
            if matches!(notice, Notice::Working { .. }) {
                ui.ctx().request_repaint();
            }
        }
        if let Some(page) = self.page {
            self.occupied.push(cards::page(ui, page, state, top));
        }
        let shown = console::Shown { page: self.page, leaving: self.leaving_until_s.is_some() };
        let done = console::show(ui, state, shown, commands);
        self.scrubbing = done.scrubbing;
        if done.exit_pressed {
            match self.leaving_until_s.take() {
                Some(_) => commands.push(Command::Exit),
                None => self.leaving_until_s = Some(self.time_s + LEAVING_S),
            }
        }
        if let Some((at, pressing)) = self.pointer.at() {
            // A ring, so that what is pointed at stays to be seen.
            let painter = ui.painter();
            painter.circle_stroke(at, 11.0, Stroke::new(8.0, style::SURFACE));
            painter.circle_stroke(at, 11.0, Stroke::new(4.0, Color32::WHITE));
            if pressing {
                painter.circle_filled(at, 9.0, style::ACCENT);
            }
        }
    }

    /// A digest of what the picture shows besides the pointer.
    fn depends_on(&self, state: &PanelState) -> u64 {
        let mut hasher = DefaultHasher::new();
        let player = state.player;
        (self.page, self.leaving_until_s.is_some(), state.title).hash(&mut hasher);
        ((player.position_s() * TIMELINE_RATE) as u64, player.duration_s().to_bits()).hash(&mut hasher);
        (player.is_playing(), player.is_looping(), player.speed().to_bits()).hash(&mut hasher);
        (state.qualities, state.quality, state.lowered).hash(&mut hasher);
        (state.passthrough, state.has_next).hash(&mut hasher);
        if self.page == Some(Page::Statistics) {
            state.statistics.hash(&mut hasher);
        }
        match state.notice {
            None => 0.hash(&mut hasher),
            Some(Notice::Note(text)) => (1, text).hash(&mut hasher),
            Some(Notice::Working { text, part }) => (2, text, part.map(f32::to_bits)).hash(&mut hasher),
            Some(Notice::Error(text)) => (3, text).hash(&mut hasher),
        }
        hasher.finish()
    }
}

#[cfg(test)]
mod tests;
