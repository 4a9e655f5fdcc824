//! [`Session`]: a window with its device, the clip it plays, and the frames it draws.
//!
//! Of a playlist, the next clip is made ready while this one plays: these two are on the device, and for a
//! moment a better version of one of them. The change takes no longer than a frame.
//!
//! A device that is lost takes all that was on it along: another one is opened, and the clip loaded anew.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Weak};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use codec::Clip;
use egui::ViewportId;
use glam::UVec2;
use program::Fault;
use winit::dpi::{LogicalSize, PhysicalSize, Size};
use winit::event::WindowEvent;
use winit::event_loop::{ActiveEventLoop, EventLoopProxy};
use winit::window::{Fullscreen, Theme, Window};

use super::frame_times::FrameTimes;
use super::icon;
use super::loader::Loader;
use super::order::carry_out;
use super::overlay::Message;
use super::screen::Screen;
use super::screenshot::Screenshot;
use super::viewed_clip::ViewedClip;
use super::viewer::{Requests, Viewer};
use crate::clips::queue::{Entry, List, Queue, Terms};
use crate::clips::{Arrival, Progress, cache_dir, title};
use crate::gpu::{Format, FrameCounts, Gpu, GpuClip, Picture, RenderSettings, Renderer};
use crate::view::View;

/// Size of the window in points where nothing says another, and the least that holds the controls.
const DEFAULT_SIZE: LogicalSize<u32> = LogicalSize::new(1280, 720);
const LEAST_SIZE: LogicalSize<u32> = LogicalSize::new(720, 360);

/// How often to look whether a hidden window has come back.
const HIDDEN_RETRY: Duration = Duration::from_millis(200);

/// What to open a window with.
pub(super) struct Start {
    /// Where the clip comes from, as [`clips::open`] takes it.
    pub(super) origin: Option<String>,
    pub(super) clip: Clip,
    /// Better versions of it that are on their way.
    pub(super) rest: Arrival,
    /// The playlist that it is of, standing at it.
    pub(super) list: Option<Queue>,
    /// Number of the viewpoint to start from.
    pub(super) viewpoint: usize,
    pub(super) settings: RenderSettings,
    /// Size in pixels.
    pub(super) size: Option<UVec2>,
}

/// What other threads report.
pub(super) enum Event {
    /// What came of an order, with its number.
    Loading(u64, Told),
    /// A picture, with its path.
    Saved(Result<PathBuf, Fault>),
}

/// What is to be loaded.
pub(super) enum Order {
    /// A clip or a playlist that was dropped on the window.
    Open(String),
    /// The rest of the clip from this origin, which plays already.
    Rest(Option<String>, Arrival),
    /// The clip from this origin, to go on with where it was.
    Again(Option<String>),
    /// The first of these that can be had, to be played next.
    Next(Vec<Entry>, Terms),
}

/// An order, and the device that clips are made ready on, as long as the window has it.
pub(super) struct Job {
    pub(super) gpu: Weak<Gpu>,
    pub(super) format: Format,
    pub(super) order: Order,
}

/// What is told of an order.
pub(super) enum Told {
    /// How far it is.
    Progress(Progress),
    Note(String),
    /// Something of a playlist could not be had.
    Skipped(Fault),
    /// A clip to be played from its start, with the playlist that it is of.
    New(Box<Playing>, Option<Queue>),
    /// The clip to be played next, by its number in the playlist.
    Next(Box<Playing>, usize),
    /// A better version of the clip that was told last.
    Better(Box<Playing>),
    Failed(Fault),
    /// Nothing, to see whether somebody still waits.
    Waiting,
    /// No more is to come.
    Done,
}

/// When to draw the next frame.
pub(super) enum Next {
    Now,
    After(Duration),
    OnInput,
}

/// A clip that is ready to be drawn.
pub(super) struct Playing {
    /// Where it comes from, as [`clips::open`] takes it.
    origin: Option<String>,
    viewed: ViewedClip,
    /// `None` where the device that it was on is gone.
    renderer: Option<Renderer>,
    /// Gaussians in the clip, plate included.
    gaussians: usize,
    /// Layers that the package announces; not all are there where the file was cut short.
    layers_announced: usize,
}

impl Playing {
    /// Uploads a clip and builds what draws it.
    pub(super) fn new(
        gpu: &Gpu,
        format: Format,
        origin: Option<String>,
        clip: &Clip,
    ) -> Result<Playing, Fault> {
        let on_gpu = Arc::new(GpuClip::upload(gpu, clip)?);
        Ok(Playing {
            origin,
            viewed: ViewedClip::new(clip),
            renderer: Some(Renderer::new(gpu, on_gpu, format, 1)?),
            gaussians: clip.len() + clip.plate.as_ref().map_or(0, |plate| plate.len()),
            layers_announced: clip.layers_announced,
        })
    }

    fn title(&self) -> String {
        title(self.origin.as_deref())
    }
}

/// What a picture of a clip depends on.
#[derive(Clone, Copy, PartialEq)]
struct Shown {
    /// Normalised clip time.
    t: f64,
    view: View,
    settings: RenderSettings,
}

/// An open window.
pub(super) struct Session {
    playing: Playing,
    viewer: Viewer,
    /// What the picture shows; `None` where it must be drawn anew.
    shown: Option<Shown>,
    counts: FrameCounts,
    frame_times: FrameTimes,
    /// When the frame before was drawn; `None` after a rest.
    last_frame: Option<Instant>,
    loader: Loader<Job>,
    /// Whether an order is under way.
    loading: bool,
    list: Option<List<Playing>>,
    saving: Option<JoinHandle<()>>,
    proxy: EventLoopProxy<Event>,
    screen: Screen,
    window: Arc<Window>,
}

impl Session {
    /// Opens a window and draws its first frame when the event loop asks for it.
    pub(super) fn open(
        event_loop: &ActiveEventLoop,
        proxy: EventLoopProxy<Event>,
        start: Start,
    ) -> Result<Session, Fault> {
        let size = start.size.map_or(Size::Logical(DEFAULT_SIZE.cast()), |size| {
            Size::Physical(PhysicalSize::new(size.x, size.y))
        });
        let attributes = Window::default_attributes()
            .with_title(title(start.origin.as_deref()))
            .with_window_icon(icon::icon())
            .with_theme(Some(Theme::Dark))
            .with_min_inner_size(LEAST_SIZE)
            .with_inner_size(size);
        let window = event_loop
            .create_window(attributes)
            .map_err(|error| Fault::Device(format!("cannot open a window: {error}; try --headless")))?;
        let window = Arc::new(window);
        let screen = Screen::open(&window)?;
        let playing = Playing::new(&screen.gpu, screen.surface.format(), start.origin, &start.clip)?;
        let viewer = Viewer::new(playing.viewed.clone(), start.viewpoint, start.settings);
        let loader = {
            let proxy = proxy.clone();
            // Without an event loop there is no window left to tell.
            let deliver = move |order, told| drop(proxy.send_event(Event::Loading(order, told)));
            Loader::new(carry_out, deliver)
        };
        let loader = loader.map_err(|error| Fault::Device(format!("cannot start a thread: {error}")))?;
        window.request_redraw();
        let mut session = Session {
            viewer,
            shown: None,
            counts: FrameCounts::default(),
            frame_times: FrameTimes::default(),
            last_frame: None,
            loader,
            loading: false,
            list: start.list.map(List::new),
            saving: None,
            proxy,
            playing,
            screen,
            window,
        };
        session.order(Order::Rest(session.playing.origin.clone(), start.rest));
        Ok(session)
    }

    /// Takes in an event of the window.
    pub(super) fn input(&mut self, event: &WindowEvent) {
        if self.screen.input.on_window_event(&self.window, event).repaint {
            self.window.request_redraw();
        }
    }

    /// Asks the event loop for a frame.
    pub(super) fn request_frame(&self) {
        self.window.request_redraw();
    }

    /// Loads a clip or a playlist in the background; the present one plays on.
    pub(super) fn load(&mut self, path: &Path) {
        self.screen.input.egui_input_mut().hovered_files.clear();
        self.viewer.message = Some(match path.to_str() {
            Some(name) => {
                if let Some(list) = &mut self.list {
                    list.forget_next();
                }
                self.order(Order::Open(name.into()));
                Message::Working(format!("Opening {}", title(Some(name))))
            }
            None => Message::Error(format!("{}: its name is not text", path.display())),
        });
        self.window.request_redraw();
    }

    fn order(&mut self, order: Order) {
        self.loading = true;
        let Screen { gpu, surface, .. } = &self.screen;
        self.loader.load(Job { gpu: Arc::downgrade(gpu), format: surface.format(), order });
    }

    /// Orders the next clip of the playlist, if there is one and nothing else is under way.
    fn order_next(&mut self) {
        if !self.loading
            && let Some((entries, awaited)) = self.list.as_mut().and_then(List::ask)
        {
            let terms = Terms { kept: cache_dir(), layers: Some(1), awaited };
            self.order(Order::Next(entries, terms));
        }
    }

    /// At the end of a clip of a playlist, goes on with the next one as soon as it is ready, unless the
    /// viewer has paused.
    fn follow(&mut self) {
        let Some(list) = &mut self.list else { return };
        let player = &mut self.viewer.player;
        if player.take_started_over() {
            list.start_over();
            return self.order_next();
        }
        if player.overrun_s().is_none() || !player.is_playing() {
            return;
        }
        if let Some(playing) = list.take() {
            self.window.set_title(&playing.title());
            self.viewer.continue_with(playing.viewed.clone());
            self.playing = playing;
            self.shown = None;
            self.forget_working();
            self.order_next();
        } else if list.awaits() {
            self.viewer.message = Some(Message::Working("Loading the next clip".into()));
        }
    }

    /// What was under way is done.
    fn forget_working(&mut self) {
        if let Some(Message::Working(_)) = self.viewer.message {
            self.viewer.message = None;
        }
    }

    /// Takes in what another thread reports.
    pub(super) fn receive(&mut self, event: Event) {
        match event {
            Event::Loading(order, told) if self.loader.is_latest(order) => self.hear(told),
            Event::Loading(..) => {}
            Event::Saved(Ok(path)) => {
                let text = format!("Saved {}", path.display());
                self.viewer.message = Some(Message::note(self.screen.input.egui_ctx(), text));
            }
            Event::Saved(Err(fault)) => self.viewer.message = Some(Message::Error(fault.to_string())),
        }
        self.window.request_redraw();
    }

    /// Takes in what is told of the order under way.
    fn hear(&mut self, told: Told) {
        match told {
            Told::Progress(progress) => {
                let text = format!("Loading: {}", progress.text());
                self.viewer.message = Some(Message::Working(text));
            }
            Told::Note(note) => self.viewer.message = Some(Message::note(self.screen.input.egui_ctx(), note)),
            Told::Skipped(fault) => {
                let text = format!("{fault}; skipped");
                self.viewer.message = Some(Message::note(self.screen.input.egui_ctx(), text));
            }
            Told::New(playing, queue) => {
                self.window.set_title(&playing.title());
                self.viewer.change_clip(playing.viewed.clone());
                self.last_frame = None;
                self.list = queue.map(List::new);
                self.playing = *playing;
                self.shown = None;
            }
            Told::Next(playing, number) => {
                if let Some(list) = &mut self.list {
                    list.put(number, *playing);
                }
            }
            Told::Better(playing) => match self.list.as_mut().and_then(List::ready) {
                Some(next) => *next = *playing,
                None => {
                    self.viewer.update_clip(playing.viewed.clone());
                    self.playing = *playing;
                    self.shown = None;
                }
            },
            Told::Waiting => {}
            Told::Failed(fault) => {
                // Of what comes next, the others were told to be skipped, too.
                self.viewer.message = Some(match self.list.as_ref().is_some_and(List::is_coming) {
                    true => Message::note(self.screen.input.egui_ctx(), format!("{fault}; skipped")),
                    false => Message::Error(fault.to_string()),
                });
                self.finish();
            }
            Told::Done => {
                self.forget_working();
                self.finish();
            }
        }
    }

    /// No more comes of the order under way.
    fn finish(&mut self) {
        self.loading = false;
        if let Some(list) = &mut self.list {
            list.finish();
        }
        self.order_next();
    }

    /// Draws and shows a frame.
    ///
    /// # Errors
    /// [`Fault::Device`] if the device was lost or has failed.
    pub(super) fn frame(&mut self) -> Result<Next, Fault> {
        let Some(frame) = self.screen.surface.acquire(&self.screen.gpu)? else {
            self.last_frame = None;
            return Ok(Next::After(HIDDEN_RETRY));
        };
        let now = Instant::now();
        let elapsed_s = self.last_frame.map_or(0.0, |last| (now - last).as_secs_f64());
        if self.last_frame.is_some() {
            self.frame_times.push(elapsed_s);
        }

        let looping = self.viewer.player.is_looping();
        self.viewer.player.set_has_next(self.list.as_ref().is_some_and(|list| list.goes_on(looping)));
        let ctx = self.screen.input.egui_ctx().clone();
        let input = self.screen.input.take_egui_input(&self.window);
        let statistics = self.statistics(frame.size);
        let mut requests = Requests::default();
        let output = ctx.run_ui(input, |ui| requests = self.viewer.frame(ui, elapsed_s, &statistics));
        self.follow();

        let [width, height] = frame.size;
        let wanted = Shown {
            t: self.viewer.player.clip_time(),
            view: View::from_camera(&self.viewer.camera(width, height)),
            settings: self.viewer.settings,
        };
        let outdated = self.shown != Some(wanted);
        if outdated {
            self.draw_picture(frame.size, &wanted)?;
        }
        let mut encoder = self.screen.gpu.encoder();
        self.screen.picture.show(&mut encoder, &frame);
        let triangles = ctx.tessellate(output.shapes, output.pixels_per_point);
        let scale = output.pixels_per_point;
        let target = frame.ui_target();
        self.screen.painter.draw(
            &self.screen.gpu,
            &mut encoder,
            &target,
            &triangles,
            scale,
            output.textures_delta,
        );
        self.screen.gpu.submit(encoder);
        self.screen.present(frame);
        self.screen.input.handle_platform_output(&self.window, output.platform_output);

        if requests.toggle_full_screen {
            let full = self.window.fullscreen().is_none().then_some(Fullscreen::Borderless(None));
            self.window.set_fullscreen(full);
        }
        if requests.screenshot {
            self.save_picture(wanted);
        }
        let animating = self.viewer.is_animating();
        self.last_frame = animating.then_some(now);
        let delay =
            output.viewport_output.get(&ViewportId::ROOT).map_or(Duration::MAX, |root| root.repaint_delay);
        Ok(match delay {
            // The statistics shown are those of the frame before.
            _ if animating || outdated => Next::Now,
            Duration::ZERO => Next::Now,
            Duration::MAX => Next::OnInput,
            delay => Next::After(delay),
        })
    }

    /// Draws the clip into the picture.
    fn draw_picture(&mut self, size: [u32; 2], wanted: &Shown) -> Result<(), Fault> {
        if self.screen.picture.size != size {
            self.screen.picture = Picture::new(&self.screen.gpu, self.screen.surface.format(), size)?;
        }
        let Shown { t, view, settings } = wanted;
        // A picture is black until something is drawn.
        if let Some(renderer) = &mut self.playing.renderer {
            let Screen { gpu, picture, .. } = &self.screen;
            let mut encoder = gpu.encoder();
            let target = std::slice::from_ref(&picture.view);
            self.counts = renderer.draw(gpu, &mut encoder, *t, &[*view], settings, target);
            gpu.submit(encoder);
        }
        self.shown = Some(*wanted);
        Ok(())
    }

    /// Saves what is seen in the background, in the folder that the program runs in.
    fn save_picture(&mut self, shown: Shown) {
        if self.saving.as_ref().is_some_and(|saving| !saving.is_finished()) {
            return;
        }
        let Some(renderer) = &self.playing.renderer else { return };
        let player = &self.viewer.player;
        let screenshot = Screenshot {
            clip: renderer.clip().clone(),
            name: self.playing.title(),
            t: shown.t,
            time_s: player.position_s(),
            view: shown.view,
            settings: shown.settings,
        };
        let (gpu, proxy) = (self.screen.gpu.clone(), self.proxy.clone());
        self.viewer.message = Some(Message::Working("Saving a picture".into()));
        self.saving = Some(std::thread::spawn(move || {
            let folder = std::env::current_dir().unwrap_or_else(|_| PathBuf::from("."));
            // Without an event loop there is no window left to tell.
            let _ = proxy.send_event(Event::Saved(screenshot.save(&gpu, &folder)));
        }));
    }

    /// Waits for a picture under way: it is written whole, and the device must not go away below it.
    fn finish_saving(&mut self) {
        if let Some(saving) = self.saving.take() {
            let _ = saving.join();
        }
    }

    /// After a frame that failed: opens another device if this one is gone and has worked until then. The
    /// clip is loaded anew, and goes on where it is.
    ///
    /// # Errors
    /// `fault`, why the frame failed, if that is no reason to; [`Fault::Device`] if no other device can be
    /// opened.
    pub(super) fn reopen(&mut self, fault: Fault) -> Result<(), Fault> {
        if !self.screen.is_worth_reopening() {
            return Err(fault);
        }
        self.finish_saving();
        self.screen = Screen::open(&self.window)?;
        self.playing.renderer = None;
        if let Some(list) = &mut self.list {
            list.forget_next();
        }
        self.shown = None;
        self.last_frame = None;
        self.order(Order::Again(self.playing.origin.clone()));
        self.viewer.message = Some(Message::Working("Loading the clip for another graphics device".into()));
        self.window.request_redraw();
        Ok(())
    }

    /// Rows for the corner of the window.
    fn statistics(&mut self, size: [u32; 2]) -> Vec<(&'static str, String)> {
        let FrameCounts { alive, sorted, alive_ms, sort_ms, .. } = self.counts;
        let total = self.playing.gaussians;
        let mut rows = vec![
            ("Gaussians", total.to_string()),
            ("alive now", share(alive, total)),
            ("sorted, drawn", share(sorted, total)),
            ("find, sort", format!("{alive_ms:.2}, {sort_ms:.2} ms")),
        ];
        let announced = self.playing.layers_announced;
        if announced > 1 {
            let there = self.viewer.layers();
            let drawn = self.viewer.settings.layers.unwrap_or(there).min(there);
            rows.insert(1, ("layers", format!("{drawn} of {announced}")));
        }
        if let Some(list) = &self.list {
            rows.insert(0, ("clip", list.place()));
        }
        if let Some(gpu_ms) = self.playing.renderer.as_mut().and_then(Renderer::gpu_ms) {
            rows.push(("GPU", format!("{gpu_ms:.2} ms")));
        }
        if let Some(times) = self.frame_times.summary() {
            rows.push(("frame p50, p95", format!("{:.1}, {:.1} ms", times.median, times.p95)));
        }
        rows.push(("size", format!("{} x {}", size[0], size[1])));
        rows.push(("adapter", self.screen.gpu.adapter_name.clone()));
        rows
    }
}

impl Drop for Session {
    fn drop(&mut self) {
        self.finish_saving();
    }
}

fn share(count: u32, total: usize) -> String {
    format!("{count} ({:.0} %)", 100.0 * f64::from(count) / total.max(1) as f64)
}
