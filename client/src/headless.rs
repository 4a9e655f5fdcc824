//! `--headless`: renders images and statistics of a clip with the renderer of the window. Of a playlist it
//! renders images alone, at times from the start of the playlist.

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use codec::{Camera, Clip};
use glam::{UVec2, uvec2};
use program::{Fault, output};

use crate::args::Args;
use crate::clips::{LoadEvent, cache_dir, playlist, printable};
use crate::gpu::{FrameCounts, Gpu, GpuClip, Offscreen, Pixels, RenderSettings, Renderer};
use crate::stats::{FrameStats, LoadingStats, Stats, Summary};
use crate::terminal::Reporter;
use crate::view::{EYE_DISTANCE_M, View};
use crate::{clips, viewpoint};

/// Default size of images.
const DEFAULT_SIZE: UVec2 = uvec2(1280, 720);

/// Tolerance in seconds at the change between two clips of a playlist, whose times are sums.
const CHANGE_TOLERANCE_S: f64 = 1e-6;

/// Renders what `args` ask for.
///
/// # Errors
/// The first [`Fault`]; images written before it stay.
pub fn run(args: &Args) -> Result<(), Fault> {
    let output = Output::check(args)?;
    match args.clip.as_deref().filter(|name| playlist::is_playlist(name)) {
        Some(list) => run_playlist(args, list, &output),
        None => run_clip(args, &output),
    }
}

/// The path of the images.
struct Output<'a> {
    path: &'a Path,
    /// Whether `path` is a folder for several images.
    is_folder: bool,
}

impl Output<'_> {
    fn check(args: &Args) -> Result<Output<'_>, Fault> {
        let path = args.out.as_ref().ok_or_else(|| Fault::Usage("--headless needs --out PATH".into()))?;
        let is_folder = args.time.len() > 1 || args.frames.as_ref().is_some_and(|frames| frames.len() > 1);
        if is_folder {
            output::check_folder(path)?;
        } else {
            output::check(path)?;
        }
        args.stats.as_ref().map_or(Ok(()), |path| output::check(path))?;
        Ok(Output { path, is_folder })
    }

    /// Writes image number `i`.
    fn write(&self, i: usize, eyes: &[Pixels]) -> Result<(), Fault> {
        let (rgb, size) = side_by_side(eyes);
        if !self.is_folder {
            return output::write_png(self.path, &rgb, size.into());
        }
        output::make_folder(self.path)?;
        output::write_png(&self.path.join(format!("frame_{i:04}.png")), &rgb, size.into())
    }
}

/// A clip on the device, and its renderer for the eyes of `--stereo` and `--view`.
struct ClipRenderer<'a> {
    gpu: &'a Gpu,
    clip: Arc<Clip>,
    views: Vec<View>,
    settings: RenderSettings,
    image: Offscreen,
    renderer: Renderer,
    upload_ms: f64,
}

impl<'a> ClipRenderer<'a> {
    fn new(gpu: &'a Gpu, clip: Arc<Clip>, views: Vec<View>, args: &Args) -> Result<ClipRenderer<'a>, Fault> {
        let settings = settings(args, &clip)?;
        let image = Offscreen::new(gpu, views[0].size, views.len() as u32, args.target)?;
        let start = Instant::now();
        let on_gpu = Arc::new(GpuClip::upload(gpu, &clip)?);
        let upload_ms = start.elapsed().as_secs_f64() * 1e3;
        let renderer = Renderer::new(gpu, on_gpu, args.target.format(), views.len())?;
        Ok(ClipRenderer { gpu, clip, views, settings, image, renderer, upload_ms })
    }

    /// Renders the clip at `time_s` and reads the pixels of each eye.
    fn pixels(&mut self, time_s: f64) -> Result<Vec<Pixels>, Fault> {
        self.render(time_s)?;
        self.image.read(self.gpu)
    }

    fn render(&mut self, time_s: f64) -> Result<FrameCounts, Fault> {
        let t = clip_time(&self.clip, time_s);
        self.image.render(self.gpu, &mut self.renderer, t, &self.views, &self.settings)
    }

    /// Renders a frame and measures it.
    fn measure(&mut self, time_s: f64) -> Result<FrameStats, Fault> {
        let start = Instant::now();
        let counts = self.render(time_s)?;
        let wall_ms = start.elapsed().as_secs_f64() * 1e3 - counts.alive_ms - counts.sort_ms;
        let draw_ms = self.renderer.gpu_ms().unwrap_or(wall_ms);
        let t = clip_time(&self.clip, time_s);
        let coverage = self.renderer.count(self.gpu, t, &self.views, &self.settings)?;
        Ok(FrameStats {
            time: time_s,
            alive: counts.alive,
            sorted: counts.sorted,
            drawn: coverage.drawn,
            fragments: coverage.fragments,
            alive_ms: counts.alive_ms,
            sort_ms: counts.sort_ms,
            draw_ms,
        })
    }

    fn stats(&self, loading: LoadingStats, frames: Vec<FrameStats>) -> Stats {
        let ClipRenderer { gpu, clip, views, renderer, .. } = self;
        Stats {
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
            upload_ms: self.upload_ms,
            gpu_timed: gpu.caps.timestamps,
            alive_ms: Summary::of(frames.iter().map(|frame| frame.alive_ms)),
            sort_ms: Summary::of(frames.iter().map(|frame| frame.sort_ms)),
            draw_ms: Summary::of(frames.iter().map(|frame| frame.draw_ms)),
            frames,
        }
    }
}

fn run_clip(args: &Args, output: &Output) -> Result<(), Fault> {
    let (clip, loading) = load(args)?;
    let times = times(args, clip.info.fps.into());
    check_times(&times, clip.info.duration_s.into(), clip.info.fps.into())?;
    let views = views(args, &clip)?;
    settings(args, &clip)?;
    let gpu = Gpu::new_headless()?;
    let mut renderer = ClipRenderer::new(&gpu, Arc::new(clip), views, args)?;
    let mut frames = Vec::new();
    for (i, &time_s) in times.iter().enumerate() {
        if args.stats.is_some() {
            if i == 0 {
                // Drivers finish compiling in the first frame, which would distort its timings.
                renderer.render(time_s)?;
            }
            frames.push(renderer.measure(time_s)?);
            output.write(i, &renderer.image.read(&gpu)?)?;
        } else {
            output.write(i, &renderer.pixels(time_s)?)?;
        }
    }
    let Some(path) = &args.stats else { return Ok(()) };
    let stats = renderer.stats(loading, frames);
    let mut json = serde_json::to_vec_pretty(&stats).expect("numbers and strings serialise");
    json.push(b'\n');
    output::write(path, &json)
}

/// Renders a playlist, its clips one after the other. Skips and reports a clip that fails to load or has no
/// such view or layer. Uploads only clips with images to render, one at a time.
fn run_playlist(args: &Args, list: &str, output: &Output) -> Result<(), Fault> {
    if args.stats.is_some() {
        return Err(Fault::Usage("--stats are of one clip, not of a playlist: name the clip".into()));
    }
    let mut reporter = Reporter::new();
    let list = playlist::wait(list, cache_dir(), |event| reporter.print(event))?;
    let gpu = Gpu::new_headless()?;
    let mut run = PlaylistRun { args, output, gpu: &gpu, pending: Vec::new(), start_s: 0.0, last: None };
    let mut failed: Option<Fault> = None;
    for name in &list.clips {
        if let Some(fault) = failed.take() {
            reporter.print(&LoadEvent::Note(format!("{fault}; skipped")));
        }
        let clip = clips::open(Some(name), cache_dir())
            .and_then(|mut arrival| arrival.wait(None, |event| reporter.print(event)));
        failed = match clip.map(|clip| run.render(name, Arc::new(clip))) {
            Ok(Ok(Rendered::Skipped(fault))) | Err(fault) => Some(fault),
            Ok(Ok(Rendered::All)) => return Ok(()),
            Ok(Ok(Rendered::More)) => None,
            Ok(Err(fault)) => return Err(fault),
        };
    }
    match (run.last.take(), failed) {
        (Some(clip), failed) => {
            failed.inspect(|fault| reporter.print(&LoadEvent::Note(format!("{fault}; skipped"))));
            run.render_end(clip)
        }
        (None, Some(fault)) => Err(fault),
        (None, None) => Err(Fault::Data("there is no clip".into())),
    }
}

/// The images of a playlist that are left to render.
struct PlaylistRun<'a> {
    args: &'a Args,
    output: &'a Output<'a>,
    gpu: &'a Gpu,
    /// Number and time of each image, known from the first clip on, whose frame rate counts.
    pending: Vec<(usize, f64)>,
    /// Where the next clip starts, in seconds.
    start_s: f64,
    /// The clip before.
    last: Option<Arc<Clip>>,
}

/// Which images are rendered after a clip.
enum Rendered {
    /// More images are left.
    More,
    /// None is left.
    All,
    /// The clip was skipped.
    Skipped(Fault),
}

impl PlaylistRun<'_> {
    /// Renders the images within `clip`.
    fn render(&mut self, name: &str, clip: Arc<Clip>) -> Result<Rendered, Fault> {
        if self.last.is_none() {
            let times = times(self.args, clip.info.fps.into());
            if let Some(time) = times.iter().find(|time| **time < 0.0) {
                return Err(Fault::Usage(format!("time {time} s is before the start")));
            }
            self.pending = times.into_iter().enumerate().collect();
        }
        let end_s = self.start_s + f64::from(clip.info.duration_s);
        let (here, later): (Vec<_>, Vec<_>) =
            self.pending.iter().copied().partition(|&(_, time_s)| time_s < end_s - CHANGE_TOLERANCE_S);
        let renderer = views(self.args, &clip).and_then(|views| {
            settings(self.args, &clip)?;
            (!here.is_empty())
                .then(|| ClipRenderer::new(self.gpu, clip.clone(), views, self.args))
                .transpose()
        });
        match renderer {
            Ok(Some(mut renderer)) => {
                for (i, time_s) in here {
                    self.output.write(i, &renderer.pixels((time_s - self.start_s).max(0.0))?)?;
                }
            }
            Ok(None) => {}
            Err(fault) => return Ok(Rendered::Skipped(fault.about(&printable(name)))),
        }
        (self.pending, self.start_s, self.last) = (later, end_s, Some(clip));
        Ok(if self.pending.is_empty() { Rendered::All } else { Rendered::More })
    }

    /// Renders the images at the end of the last clip.
    ///
    /// # Errors
    /// [`Fault::Usage`] if a time is beyond the end.
    fn render_end(&self, clip: Arc<Clip>) -> Result<(), Fault> {
        let (fps, duration_s) = (clip.info.fps, clip.info.duration_s);
        let times: Vec<f64> = self.pending.iter().map(|&(_, time_s)| time_s).collect();
        check_times(&times, self.start_s, fps.into())?;
        let views = views(self.args, &clip)?;
        let mut renderer = ClipRenderer::new(self.gpu, clip, views, self.args)?;
        for &(i, _) in &self.pending {
            self.output.write(i, &renderer.pixels(duration_s.into())?)?;
        }
        Ok(())
    }
}

/// Loads the complete clip, and prints progress.
fn load(args: &Args) -> Result<(Clip, LoadingStats), Fault> {
    let start = Instant::now();
    let elapsed_ms = || start.elapsed().as_secs_f64() * 1e3;
    let (mut reporter, mut playable_ms) = (Reporter::new(), None);
    let clip = clips::open(args.clip.as_deref(), cache_dir())?.wait(None, |event| {
        if let LoadEvent::Clip(_) = event {
            playable_ms.get_or_insert_with(elapsed_ms);
        }
        reporter.print(event);
    })?;
    let whole_ms = elapsed_ms();
    Ok((clip, LoadingStats { playable_ms: playable_ms.unwrap_or(whole_ms), whole_ms }))
}

/// Times of the images in seconds from the start. `captured_fps` is the default of `--fps`.
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

/// Checks that `times` are between 0 and `duration`, in seconds.
fn check_times(times: &[f64], duration: f64, captured_fps: f64) -> Result<(), Fault> {
    // Half a captured frame beyond the end is the end: times in text are rounded.
    let slack = if captured_fps > 0.0 { 0.5 / captured_fps } else { 0.0 };
    match times.iter().find(|&&time| !(0.0..=duration + slack).contains(&time)) {
        Some(time) => {
            Err(Fault::Usage(format!("time {time} s is outside the clip, which lasts {duration} s")))
        }
        None => Ok(()),
    }
}

/// Normalised clip time at `time` seconds, 1 beyond the end.
fn clip_time(clip: &Clip, time: f64) -> f64 {
    let duration = f64::from(clip.info.duration_s);
    if duration > 0.0 { (time / duration).min(1.0) } else { 0.0 }
}

/// The views of the eyes.
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

/// The render settings of `args` for `clip`.
///
/// # Errors
/// [`Fault::Usage`] if the clip has fewer layers than `--layer`.
pub(crate) fn settings(args: &Args, clip: &Clip) -> Result<RenderSettings, Fault> {
    let settings = args.settings();
    match settings.layers {
        Some(layers) if layers > clip.layers.len() => {
            Err(Fault::Usage(format!("--layer {layers}: the clip has {} layers", clip.layers.len())))
        }
        _ => Ok(settings),
    }
}

/// One RGB image of all eyes from left to right, and its size.
fn side_by_side(eyes: &[Pixels]) -> (Vec<u8>, UVec2) {
    let size = eyes[0].size;
    let row = size.x as usize * 3;
    let images: Vec<Vec<u8>> = eyes.iter().map(Pixels::to_rgb8).collect();
    let rows = (0..size.y as usize).flat_map(|y| images.iter().map(move |image| &image[y * row..][..row]));
    (rows.flatten().copied().collect(), uvec2(size.x * eyes.len() as u32, size.y))
}
