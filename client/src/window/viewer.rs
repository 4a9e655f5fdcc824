//! [`Viewer`]: the state that keys, mouse and controls change, and how they change it.
//!
//! It uses the interface library but neither window nor GPU: tests feed it key presses and drags, and check
//! the playback position and the camera.

use codec::{Camera, Viewpoint};
use egui::{Context, CursorIcon, Event, Id, PointerButton, Popup, Rect, Response, Sense, Ui};

use super::bar::{self, Choices, Controls};
use super::camera::{CameraControl, ZOOM_PER_NOTCH};
use super::keys::{self, Command, FlyKeys};
use super::library::Opening;
use super::overlay::{self, Message};
use super::viewed_clip::ViewedClip;
use crate::audio::Volume;
use crate::clips::Direction;
use crate::clock::Clock;
use crate::gpu::RenderSettings;

/// Seconds that the pointer rests in full screen until it and the controls disappear.
const REST_S: f64 = 3.0;

/// Points of scrolling per notch of a wheel.
const POINTS_PER_NOTCH: f64 = 40.0;

/// Seconds that a frame takes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FrameSeconds {
    /// By the clock of the display.
    pub(crate) elapsed_s: f64,
    /// By which the clip goes on while it plays: by what is heard, if it has sound.
    pub(crate) played_s: f64,
}

/// Requests of the interface to the window.
#[derive(Debug, Default, PartialEq, Eq)]
pub(crate) struct Requests {
    pub(crate) screenshot: bool,
    pub(crate) toggle_full_screen: bool,
    /// Make this frame the poster of the clip.
    pub(crate) set_poster: bool,
    /// What to open, in the order of the wishes: keys pressed between two frames are several.
    pub(crate) open: Vec<Opening>,
}

/// The state of the interface.
pub(crate) struct Viewer {
    pub(crate) clock: Clock,
    pub(crate) settings: RenderSettings,
    pub(crate) message: Option<Message>,
    pub(crate) choices: Choices,
    /// Parts of a take that play without loading, as seconds (from, to).
    pub(crate) buffered: Vec<(f64, f64)>,
    /// Why no sound is heard, if there is no audio device.
    pub(crate) silence: Option<String>,
    /// Whether the pointer holds the timeline.
    is_scrubbing: bool,
    clip: ViewedClip,
    camera: CameraControl,
    /// Index of the viewpoint chosen last.
    viewpoint: usize,
    fly_keys: FlyKeys,
    /// When the pointer moved last, or full screen began, by the interface's time in seconds.
    moved_s: f64,
    is_full_screen: bool,
    /// Part of the window's height that the bar covers. In full screen it lies over the picture for a while only.
    covered: f64,
    show_controls: bool,
    show_statistics: bool,
    show_keys: bool,
}

impl Viewer {
    /// Plays `clip` from its first viewpoint.
    pub(crate) fn new(clip: ViewedClip, settings: RenderSettings) -> Viewer {
        Viewer {
            clock: Clock::new(clip.duration_s, clip.fps),
            settings,
            message: None,
            choices: Choices::default(),
            buffered: Vec::new(),
            silence: None,
            is_scrubbing: false,
            camera: CameraControl::new(&clip.viewpoints[0], clip.up),
            clip,
            viewpoint: 0,
            fly_keys: FlyKeys::default(),
            moved_s: 0.0,
            is_full_screen: false,
            covered: 0.0,
            show_controls: true,
            show_statistics: false,
            show_keys: false,
        }
    }

    /// Plays another clip from its start, from its first viewpoint, with all its layers.
    pub(crate) fn change_clip(&mut self, clip: ViewedClip) {
        self.clock.change_clip(clip.duration_s, clip.fps);
        self.settings.layers = None;
        self.camera = CameraControl::new(&clip.viewpoints[0], clip.up);
        self.viewpoint = 0;
        self.clip = clip;
        // Notes on it came before it, and errors stay until they are dismissed.
        self.message.take_if(|message| matches!(message, Message::Working(_)));
    }

    /// Continues with the next clip of a playlist. The camera stays if both clips have the same viewpoints.
    pub(crate) fn continue_with(&mut self, clip: ViewedClip) {
        self.clock.continue_with(clip.duration_s, clip.fps);
        self.settings.layers = self.settings.layers.filter(|layers| *layers <= clip.layers);
        if (clip.up, &clip.viewpoints) != (self.clip.up, &self.clip.viewpoints) {
            self.camera = CameraControl::new(&clip.viewpoints[0], clip.up);
            self.viewpoint = 0;
        }
        self.clip = clip;
    }

    /// Replaces the clip by a version of it with other layers, which may be the first dynamic ones, and changes
    /// nothing else. A version that differs in more plays as by [`Viewer::change_clip`].
    pub(crate) fn update_clip(&mut self, clip: ViewedClip) {
        let ViewedClip { layers, is_static, .. } = self.clip;
        if (ViewedClip { layers, is_static, ..clip.clone() }) == self.clip {
            self.clip = clip;
        } else {
            self.change_clip(clip);
        }
    }

    /// Shows a note.
    pub(crate) fn note(&mut self, text: String) {
        self.message = Some(Message::note(self.message.take(), text));
    }

    /// Shows an error.
    pub(crate) fn error(&mut self, text: String) {
        self.message = Some(Message::error(self.message.take(), text));
    }

    /// Says what is being done, unless a note or an error is shown.
    pub(crate) fn progress(&mut self, text: String) {
        if matches!(self.message, None | Some(Message::Working(_))) {
            self.message = Some(Message::Working(text));
        }
    }

    /// Where the camera is, and what it looks at.
    pub(crate) fn camera_viewpoint(&self) -> Viewpoint {
        self.camera.viewpoint()
    }

    /// The camera for a window of `width` x `height` pixels. Its view fills the part above the bar, and goes on behind it.
    pub(crate) fn camera(&self, width: u32, height: u32) -> Camera {
        let above = (f64::from(height) * (1.0 - self.covered)).round() as u32;
        Camera { height, ..self.camera.camera(width, above.max(1)) }
    }

    /// Normalised clip time of the image; always 0 for a static clip.
    pub(crate) fn clip_time(&self) -> f64 {
        if self.clip.is_static { 0.0 } else { self.clock.clip_time() }
    }

    /// Seconds until the image changes without further input: 0 while it moves, `None` for never. A static clip
    /// changes only at its end, if it is `in_playlist`.
    pub(crate) fn next_change_s(&self, in_playlist: bool) -> Option<f64> {
        if self.fly_keys.fly().is_flying() {
            return Some(0.0);
        }
        match (self.clock.is_advancing(), self.clip.is_static) {
            (true, false) => Some(0.0),
            (true, true) => in_playlist.then(|| self.clock.remaining_s()),
            (false, _) => None,
        }
    }

    /// Whether the pointer holds the timeline.
    pub(crate) fn is_scrubbing(&self) -> bool {
        self.is_scrubbing
    }

    /// Advances the clip by `played_s` seconds, unless the pointer holds the timeline.
    pub(crate) fn advance(&mut self, played_s: f64) {
        if !self.is_scrubbing {
            self.clock.advance(played_s);
        }
    }

    /// Takes in whether the window fills the screen.
    pub(crate) fn set_full_screen(&mut self, ctx: &Context, is_full_screen: bool) {
        if !std::mem::replace(&mut self.is_full_screen, is_full_screen) {
            self.moved_s = ctx.input(|input| input.time);
        }
    }

    /// Handles the input of a frame, advances clock and camera, and shows the controls, with the controls of the
    /// `volume` if the clip has sound. `statistics` are rows of names and values.
    pub(crate) fn frame(
        &mut self,
        ui: &mut Ui,
        FrameSeconds { elapsed_s, played_s }: FrameSeconds,
        mut volume: Option<&mut Volume>,
        statistics: &[(&str, String)],
    ) -> Requests {
        let ctx = ui.ctx().clone();
        let mut commands = self.keyboard(&ctx);
        let window = ui.available_rect_before_wrap();
        let mut requests = Requests::default();
        let is_resting = self.is_resting(&ctx);
        if is_resting {
            ctx.set_cursor_icon(CursorIcon::None);
        }
        if self.show_controls && !is_resting {
            let controls = Controls {
                clock: &mut self.clock,
                settings: &mut self.settings,
                choices: &self.choices,
                opening: &mut requests.open,
                is_scrubbing: &mut self.is_scrubbing,
                is_static: self.clip.is_static,
                volume: volume.as_deref_mut(),
                silence: self.silence.as_deref(),
                buffered: &self.buffered,
                layers: self.clip.layers,
                viewpoints: &self.clip.viewpoints,
                viewpoint: self.viewpoint,
            };
            bar::show(ui, controls, &mut commands);
        }
        let picture = ui.available_rect_before_wrap();
        let bar_height = window.bottom() - picture.bottom();
        self.covered = if self.is_full_screen { 0.0 } else { f64::from(bar_height / window.height()) };
        requests.toggle_full_screen = self.mouse(ui, picture);

        for command in commands {
            match (command, volume.as_deref_mut()) {
                (Command::ToggleMuted, Some(volume)) => volume.toggle_muted(),
                _ => self.apply(command, &mut requests),
            }
        }
        self.advance(played_s);
        self.camera.fly(self.fly_keys.fly(), elapsed_s);

        if self.show_statistics && self.show_controls && !self.show_keys {
            overlay::statistics(&ctx, statistics);
        }
        if self.show_keys {
            overlay::keys(&ctx);
        }
        overlay::message(&ctx, bar_height, &mut self.message);
        if ctx.input(|input| !input.raw.hovered_files.is_empty()) {
            overlay::drop_hint(&ctx);
        }
        requests
    }

    /// The commands of keys, unless a number is typed.
    fn keyboard(&mut self, ctx: &Context) -> Vec<Command> {
        if ctx.text_edit_focused() {
            self.fly_keys.release();
            return Vec::new();
        }
        let control_has_focus = ctx.memory(|memory| memory.focused().is_some());
        ctx.input(|input| {
            self.fly_keys.update(input);
            keys::commands(input, control_has_focus)
        })
    }

    /// Whether the pointer rests in full screen, over no menu.
    fn is_resting(&mut self, ctx: &Context) -> bool {
        let is_move = |event: &Event| matches!(event, Event::PointerMoved(_) | Event::PointerButton { .. });
        let (now_s, moves) =
            ctx.input(|input| (input.time, input.events.iter().any(is_move) || input.pointer.any_down()));
        if moves || Popup::is_any_open(ctx) {
            self.moved_s = now_s;
        }
        let rest_s = self.moved_s + REST_S - now_s;
        if self.is_full_screen && rest_s > 0.0 {
            ctx.request_repaint_after_secs(rest_s as f32);
        }
        self.is_full_screen && rest_s <= 0.0
    }

    /// Handles drags and the wheel over the picture. Returns whether a double click asks for full screen, or for its end.
    fn mouse(&mut self, ui: &Ui, picture: Rect) -> bool {
        let response = ui.interact(picture, Id::unique("picture"), Sense::drag());
        if response.drag_started() {
            // A control focused with Tab returns the keyboard to the picture.
            ui.memory_mut(|memory| memory.focused().into_iter().for_each(|id| memory.surrender_focus(id)));
        }
        self.drag(&response, f64::from(ui.ctx().content_rect().height()) * (1.0 - self.covered));
        if response.contains_pointer() {
            let (scroll, zoom) = ui.input(|input| (input.smooth_scroll_delta().y, input.zoom_delta()));
            // A pinch to double size halves the distance: ln 2 / ln(1 / 0.9) notches.
            let pinch = f64::from(zoom.max(f32::MIN_POSITIVE)).ln() / ZOOM_PER_NOTCH.recip().ln();
            self.camera.zoom(f64::from(scroll) / POINTS_PER_NOTCH + pinch);
        }
        response.contains_pointer()
            && ui.input(|input| input.pointer.button_double_clicked(PointerButton::Primary))
    }

    fn drag(&mut self, response: &Response, view_height: f64) {
        let delta = response.drag_delta();
        let (dx, dy) = (f64::from(delta.x) / view_height, f64::from(delta.y) / view_height);
        let modifiers = response.ctx.input(|input| input.modifiers);
        let flying = self.fly_keys.fly().is_flying();
        let other_button =
            response.dragged_by(PointerButton::Secondary) || response.dragged_by(PointerButton::Middle);
        if other_button || response.dragged() && modifiers.shift && !flying {
            self.camera.pan(dx, dy);
        } else if response.dragged() && (flying || modifiers.ctrl) {
            self.camera.look(dx, dy);
        } else if response.dragged() {
            self.camera.orbit(dx, dy);
        }
    }

    fn apply(&mut self, command: Command, requests: &mut Requests) {
        let clock = &mut self.clock;
        match command {
            Command::TogglePlaying => clock.toggle_playing(),
            Command::StepBack => clock.step_back(),
            Command::StepForward => clock.step_forward(),
            Command::GoToStart => clock.seek(0.0),
            Command::Slower => clock.slower(),
            Command::Faster => clock.faster(),
            Command::NormalSpeed => clock.set_speed(1.0),
            // A static clip comes to its end in any case.
            Command::ToggleReverse if self.clip.is_static => {}
            Command::ToggleReverse => clock.set_reversed(!clock.is_reversed()),
            // There is nothing to mute.
            Command::ToggleMuted => {}
            Command::ToggleLoop => clock.set_looping(!clock.is_looping()),
            Command::GoToViewpoint(number) => self.go_to_viewpoint(number),
            Command::Recentre => self.go_to_viewpoint(self.viewpoint),
            Command::TurnUp => {
                let (camera, axis) = self.camera.with_next_up();
                self.camera = camera;
                self.note(format!(
                    "{axis} is up. A field opens so with --up {axis}, or with \"up\" in its scene.json"
                ));
            }
            Command::Screenshot => requests.screenshot = true,
            Command::OpenFile => requests.open.push(Opening::Picker),
            Command::PreviousClip => requests.open.push(Opening::Beside(Direction::Back)),
            Command::NextClip => requests.open.push(Opening::Beside(Direction::Forward)),
            // The format has no other up axis for it.
            Command::SetPoster if !self.camera.has_up(self.clip.up) => self.note(
                "A poster has the up axis of its clip, and T turned another one up: open the clip again for a poster, or \
                 package its field again with \"up\" in its scene.json"
                    .into(),
            ),
            Command::SetPoster => requests.set_poster = true,
            Command::ToggleKeys => self.show_keys = !self.show_keys,
            Command::ToggleStatistics => self.show_statistics = !self.show_statistics,
            Command::ToggleInterface => {
                self.show_controls = !self.show_controls;
                if !self.show_controls {
                    self.note("U shows the controls again".into());
                }
            }
            Command::ToggleFullScreen => requests.toggle_full_screen = true,
            Command::Dismiss if self.show_keys => self.show_keys = false,
            Command::Dismiss if self.message.is_some() => self.message = None,
            Command::Dismiss => requests.toggle_full_screen |= self.is_full_screen,
        }
    }

    /// Goes to a viewpoint, if there is one with this number.
    pub(crate) fn go_to_viewpoint(&mut self, number: usize) {
        if let Some(viewpoint) = self.clip.viewpoints.get(number) {
            self.camera.go_to(viewpoint);
            self.viewpoint = number;
        }
    }
}

#[cfg(test)]
mod tests;
