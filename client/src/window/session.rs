//! [`Session`]: a window with its device, the clip it plays, and the frames it draws.
//!
//! The loader makes clips ready, on a thread of its own, the next clip of a playlist while this one plays: both are on the
//! device, and for a moment a newer version of one of them. Going from one to the other takes no longer than a frame.
//!
//! A lost device takes all clips on it along: the session opens another one and loads the clip again.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Weak};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use egui::epaint::ClippedPrimitive;
use egui::{TexturesDelta, ViewportId};
use glam::{DMat4, DVec3};
use winit::dpi::{LogicalSize, PhysicalSize, Size};
use winit::event::WindowEvent;
use winit::event_loop::{ActiveEventLoop, EventLoopProxy};
use winit::window::{Fullscreen, Theme, Window};

use super::bar::Choices;
use super::icon;
use super::library::{Library, Opening};
use super::overlay::Message;
use super::picker::{self, Picked};
use super::poster::PosterChange;
use super::screen::Screen;
use super::screenshot::Screenshot;
use super::viewed_clip::ViewedClip;
use super::viewer::{FrameSeconds, Requests, Viewer};
use crate::args::Args;
use crate::audio::{SoundTrack, Speaker};
use crate::clips::{
    Change, ClipController, ClipTarget, Direction, Entry, LoadOptions, Transition, too_few_layers,
};
use crate::content::{OpenEvent, OpenTake, cache_dir, is_url, title};
use crate::folders;
use crate::gpu::{Format, FrameCounts, FrameLayout, Gpu, Picture, RenderSettings, Renderer, SurfaceFrame};
use crate::player::{Beginning, TakePlayer};
use crate::stats::Latest;
use crate::terminal::Reporter;
use crate::view::View;
use crate::viewpoint;
use crate::worker::join_in_time;
use program::Fault;
use program::output::folder_of;

/// Default size of the window in points, and the least one that holds the controls.
const DEFAULT_SIZE: LogicalSize<u32> = LogicalSize::new(1280, 720);
const LEAST_SIZE: LogicalSize<u32> = LogicalSize::new(800, 400);

/// Part of each side of the screen that a new window takes at most: a desktop has bars, and a window a title.
const SCREEN_PART: f64 = 0.9;

/// Interval between the steps of a clip in a hidden window: sound stops after a quarter of a second without a step. It is
/// also the longest wait for a requested frame: Wayland sends none while the window is hidden.
const HIDDEN_STEP: Duration = Duration::from_millis(100);

/// Interval between looks whether a part of a take has come, while the clip pauses.
const LOADING_RETRY: Duration = Duration::from_millis(100);

/// Most seconds from drawing a frame to its display that are assumed.
const AHEAD_MAX_S: f64 = 0.034;

/// How long a part of a take may be missing before the window says so: shorter waits are barely seen.
const LOADING_PATIENCE: Duration = Duration::from_millis(250);

/// Frames whose times the statistics sum up: two seconds at 60 frames per second.
const FRAMES_SUMMARISED: usize = 120;

/// What to say where no dialog chooses a file.
const NO_DIALOG: &str =
    "the desktop has no file dialog: drop a file on the window, or install a desktop portal or zenity";

/// What other threads report.
pub(super) enum Event {
    /// The loader has something to tell.
    Loading,
    /// A screenshot was saved at this path.
    Saved(Result<PathBuf, Fault>),
    /// The dialog that chooses a file has ended.
    Picked(Picked),
    /// The poster of a clip was written.
    PosterWritten(Result<(), Fault>),
}

/// What the command line asks of the clip that the window opens for.
struct Asked {
    /// Name or number of a viewpoint.
    view: Option<String>,
    /// Number of layers to draw.
    layers: Option<usize>,
}

impl Asked {
    /// Number of the viewpoint of `clip`.
    ///
    /// # Errors
    /// [`Fault::Usage`] if it has no such viewpoint, or fewer layers.
    fn viewpoint_of(&self, clip: &ViewedClip) -> Result<usize, Fault> {
        let viewpoint = self.view.as_deref().map_or(Ok(0), |name| viewpoint::find(&clip.viewpoints, name))?;
        match self.layers {
            Some(layers) if layers > clip.layers => Err(too_few_layers(layers, "the clip", clip.layers)),
            _ => Ok(viewpoint),
        }
    }
}

/// When to draw the next frame.
pub(super) enum Next {
    Now,
    After(Duration),
    OnInput,
}

/// The device that clips are made ready on, as long as the window has it.
#[derive(Clone)]
struct WindowTarget {
    gpu: Weak<Gpu>,
    format: Format,
    proxy: EventLoopProxy<Event>,
}

impl WindowTarget {
    fn new(screen: &Screen, proxy: &EventLoopProxy<Event>) -> WindowTarget {
        WindowTarget {
            gpu: Arc::downgrade(&screen.gpu),
            format: screen.surface.format(),
            proxy: proxy.clone(),
        }
    }
}

impl ClipTarget for WindowTarget {
    type Ready = Box<Playing>;

    fn prepare(
        &self,
        entry: &Entry,
        opened: Arc<OpenTake>,
        beginning: Beginning<'_>,
    ) -> Result<Box<Playing>, Fault> {
        let gpu = self
            .gpu
            .upgrade()
            .ok_or_else(|| Fault::Device("the graphics device is gone: open the clip again".into()))?;
        let layout = FrameLayout::plain(self.format, 1);
        let (renderer, take) =
            TakePlayer::begin(&gpu, opened.clone(), layout, beginning, waker(&self.proxy))?;
        Ok(Box::new(Playing {
            title: title(entry.name.as_deref()),
            viewed: ViewedClip::new(&opened),
            renderer: Some(renderer),
            take: Some(take),
            sound: opened.sound.clone(),
            metres_per_unit: opened.info().metres_per_unit.into(),
            gaussians: opened.gaussians(),
            layers_announced: opened.layer_ends().len(),
        }))
    }
}

/// The take on display.
struct Playing {
    title: String,
    viewed: ViewedClip,
    /// `None` before the first clip is there, and once its device was lost.
    renderer: Option<Renderer>,
    /// Its segments, as long as there is a renderer.
    take: Option<TakePlayer>,
    sound: SoundTrack,
    metres_per_unit: f64,
    /// Number of Gaussians, plate included.
    gaussians: usize,
    /// Number of layers that the package announces; a truncated file has fewer.
    layers_announced: usize,
}

impl Playing {
    /// Nothing yet, under this title.
    fn nothing(title: String) -> Playing {
        Playing {
            title,
            viewed: ViewedClip::none(),
            renderer: None,
            take: None,
            sound: SoundTrack::default(),
            metres_per_unit: 1.0,
            gaussians: 0,
            layers_announced: 0,
        }
    }
}

/// Tells the event loop that a loader has something. The event loop has ended where that fails.
fn waker(proxy: &EventLoopProxy<Event>) -> impl Fn() + Send + 'static {
    let proxy = proxy.clone();
    move || drop(proxy.send_event(Event::Loading))
}

/// The inputs of a picture of a clip.
#[derive(Clone, Copy, PartialEq)]
struct PictureState {
    /// Changes with the segments of a take that are drawn; see [`TakePlayer::revision`].
    revision: u64,
    /// Normalised clip time.
    t: f64,
    view: View,
    settings: RenderSettings,
}

/// An open window.
pub(super) struct Session {
    playing: Playing,
    /// Until the clip that the window opened for is there, or the viewer opens another one; a fault ends the run until
    /// then.
    asked: Option<Asked>,
    viewer: Viewer,
    /// Inputs of the present picture; `None` if it must be drawn again.
    drawn: Option<PictureState>,
    counts: FrameCounts,
    /// Milliseconds between frames while the clip plays.
    frame_ms: Latest<FRAMES_SUMMARISED>,
    /// Time of the previous frame; `None` after a rest, which the clip's clock does not count.
    last_frame: Option<Instant>,
    /// Whether the previous frame asked for this one at once.
    is_continuous: bool,
    /// Whether a frame was requested by [`Session::request_frame`], and has not come.
    awaits_frame: bool,
    /// Whether other windows cover this one.
    is_covered: bool,
    /// Files that were dropped on the window, one event each, until all of them are known.
    dropped: Vec<PathBuf>,
    clips: ClipController<WindowTarget>,
    library: Library,
    /// Whether the dialog that chooses a file is open.
    is_picking: bool,
    speaker: Speaker,
    reporter: Reporter,
    /// Since when a part of the take is missing at the position, and whether that was said.
    loading_since: Option<(Instant, bool)>,
    saving: Option<JoinHandle<()>>,
    proxy: EventLoopProxy<Event>,
    screen: Screen,
    window: Arc<Window>,
}

impl Session {
    /// Opens a window for the clip of `args`, which the loader opens, and draws its first frame when the event loop asks
    /// for it.
    ///
    /// # Errors
    /// [`Fault::Device`] if there is no window, no device that draws in it, or no thread for the loader.
    pub(super) fn open(
        event_loop: &ActiveEventLoop,
        proxy: EventLoopProxy<Event>,
        args: &Args,
    ) -> Result<Session, Fault> {
        let size = args.size.map_or(Size::Logical(first_size(screen_size(event_loop)).cast()), |size| {
            Size::Physical(PhysicalSize::new(size.x, size.y))
        });
        let playing = Playing::nothing(title(args.clips.first().map(String::as_str)));
        let attributes = Window::default_attributes()
            .with_title(&*playing.title)
            .with_window_icon(icon::icon())
            .with_theme(Some(Theme::Dark))
            .with_min_inner_size(LEAST_SIZE)
            .with_inner_size(size);
        let window = event_loop
            .create_window(attributes)
            .map_err(|error| Fault::Device(format!("cannot open a window: {error}: try --headless")))?;
        let window = Arc::new(window);
        let screen = Screen::open(&window)?;
        let settings = args.settings();
        let mut viewer = Viewer::new(playing.viewed.clone(), RenderSettings { layers: None, ..settings });
        viewer.progress(opening(&args.clips));
        let options = LoadOptions { source: args.source(cache_dir()), min_layers: 1, is_complete: false };
        let mut clips = ClipController::new(options, true, waker(&proxy))?;
        clips.set_target(WindowTarget::new(&screen, &proxy), 0.0);
        clips.open(args.clips.clone());
        window.request_redraw();
        Ok(Session {
            asked: Some(Asked { view: args.view.clone(), layers: settings.layers }),
            viewer,
            speaker: Speaker::new(folders::state()),
            drawn: None,
            counts: FrameCounts::default(),
            frame_ms: Latest::default(),
            last_frame: None,
            is_continuous: false,
            awaits_frame: false,
            is_covered: false,
            dropped: Vec::new(),
            clips,
            library: Library::open(waker(&proxy)),
            is_picking: false,
            reporter: Reporter::new(),
            loading_since: None,
            saving: None,
            proxy,
            playing,
            screen,
            window,
        })
    }

    /// Handles an event of the window.
    pub(super) fn input(&mut self, event: &WindowEvent) {
        if let WindowEvent::Occluded(is_covered) = *event {
            self.is_covered = is_covered;
            self.window.request_redraw();
        }
        if self.screen.input.on_window_event(&self.window, event).repaint {
            self.window.request_redraw();
        }
    }

    /// Asks the event loop for a frame. If the frame before has not come, the clip plays on without a picture. Returns the
    /// time until the next call, unless a frame comes.
    pub(super) fn request_frame(&mut self) -> Duration {
        match std::mem::replace(&mut self.awaits_frame, true) {
            // A frame that is slow to come draws what stands still.
            true if !self.viewer.clock.is_advancing() => {}
            true => {
                let (now, elapsed_s) = self.begin_step();
                self.step_hidden(now, elapsed_s);
            }
            false => self.window.request_redraw(),
        }
        HIDDEN_STEP
    }

    /// Takes in a file or a folder that was dropped on the window.
    pub(super) fn receive_file(&mut self, path: PathBuf) {
        self.screen.input.egui_input_mut().hovered_files.clear();
        self.dropped.push(path);
    }

    /// Loads what was dropped on the window, in the order of the names.
    pub(super) fn open_received(&mut self) {
        if !self.dropped.is_empty() {
            let mut paths = std::mem::take(&mut self.dropped);
            paths.sort();
            self.load_files(&paths);
        }
    }

    /// Loads files and folders in the background, while the present clip plays.
    fn load_files(&mut self, paths: &[PathBuf]) {
        let names: Vec<String> = paths.iter().filter_map(|path| path.to_str().map(String::from)).collect();
        let unnamed = paths.iter().find(|path| path.to_str().is_none());
        if !names.is_empty() {
            self.load(names);
        }
        if let Some(path) = unnamed {
            let why = format!("{}: its name is not text: rename it", path.display());
            self.error(why);
        }
    }

    fn load(&mut self, names: Vec<String>) {
        // A choice of the viewer takes the place of what was said before.
        self.viewer.message = None;
        self.asked = None;
        self.progress(opening(&names));
        self.clips.open(names);
    }

    /// Opens what the viewer chose.
    fn open_chosen(&mut self, opening: Opening) {
        match opening {
            Opening::Clip(name) => self.load(vec![name]),
            Opening::Beside(direction) => match self.clips.skip(direction) {
                Some(change) => {
                    self.viewer.message = None;
                    self.asked = None;
                    self.apply(change);
                }
                None if !self.clips.has_neighbour(direction) => self.note("There is no other clip".into()),
                None => {}
            },
            Opening::Picker if self.is_picking => {}
            Opening::Picker => {
                self.is_picking = true;
                let proxy = self.proxy.clone();
                // The event loop has ended where sending fails.
                picker::open(&self.window, self.shown_file().map(folder_of), move |picked| {
                    drop(proxy.send_event(Event::Picked(picked)));
                });
            }
        }
    }

    /// The file of the clip on display; `None` of one from a URL and of the demo.
    fn shown_file(&self) -> Option<&Path> {
        self.clips.current_name().filter(|name| !is_url(name)).map(Path::new)
    }

    /// Makes this frame the poster of the clip, in the background.
    fn set_poster(&mut self) {
        let Some(clip) = self.shown_file().map(Path::to_owned) else { return };
        let change = PosterChange {
            clip,
            time_s: self.viewer.clock.position_s(),
            viewpoint: self.viewer.camera_viewpoint(),
        };
        let proxy = self.proxy.clone();
        self.progress("Writing the poster".into());
        std::thread::spawn(move || drop(proxy.send_event(Event::PosterWritten(change.write()))));
    }

    /// What the menus offer besides the clip on display.
    fn choices(&self) -> Choices {
        Choices {
            has_previous: self.clips.has_neighbour(Direction::Back),
            has_next: self.clips.has_neighbour(Direction::Forward),
            is_package: self.shown_file().is_some_and(|path| path.extension() == Some("aarc".as_ref())),
            recent: self.library.recent(),
        }
    }

    /// Takes in an event of another thread.
    ///
    /// # Errors
    /// Why the clip that the window opened for cannot be shown as the command line asks, unless the viewer has opened
    /// another one.
    pub(super) fn receive(&mut self, event: Event) -> Result<(), Fault> {
        match event {
            Event::Loading => {
                while let Some(change) = self.clips.poll() {
                    match (change, self.asked.take()) {
                        (Change::Failed(fault), Some(_)) => return Err(fault),
                        (Change::Show { clip, transition, .. }, Some(asked)) => {
                            let viewpoint = asked.viewpoint_of(&clip.viewed)?;
                            self.show(*clip, transition);
                            self.viewer.go_to_viewpoint(viewpoint);
                            self.viewer.settings.layers = asked.layers;
                        }
                        (change, asked) => {
                            self.asked = asked;
                            self.apply(change);
                        }
                    }
                }
                // The end of a static clip may now lead to another one.
                self.window.request_redraw();
            }
            Event::Saved(Ok(path)) => self.note(format!("Saved {}", path.display())),
            Event::PosterWritten(Ok(())) => self.note("The clip has a new poster".into()),
            Event::Saved(Err(fault)) | Event::PosterWritten(Err(fault)) => {
                self.error(fault.to_string());
            }
            Event::Picked(picked) => {
                self.is_picking = false;
                match picked {
                    Picked::File(path) => self.load_files(&[path]),
                    Picked::Nothing => {}
                    Picked::NoDialog => self.error(NO_DIALOG.into()),
                }
            }
        }
        Ok(())
    }

    /// Carries out a change of the clip on display.
    fn apply(&mut self, change: Change<Box<Playing>>) {
        match change {
            Change::Show { clip, transition, .. } => self.show(*clip, transition),
            Change::Progress(progress) => {
                self.progress(format!("Loading: {}", progress.text()));
            }
            Change::Waiting => self.progress("Loading another clip".into()),
            Change::Note(note) => {
                self.reporter.print(&OpenEvent::Note(note.clone()));
                self.note(note);
            }
            Change::Failed(fault) => {
                self.reporter.print(&OpenEvent::Note(fault.to_string()));
                self.error(fault.to_string());
            }
            Change::Idle => self.clear_progress(),
        }
    }

    fn show(&mut self, playing: Playing, transition: Transition) {
        let viewed = playing.viewed.clone();
        self.speaker.change_track(playing.sound.clone(), !matches!(transition, Transition::Open));
        match transition {
            Transition::Open => {
                if let Some(name) = self.clips.named() {
                    self.library.remember(name);
                }
                self.viewer.change_clip(viewed);
                self.last_frame = None;
            }
            Transition::Follow => {
                self.viewer.continue_with(viewed);
                self.clear_progress();
            }
            Transition::Refine => self.viewer.update_clip(viewed),
        }
        self.window.set_title(&playing.title);
        self.viewer.buffered.clear();
        self.playing = playing;
        self.drawn = None;
        self.window.request_redraw();
    }

    fn error(&mut self, text: String) {
        self.viewer.error(text);
        self.window.request_redraw();
    }

    fn note(&mut self, text: String) {
        self.viewer.note(text);
        self.window.request_redraw();
    }

    fn progress(&mut self, text: String) {
        self.viewer.progress(text);
        self.window.request_redraw();
    }

    fn clear_progress(&mut self) {
        if let Some(Message::Working(_)) = self.viewer.message {
            self.viewer.message = None;
            self.window.request_redraw();
        }
    }

    /// Draws and shows a frame.
    ///
    /// # Errors
    /// [`Fault::Device`] if the device was lost or has failed.
    pub(super) fn frame(&mut self) -> Result<Next, Fault> {
        // A window with the focus is not minimised. Asking takes a round trip to the display.
        let is_hidden =
            self.is_covered || !self.window.has_focus() && self.window.is_minimized() == Some(true);
        self.awaits_frame = false;
        let acquired = if is_hidden { None } else { self.screen.surface.acquire(&self.screen.gpu)? };
        let (now, elapsed_s) = self.begin_step();
        let Some(frame) = acquired else {
            self.step_hidden(now, elapsed_s);
            return Ok(Next::After(HIDDEN_STEP));
        };
        if self.is_continuous {
            self.frame_ms.push(elapsed_s * 1e3);
        }

        let ctx = self.screen.input.egui_ctx().clone();
        self.library.update();
        self.viewer.choices = self.choices();
        self.viewer.set_full_screen(&ctx, self.window.fullscreen().is_some());
        let input = self.screen.input.take_egui_input(&self.window);
        let statistics = self.statistics(frame.size);
        let mut requests = Requests::default();
        let seconds = self.listen(elapsed_s);
        self.viewer.silence = self.speaker.silence();
        let mut volume = self.speaker.controls();
        let output = ctx.run_ui(input, |ui| {
            requests = self.viewer.frame(ui, seconds, volume.as_deref_mut(), &statistics);
        });
        if let Some(change) = self.clips.advance(&mut self.viewer.clock) {
            self.apply(change);
        }
        self.speaker.rest(&self.viewer.clock, self.viewer.is_scrubbing());

        let state = self.picture_state(frame.size);
        let outdated = self.drawn != Some(state);
        if outdated {
            self.draw_picture(frame.size, &state)?;
        }
        let scale = output.pixels_per_point;
        let triangles = ctx.tessellate(output.shapes, scale);
        self.present(frame, &triangles, scale, output.textures_delta);
        self.screen.input.handle_platform_output(&self.window, output.platform_output);

        self.carry_out(requests, state);
        let next_change =
            self.viewer.next_change_s(self.clips.queue().is_some()).map(Duration::from_secs_f64);
        self.last_frame = next_change.map(|_| now);
        self.is_continuous = next_change == Some(Duration::ZERO);
        let repaint =
            output.viewport_output.get(&ViewportId::ROOT).map_or(Duration::MAX, |root| root.repaint_delay);
        Ok(match next_change.unwrap_or(Duration::MAX).min(repaint).min(self.loading_retry()) {
            // The statistics describe the previous frame.
            _ if outdated || self.playing.take.as_ref().is_some_and(TakePlayer::is_uploading) => Next::Now,
            Duration::ZERO => Next::Now,
            Duration::MAX => Next::OnInput,
            delay => Next::After(delay),
        })
    }

    /// Brings the clip up to date, before it goes on by the seconds that are returned.
    fn begin_step(&mut self) -> (Instant, f64) {
        let now = Instant::now();
        let elapsed_s = self.last_frame.map_or(0.0, |last| (now - last).as_secs_f64());
        self.update_take(now);
        let looping = self.viewer.clock.is_looping();
        self.viewer.clock.set_has_next(self.clips.is_followed(looping));
        (now, elapsed_s)
    }

    /// Lets the clip play on without a picture: it is heard.
    fn step_hidden(&mut self, now: Instant, elapsed_s: f64) {
        let FrameSeconds { played_s, .. } = self.listen(elapsed_s);
        self.viewer.advance(played_s);
        if let Some(change) = self.clips.advance(&mut self.viewer.clock) {
            self.apply(change);
        }
        self.speaker.rest(&self.viewer.clock, self.viewer.is_scrubbing());
        self.last_frame = self.viewer.clock.is_advancing().then_some(now);
        self.is_continuous = false;
    }

    /// Does what the interface asks the window for, at this picture.
    fn carry_out(&mut self, requests: Requests, state: PictureState) {
        if requests.toggle_full_screen {
            let full = self.window.fullscreen().is_none().then_some(Fullscreen::Borderless(None));
            self.window.set_fullscreen(full);
        }
        if requests.screenshot {
            self.save_picture(state);
        }
        if requests.set_poster {
            self.set_poster();
        }
        for opening in requests.open {
            self.open_chosen(opening);
        }
    }

    /// The inputs of the picture of this frame.
    fn picture_state(&self, [width, height]: [u32; 2]) -> PictureState {
        PictureState {
            revision: self.playing.take.as_ref().map_or(0, TakePlayer::revision),
            t: self.shown_time(),
            view: View::from_camera(&self.viewer.camera(width, height)),
            settings: self.viewer.settings,
        }
    }

    /// Takes in what is heard, and where the camera hears it.
    fn listen(&mut self, elapsed_s: f64) -> FrameSeconds {
        let Session { speaker, viewer, playing, .. } = self;
        // A frame is seen about as long after it is drawn as frames are apart.
        let ahead_s = elapsed_s.min(AHEAD_MAX_S);
        let camera_from_world = DMat4::from_cols_array_2d(&viewer.camera(1, 1).camera_from_world).transpose();
        speaker.place(&viewer.clock, |point| {
            let seen = playing.metres_per_unit * camera_from_world.transform_point3(point);
            DVec3::new(seen.x, -seen.y, -seen.z)
        });
        let played_s = speaker.step(&viewer.clock, viewer.is_scrubbing(), elapsed_s, ahead_s);
        if let Some(note) = self.speaker.take_note() {
            self.apply(Change::Note(note));
        }
        FrameSeconds { elapsed_s, played_s }
    }

    /// Brings the segments of a take up to the position, and lets the clock wait for those that are missing there, or for
    /// the take itself.
    fn update_take(&mut self, now: Instant) {
        let clock = &mut self.viewer.clock;
        let mut notes = Vec::new();
        let (is_missing, what) = match (&mut self.playing.take, &mut self.playing.renderer) {
            (Some(take), Some(renderer)) => {
                take.update(&self.screen.gpu, renderer, clock);
                if self.drawn.is_none_or(|drawn| drawn.revision != take.revision()) {
                    self.viewer.buffered = take.buffered().to_vec();
                }
                notes = take.take_notes();
                notes.extend(self.clips.reopen(clock, || take.is_replaced()));
                (take.is_missing(clock.position_s()), Some("Loading this part of the take"))
            }
            // What is opened was said.
            _ => (self.clips.is_loading(), None),
        };
        clock.set_waiting(is_missing);
        for note in notes {
            self.apply(Change::Note(note));
        }
        match (is_missing, &mut self.loading_since) {
            (true, None) => self.loading_since = Some((now, false)),
            (true, Some((since, said))) if !*said && now - *since > LOADING_PATIENCE => {
                *said = true;
                if let Some(what) = what {
                    self.progress(what.into());
                }
            }
            (true, Some(_)) | (false, None) => {}
            (false, Some((_, said))) => {
                let said = *said;
                self.loading_since = None;
                if said {
                    self.clear_progress();
                }
            }
        }
    }

    /// Time until the next look whether a part of a take has come, or is to be asked for again.
    fn loading_retry(&self) -> Duration {
        self.loading_since.map_or(Duration::MAX, |_| LOADING_RETRY)
    }

    /// Normalised time of the picture: of a take, the latest complete one while a part of it is being loaded.
    fn shown_time(&self) -> f64 {
        let clock = &self.viewer.clock;
        match &self.playing.take {
            Some(take) if clock.duration_s() > 0.0 && !self.playing.viewed.is_static => {
                take.shown_s(clock.position_s()) / clock.duration_s()
            }
            _ => self.viewer.clip_time(),
        }
    }

    /// Shows the picture and the interface over it.
    fn present(
        &mut self,
        frame: SurfaceFrame,
        triangles: &[ClippedPrimitive],
        scale: f32,
        textures: TexturesDelta,
    ) {
        let Screen { gpu, picture, painter, .. } = &mut self.screen;
        let mut encoder = gpu.encoder();
        picture.show(&mut encoder, &frame);
        painter.draw(gpu, &mut encoder, &frame.ui_target(), triangles, scale, textures);
        gpu.submit(encoder);
        self.screen.present(frame);
    }

    /// Draws the clip into the picture.
    fn draw_picture(&mut self, size: [u32; 2], state: &PictureState) -> Result<(), Fault> {
        if self.screen.picture.size != size {
            self.screen.picture = Picture::new(&self.screen.gpu, self.screen.surface.format(), size)?;
        }
        let PictureState { t, view, settings, .. } = state;
        // A new picture is black.
        if let Some(renderer) = &mut self.playing.renderer {
            let Screen { gpu, picture, .. } = &self.screen;
            let mut encoder = gpu.encoder();
            let target = std::slice::from_ref(&picture.view);
            self.counts = renderer.prepare(gpu, *t, &[*view], settings);
            renderer.record(gpu, &mut encoder, target, None, None);
            gpu.submit(encoder);
        }
        self.drawn = Some(*state);
        Ok(())
    }

    /// Saves the picture in the background, in the user's folder for pictures.
    fn save_picture(&mut self, state: PictureState) {
        if self.saving.as_ref().is_some_and(|saving| !saving.is_finished()) {
            return;
        }
        let Some(renderer) = &self.playing.renderer else { return };
        let clock = &self.viewer.clock;
        let screenshot = Screenshot {
            clip: renderer.clip().clone(),
            name: self.playing.title.clone(),
            t: state.t,
            time_s: clock.position_s(),
            view: state.view,
            settings: state.settings,
        };
        let (gpu, proxy) = (self.screen.gpu.clone(), self.proxy.clone());
        self.progress("Saving a picture".into());
        self.saving = Some(std::thread::spawn(move || {
            // The event loop has ended where this fails.
            let _ = proxy.send_event(Event::Saved(screenshot.save(&gpu, &folders::pictures())));
        }));
    }

    /// Waits for a picture that is being saved: it is written whole.
    fn finish_saving(&mut self) {
        if let Some(saving) = self.saving.take() {
            join_in_time(saving);
        }
    }

    /// Opens another device after a frame failed because this one was lost; the clip is loaded again and
    /// continues where it was.
    ///
    /// # Errors
    /// `fault`, of the failed frame, if the device was not lost or had not worked long enough;
    /// [`Fault::Device`] if no other device can be opened.
    pub(super) fn reopen(&mut self, fault: Fault) -> Result<(), Fault> {
        if !self.screen.is_worth_replacing() {
            return Err(fault);
        }
        self.finish_saving();
        self.screen = Screen::open(&self.window)?;
        (self.playing.renderer, self.playing.take) = (None, None);
        self.drawn = None;
        self.last_frame = None;
        self.clips.set_target(WindowTarget::new(&self.screen, &self.proxy), self.viewer.clock.position_s());
        self.progress("Loading the clip for another graphics device".into());
        Ok(())
    }

    /// Rows of the statistics in the corner of the window.
    fn statistics(&mut self, size: [u32; 2]) -> Vec<(&'static str, String)> {
        let FrameCounts { alive, sorted, alive_ms, sort_ms } = self.counts;
        let total = self.playing.gaussians;
        let mut rows = vec![
            ("Gaussians", total.to_string()),
            ("alive now", share(alive, total)),
            ("sorted, drawn", share(sorted, total)),
            ("find, sort", format!("{alive_ms:.2}, {sort_ms:.2} ms")),
        ];
        let announced = self.playing.layers_announced;
        if announced > 1 {
            let there = self.playing.take.as_ref().map_or(0, |take| take.counts().resident_layers);
            let drawn = self.viewer.settings.layers.unwrap_or(there).min(there);
            rows.insert(1, ("layers", format!("{drawn} of {announced}")));
        }
        if let Some(take) = &self.playing.take {
            rows.extend(take.counts().rows());
        }
        if let Some(queue) = self.clips.queue() {
            rows.insert(0, ("clip", format!("{} of {}", queue.position() + 1, queue.len())));
        }
        if let Some(gpu_ms) = self.playing.renderer.as_mut().and_then(Renderer::gpu_ms) {
            rows.push(("GPU", format!("{gpu_ms:.2} ms")));
        }
        if let Some(times) = self.frame_ms.summary() {
            rows.push(("frame p50, p95", format!("{:.1}, {:.1} ms", times.median, times.p95)));
        }
        rows.push(("size", format!("{} x {}", size[0], size[1])));
        rows.push(("adapter", self.screen.gpu.adapter_name.clone()));
        if self.screen.gpu.caps.f16 {
            rows.push(("fragments", "in f16".into()));
        }
        rows
    }
}

impl Drop for Session {
    fn drop(&mut self) {
        self.finish_saving();
    }
}

/// What to say while clips are opened.
fn opening(names: &[String]) -> String {
    match names {
        [] => format!("Opening {}", title(None)),
        [name] => format!("Opening {}", title(Some(name))),
        _ => format!("Opening {} files", names.len()),
    }
}

/// Size of the screen in points, if the display says it.
fn screen_size(event_loop: &ActiveEventLoop) -> Option<LogicalSize<f64>> {
    let monitor = event_loop.primary_monitor().or_else(|| event_loop.available_monitors().next())?;
    Some(monitor.size().to_logical(monitor.scale_factor()))
}

/// Size of a new window in points, on a `screen` of a size in points.
fn first_size(screen: Option<LogicalSize<f64>>) -> LogicalSize<u32> {
    let side = |default: u32, least: u32, screen: Option<f64>| match screen {
        // Some displays do not say how large they are.
        Some(screen) if screen > 0.0 => default.min((SCREEN_PART * screen) as u32).max(least),
        _ => default,
    };
    LogicalSize::new(
        side(DEFAULT_SIZE.width, LEAST_SIZE.width, screen.map(|screen| screen.width)),
        side(DEFAULT_SIZE.height, LEAST_SIZE.height, screen.map(|screen| screen.height)),
    )
}

fn share(count: u32, total: usize) -> String {
    format!("{count} ({:.0} %)", 100.0 * f64::from(count) / total.max(1) as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_new_window_fits_the_screen() {
        for (screen, [width, height]) in [
            (None, [1280, 720]),
            (Some([1920.0, 1080.0]), [1280, 720]),
            (Some([1280.0, 800.0]), [1152, 720]),
            // 1600x1000 pixels at a scale of 2.
            (Some([800.0, 500.0]), [800, 450]),
            (Some([0.0, 0.0]), [1280, 720]),
        ] {
            let size = first_size(screen.map(|[width, height]| LogicalSize::new(width, height)));
            assert_eq!(size, LogicalSize::new(width, height), "{screen:?}");
        }
    }
}
