//! [`Show`]: the clip on display, its clock, its place, and the panel.
//!
//! It outlives sessions and devices: the next one continues with the same clip at the same instant and
//! place. `clip` is what the loader makes, `place` where it stands, `quality` how well it is drawn, `notices`
//! and `statistics` what the panel says.

mod clip;
mod notices;
pub(crate) mod place;
pub(crate) mod quality;
mod statistics;

use std::sync::Arc;

use glam::{DVec3, UVec2};

use crate::audio::Speaker;
use crate::clips::{Change, ClipController, Direction, Entry, LoadOptions, Transition};
use crate::clock::Clock;
use crate::content::title;
use crate::gpu::{FrameCounts, Gpu, Level, Renderer, RuntimeFormat, UiPainter};
use crate::headset::interaction::{Command, Hands, Haptics, Pose, Similarity, SpaceChange};
use crate::headset::pacing::FrameTimer;
use crate::headset::panel::{Painting, Panel, PanelQuad, PanelState, PointerRay};
use crate::player::{TakeCounts, TakePlayer};
use clip::{HeadsetTarget, ReadyClip};
use notices::Notices;
use place::Place;
use program::Fault;
use quality::{Heat, Punctuality, Quality};
use statistics::{FrameCost, Statistics};

/// Seconds from a frame's beginning to its display that are assumed: about two periods. The runtime's clock is not the
/// clock of sound, so the prediction itself does not say.
const AHEAD_S: f64 = 0.025;

/// How long a part of a take may be missing before the panel says so: shorter waits are barely seen.
const LOADING_PATIENCE_S: f64 = 0.25;

/// What the viewer sees and does.
pub(crate) struct Show {
    // Before the device that they are on.
    playing: Option<Playing>,
    clips: ClipController<HeadsetTarget>,
    panel: Option<Panel>,
    painter: Option<UiPainter>,
    device: Option<Device>,
    place: Place,
    clock: Clock,
    timer: FrameTimer,
    /// Time of the panel, which goes on while the clip waits.
    panel_timer: FrameTimer,
    quality: Quality,
    commands: Vec<Command>,
    speaker: Speaker,
    /// Changes of the spaces, with the display times at which they take effect.
    space_changes: Vec<(i64, SpaceChange)>,
    /// Whether the room is seen behind the clip; `None` if the headset cannot show it.
    passthrough: Option<bool>,
    /// Seconds for which a part of the take has been missing at the position.
    missing_s: f64,
    notices: Notices,
    statistics: Statistics,
}

/// The device of a session, and the format that eyes are drawn in.
struct Device {
    gpu: Arc<Gpu>,
    format: RuntimeFormat,
}

/// The clip on display.
struct Playing {
    title: String,
    clip: ReadyClip,
}

/// The viewer during a frame.
pub(crate) struct Viewer<'a> {
    /// Whether the viewer is with this program: tracked, and not in the system's menu.
    pub(crate) attends: bool,
    pub(crate) head: Option<&'a Pose>,
    pub(crate) hands: &'a Hands,
}

/// What a frame changed.
#[derive(Default)]
pub(crate) struct Moved {
    /// Whether the viewer wants to leave.
    pub(crate) leaves: bool,
    /// From the hands, left then right, to the panel.
    pub(crate) rays: [Option<PointerRay>; 2],
}

/// A point of the stage as the head hears it: metres to the right, up and backwards.
fn heard_at(head: &Pose, point: DVec3) -> DVec3 {
    head.orientation.as_dquat().inverse() * (point - head.position.as_dvec3())
}

impl Show {
    /// Opens `names`, clips and playlists, or the demo, which load once there is a device. `attended` is whether a
    /// viewer is there to read on the panel why it cannot be loaded.
    ///
    /// # Errors
    /// [`Fault::Device`] if the system refuses another thread.
    pub(crate) fn new(
        names: Vec<String>,
        options: LoadOptions,
        quality: Quality,
        place: Place,
        speaker: Speaker,
        attended: bool,
    ) -> Result<Show, Fault> {
        let mut notices = Notices::new(attended);
        notices.work(format!("Opening {}", title(names.first().map(String::as_str))));
        let mut clips = ClipController::new(options, true, || ())?;
        clips.open(names);
        Ok(Show {
            playing: None,
            clips,
            panel: None,
            painter: None,
            device: None,
            place,
            clock: Clock::new(0.0, 0.0),
            timer: FrameTimer::default(),
            panel_timer: FrameTimer::default(),
            quality,
            commands: Vec::new(),
            speaker,
            space_changes: Vec::new(),
            passthrough: None,
            missing_s: 0.0,
            notices,
            statistics: Statistics::default(),
        })
    }

    /// Prepares for a session on `gpu` that draws in `format`, and may show the room, slow the display down and
    /// foveate. The clip on display is loaded again if the device or the format is another one.
    pub(crate) fn prepare(
        &mut self,
        gpu: &Arc<Gpu>,
        format: RuntimeFormat,
        has_passthrough: bool,
        [can_slow, can_foveate]: [bool; 2],
    ) {
        self.quality.change_display(can_slow, can_foveate);
        self.timer = FrameTimer::default();
        self.passthrough = has_passthrough.then(|| self.shows_passthrough());
        // The images of the session before are gone, and with them the picture of the panel.
        if let Some(panel) = &mut self.panel {
            panel.forget_picture();
        }
        let is_same = |device: &Device| Arc::ptr_eq(&device.gpu, gpu) && device.format == format;
        if !self.device.as_ref().is_some_and(is_same) {
            self.release_device();
            self.device = Some(Device { gpu: gpu.clone(), format });
            self.clips
                .set_target(HeadsetTarget { gpu: Arc::downgrade(gpu), format }, self.clock.position_s());
        }
        self.painter = Some(UiPainter::for_runtime(gpu, format));
    }

    /// Lets go of a lost device. The clip stays where it is and waits; the panel says why.
    pub(crate) fn lose_device(&mut self) {
        self.release_device();
        if self.playing.is_some() {
            self.notices.work("The graphics device stopped working: loading the clip for another one".into());
        }
    }

    /// Lets go of everything on the device.
    fn release_device(&mut self) {
        self.painter = None;
        if let Some(playing) = &mut self.playing
            && playing.clip.renderer.take().is_some()
        {
            playing.clip.take = None;
            self.notices.work("Loading the clip for another graphics device".into());
        }
        self.device = None;
    }

    /// Takes in what was loaded: the first version of a clip plays from its start, better ones take its
    /// place. Faults are shown on the panel.
    ///
    /// # Errors
    /// Why the first clip could not be loaded, if no viewer is there to read it.
    pub(crate) fn receive(&mut self) -> Result<(), Fault> {
        while let Some(change) = self.clips.poll() {
            self.apply(change)?;
        }
        Ok(())
    }

    fn apply(&mut self, change: Change<Box<ReadyClip>>) -> Result<(), Fault> {
        match change {
            Change::Show { entry, clip, transition } => self.show(&entry, *clip, transition),
            Change::Progress(progress) => self.notices.progress(&progress),
            Change::Waiting => self.notices.work("Loading the next clip".into()),
            Change::Note(note) => self.notices.note(note),
            Change::Idle => self.notices.clear_progress(),
            Change::Failed(fault) => {
                // A clip that was on a lost device cannot be drawn any more.
                let is_drawn = self.renderer().is_some();
                self.notices.fail(fault, is_drawn)?;
                if self.panel.as_ref().is_some_and(|panel| !panel.is_visible()) {
                    self.commands.push(Command::TogglePanel);
                }
            }
        }
        Ok(())
    }

    fn show(&mut self, entry: &Entry, mut clip: ReadyClip, transition: Transition) {
        self.quality.change_clip(std::mem::take(&mut clip.layer_ends));
        self.notices.on_clip();
        self.speaker
            .change_track(clip.sound.clone(), matches!(transition, Transition::Follow | Transition::Refine));
        let (duration_s, fps) = (clip.duration_s, clip.info.fps.into());
        // The clips of a playlist stand in one place.
        let list = self.clips.queue().and_then(|_| self.clips.named());
        let name = list.or(entry.name.as_deref());
        match (transition, &mut self.playing) {
            (Transition::Refine, Some(playing)) if playing.clip.info == clip.info => {
                // What hands hold stays where it is.
                clip.subject = playing.clip.subject;
                playing.clip = clip;
                log::info!("{}: now {} layers", playing.title, self.quality.layers());
                return;
            }
            (Transition::Follow, Some(playing)) => {
                match self.clock.overrun_s() {
                    Some(_) => self.clock.continue_with(duration_s, fps),
                    None => self.clock.change_clip(duration_s, fps),
                }
                if clip.shares_stage(&playing.clip) {
                    clip.subject = playing.clip.subject;
                }
                self.place.follow(name, clip.subject);
                self.notices.clear_progress();
            }
            _ => {
                self.clock.change_clip(duration_s, fps);
                self.timer = FrameTimer::default();
                self.place.change(name);
            }
        }
        let title = title(entry.name.as_deref());
        log::info!("playing {title}");
        self.playing = Some(Playing { title, clip });
    }

    /// The spaces change at a display time.
    pub(crate) fn change_space_at(&mut self, at_ns: i64, change: SpaceChange) {
        self.space_changes.push((at_ns, change));
    }

    /// Takes in how hot the headset is.
    pub(crate) fn change_heat(&mut self, heat: Heat) {
        self.quality.change_heat(heat);
    }

    /// Moves on to the frame seen at `display_ns`: hands, then their commands and the panel's, then the timer.
    pub(crate) fn advance(&mut self, display_ns: i64, viewer: &Viewer<'_>, haptics: &mut Haptics) -> Moved {
        let elapsed_s = self.timer.elapsed_s(display_ns, viewer.attends);
        let mut moved = Moved::default();
        let Some(head) = viewer.head else { return moved };
        let due = self.space_changes.extract_if(.., |(at_ns, _)| *at_ns <= display_ns);
        let mut due: Vec<SpaceChange> = due.map(|(_, change)| change).collect();
        // The head is where it is in the last stage.
        due.sort_by_key(|change| matches!(change, SpaceChange::Viewer));
        for change in due {
            self.place.change_space(change, head);
            if let Some(panel) = &mut self.panel {
                panel.place(head);
            }
        }
        let mut commands = std::mem::take(&mut self.commands);
        let mut scrubbing = self.take_hands(viewer, head, elapsed_s, &mut moved, &mut commands, haptics);
        scrubbing |= self.panel.as_ref().is_some_and(Panel::is_scrubbing);
        for &command in &commands {
            moved.leaves |= self.carry_out(command, head);
        }
        commands.clear();
        self.commands = commands;
        self.clock.set_has_next(self.clips.is_followed(self.clock.is_looping()));
        self.update_take(elapsed_s);
        let played_s = self.listen(viewer, head, elapsed_s, scrubbing);
        if !scrubbing {
            self.clock.advance(played_s);
        }
        if let Some(change) = self.clips.advance(&mut self.clock)
            && let Err(fault) = self.apply(change)
        {
            log::warn!("{fault}");
        }
        moved
    }

    /// Takes in what is heard, and where the head hears it. Returns the seconds by which the clip goes on.
    fn listen(&mut self, viewer: &Viewer<'_>, head: &Pose, elapsed_s: f64, scrubbing: bool) -> f64 {
        if !viewer.attends {
            self.speaker.stop();
            return elapsed_s;
        }
        if let Some(stage_from_clip) = self.place.interaction.stage_from_clip() {
            self.speaker.place(&self.clock, |point| heard_at(head, stage_from_clip.point(point)));
        }
        let played_s = self.speaker.step(&self.clock, scrubbing, elapsed_s, AHEAD_S);
        if let Some(note) = self.speaker.take_note() {
            self.notices.note(note);
        }
        played_s
    }

    /// Brings the segments of a take up to the position, and lets the clock wait for those that are missing there, or for
    /// the take itself.
    fn update_take(&mut self, elapsed_s: f64) {
        let device = self.device.as_ref();
        let playing = self.playing.as_mut().map(|playing| &mut playing.clip);
        let Some((device, ReadyClip { take: Some(take), renderer: Some(renderer), .. })) =
            device.zip(playing)
        else {
            self.clock.set_waiting(self.clips.is_loading());
            return;
        };
        take.update(&device.gpu, renderer, &self.clock);
        let is_missing = take.is_missing(self.clock.position_s());
        self.clock.set_waiting(is_missing);
        let mut notes = take.take_notes();
        notes.extend(self.clips.reopen(&self.clock, || take.is_replaced()));
        for note in notes {
            self.notices.note(note);
        }
        let was_said = self.missing_s > LOADING_PATIENCE_S;
        self.missing_s = if is_missing { self.missing_s + elapsed_s } else { 0.0 };
        match (was_said, self.missing_s > LOADING_PATIENCE_S) {
            (false, true) => self.notices.work("Loading this part of the take".into()),
            (true, false) => self.notices.clear_progress(),
            _ => {}
        }
    }

    /// Takes in the hands, on the panel and on the clip; whether one of them scrubs.
    fn take_hands(
        &mut self,
        viewer: &Viewer<'_>,
        head: &Pose,
        elapsed_s: f64,
        moved: &mut Moved,
        commands: &mut Vec<Command>,
        haptics: &mut Haptics,
    ) -> bool {
        if let Some(playing) = &self.playing {
            self.place.settle(playing.clip.subject, head);
        }
        let panel = self.panel.get_or_insert_with(|| Panel::new(head));
        let was_scrubbing = panel.is_scrubbing();
        self.place.interaction.take(viewer.hands, viewer.attends, elapsed_s);
        let on_panel = panel.point(self.place.interaction.inputs(), haptics);
        self.place.update(head, on_panel, &self.clock, commands, haptics);
        moved.rays = panel.rays(self.place.interaction.inputs(), head);
        was_scrubbing || self.place.interaction.is_scrubbing()
    }

    /// A new picture of the panel in the frame seen at `display_ns`, if something on it changed. What is pressed on it
    /// takes effect in the next frame: the layout takes time that the GPU would wait.
    pub(crate) fn paint_panel(&mut self, display_ns: i64) -> Option<Painting> {
        let elapsed_s = self.panel_timer.elapsed_s(display_ns, true);
        self.statistics.refresh(elapsed_s);
        let title = match &self.playing {
            Some(playing) => &playing.title,
            None if self.clips.is_loading() => "",
            None => "No clip",
        };
        let state = PanelState {
            title,
            clock: &self.clock,
            is_static: self.playing.as_ref().is_some_and(|playing| playing.clip.is_static),
            qualities: &Level::ALL.map(Level::name),
            quality: self.quality.level() as usize,
            lowered: self.quality.is_lowered(),
            passthrough: self.passthrough,
            has_next: self.clips.has_neighbour(Direction::Forward),
            volume: self.speaker.controls().map(|volume| (volume.level(), volume.is_muted())),
            buffered: self
                .playing
                .as_ref()
                .and_then(|playing| playing.clip.take.as_ref())
                .map_or(&[], TakePlayer::buffered),
            statistics: &self.statistics.rows,
            notice: self.notices.shown(),
        };
        self.panel.as_mut()?.frame(&state, elapsed_s, &mut self.commands)
    }

    /// Carries out a command of the viewer; whether it is to leave.
    fn carry_out(&mut self, command: Command, head: &Pose) -> bool {
        if self.panel.as_mut().is_some_and(|panel| panel.apply(command, head))
            || command.play(&mut self.clock)
        {
            return false;
        }
        match command {
            Command::Exit => return true,
            Command::Recentre => self.place.recentre(head),
            Command::NextClip => {
                if let Some(Change::Waiting) = self.clips.skip(Direction::Forward) {
                    // A choice of the viewer takes the place of what was said before.
                    self.notices.dismiss();
                    self.notices.work("Loading the next clip".into());
                }
            }
            Command::ToggleMuted => {
                if let Some(volume) = self.speaker.controls() {
                    volume.toggle_muted();
                }
            }
            Command::Better => self.quality.improve(),
            Command::Coarser => self.quality.coarsen(),
            Command::TogglePassthrough => self.passthrough = self.passthrough.map(|visible| !visible),
            Command::Dismiss => self.notices.dismiss(),
            _ => {}
        }
        false
    }

    /// Takes in a frame of `size` pixels an eye, on a display with one image every `period_ns` that repeated the frame
    /// before or not. Returns milliseconds of the GPU that were not returned before, if it has timestamps.
    pub(crate) fn measure(
        &mut self,
        counts: FrameCounts,
        size: UVec2,
        period_ns: i64,
        missed: bool,
    ) -> Option<f64> {
        let gpu_ms = self.renderer().and_then(Renderer::gpu_ms);
        let (settings, layers) = (self.quality.settings(), self.quality.layers());
        let period_ms = period_ns as f64 * 1e-6;
        let take =
            self.playing.as_ref().and_then(|playing| playing.clip.take.as_ref()).map(TakePlayer::counts);
        self.statistics.latest = Some(FrameCost { counts, settings, layers, size, gpu_ms, period_ms, take });
        // Loading takes time of the CPU, which no level gives back.
        let missed = missed && !self.clips.is_loading();
        self.quality.measure(Punctuality { gpu_ms, period_ms, missed });
        self.renderer().and_then(Renderer::new_gpu_ms)
    }

    /// Remembers where the clip stands, though a hand may hold it.
    pub(crate) fn save(&mut self) {
        self.place.save();
    }

    /// The outcome of the run.
    ///
    /// # Errors
    /// Why no clip was shown.
    pub(crate) fn outcome(self) -> Result<(), Fault> {
        self.notices.outcome()
    }

    /// Counts of the segments of a take.
    pub(crate) fn take_counts(&self) -> Option<TakeCounts> {
        self.take().map(TakePlayer::counts)
    }

    /// The segments of the take on display.
    fn take(&self) -> Option<&TakePlayer> {
        self.playing.as_ref().and_then(|playing| playing.clip.take.as_ref())
    }

    /// Whether a clip is being loaded, or a segment of a take uploaded.
    pub(crate) fn is_loading(&self) -> bool {
        self.clips.is_loading() || self.take().is_some_and(TakePlayer::is_uploading)
    }

    /// Normalised time of the picture: of a take, the latest complete one while a part of it is being loaded.
    pub(crate) fn shown_time(&self) -> f64 {
        let clock = &self.clock;
        match self.take() {
            Some(take) if clock.duration_s() > 0.0 => take.shown_s(clock.position_s()) / clock.duration_s(),
            _ => clock.clip_time(),
        }
    }

    /// From clip to stage; `None` before the clip has a place.
    pub(crate) fn stage_from_clip(&self) -> Option<Similarity> {
        self.place.interaction.stage_from_clip()
    }

    /// The renderer of the clip; `None` while it is being loaded.
    pub(crate) fn renderer(&mut self) -> Option<&mut Renderer> {
        self.playing.as_mut().and_then(|playing| playing.clip.renderer.as_mut())
    }

    /// The painter of the panel.
    pub(crate) fn painter(&mut self) -> Option<&mut UiPainter> {
        self.painter.as_mut()
    }

    /// The panel's quad, if the panel is shown.
    pub(crate) fn panel_quad(&self) -> Option<&PanelQuad> {
        self.panel.as_ref().filter(|panel| panel.is_visible()).map(Panel::quad)
    }

    /// Number of Gaussians of the clip, plate included.
    pub(crate) fn gaussians(&self) -> usize {
        self.playing.as_ref().map_or(0, |playing| playing.clip.gaussians)
    }

    pub(crate) fn quality(&self) -> &Quality {
        &self.quality
    }

    pub(crate) fn clock(&self) -> &Clock {
        &self.clock
    }

    /// Whether the room is shown behind the clip.
    pub(crate) fn shows_passthrough(&self) -> bool {
        self.passthrough.unwrap_or(false)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, Quat, Vec3};

    #[test]
    fn the_clip_waits_for_another_device() {
        let options = LoadOptions { source: Default::default(), min_layers: 1, is_complete: false };
        let quality = Quality::new(Default::default(), Level::Exact, true);
        let mut show =
            Show::new(Vec::new(), options, quality, Place::new(None, None), Speaker::silent(), true).unwrap();
        show.clock = Clock::new(1.0, 30.0);
        // There is no device: the clip is loaded once there is one.
        show.update_take(0.1);
        assert!(show.clips.is_loading() && show.clock.is_waiting());
    }

    #[test]
    fn a_source_stays_where_the_clip_stands_while_the_head_turns() {
        // A performer at (0, 1, 0) of a clip that stands 2 m ahead, turned by a quarter.
        let stage_from_clip = Similarity {
            scale: 1.0,
            rotation: DQuat::from_rotation_y(std::f64::consts::FRAC_PI_2),
            translation: DVec3::new(0.0, 0.0, -2.0),
        };
        let heard = |turn: f32| {
            let head = Pose { position: Vec3::Y, orientation: Quat::from_rotation_y(turn) };
            heard_at(&head, stage_from_clip.point(DVec3::Y))
        };
        let near = |a: DVec3, b: DVec3| assert!((a - b).length() < 1e-6, "{a} {b}");
        near(heard(0.0), DVec3::new(0.0, 0.0, -2.0));
        // Turned to the left, it is at the right.
        near(heard(std::f32::consts::FRAC_PI_2), DVec3::new(2.0, 0.0, 0.0));
        near(heard(std::f32::consts::PI), DVec3::new(0.0, 0.0, 2.0));
    }
}
