//! `--headless`: renders images and statistics of a clip with the renderer of the window. Of a playlist it
//! renders images alone, at times from the start of the playlist.
//!
//! A device that is lost after it has rendered enough images is replaced, and the image rendered again.

use std::ops::Range;
use std::sync::Arc;
use std::time::Instant;

use codec::{Camera, Poster};
use glam::{UVec2, uvec2};
use image::RgbImage;
use program::images::{ImageOutput, tiled};
use program::{Fault, output, read_camera};

use crate::args::Args;
use crate::clips::{Change, ClipController, ClipTarget, Entry, LoadOptions, playlist, too_few_layers};
use crate::content::{OpenEvent, OpenTake, cache_dir, open, redacted};
use crate::gpu::{
    ChannelDepth, DEVICE_REPLACED, FrameCounts, FrameLayout, Gpu, Offscreen, Pixels, RenderSettings,
    Renderer, choose_f16,
};
use crate::player::{Beginning, Extent, TakePlayer};
use crate::stats::{FrameStats, LoadingStats, Stats, Summary, TakeStats};
use crate::terminal::Reporter;
use crate::view::View;
use crate::viewpoint;

/// Default size of images.
const DEFAULT_SIZE: UVec2 = uvec2(1280, 720);

/// Most images of a run, whose times are in memory: more than a day at 100 per second.
const IMAGES_MAX: usize = 10_000_000;

/// Tolerance in seconds at the change between two clips of a playlist, whose times are sums.
const CHANGE_TOLERANCE_S: f64 = 1e-6;

/// Renders what `args` ask for.
///
/// # Errors
/// The first [`Fault`]; images written before it stay.
pub fn run(args: &Args) -> Result<(), Fault> {
    let output = check_outputs(args)?;
    match playlist::is_list(&args.clips) {
        true if args.poster => {
            Err(Fault::Usage("--poster is of one clip, not of a playlist: name a clip of it".into()))
        }
        true => run_playlist(args, &output),
        false => run_clip(args, &output),
    }
}

/// Checks before any work is done that the images and statistics can be written.
fn check_outputs(args: &Args) -> Result<ImageOutput, Fault> {
    let path = args.out.as_ref().ok_or_else(|| Fault::Usage("--headless needs --out PATH".into()))?;
    if let Some(frames) = args.frames.as_ref().filter(|frames| frames.len() > IMAGES_MAX) {
        let Range { start, end } = frames;
        return Err(Fault::Usage(format!(
            "--frames {start}..{end}: a run renders {IMAGES_MAX} images at most; give fewer"
        )));
    }
    args.stats.as_ref().map_or(Ok(()), |path| output::check(path))?;
    ImageOutput::check(path, args.frames.is_some() || args.time.len() > 1)
}

/// Writes image number `i`: all eyes from left to right.
fn write_image(output: &ImageOutput, i: usize, eyes: &[Pixels]) -> Result<(), Fault> {
    let image = |eye: &Pixels| {
        RgbImage::from_raw(eye.size.x, eye.size.y, eye.to_rgb8()).expect("three bytes per pixel")
    };
    let images: Vec<RgbImage> = eyes.iter().map(image).collect();
    output.write(i, &tiled(&images, images.len() as u32)).map(drop)
}

/// The graphics device.
struct Device {
    gpu: Gpu,
    /// Bits per channel of the images.
    target: ChannelDepth,
    /// Number of images rendered.
    images: u64,
}

impl Device {
    fn open(target: ChannelDepth) -> Result<Device, Fault> {
        let mut gpu = Gpu::new_headless()?;
        choose_f16(&mut gpu, target)?;
        Ok(Device { gpu, target, images: 0 })
    }

    /// Opens another device in place of one that failed with `fault`: that was lost after it had rendered
    /// enough images.
    ///
    /// # Errors
    /// `fault` if the device was not lost or had not worked long enough; [`Fault::Device`] if no other one
    /// can be opened.
    fn replace(&mut self, fault: Fault) -> Result<(), Fault> {
        if !self.gpu.is_worth_replacing(self.images) {
            return Err(fault);
        }
        *self = Device::open(self.target)?;
        Reporter::new().print(&OpenEvent::Note(DEVICE_REPLACED.into()));
        Ok(())
    }
}

/// A take on the device, and its renderer for the views of `args`.
struct ClipRenderer<'a> {
    args: &'a Args,
    device: &'a mut Device,
    clip: Arc<OpenTake>,
    views: Vec<View>,
    settings: RenderSettings,
    state: DeviceState,
}

/// Waits until what was written to the GPU lies there.
fn finish_uploads(gpu: &Gpu) -> Result<(), Fault> {
    gpu.submit(gpu.encoder());
    gpu.wait()
}

/// A frame that was measured.
struct MeasuredFrame {
    /// With the wall time of drawing.
    stats: FrameStats,
    /// Its GPU time in milliseconds, if the device wrote one.
    gpu_ms: Option<f64>,
}

/// The parts of a [`ClipRenderer`] that are lost with the device.
struct DeviceState {
    image: Offscreen,
    renderer: Renderer,
    take: TakePlayer,
    upload_ms: f64,
}

impl DeviceState {
    fn new(gpu: &Gpu, opened: &Arc<OpenTake>, views: &[View], args: &Args) -> Result<DeviceState, Fault> {
        let mut image = Offscreen::new(gpu, views[0].size, views.len() as u32, args.target)?;
        let inset = args.settings().inset;
        if let Some(side) = inset {
            image = image.foveated(gpu, side)?;
        }
        let layout =
            FrameLayout { format: args.target.format(), eyes: views.len(), foveated: inset.is_some() };
        let start = Instant::now();
        let (mut renderer, mut take) = TakePlayer::new(gpu, opened.clone(), layout, || ())?;
        take.wait(gpu, &mut renderer, 0.0, Extent::All)?;
        finish_uploads(gpu)?;
        let upload_ms = start.elapsed().as_secs_f64() * 1e3;
        Ok(DeviceState { image, renderer, take, upload_ms })
    }
}

impl<'a> ClipRenderer<'a> {
    fn new(
        device: &'a mut Device,
        clip: Arc<OpenTake>,
        poster: Option<Poster>,
        args: &'a Args,
    ) -> Result<ClipRenderer<'a>, Fault> {
        let (views, settings) = (views(args, &clip, poster)?, settings(args, &clip)?);
        let state = match DeviceState::new(&device.gpu, &clip, &views, args) {
            Err(fault) => {
                device.replace(fault)?;
                DeviceState::new(&device.gpu, &clip, &views, args)
            }
            state => state,
        }?;
        Ok(ClipRenderer { args, device, clip, views, settings, state })
    }

    /// Renders the clip at `time_s` and reads the pixels of each eye.
    fn pixels(&mut self, time_s: f64) -> Result<Vec<Pixels>, Fault> {
        self.with_device(|this| {
            this.render(time_s)?;
            this.state.image.read(&this.device.gpu)
        })
    }

    fn render(&mut self, time_s: f64) -> Result<FrameCounts, Fault> {
        self.load(time_s)?;
        self.draw(time_s)
    }

    /// Waits until everything at `time_s` is decoded and uploaded.
    fn load(&mut self, time_s: f64) -> Result<(), Fault> {
        let DeviceState { renderer, take, .. } = &mut self.state;
        take.wait(&self.device.gpu, renderer, time_s, Extent::All)?;
        let mut reporter = Reporter::new();
        take.take_notes().into_iter().for_each(|note| reporter.print(&OpenEvent::Note(note)));
        Ok(())
    }

    /// Draws what is uploaded.
    fn draw(&mut self, time_s: f64) -> Result<FrameCounts, Fault> {
        let t = clip_time(&self.clip, time_s);
        let DeviceState { image, renderer, .. } = &mut self.state;
        image.render(&self.device.gpu, renderer, t, &self.views, &self.settings)
    }

    /// Renders a frame, measures it, and reads the pixels of each eye.
    fn measure(&mut self, time_s: f64) -> Result<(MeasuredFrame, Vec<Pixels>), Fault> {
        self.with_device(|this| {
            if this.device.images == 0 {
                // Drivers finish compiling in the first frame, which would distort its timings.
                this.render(time_s)?;
            }
            this.load(time_s)?;
            finish_uploads(&this.device.gpu)?;
            this.state.renderer.new_gpu_ms();
            let start = Instant::now();
            let counts = this.draw(time_s)?;
            let draw_ms = start.elapsed().as_secs_f64() * 1e3 - counts.alive_ms - counts.sort_ms;
            let DeviceState { image, renderer, .. } = &mut this.state;
            let gpu_ms = renderer.new_gpu_ms();
            let coverage = renderer.count(&this.device.gpu)?;
            let stats = FrameStats {
                time: time_s,
                alive: counts.alive,
                sorted: counts.sorted,
                drawn: coverage.drawn,
                fragments: coverage.fragments,
                alive_ms: counts.alive_ms,
                sort_ms: counts.sort_ms,
                draw_ms,
            };
            Ok((MeasuredFrame { stats, gpu_ms }, image.read(&this.device.gpu)?))
        })
    }

    /// Runs `work` to produce an image; once more on another device if this one is lost after it has rendered
    /// enough images.
    fn with_device<T>(&mut self, mut work: impl FnMut(&mut Self) -> Result<T, Fault>) -> Result<T, Fault> {
        let result = match work(self) {
            Err(fault) => {
                self.device.replace(fault)?;
                self.state = DeviceState::new(&self.device.gpu, &self.clip, &self.views, self.args)?;
                work(self)
            }
            result => result,
        }?;
        self.device.images += 1;
        Ok(result)
    }

    fn stats(&self, loading: LoadingStats, frames: Vec<MeasuredFrame>) -> Stats {
        let gpu_timed = frames.iter().all(|frame| frame.gpu_ms.is_some());
        let timed = |MeasuredFrame { stats, gpu_ms }: MeasuredFrame| FrameStats {
            draw_ms: gpu_ms.filter(|_| gpu_timed).unwrap_or(stats.draw_ms),
            ..stats
        };
        let frames: Vec<FrameStats> = frames.into_iter().map(timed).collect();
        let ClipRenderer { device: Device { gpu, .. }, clip, views, state, .. } = self;
        let DeviceState { renderer, take, upload_ms, .. } = state;
        Stats {
            adapter: gpu.adapter_name.clone(),
            driver: gpu.driver.clone(),
            width: views[0].size.x,
            height: views[0].size.y,
            eyes: views.len(),
            passes: renderer.passes(),
            gaussians: clip.gaussians(),
            gpu_bytes: renderer.clip().bytes(),
            take: Some(take.counts()).filter(|counts| counts.segments > 1).map(TakeStats::from),
            pipelines: renderer.pipelines(),
            loading,
            upload_ms: *upload_ms,
            gpu_timed,
            f16: gpu.caps.f16,
            alive_ms: Summary::new(frames.iter().map(|frame| frame.alive_ms)),
            sort_ms: Summary::new(frames.iter().map(|frame| frame.sort_ms)),
            draw_ms: Summary::new(frames.iter().map(|frame| frame.draw_ms)),
            frames,
        }
    }
}

fn run_clip(args: &Args, output: &ImageOutput) -> Result<(), Fault> {
    let Loaded { clip, poster, stats: loading } = load(args)?;
    let fps = clip.info().fps.into();
    let times = times(args, poster, fps);
    check_times(&times, clip.duration_s(), fps)?;
    views(args, &clip, poster)?;
    settings(args, &clip)?;
    let mut device = Device::open(args.target)?;
    let mut renderer = ClipRenderer::new(&mut device, clip, poster, args)?;
    let mut frames = Vec::new();
    for (i, &time_s) in times.iter().enumerate() {
        if args.stats.is_some() {
            let (frame, eyes) = renderer.measure(time_s)?;
            frames.push(frame);
            write_image(output, i, &eyes)?;
        } else {
            write_image(output, i, &renderer.pixels(time_s)?)?;
        }
    }
    let Some(path) = &args.stats else { return Ok(()) };
    let stats = renderer.stats(loading, frames);
    let mut json = serde_json::to_vec_pretty(&stats).expect("numbers and strings serialise");
    json.push(b'\n');
    output::write(path, &json)
}

/// Checks that a clip has the view and layers of `args`, and uploads nothing: only clips with images to
/// render are uploaded, one at a time.
#[derive(Clone)]
struct HeadlessTarget {
    args: Args,
}

impl ClipTarget for HeadlessTarget {
    type Ready = Arc<OpenTake>;

    fn prepare(&self, entry: &Entry, take: Arc<OpenTake>, _: Beginning<'_>) -> Result<Arc<OpenTake>, Fault> {
        views(&self.args, &take, None)
            .and_then(|_| settings(&self.args, &take))
            .map_err(|fault| named(fault, entry))?;
        Ok(take)
    }
}

fn named(fault: Fault, entry: &Entry) -> Fault {
    fault.about(&redacted(entry.name.as_deref().unwrap_or_default()))
}

/// Renders a playlist, its clips one after the other. Reports and skips clips that cannot be loaded or
/// rendered.
fn run_playlist(args: &Args, output: &ImageOutput) -> Result<(), Fault> {
    if args.stats.is_some() {
        return Err(Fault::Usage("--stats are of one clip, not of a playlist: name a clip of it".into()));
    }
    let mut reporter = Reporter::new();
    let options = LoadOptions { source: args.source(cache_dir()), min_layers: 1, is_complete: true };
    let mut clips = ClipController::new(options, false, || ())?;
    clips.open(args.clips.iter().cloned());
    clips.set_target(HeadlessTarget { args: args.clone() }, 0.0);
    let mut run = PlaylistRun { args, output, device: None, pending: Vec::new(), start_s: 0.0, last: None };
    let mut failed: Option<Fault> = None;
    while let Some((entry, clip)) = next_clip(&mut clips, &mut reporter)? {
        if let Some(fault) = failed.take() {
            reporter.print(&OpenEvent::Note(format!("{fault}; skipped")));
        }
        let times = run.take_times(&clip)?;
        if !run.pending.is_empty() {
            clips.prefetch();
        }
        match run.render(&entry, clip, times)? {
            Rendered::More => {}
            Rendered::All => return Ok(()),
            Rendered::Skipped(fault) => failed = Some(fault),
        }
    }
    match (run.last.take(), failed) {
        (Some(clip), failed) => {
            failed.inspect(|fault| reporter.print(&OpenEvent::Note(format!("{fault}; skipped"))));
            run.render_end(clip)
        }
        (None, Some(fault)) => Err(fault),
        (None, None) => {
            let names: Vec<String> = args.clips.iter().map(|name| redacted(name)).collect();
            Err(Fault::Data(format!("{}: no clip of it plays: name others", names.join(", "))))
        }
    }
}

/// The images of a playlist that are left to render.
struct PlaylistRun<'a> {
    args: &'a Args,
    output: &'a ImageOutput,
    /// Opened for the first image.
    device: Option<Device>,
    /// Number and time of each image. The frame rate of the first clip decides the times.
    pending: Vec<(usize, f64)>,
    /// Where the next clip starts, in seconds.
    start_s: f64,
    /// The clip before.
    last: Option<Arc<OpenTake>>,
}

/// The images left after a clip.
enum Rendered {
    More,
    All,
    /// The clip was skipped.
    Skipped(Fault),
}

impl PlaylistRun<'_> {
    /// Takes the images within `clip`, the next one, from those that are left.
    ///
    /// # Errors
    /// [`Fault::Usage`] if a time is before the start.
    fn take_times(&mut self, clip: &OpenTake) -> Result<Vec<(usize, f64)>, Fault> {
        if self.last.is_none() {
            let times = times(self.args, None, clip.info().fps.into());
            if let Some(time) = times.iter().find(|time| **time < 0.0) {
                return Err(Fault::Usage(format!("time {time} s is before the start: give 0 or later")));
            }
            self.pending = times.into_iter().enumerate().collect();
        }
        let end_s = self.start_s + clip.duration_s();
        let is_here = |&(_, time_s): &(usize, f64)| time_s < end_s - CHANGE_TOLERANCE_S;
        let (here, later) = self.pending.iter().partition(|image| is_here(image));
        self.pending = later;
        Ok(here)
    }

    /// Renders the images `times` of `clip`. If it cannot be uploaded, the next clip takes its place.
    fn render(
        &mut self,
        entry: &Entry,
        clip: Arc<OpenTake>,
        times: Vec<(usize, f64)>,
    ) -> Result<Rendered, Fault> {
        if !times.is_empty() {
            let device = opened(&mut self.device, self.args.target)?;
            match ClipRenderer::new(device, clip.clone(), None, self.args) {
                Ok(mut renderer) => {
                    for (i, time_s) in times {
                        write_image(self.output, i, &renderer.pixels((time_s - self.start_s).max(0.0))?)?;
                    }
                }
                Err(fault) => {
                    if self.device.as_ref().is_some_and(|device| device.gpu.is_lost()) {
                        // The next clip would fail as this one did.
                        return Err(fault);
                    }
                    self.pending.splice(0..0, times);
                    return Ok(Rendered::Skipped(named(fault, entry)));
                }
            }
        }
        (self.start_s, self.last) = (self.start_s + clip.duration_s(), Some(clip));
        Ok(if self.pending.is_empty() { Rendered::All } else { Rendered::More })
    }

    /// Renders the images at the end of the last clip.
    ///
    /// # Errors
    /// [`Fault::Usage`] if a time is beyond the end.
    fn render_end(&mut self, clip: Arc<OpenTake>) -> Result<(), Fault> {
        let (fps, duration_s) = (clip.info().fps, clip.duration_s());
        let times: Vec<f64> = self.pending.iter().map(|&(_, time_s)| time_s).collect();
        check_times(&times, self.start_s, fps.into())?;
        let device = opened(&mut self.device, self.args.target)?;
        let mut renderer = ClipRenderer::new(device, clip, None, self.args)?;
        for &(i, _) in &self.pending {
            write_image(self.output, i, &renderer.pixels(duration_s)?)?;
        }
        Ok(())
    }
}

/// The device for images of `target`, opened at the first call.
fn opened(device: &mut Option<Device>, target: ChannelDepth) -> Result<&mut Device, Fault> {
    if device.is_none() {
        *device = Some(Device::open(target)?);
    }
    Ok(device.as_mut().expect("it was just opened"))
}

/// Waits for the next clip of a playlist; `None` after the last.
///
/// # Errors
/// The fault of the last clip, if none can be loaded.
fn next_clip(
    clips: &mut ClipController<HeadlessTarget>,
    reporter: &mut Reporter,
) -> Result<Option<(Entry, Arc<OpenTake>)>, Fault> {
    loop {
        match clips.follow().or_else(|| clips.wait()) {
            None => return Ok(None),
            Some(Change::Show { entry, clip, .. }) => return Ok(Some((entry, clip))),
            Some(Change::Progress(progress)) => reporter.print(&OpenEvent::Progress(progress)),
            Some(Change::Note(note)) => reporter.print(&OpenEvent::Note(note)),
            Some(Change::Failed(fault)) => return Err(fault),
            Some(Change::Waiting | Change::Idle) => {}
        }
    }
}

/// A clip that was loaded, and the time and view that it states to stand for it.
struct Loaded {
    clip: Arc<OpenTake>,
    poster: Option<Poster>,
    stats: LoadingStats,
}

/// Loads the complete clip, and prints progress.
fn load(args: &Args) -> Result<Loaded, Fault> {
    let start = Instant::now();
    let elapsed_ms = || start.elapsed().as_secs_f64() * 1e3;
    let (mut reporter, mut playable_ms) = (Reporter::new(), None);
    let clip = open(args.clips.first().map(String::as_str), &args.source(cache_dir()))?.wait(|event| {
        if let OpenEvent::Take(_) = event {
            playable_ms.get_or_insert_with(elapsed_ms);
        }
        reporter.print(event);
    })?;
    let poster = args.poster.then(|| clip.poster()).flatten();
    let whole_ms = elapsed_ms();
    let stats = LoadingStats { playable_ms: playable_ms.unwrap_or(whole_ms), whole_ms };
    Ok(Loaded { clip, poster, stats })
}

/// Times of the images in seconds from the start: the time of `poster` if there is one. `captured_fps` is the default
/// of `--fps`.
fn times(args: &Args, poster: Option<Poster>, captured_fps: f64) -> Vec<f64> {
    match &args.frames {
        Some(frames) => {
            let fps = args.fps.unwrap_or(captured_fps);
            frames.clone().map(|frame| f64::from(frame) / fps).collect()
        }
        None if args.time.is_empty() => vec![poster.map_or(0.0, |poster| poster.time_s)],
        None => args.time.clone(),
    }
}

/// Checks that `times` are between 0 and `duration`, in seconds.
fn check_times(times: &[f64], duration: f64, captured_fps: f64) -> Result<(), Fault> {
    // Half a captured frame beyond the end is the end: times in text are rounded.
    let slack = if captured_fps > 0.0 { 0.5 / captured_fps } else { 0.0 };
    match times.iter().find(|&&time| !(0.0..=duration + slack).contains(&time)) {
        Some(time) => Err(Fault::Usage(format!(
            "time {time} s is outside the clip: give 0 to {} s",
            (duration * 1e3).round() / 1e3
        ))),
        None => Ok(()),
    }
}

/// Normalised clip time at `time` seconds, 1 beyond the end.
fn clip_time(clip: &OpenTake, time: f64) -> f64 {
    let duration = clip.duration_s();
    if duration > 0.0 { (time / duration).min(1.0) } else { 0.0 }
}

/// The views of the eyes: the views of `poster` if there is one.
fn views(args: &Args, clip: &OpenTake, poster: Option<Poster>) -> Result<Vec<View>, Fault> {
    if let Some(path) = &args.camera {
        let camera = read_camera(path)?;
        let camera = args.size.map_or(camera.clone(), |size| camera.resized(size.x, size.y));
        return Ok(eyes(args, clip, camera));
    }
    if let Some(poster) = poster {
        let size = args.size.unwrap_or(DEFAULT_SIZE);
        return Ok(eyes(args, clip, poster.viewpoint().camera(clip.info().up, size.x, size.y)));
    }
    let viewpoints = &clip.info().viewpoints;
    let chosen = args.view.as_deref().map_or(Ok(0), |name| viewpoint::find(viewpoints, name))?;
    let viewpoint = &viewpoints[chosen];
    Ok(match args.lens {
        Some(lens) => {
            let size = args.size.map_or(lens.size(), |size| size.to_array());
            let (subject, up) = (clip.subject()?, clip.info().up);
            let head = match args.standpoint() {
                Some(standpoint) => standpoint.camera(&subject, up),
                None => viewpoint.camera(up, 1, 1),
            };
            let cameras = lens.cameras(&head, subject.metres_per_unit, size);
            cameras.iter().map(View::from_camera).collect()
        }
        None => {
            let size = args.size.unwrap_or(DEFAULT_SIZE);
            eyes(args, clip, viewpoint.camera(clip.info().up, size.x, size.y))
        }
    })
}

/// The view of `camera`, or with --stereo the views of two eyes.
fn eyes(args: &Args, clip: &OpenTake, camera: Camera) -> Vec<View> {
    if args.stereo {
        let distance = Camera::EYE_DISTANCE_M / f64::from(clip.info().metres_per_unit);
        camera.stereo_pair(distance).iter().map(View::from_camera).collect()
    } else {
        vec![View::from_camera(&camera)]
    }
}

/// The render settings of `args` for `clip`.
///
/// # Errors
/// [`Fault::Usage`] if the clip has fewer layers than `--layer`.
fn settings(args: &Args, clip: &OpenTake) -> Result<RenderSettings, Fault> {
    let settings = args.settings();
    match settings.layers {
        Some(layers) if layers > clip.layer_count() => {
            Err(too_few_layers(layers, "the clip", clip.layer_count()))
        }
        _ => Ok(settings),
    }
}
