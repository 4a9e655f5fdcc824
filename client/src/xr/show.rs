//! [`Show`]: what is shown: a clip, its clock, where it stands, and what hands do to it.
//!
//! It outlives sessions: one that was lost is followed by another with the same clip at the same
//! instant and place.

use std::sync::Arc;

use super::interaction::{Command, Hands, Haptics, Interaction, Pose, Similarity};
use super::loading::{Loaded, Loading};
use super::pacing::Clock;
use crate::fault::Fault;
use crate::gpu::{Gpu, Renderer, RuntimeFormat, Settings};
use crate::player::Player;

/// What the viewer sees and does.
pub(super) struct Show {
    // Before the device that they are on.
    playing: Option<Playing>,
    loading: Option<Loading>,
    gpu: Arc<Gpu>,
    name: Option<String>,
    format: Option<RuntimeFormat>,
    settings: Settings,
    player: Player,
    clock: Clock,
    commands: Vec<Command>,
    replace_at_ns: Option<i64>,
    see_through: bool,
}

/// A clip that is there.
struct Playing {
    loaded: Loaded,
    /// From when the head is first seen.
    interaction: Option<Interaction>,
}

/// What a frame knows of the viewer.
pub(super) struct Viewer<'a> {
    /// Whether the viewer is with this program: tracked, and not in the system's menu.
    pub(super) attends: bool,
    pub(super) head: Option<&'a Pose>,
    pub(super) hands: &'a Hands,
}

impl Show {
    /// Of the clip `name`, which begins to load with the first session.
    pub(super) fn new(gpu: Arc<Gpu>, name: Option<String>, settings: Settings) -> Show {
        Show {
            playing: None,
            loading: None,
            gpu,
            name,
            format: None,
            settings,
            player: Player::new(0.0, 0.0),
            clock: Clock::default(),
            commands: Vec::new(),
            replace_at_ns: None,
            see_through: false,
        }
    }

    pub(super) fn gpu(&self) -> &Arc<Gpu> {
        &self.gpu
    }

    /// Makes sure that the clip is drawn in `format`.
    ///
    /// # Errors
    /// [`Fault::Device`] if the system refuses another thread.
    pub(super) fn prepare(&mut self, format: RuntimeFormat) -> Result<(), Fault> {
        self.clock = Clock::default();
        if self.format != Some(format) {
            self.format = Some(format);
            self.playing = None;
            self.loading = Some(Loading::start(self.gpu.clone(), self.name.clone(), format)?);
        }
        Ok(())
    }

    /// Takes in a clip that has arrived, which then plays from its start.
    ///
    /// # Errors
    /// Why it could not be loaded, and [`Fault::Usage`] if it has not the layers asked for.
    pub(super) fn receive(&mut self) -> Result<(), Fault> {
        let Some(arrived) = self.loading.as_ref().and_then(Loading::poll) else { return Ok(()) };
        self.loading = None;
        let loaded = arrived?;
        if let Some(layers) = self.settings.layers.filter(|&layers| layers > loaded.layers) {
            return Err(Fault::Usage(format!("--layer {layers}: the clip has {} layers", loaded.layers)));
        }
        self.player.change_clip(loaded.duration_s, loaded.fps);
        self.clock = Clock::default();
        self.playing = Some(Playing { loaded, interaction: None });
        Ok(())
    }

    /// Has the clip put before the viewer anew at a display time.
    pub(super) fn replace_at(&mut self, at_ns: i64) {
        self.replace_at_ns = Some(at_ns);
    }

    /// Moves on to the frame seen at `display_ns`; whether the viewer wants to leave.
    pub(super) fn advance(&mut self, display_ns: i64, viewer: &Viewer<'_>, haptics: &mut Haptics) -> bool {
        let elapsed_s = self.clock.elapsed_s(display_ns, viewer.attends);
        let (Some(playing), Some(head)) = (&mut self.playing, viewer.head) else { return false };
        let subject = playing.loaded.subject;
        let interaction =
            playing.interaction.get_or_insert_with(|| Interaction::new(subject, subject.start(head)));
        if self.replace_at_ns.take_if(|at_ns| *at_ns <= display_ns).is_some() {
            interaction.recentre(head);
        }
        interaction.take(viewer.hands, viewer.attends, elapsed_s);
        self.commands.clear();
        interaction.update(head, [false; 2], &self.player, &mut self.commands, haptics);
        let mut leave = false;
        for command in &self.commands {
            match command {
                Command::Exit => leave = true,
                Command::Recentre => interaction.recentre(head),
                Command::TogglePassthrough => self.see_through = !self.see_through,
                command => drop(command.play(&mut self.player)),
            }
        }
        if !interaction.is_scrubbing() {
            self.player.advance(elapsed_s);
        }
        leave
    }

    /// Where the clip stands, once it is there and has a place.
    pub(super) fn stage_from_clip(&self) -> Option<Similarity> {
        Some(self.playing.as_ref()?.interaction.as_ref()?.stage_from_clip())
    }

    /// What draws the clip.
    pub(super) fn renderer(&mut self) -> Option<&mut Renderer> {
        self.playing.as_mut().map(|playing| &mut playing.loaded.renderer)
    }

    pub(super) fn gaussians(&self) -> usize {
        self.playing.as_ref().map_or(0, |playing| playing.loaded.gaussians)
    }

    pub(super) fn settings(&self) -> Settings {
        self.settings
    }

    pub(super) fn player(&self) -> &Player {
        &self.player
    }

    /// Whether the viewer wants to see the room behind the clip.
    pub(super) fn see_through(&self) -> bool {
        self.see_through
    }
}
