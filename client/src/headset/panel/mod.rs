//! [`Panel`]: the controls in the headset, on a quad that controllers point at.
//!
//! It knows the interface library but neither runtime nor GPU: hands come in, commands and triangles go out, so
//! that its tests point at buttons and look at the clock. A quad layer shows it with the pose and size of the
//! [`PanelQuad`]; the image is drawn in display-referred, premultiplied colours and starts fully transparent.

mod cards;
mod console;
mod pointer;
mod quad;
mod ray;
mod state;
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
pub use state::{Notice, PanelState};

use super::interaction::{Command, Haptics, Inputs, Pose, Side};
use pointer::Pointer;
use state::Page;

/// Seconds for which "Exit" waits for a second press.
const LEAVING_S: f64 = 4.0;

/// Pictures of the timeline per second; the handle moves too little for more.
const TIMELINE_RATE: f64 = 30.0;

/// A picture of the panel.
#[must_use = "later pictures use the textures of this one"]
pub struct Painting {
    triangles: Vec<ClippedPrimitive>,
    textures: TexturesDelta,
}

impl Painting {
    /// Size of the image in pixels.
    pub const SIZE: [u32; 2] = [(SIZE.x * PIXELS_PER_POINT) as u32, (SIZE.y * PIXELS_PER_POINT) as u32];

    /// The triangles, and the changes of textures since the painting before, which come first.
    pub fn into_parts(mut self) -> (Vec<ClippedPrimitive>, TexturesDelta) {
        (std::mem::take(&mut self.triangles), std::mem::take(&mut self.textures))
    }
}

impl Drop for Painting {
    /// A painting that an error leaves undrawn is the panel's last: its textures go with it.
    fn drop(&mut self) {
        self.textures.clear();
    }
}

/// The panel.
pub struct Panel {
    ctx: Context,
    quad: PanelQuad,
    pointer: Pointer,
    /// Events of the pointer for the next frame.
    events: Vec<Event>,
    /// Whether a press was interrupted since the last frame.
    press_lost: bool,
    visible: bool,
    page: Option<Page>,
    /// Time at which "Exit" stops waiting for its second press.
    leaving_until_s: Option<f64>,
    scrubbing: bool,
    /// Areas that are drawn on.
    occupied: Vec<Rect>,
    time_s: f64,
    /// Digest of the state of the last painting; `None` if the next frame differs anyway.
    painted: Option<u64>,
}

impl Panel {
    /// A visible panel in front of a viewer with the head at `head`.
    pub fn new(head: &Pose) -> Panel {
        let ctx = Context::default();
        style::apply(&ctx);
        Panel {
            ctx,
            quad: PanelQuad::before(head),
            pointer: Pointer::default(),
            events: Vec::new(),
            press_lost: false,
            visible: true,
            page: None,
            leaving_until_s: None,
            scrubbing: false,
            occupied: vec![console::AREA],
            time_s: 0.0,
            painted: None,
        }
    }

    /// Prepares for another image and painter: the next painting holds everything. The panel stays as it is.
    pub fn forget_picture(&mut self) {
        let ctx = Context::default();
        style::apply(&ctx);
        self.pointer.leave(&mut self.events);
        self.events.clear();
        (self.ctx, self.painted, self.press_lost, self.scrubbing) = (ctx, None, false, false);
    }

    /// Takes in where the hands point; returns which ones, left then right, point at the panel.
    pub fn point(&mut self, inputs: &Inputs, haptics: &mut Haptics) -> [bool; 2] {
        if !self.visible {
            return [false; 2];
        }
        let pointing = self.pointer.update(inputs, &self.quad, &self.occupied, &mut self.events, haptics);
        self.press_lost |= pointing.lost;
        pointing.on_panel
    }

    /// Pointer rays of the hands, left then right, for eyes at the pose `head`; they end at the panel if they
    /// meet it. A hidden panel has none.
    pub fn rays(&self, inputs: &Inputs, head: &Pose) -> [Option<PointerRay>; 2] {
        Side::BOTH.map(|side| {
            let aim = inputs.aim(side).filter(|_| self.visible)?;
            let on_panel = |at: Pos2| self.occupied.iter().any(|area| area.contains(at));
            let hit = self.quad.hit(&aim).filter(|hit| on_panel(hit.at));
            PointerRay::new(&aim, hit.map(|hit| hit.distance_m), head.position)
        })
    }

    /// Applies a command, of the panel or of a button; returns whether it was for the panel alone.
    pub fn apply(&mut self, command: Command, head: &Pose) -> bool {
        let toggled = |page| if self.page == Some(page) { None } else { Some(page) };
        match command {
            Command::TogglePanel => {
                self.visible = !self.visible;
                self.place(head);
                if !self.visible {
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

    /// Puts the panel in front of a viewer with the head at `head`.
    pub fn place(&mut self, head: &Pose) {
        self.quad = PanelQuad::before(head);
    }

    /// Quad of the panel in the stage.
    pub fn quad(&self) -> &PanelQuad {
        &self.quad
    }

    /// Whether the panel is visible.
    pub fn is_visible(&self) -> bool {
        self.visible
    }

    /// Whether a hand holds the timeline: the clock must then not advance by itself.
    pub fn is_scrubbing(&self) -> bool {
        self.scrubbing
    }

    /// Runs a frame of the interface, `elapsed_s` seconds after the frame before. Pressed buttons append to
    /// `commands`. Returns a new picture if the panel changed.
    pub fn frame(
        &mut self,
        state: &PanelState,
        elapsed_s: f64,
        commands: &mut Vec<Command>,
    ) -> Option<Painting> {
        self.time_s += if elapsed_s.is_finite() { elapsed_s.max(0.0) } else { 0.0 };
        self.leaving_until_s = self.leaving_until_s.filter(|&until_s| self.time_s < until_s);
        let depends_on = self.depends_on(state);
        if !self.visible || self.events.is_empty() && self.painted == Some(depends_on) {
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
            // The hand was lost during a press: the release is not a click.
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
        let open = console::OpenParts { page: self.page, leaving: self.leaving_until_s.is_some() };
        let done = console::show(ui, state, open, commands);
        self.scrubbing = done.scrubbing;
        if done.exit_pressed {
            match self.leaving_until_s.take() {
                Some(_) => commands.push(Command::Exit),
                None => self.leaving_until_s = Some(self.time_s + LEAVING_S),
            }
        }
        if let Some((at, pressing)) = self.pointer.at() {
            // A ring leaves the target visible.
            let painter = ui.painter();
            painter.circle_stroke(at, 11.0, Stroke::new(8.0, style::SURFACE));
            painter.circle_stroke(at, 11.0, Stroke::new(4.0, Color32::WHITE));
            if pressing {
                painter.circle_filled(at, 9.0, style::ACCENT);
            }
        }
    }

    /// Digest of everything in the picture except the pointer.
    fn depends_on(&self, state: &PanelState) -> u64 {
        let mut hasher = DefaultHasher::new();
        let clock = state.clock;
        (self.page, self.leaving_until_s.is_some(), state.title).hash(&mut hasher);
        if state.has_timeline() {
            // Nobody reads a number that runs; one that stands is the frame on display.
            let position_s = clock.position_s();
            let position =
                if clock.is_playing() { (position_s * TIMELINE_RATE) as u64 } else { position_s.to_bits() };
            (position, clock.duration_s().to_bits()).hash(&mut hasher);
            let ends =
                state.buffered.iter().map(|(from_s, to_s)| [from_s, to_s].map(|end_s| end_s.to_bits()));
            ends.for_each(|ends| ends.hash(&mut hasher));
        }
        (clock.is_playing(), clock.is_looping(), clock.is_reversed(), clock.speed().to_bits())
            .hash(&mut hasher);
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
