//! Renders images and statistics of a clip, through the renderer that a window uses; images only for a
//! playlist, whose clips follow one another in time.
//!
//! A device that is lost after it has drawn enough is replaced, and the image drawn again.

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use codec::{Camera, Clip};
use glam::{UVec2, uvec2};

use crate::args::Args;
use crate::clips::{
    Change, ClipController, ClipTarget, Entry, LoadEvent, LoadOptions, cache_dir, playlist, printable,
};
use crate::gpu::{DEVICE_REPLACED, FrameCounts, Gpu, GpuClip, Offscreen, Pixels, RenderSettings, Renderer};
use crate::stats::{FrameStats, LoadingStats, Stats, Summary};
use crate::terminal::Reporter;
use crate::view::{EYE_DISTANCE_M, View};
use crate::{clips, viewpoint};
use program::Fault;
use program::output;

/// Default size of images.
const DEFAULT_SIZE: UVec2 = uvec2(1280, 720);

/// Seconds before a clip's end that belong to the next clip: times of a playlist are sums with rounding
/// errors.
const CHANGE_S: f64 = 1e-6;

/// Renders what `args` ask for.
///
/// # Errors
/// Any [`Fault`]; images that were written before it stay.
pub fn run(args: &Args) -> Result<(), Fault> {
    let output = Output::check(args)?;
    match args.clip.as_deref().filter(|name| playlist::is_playlist(name)) {
        Some(list) => run_list(args, list, &output),
        None => run_clip(args, &output),
    }
}

/// The output of images.
struct Output<'a> {
    path: &'a Path,
    /// Whether `path` is a folder for several images.
    many: bool,
}

impl Output<'_> {
    fn check(args: &Args) -> Result<Output<'_>, Fault> {
        let path = args.out.as_ref().ok_or_else(|| Fault::Usage("--headless needs --out PATH".into()))?;
        let many = args.time.len() > 1 || args.frames.as_ref().is_some_and(|frames| frames.len() > 1);
        if many {
            output::check_folder(path)?;
        } else {
            output::check(path)?;
        }
        args.stats.as_ref().map_or(Ok(()), |path| output::check(path))?;
        Ok(Output { path, many })
    }

    /// Writes image number `i`.
    fn write(&self, i: usize, eyes: &[Pixels]) -> Result<(), Fault> {
        let (rgb, size) = side_by_side(eyes);
        if !self.many {
            return output::write_png(self.path, &rgb, size.into());
        }
        output::make_folder(self.path)?;
        output::write_png(&self.path.join(format!("frame_{i:04}.png")), &rgb, size.into())
    }
}

/// The graphics device.
struct Device {
    gpu: Gpu,
    /// Number of images that it has drawn.
    images: u64,
}

impl Device {
    fn open() -> Result<Device, Fault> {
        Ok(Device { gpu: Gpu::new_headless()?, images: 0 })
    }
}

/// A clip on the device, and the renderer of the requested eyes.
struct Stage<'a> {
    args: &'a Args,
    device: &'a mut Device,
    clip: Arc<Clip>,
    views: Vec<View>,
    settings: RenderSettings,
    on_device: OnDevice,
}

/// The parts of a [`Stage`] that a lost device takes along.
struct OnDevice {
    image: Offscreen,
    renderer: Renderer,
    upload_ms: f64,
}

impl OnDevice {
    fn new(gpu: &Gpu, clip: &Clip, views: &[View], args: &Args) -> Result<OnDevice, Fault> {
        let image = Offscreen::new(gpu, views[0].size, views.len() as u32, args.target)?;
        let start = Instant::now();
        let on_gpu = Arc::new(GpuClip::upload(gpu, clip)?);
        let upload_ms = start.elapsed().as_secs_f64() * 1e3;
        let renderer = Renderer::new(gpu, on_gpu, args.target.format(), views.len())?;
        Ok(OnDevice { image, renderer, upload_ms })
    }
}

impl<'a> Stage<'a> {
    fn new(device: &'a mut Device, clip: Arc<Clip>, args: &'a Args) -> Result<Stage<'a>, Fault> {
        let (views, settings) = (views(args, &clip)?, settings(args, &clip)?);
        let on_device = OnDevice::new(&device.gpu, &clip, &views, args)?;
        Ok(Stage { args, device, clip, views, settings, on_device })
    }

    /// Draws the instant `time` seconds from the start of the clip.
    fn draw(&mut self, time: f64) -> Result<Vec<Pixels>, Fault> {
        self.unless_lost(|stage| {
            stage.render(time)?;
            stage.on_device.image.read(&stage.device.gpu)
        })
    }

    fn render(&mut self, time: f64) -> Result<FrameCounts, Fault> {
        let t = clip_time(&self.clip, time);
        let OnDevice { image, renderer, .. } = &mut self.on_device;
        image.render(&self.device.gpu, renderer, t, &self.views, &self.settings)
    }

    /// Draws a frame, measures it, and reads it back.
    fn measure(&mut self, time: f64) -> Result<(FrameStats, Vec<Pixels>), Fault> {
        self.unless_lost(|stage| {
            if stage.device.images == 0 {
                // Drivers finish compiling in the first frame: keep that out of the timings.
                stage.render(time)?;
            }
            let start = Instant::now();
            let counts = stage.render(time)?;
            let wall_ms = start.elapsed().as_secs_f64() * 1e3 - counts.alive_ms - counts.sort_ms;
            let t = clip_time(&stage.clip, time);
            let OnDevice { image, renderer, .. } = &mut stage.on_device;
            let draw_ms = renderer.gpu_ms().unwrap_or(wall_ms);
            let coverage = renderer.count(&stage.device.gpu, t, &stage.views, &stage.settings)?;
            let stats = FrameStats {
                time,
                alive: counts.alive,
                sorted: counts.sorted,
                drawn: coverage.drawn,
                fragments: coverage.fragments,
                alive_ms: counts.alive_ms,
                sort_ms: counts.sort_ms,
                draw_ms,
            };
            Ok((stats, image.read(&stage.device.gpu)?))
        })
    }

    /// Draws an image by `work`; again on another device if this one is lost after it has drawn enough.
    fn unless_lost<T>(&mut self, mut work: impl FnMut(&mut Self) -> Result<T, Fault>) -> Result<T, Fault> {
        let result = match work(self) {
            Err(_) if self.device.gpu.is_worth_replacing(self.device.images) => {
                *self.device = Device::open()?;
                self.on_device = OnDevice::new(&self.device.gpu, &self.clip, &self.views, self.args)?;
                Reporter::new().tell(&LoadEvent::Note(DEVICE_REPLACED.into()));
                work(self)
            }
            result => result,
        }?;
        self.device.images += 1;
        Ok(result)
    }
}

fn run_clip(args: &Args, output: &Output) -> Result<(), Fault> {
    let (clip, loading) = load(args)?;
    let times = times(args, clip.info.fps.into());
    check_times(&times, clip.info.duration_s.into(), clip.info.fps.into())?;
    views(args, &clip)?;
    settings(args, &clip)?;
    let mut device = Device::open()?;
    let mut stage = Stage::new(&mut device, Arc::new(clip), args)?;
    let mut frames = Vec::new();
    for (i, &time) in times.iter().enumerate() {
        if args.stats.is_some() {
            let (stats, eyes) = stage.measure(time)?;
            frames.push(stats);
            output.write(i, &eyes)?;
        } else {
            output.write(i, &stage.draw(time)?)?;
        }
    }

    if let Some(path) = &args.stats {
        let Stage { device: Device { gpu, .. }, clip, views, on_device, .. } = stage;
        let OnDevice { renderer, upload_ms, .. } = on_device;
        let stats = Stats {
            adapter: gpu.adapter_name.clone(),
            driver: gpu.driver.clone(),
            width: views[0].size.x,
            height: views[0].size.y,
            eyes: views.len(),
            passes: views.len() / renderer.eyes_per_pass() as usize,
            gaussians: clip.len() + clip.plate.as_ref().map_or(0, |plate| plate.len()),
            gpu_bytes: renderer.clip().bytes(),
            pipelines: renderer.pipelines(),
            loading,
            upload_ms,
            gpu_timed: gpu.caps.timestamps,
            alive_ms: Summary::of(frames.iter().map(|frame| frame.alive_ms)),
            sort_ms: Summary::of(frames.iter().map(|frame| frame.sort_ms)),
            draw_ms: Summary::of(frames.iter().map(|frame| frame.draw_ms)),
            frames,
        };
        let mut json = serde_json::to_vec_pretty(&stats).expect("numbers and strings serialise");
        json.push(b'\n');
        output::write(path, &json)?;
    }
    Ok(())
}

/// Makes nothing ready: only clips with requested images are uploaded, one at a time. Clips that cannot be
/// drawn as `args` ask fail.
#[derive(Clone)]
struct ListTarget {
    args: Args,
}

impl ClipTarget for ListTarget {
    type Ready = Arc<Clip>;

    fn prepare(&self, entry: &Entry, clip: Box<Clip>) -> Result<Arc<Clip>, Fault> {
        views(&self.args, &clip)
            .and_then(|_| settings(&self.args, &clip))
            .map_err(|fault| named(fault, entry))?;
        Ok(clip.into())
    }
}

fn named(fault: Fault, entry: &Entry) -> Fault {
    fault.about(&printable(entry.name.as_deref().unwrap_or_default()))
}

/// Renders a playlist: its clips one after the other, as they play. Clips that cannot be loaded or drawn are
/// reported and skipped.
fn run_list(args: &Args, list: &str, output: &Output) -> Result<(), Fault> {
    if args.stats.is_some() {
        return Err(Fault::Usage("--stats are of one clip, not of a playlist: name the clip".into()));
    }
    let mut reporter = Reporter::new();
    let options = LoadOptions { cache_dir: cache_dir(), min_layers: 1, is_complete: true };
    let mut clips = ClipController::new(options, false, || ())?;
    clips.open(Some(list.into()));
    clips.set_target(ListTarget { args: args.clone() });
    let mut device = None;
    let mut last: Option<Arc<Clip>> = None;
    let mut failed: Option<Fault> = None;
    let (mut todo, mut start) = (Vec::new(), 0.0);
    while let Some((entry, clip)) = next_clip(&mut clips, &mut reporter)? {
        if let Some(fault) = failed.take() {
            reporter.tell(&LoadEvent::Note(format!("{fault}; skipped")));
        }
        if last.is_none() {
            let times = times(args, clip.info.fps.into());
            if let Some(time) = times.iter().find(|time| **time < 0.0) {
                return Err(Fault::Usage(format!("time {time} s is before the start")));
            }
            todo = times.into_iter().enumerate().collect();
        }
        let end = start + f64::from(clip.info.duration_s);
        let (here, later): (Vec<_>, Vec<_>) =
            todo.iter().copied().partition(|&(_, time)| time < end - CHANGE_S);
        if !here.is_empty() {
            match Stage::new(opened(&mut device)?, clip.clone(), args) {
                Ok(mut stage) => {
                    for (i, time) in here {
                        output.write(i, &stage.draw((time - start).max(0.0))?)?;
                    }
                }
                Err(fault) => {
                    failed = Some(named(fault, &entry));
                    continue;
                }
            }
        }
        todo = later;
        last = Some(clip);
        start = end;
        if todo.is_empty() {
            return Ok(());
        }
    }
    let Some(clip) = last else {
        return Err(failed.unwrap_or_else(|| Fault::Data("there is no clip".into())));
    };
    failed.inspect(|fault| reporter.tell(&LoadEvent::Note(format!("{fault}; skipped"))));
    // The times left are the very end, or beyond it.
    let (fps, duration) = (clip.info.fps, clip.info.duration_s);
    let left: Vec<f64> = todo.iter().map(|&(_, time)| time).collect();
    check_times(&left, start, fps.into())?;
    let mut stage = Stage::new(opened(&mut device)?, clip, args)?;
    todo.iter().try_for_each(|&(i, _)| output.write(i, &stage.draw(duration.into())?))
}

/// The device, opened when it is needed first.
fn opened(device: &mut Option<Device>) -> Result<&mut Device, Fault> {
    if device.is_none() {
        *device = Some(Device::open()?);
    }
    Ok(device.as_mut().expect("it was just opened"))
}

/// Waits for the next clip of a playlist; `None` after the last.
///
/// # Errors
/// Why none can be loaded.
fn next_clip(
    clips: &mut ClipController<ListTarget>,
    reporter: &mut Reporter,
) -> Result<Option<(Entry, Arc<Clip>)>, Fault> {
    loop {
        match clips.follow().or_else(|| clips.wait()) {
            None => return Ok(None),
            Some(Change::Show { entry, clip, .. }) => return Ok(Some((entry, clip))),
            Some(Change::Progress(progress)) => reporter.tell(&LoadEvent::Progress(progress)),
            Some(Change::Note(note)) => reporter.tell(&LoadEvent::Note(note)),
            Some(Change::Failed(fault)) => return Err(fault),
            Some(Change::Waiting | Change::Idle) => {}
        }
    }
}

/// Loads the complete clip, with its progress on the terminal.
fn load(args: &Args) -> Result<(Clip, LoadingStats), Fault> {
    let start = Instant::now();
    let elapsed_ms = || start.elapsed().as_secs_f64() * 1e3;
    let (mut reporter, mut playable_ms) = (Reporter::new(), None);
    let clip = clips::open(args.clip.as_deref(), cache_dir())?.wait(None, |event| {
        if let LoadEvent::Clip(_) = event {
            playable_ms.get_or_insert_with(elapsed_ms);
        }
        reporter.tell(event);
    })?;
    let whole_ms = elapsed_ms();
    Ok((clip, LoadingStats { playable_ms: playable_ms.unwrap_or(whole_ms), whole_ms }))
}

/// The times to render, in seconds from the start; frames are counted at `captured_fps` by default.
fn times(args: &Args, captured_fps: f64) -> Vec<f64> {
    match &args.frames {
        Some(frames) => {
            let fps = args.fps.unwrap_or(captured_fps);
            frames.clone().map(|frame| f64::from(frame) / fps).collect()
        }
        None if args.time.is_empty() => vec![0.0],
        None => args.time.clone(),
    }
}

/// Checks that times are within `duration` seconds.
fn check_times(times: &[f64], duration: f64, captured_fps: f64) -> Result<(), Fault> {
    // Times in text are rounded: half a captured frame beyond the end counts as the end.
    let slack = if captured_fps > 0.0 { 0.5 / captured_fps } else { 0.0 };
    match times.iter().find(|&&time| !(0.0..=duration + slack).contains(&time)) {
        Some(time) => {
            Err(Fault::Usage(format!("time {time} s is outside the clip, which lasts {duration} s")))
        }
        None => Ok(()),
    }
}

/// Normalised clip time of `time` seconds.
fn clip_time(clip: &Clip, time: f64) -> f64 {
    let duration = f64::from(clip.info.duration_s);
    if duration > 0.0 { (time / duration).min(1.0) } else { 0.0 }
}

/// The views of the requested eyes.
fn views(args: &Args, clip: &Clip) -> Result<Vec<View>, Fault> {
    let camera: Camera = match (&args.camera, &args.view) {
        (Some(path), _) => {
            let camera = viewpoint::read_camera(path)?;
            args.size.map_or(camera.clone(), |size| camera.resized(size.x, size.y))
        }
        (None, name) => {
            let viewpoints = viewpoint::viewpoints(clip);
            let chosen = name.as_deref().map_or(Ok(0), |name| viewpoint::find(&viewpoints, name))?;
            viewpoint::camera(clip, &viewpoints[chosen], args.size.unwrap_or(DEFAULT_SIZE))
        }
    };
    let view = View::from_camera(&camera);
    if args.stereo {
        Ok(view.stereo_pair(EYE_DISTANCE_M / clip.info.metres_per_unit).to_vec())
    } else {
        Ok(vec![view])
    }
}

/// The settings of `args`, checked against the clip.
pub(crate) fn settings(args: &Args, clip: &Clip) -> Result<RenderSettings, Fault> {
    let settings = args.settings();
    match settings.layers {
        Some(layers) if layers > clip.layers.len() => {
            Err(Fault::Usage(format!("--layer {layers}: the clip has {} layers", clip.layers.len())))
        }
        _ => Ok(settings),
    }
}

/// The images of all eyes side by side as RGB bytes, and the size of the result.
fn side_by_side(eyes: &[Pixels]) -> (Vec<u8>, UVec2) {
    let size = eyes[0].size;
    let row = size.x as usize * 3;
    let images: Vec<Vec<u8>> = eyes.iter().map(Pixels::to_rgb8).collect();
    let rows = (0..size.y as usize).flat_map(|y| images.iter().map(move |image| &image[y * row..][..row]));
    (rows.flatten().copied().collect(), uvec2(size.x * eyes.len() as u32, size.y))
}
