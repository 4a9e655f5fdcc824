//! [`Show`]: what is shown: a clip, its clock, where it stands, and what hands do to it.
//!
//! It outlives sessions: one that was lost is followed by another with the same clip at the same
//! instant and place.

use std::sync::Arc;

use glam::UVec2;
use program::Fault;

use super::interaction::{Command, Hands, Haptics, Interaction, PlacementStore, Pose, Similarity};
use super::loading::{self, Loaded, Loading, Order, Request};
use super::pacing::Clock;
use super::panel::{Beam, Board, Notice, Painting, Panel, PanelState};
use super::quality::Quality;
use crate::clips::queue::List;
use crate::clips::{is_url, redacted, title};
use crate::gpu::{Cutoff, FrameCounts, Gpu, Level, RenderSettings, Renderer, RuntimeFormat, UiPainter};
use crate::player::Player;

/// Seconds between new numbers among the statistics: as fast as they can be read.
const STATISTICS_S: f64 = 0.5;

/// What the viewer sees and does.
pub(super) struct Show {
    // Before the device that they are on.
    playing: Option<Playing>,
    loading: Option<Loading>,
    panel: Option<Panel>,
    painter: Option<UiPainter>,
    gpu: Arc<Gpu>,
    /// The clip named on the command line.
    request: Request,
    /// What was named last: a clip, or a playlist.
    named: Option<String>,
    /// The clip to play after the one that was loaded last.
    next: Option<String>,
    /// The playlist that plays.
    list: Option<List<Box<Loaded>>>,
    /// Whether the next clip of the playlist is to play as soon as it is ready.
    hurries: bool,
    /// Whether someone is there who can read the panel.
    attended: bool,
    /// Why no clip has played so far.
    unplayed: Option<Fault>,
    interaction: Interaction,
    format: Option<RuntimeFormat>,
    quality: Quality,
    store: Option<PlacementStore>,
    player: Player,
    clock: Clock,
    /// Time for the panel, which goes on while the clip waits.
    panel_clock: Clock,
    commands: Vec<Command>,
    replace_at_ns: Option<i64>,
    /// Whether the room is seen behind the clip; `None` where it cannot be.
    room: Option<bool>,
    notice: Option<Told>,
    statistics: Statistics,
}

/// A clip that is there.
struct Playing {
    loaded: Loaded,
    /// What it is called: for people, and in the store.
    title: String,
    key: String,
}

/// Something the panel tells.
enum Told {
    Loading { text: String, part: Option<f32> },
    Note(String),
    Failed(String),
}

/// Numbers for the panel.
#[derive(Default)]
struct Statistics {
    rows: Vec<(&'static str, String)>,
    age_s: f64,
    latest: Option<Measured>,
}

/// What a frame took, and what was left out.
struct Measured {
    counts: FrameCounts,
    settings: RenderSettings,
    layers: usize,
    /// Size of an eye's image.
    size: UVec2,
    gpu_ms: Option<f64>,
    period_ms: f64,
}

/// What a frame knows of the viewer.
pub(super) struct Viewer<'a> {
    /// Whether the viewer is with this program: tracked, and not in the system's menu.
    pub(super) attends: bool,
    /// Whether the frame will be seen.
    pub(super) looks: bool,
    pub(super) head: Option<&'a Pose>,
    pub(super) hands: &'a Hands,
}

/// What came of moving on.
pub(super) struct Moved {
    /// Whether the viewer wants to leave.
    pub(super) leaves: bool,
    /// A new picture of the panel, which must be drawn.
    pub(super) painting: Option<Painting>,
    /// From hands to the panel.
    pub(super) beams: [Option<Beam>; 2],
}

impl Show {
    /// Of the clip `request`, which begins to load with the first session. `attended` is whether
    /// someone is there who can read on the panel why it cannot be loaded.
    pub(super) fn new(
        gpu: Arc<Gpu>,
        request: Request,
        quality: Quality,
        store: Option<PlacementStore>,
        attended: bool,
    ) -> Show {
        Show {
            playing: None,
            loading: None,
            panel: None,
            painter: None,
            gpu,
            request,
            named: None,
            next: None,
            list: None,
            hurries: false,
            attended,
            unplayed: None,
            interaction: Interaction::default(),
            format: None,
            quality,
            store,
            player: Player::new(0.0, 0.0),
            clock: Clock::default(),
            panel_clock: Clock::default(),
            commands: Vec::new(),
            replace_at_ns: None,
            room: None,
            notice: None,
            statistics: Statistics::default(),
        }
    }

    pub(super) fn gpu(&self) -> &Arc<Gpu> {
        &self.gpu
    }

    /// Makes ready for a session that is drawn in `format` and may show the room.
    ///
    /// # Errors
    /// [`Fault::Device`] if the system refuses another thread.
    pub(super) fn prepare(&mut self, format: RuntimeFormat, can_see_through: bool) -> Result<(), Fault> {
        self.clock = Clock::default();
        self.room = can_see_through.then(|| self.see_through());
        // The images of the session before are gone, and with them the picture of the panel.
        self.panel = None;
        self.painter = Some(UiPainter::for_runtime(&self.gpu, format));
        if self.format != Some(format) {
            self.format = Some(format);
            self.playing = None;
            self.list = None;
            self.interaction.take_away();
            self.load(self.request.name.clone())?;
        }
        Ok(())
    }

    fn load(&mut self, name: Option<String>) -> Result<(), Fault> {
        let Some(format) = self.format else { return Ok(()) };
        let text = format!("Opening {}", title(name.as_deref()));
        self.notice = Some(Told::Loading { text, part: None });
        self.named.clone_from(&name);
        let request = Request { name, ..self.request.clone() };
        self.loading = Some(Loading::start(self.gpu.clone(), request, Order::Named, format)?);
        Ok(())
    }

    /// Begins to load the next clip of the playlist, if there is one and nothing else is loaded.
    fn load_next(&mut self) -> Result<(), Fault> {
        if self.loading.is_none()
            && let Some(format) = self.format
            && let Some((entries, awaited)) = self.list.as_mut().and_then(List::ask)
        {
            let order = Order::Next(entries, awaited);
            self.loading = Some(Loading::start(self.gpu.clone(), self.request.clone(), order, format)?);
        }
        Ok(())
    }

    /// Takes in what is told of a clip on its way. One that is there plays from its start, and better
    /// ones take its place. Why one cannot be loaded is told on the panel.
    ///
    /// # Errors
    /// Why the first clip could not be loaded, if nobody is there to read that.
    pub(super) fn receive(&mut self) -> Result<(), Fault> {
        while let Some(told) = self.loading.as_ref().and_then(Loading::poll) {
            match told {
                loading::Told::Next(next) => (self.next, self.list) = (next, None),
                loading::Told::List(queue) => (self.next, self.list) = (None, Some(List::new(queue))),
                // Of what comes next, nobody asks how far it is.
                loading::Told::Progress(_) if !self.is_awaited() => {}
                loading::Told::Progress(progress) => {
                    let text = format!("Loading: {}", progress.text());
                    self.notice = Some(Told::Loading { text, part: progress.part() });
                }
                loading::Told::Note(note) => {
                    log::info!("{note}");
                    self.notice = Some(Told::Note(note));
                }
                loading::Told::Skipped(fault) => {
                    log::warn!("{fault}; skipped");
                    self.notice = Some(Told::Note(format!("{fault}; skipped")));
                }
                loading::Told::Clip { loaded, first } => {
                    if let Err(fault) = self.take(loaded, first) {
                        self.finish();
                        return self.fail(fault);
                    }
                }
                // The clip that plays is the only one that can be had.
                loading::Told::Failed(fault)
                    if self.playing.is_some() && self.list.as_ref().is_some_and(List::is_coming) =>
                {
                    log::warn!("{fault}; skipped");
                    self.finish();
                    self.notice = Some(Told::Note(format!("{fault}; skipped")));
                }
                loading::Told::Failed(fault) => {
                    self.finish();
                    return self.fail(fault).and_then(|()| self.go_on_loading());
                }
                loading::Told::Done => {
                    self.finish();
                    self.go_on_loading()?;
                }
            }
        }
        Ok(())
    }

    /// Whether what is loaded is to be seen at once.
    fn is_awaited(&self) -> bool {
        self.playing.is_none() || self.list.as_ref().is_none_or(|list| !list.is_coming() || list.is_awaited())
    }

    /// No more comes of what is loaded. Where nothing plays, the viewer may have the list tried again.
    fn finish(&mut self) {
        self.loading = None;
        self.notice.take_if(|notice| matches!(notice, Told::Loading { .. }));
        let Some(list) = &mut self.list else { return };
        if self.playing.is_some() {
            list.finish();
        } else {
            list.forget_next();
            self.hurries = false;
        }
    }

    /// Loads what comes after the clip that plays.
    fn go_on_loading(&mut self) -> Result<(), Fault> {
        if self.playing.is_some() { self.load_next() } else { Ok(()) }
    }

    /// Takes a clip in: to play now, or next.
    ///
    /// # Errors
    /// Those of [`Show::play`].
    fn take(&mut self, loaded: Box<Loaded>, first: bool) -> Result<(), Fault> {
        let Some(list) = &mut self.list else { return self.play(*loaded, first) };
        let is_next = if first { self.playing.is_some() && list.is_coming() } else { list.ready().is_some() };
        if is_next {
            list.put(loaded.entry.number, loaded);
            return Ok(());
        }
        if first {
            list.go_to(loaded.entry.number);
            self.hurries = false;
        }
        self.play(*loaded, first)
    }

    /// At the end of a clip of a playlist, unless the viewer has paused, or where the viewer wants it, goes
    /// on with the next one as soon as it is ready.
    fn follow(&mut self) -> Result<(), Fault> {
        let Some(list) = &mut self.list else { return Ok(()) };
        if self.player.take_started_over() {
            list.start_over();
            return self.go_on_loading();
        }
        let is_over = self.player.overrun_s().is_some() && self.player.is_playing();
        if !is_over && !self.hurries {
            return Ok(());
        }
        if self.hurries {
            self.load_next()?;
        }
        let Some(list) = &mut self.list else { return Ok(()) };
        let Some(loaded) = list.take() else {
            if list.awaits() {
                self.notice = Some(Told::Loading { text: "Loading the next clip".into(), part: None });
            }
            self.hurries &= list.has_next();
            return Ok(());
        };
        self.hurries = false;
        let mut loaded = match self.accept(*loaded) {
            Ok(loaded) => loaded,
            Err(fault) => return self.load_next().and(Err(fault)),
        };
        let (duration_s, fps) = (loaded.info.duration_s.into(), loaded.info.fps.into());
        match self.player.overrun_s() {
            Some(_) => self.player.continue_with(duration_s, fps),
            None => self.player.change_clip(duration_s, fps),
        }
        if let Some(playing) = &mut self.playing {
            // Nothing moves but what moves in the clips.
            if loaded.is_on_stage_of(&playing.loaded) {
                loaded.subject = playing.loaded.subject;
            }
            if let Some(placement) = self.interaction.placement().copied() {
                self.interaction.put(loaded.subject, placement);
            }
            playing.title = title(loaded.entry.name.as_deref());
            log::info!("playing {}", playing.title);
            playing.loaded = loaded;
        }
        self.notice.take_if(|notice| matches!(notice, Told::Loading { .. }));
        self.load_next()
    }

    /// Plays a clip from its start, or goes on with a better one of the same.
    ///
    /// # Errors
    /// If it has not the layers asked for.
    fn play(&mut self, loaded: Loaded, first: bool) -> Result<(), Fault> {
        let loaded = self.accept(loaded)?;
        self.unplayed = None;
        self.notice.take_if(|notice| matches!(notice, Told::Failed(_)));
        if let Some(playing) = &mut self.playing
            && !first
            && loaded.goes_on(&playing.loaded)
        {
            // What it is held by stays where it is.
            playing.loaded = Loaded { subject: playing.loaded.subject, ..loaded };
            log::info!("{}: now {} layers", playing.title, self.quality.layers());
            return Ok(());
        }
        self.save();
        self.player.change_clip(loaded.info.duration_s.into(), loaded.info.fps.into());
        self.clock = Clock::default();
        // It has a place once it is known where the head is.
        self.interaction.take_away();
        let title = title(loaded.entry.name.as_deref());
        // The clips of a playlist stand in one place.
        let key = match &self.list {
            Some(_) => key(self.named.as_deref()),
            None => key(loaded.entry.name.as_deref()),
        };
        log::info!("playing {title}");
        self.playing = Some(Playing { loaded, title, key });
        Ok(())
    }

    /// A clip, if it has the layers asked for.
    fn accept(&mut self, mut loaded: Loaded) -> Result<Loaded, Fault> {
        let layer_ends = std::mem::take(&mut loaded.layer_ends);
        let there = layer_ends.len();
        self.quality
            .change_clip(layer_ends)
            .map_err(|asked| Fault::Usage(format!("--layer {asked}: the clip has {there} layers")))?;
        Ok(loaded)
    }

    /// Tells that a clip cannot be played.
    fn fail(&mut self, fault: Fault) -> Result<(), Fault> {
        if self.playing.is_none() {
            if !self.attended {
                return Err(fault);
            }
            eprintln!("{fault}; the headset shows this and waits for another clip, or the exit");
            self.unplayed = Some(fault.clone());
        } else {
            log::warn!("{fault}");
        }
        self.notice = Some(Told::Failed(fault.to_string()));
        if self.panel.as_ref().is_some_and(|panel| !panel.is_shown()) {
            self.commands.push(Command::TogglePanel);
        }
        Ok(())
    }

    /// Whether a clip is on its way.
    pub(super) fn is_loading(&self) -> bool {
        self.loading.is_some()
    }

    /// At the end.
    ///
    /// # Errors
    /// Why no clip was played.
    pub(super) fn outcome(self) -> Result<(), Fault> {
        self.unplayed.map_or(Ok(()), Err)
    }

    /// Has the clip put before the viewer anew at a display time.
    pub(super) fn replace_at(&mut self, at_ns: i64) {
        self.replace_at_ns = Some(at_ns);
    }

    /// Moves on to the frame seen at `display_ns`.
    pub(super) fn advance(&mut self, display_ns: i64, viewer: &Viewer<'_>, haptics: &mut Haptics) -> Moved {
        let elapsed_s = self.clock.elapsed_s(display_ns, viewer.attends);
        let panel_elapsed_s = self.panel_clock.elapsed_s(display_ns, true);
        let mut moved = Moved { leaves: false, painting: None, beams: [None; 2] };
        let Some(head) = viewer.head else { return moved };
        let mut commands = std::mem::take(&mut self.commands);
        let panel = self.panel.get_or_insert_with(|| Panel::new(head));
        let mut scrubbing = panel.is_scrubbing();
        let interaction = &mut self.interaction;
        if let (Some(playing), None) = (&self.playing, interaction.placement()) {
            let subject = playing.loaded.subject;
            let left = self.store.as_ref().and_then(|store| store.get(&playing.key));
            interaction.put(subject, left.unwrap_or_else(|| subject.start(head)));
        }
        interaction.take(viewer.hands, viewer.attends, elapsed_s);
        let on_panel = panel.point(interaction.inputs(), haptics);
        interaction.update(head, on_panel, &self.player, &mut commands, haptics);
        scrubbing |= interaction.is_scrubbing();
        moved.beams = panel.beams(interaction.inputs(), head);
        if self.replace_at_ns.take_if(|at_ns| *at_ns <= display_ns).is_some() {
            commands.push(Command::Recentre);
        }
        if viewer.looks {
            self.statistics.refresh(panel_elapsed_s);
            let title = match &self.playing {
                Some(playing) => &playing.title,
                None if self.loading.is_some() => "",
                None => "No clip",
            };
            let state = PanelState {
                title,
                player: &self.player,
                qualities: &Level::ALL.map(Level::name),
                quality: self.quality.level() as usize,
                lowered: self.quality.is_lowered(),
                passthrough: self.room,
                has_next: self.next.is_some() || self.list.as_ref().is_some_and(List::has_next),
                statistics: &self.statistics.rows,
                notice: self.notice.as_ref().map(|told| match told {
                    Told::Loading { text, part } => Notice::Working { text, part: *part },
                    Told::Note(text) => Notice::Note(text),
                    Told::Failed(text) => Notice::Error(text),
                }),
            };
            moved.painting = panel.frame(&state, panel_elapsed_s, &mut commands);
            scrubbing |= panel.is_scrubbing();
        }
        for &command in &commands {
            moved.leaves |= self.carry_out(command, head);
        }
        commands.clear();
        self.commands = commands;
        let looping = self.player.is_looping();
        self.player.set_has_next(self.list.as_ref().is_some_and(|list| list.goes_on(looping)));
        if !scrubbing {
            self.player.advance(elapsed_s);
        }
        if let Err(fault) = self.follow() {
            self.notice = Some(Told::Failed(fault.to_string()));
        }
        moved
    }

    /// Does what the viewer wants; whether that is to leave.
    fn carry_out(&mut self, command: Command, head: &Pose) -> bool {
        if self.panel.as_mut().is_some_and(|panel| panel.apply(command, head))
            || command.play(&mut self.player)
        {
            return false;
        }
        match command {
            Command::Exit => return true,
            Command::Recentre => self.interaction.recentre(head),
            Command::NextClip if self.list.is_some() => self.hurries = true,
            Command::NextClip => {
                if let (Some(next), None) = (self.next.clone(), &self.loading)
                    && let Err(fault) = self.load(Some(next))
                {
                    self.notice = Some(Told::Failed(fault.to_string()));
                }
            }
            Command::Better => self.quality.choose(self.quality.level().better()),
            Command::Coarser => self.quality.choose(self.quality.level().coarser()),
            Command::TogglePassthrough => self.room = self.room.map(|seen| !seen),
            Command::Dismiss if self.loading.is_none() => self.notice = None,
            _ => {}
        }
        false
    }

    /// Takes in what drawing a frame of `size` pixels an eye took, where the display shows one every
    /// `period_ns`; milliseconds of the GPU, if it can tell.
    pub(super) fn measure(&mut self, counts: FrameCounts, size: UVec2, period_ns: i64) -> Option<f64> {
        let gpu_ms = self.renderer().and_then(Renderer::gpu_ms);
        let (settings, layers) = (self.quality.settings(), self.quality.layers());
        let period_ms = period_ns as f64 * 1e-6;
        self.statistics.latest = Some(Measured { counts, settings, layers, size, gpu_ms, period_ms });
        self.quality.measure(gpu_ms, period_ms);
        gpu_ms
    }

    /// Keeps where the clip stands.
    fn remember(&mut self) {
        let Some(playing) = &self.playing else { return };
        if let (Some(store), Some(placement)) = (&mut self.store, self.interaction.placement()) {
            store.set(&playing.key, placement);
        }
    }

    /// Has written down where clips stand.
    pub(super) fn save(&mut self) {
        self.remember();
        if let Some(store) = &mut self.store {
            store.save();
        }
    }

    /// Where the clip stands, once it is there and has a place.
    pub(super) fn stage_from_clip(&self) -> Option<Similarity> {
        self.interaction.stage_from_clip()
    }

    /// What draws the clip.
    pub(super) fn renderer(&mut self) -> Option<&mut Renderer> {
        self.playing.as_mut().map(|playing| &mut playing.loaded.renderer)
    }

    /// What draws the panel.
    pub(super) fn painter(&mut self) -> Option<&mut UiPainter> {
        self.painter.as_mut()
    }

    /// Where the panel is, if it is to be seen.
    pub(super) fn board(&self) -> Option<&Board> {
        self.panel.as_ref().filter(|panel| panel.is_shown()).map(Panel::board)
    }

    pub(super) fn gaussians(&self) -> usize {
        self.playing.as_ref().map_or(0, |playing| playing.loaded.gaussians)
    }

    pub(super) fn quality(&self) -> &Quality {
        &self.quality
    }

    pub(super) fn player(&self) -> &Player {
        &self.player
    }

    /// Whether the room is to be seen behind the clip.
    pub(super) fn see_through(&self) -> bool {
        self.room.unwrap_or(false)
    }
}

impl Statistics {
    /// Brings the rows up to date from time to time.
    fn refresh(&mut self, elapsed_s: f64) {
        self.age_s += elapsed_s;
        let Some(latest) = self.latest.as_ref().filter(|_| self.age_s >= STATISTICS_S) else { return };
        self.age_s = 0.0;
        let Measured { counts, settings, layers, size, gpu_ms, period_ms } = latest;
        let gpu = gpu_ms.map_or("unknown".into(), |ms| format!("{ms:.1} of {period_ms:.1} ms"));
        let reach = match settings.cutoff {
            Cutoff::Exact => "all of it",
            Cutoff::Sqrt8 => "sqrt 8 sigma",
            Cutoff::Sqrt5 => "sqrt 5 sigma",
        };
        self.rows.clear();
        self.rows.extend([
            ("alive now", counts.alive.to_string()),
            ("too faint", counts.culled.to_string()),
            ("drawn", counts.sorted.to_string()),
            ("find, sort", format!("{:.2}, {:.2} ms", counts.alive_ms, counts.sort_ms)),
            ("GPU", gpu),
            ("each eye", format!("{} x {} px", size.x, size.y)),
            ("reach", reach.into()),
            ("layers", format!("{} of {layers}", settings.layers.unwrap_or(*layers))),
        ]);
    }
}

/// What a clip is called in the store: the same from wherever the program is started.
fn key(name: Option<&str>) -> String {
    name.map_or("demo".into(), |name| {
        if is_url(name) {
            return redacted(name);
        }
        std::path::absolute(name).map_or(name.into(), |path| path.to_string_lossy().into_owned())
    })
}
