//! Renders images and statistics of a clip, through the renderer that a window uses; of a playlist images
//! alone, by the time that has gone by since its start.

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

/// Size of images where nothing says another.
const DEFAULT_SIZE: UVec2 = uvec2(1280, 720);

/// Seconds by which an instant at the change of two clips may be early and still be of the second: times
/// of a playlist are sums.
const CHANGE_S: f64 = 1e-6;

/// Does what `args` ask for.
///
/// # Errors
/// The [`Fault`] that says what is wrong; images written before it stay.
pub fn run(args: &Args) -> Result<(), Fault> {
    let output = Output::check(args)?;
    match args.clip.as_deref().filter(|name| playlist::is_playlist(name)) {
        Some(list) => run_list(args, list, &output),
        None => run_clip(args, &output),
    }
}

/// Where images go.
struct Output<'a> {
    path: &'a Path,
    /// Whether that is a folder for several.
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

/// A clip on the device, and what draws it for the eyes that are asked for.
struct Stage<'a> {
    gpu: &'a Gpu,
    clip: Arc<Clip>,
    views: Vec<View>,
    settings: RenderSettings,
    image: Offscreen,
    renderer: Renderer,
    upload_ms: f64,
}

impl<'a> Stage<'a> {
    fn new(gpu: &'a Gpu, clip: Arc<Clip>, views: Vec<View>, args: &Args) -> Result<Stage<'a>, Fault> {
        let settings = settings(args, &clip)?;
        let image = Offscreen::new(gpu, views[0].size, views.len() as u32, args.target)?;
        let start = Instant::now();
        let on_gpu = Arc::new(GpuClip::upload(gpu, &clip)?);
        let upload_ms = start.elapsed().as_secs_f64() * 1e3;
        let renderer = Renderer::new(gpu, on_gpu, args.target.format(), views.len())?;
        Ok(Stage { gpu, clip, views, settings, image, renderer, upload_ms })
    }

    /// Draws the instant `time` seconds from the start of the clip.
    fn draw(&mut self, time: f64) -> Result<Vec<Pixels>, Fault> {
        self.render(time)?;
        self.image.read(self.gpu)
    }

    fn render(&mut self, time: f64) -> Result<FrameCounts, Fault> {
        let t = clip_time(&self.clip, time);
        self.image.render(self.gpu, &mut self.renderer, t, &self.views, &self.settings)
    }

    /// Draws a frame and measures it.
    fn measure(&mut self, time: f64) -> Result<FrameStats, Fault> {
        let start = Instant::now();
        let counts = self.render(time)?;
        let wall_ms = start.elapsed().as_secs_f64() * 1e3 - counts.alive_ms - counts.sort_ms;
        let draw_ms = self.renderer.gpu_ms().unwrap_or(wall_ms);
        let t = clip_time(&self.clip, time);
        let coverage = self.renderer.count(self.gpu, t, &self.views, &self.settings)?;
        Ok(FrameStats {
            time,
            alive: counts.alive,
            sorted: counts.sorted,
            drawn: coverage.drawn,
            fragments: coverage.fragments,
            alive_ms: counts.alive_ms,
            sort_ms: counts.sort_ms,
            draw_ms,
        })
    }
}

fn run_clip(args: &Args, output: &Output) -> Result<(), Fault> {
    let (clip, loading) = load(args)?;
    let times = times(args, clip.info.fps.into());
    check_times(&times, clip.info.duration_s.into(), clip.info.fps.into())?;
    let views = views(args, &clip)?;
    settings(args, &clip)?;
    let gpu = Gpu::new_headless()?;
    let mut stage = Stage::new(&gpu, Arc::new(clip), views, args)?;
    let mut frames = Vec::new();
    for (i, &time) in times.iter().enumerate() {
        if args.stats.is_some() {
            if i == 0 {
                // Drivers finish their compiling in the first frame: keep that out of the timings.
                stage.render(time)?;
            }
            frames.push(stage.measure(time)?);
            output.write(i, &stage.image.read(&gpu)?)?;
        } else {
            output.write(i, &stage.draw(time)?)?;
        }
    }

    if let Some(path) = &args.stats {
        let Stage { clip, views, renderer, upload_ms, .. } = stage;
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

/// Renders a playlist: its clips one after the other, as they play. One that cannot be had is told and
/// skipped, as is one that cannot be drawn. Only clips of which pictures are asked for are on the device,
/// one at a time.
fn run_list(args: &Args, list: &str, output: &Output) -> Result<(), Fault> {
    if args.stats.is_some() {
        return Err(Fault::Usage("--stats are of one clip, not of a playlist: name the clip".into()));
    }
    let mut reporter = Reporter::new();
    let list = playlist::wait(list, cache_dir(), |news| reporter.tell(news))?;
    let gpu = Gpu::new_headless()?;
    let mut last: Option<Arc<Clip>> = None;
    let mut failed: Option<Fault> = None;
    let (mut todo, mut start) = (Vec::new(), 0.0);
    for name in &list.clips {
        if let Some(fault) = failed.take() {
            reporter.tell(&LoadEvent::Note(format!("{fault}; skipped")));
        }
        let arrived = clips::open(Some(name), cache_dir())
            .and_then(|mut arrival| arrival.wait(None, |news| reporter.tell(news)));
        let clip = match arrived {
            Ok(clip) => Arc::new(clip),
            Err(fault) => {
                failed = Some(fault);
                continue;
            }
        };
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
        let stage = views(args, &clip).and_then(|views| {
            settings(args, &clip)?;
            (!here.is_empty()).then(|| Stage::new(&gpu, clip.clone(), views, args)).transpose()
        });
        match stage {
            Ok(Some(mut stage)) => {
                for (i, time) in here {
                    output.write(i, &stage.draw((time - start).max(0.0))?)?;
                }
            }
            Ok(None) => {}
            Err(fault) => {
                failed = Some(fault.about(&printable(name)));
                continue;
            }
        }
        todo = later;
        last = Some(clip);
        start = end;
        if todo.is_empty() {
            return Ok(());
        }
    }
    let clip = match (last, failed) {
        (Some(clip), failed) => {
            failed.inspect(|fault| reporter.tell(&LoadEvent::Note(format!("{fault}; skipped"))));
            clip
        }
        (None, Some(fault)) => return Err(fault),
        (None, None) => return Err(Fault::Data("there is no clip".into())),
    };
    // What is left is the very end, or beyond it.
    let (fps, duration) = (clip.info.fps, clip.info.duration_s);
    let left: Vec<f64> = todo.iter().map(|&(_, time)| time).collect();
    check_times(&left, start, fps.into())?;
    let views = views(args, &clip)?;
    let mut stage = Stage::new(&gpu, clip, views, args)?;
    for (i, _) in todo {
        output.write(i, &stage.draw(duration.into())?)?;
    }
    Ok(())
}

/// Waits for the whole clip, with its progress on the terminal.
fn load(args: &Args) -> Result<(Clip, LoadingStats), Fault> {
    let start = Instant::now();
    let elapsed_ms = || start.elapsed().as_secs_f64() * 1e3;
    let (mut reporter, mut playable_ms) = (Reporter::new(), None);
    let clip = clips::open(args.clip.as_deref(), cache_dir())?.wait(None, |news| {
        if let LoadEvent::Clip(_) = news {
            playable_ms.get_or_insert_with(elapsed_ms);
        }
        reporter.tell(news);
    })?;
    let whole_ms = elapsed_ms();
    Ok((clip, LoadingStats { playable_ms: playable_ms.unwrap_or(whole_ms), whole_ms }))
}

/// The times to render, in seconds from the start; `captured_fps` where nothing says another rate.
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

/// Checks that times are within what lasts `duration` seconds.
fn check_times(times: &[f64], duration: f64, captured_fps: f64) -> Result<(), Fault> {
    // Times are often rounded in text: half a captured frame beyond the end is still the end.
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

/// The eyes to render.
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

/// The settings that `args` ask for.
pub(crate) fn settings(args: &Args, clip: &Clip) -> Result<RenderSettings, Fault> {
    let settings = args.settings();
    match settings.layers {
        Some(layers) if layers > clip.layers.len() => {
            Err(Fault::Usage(format!("--layer {layers}: the clip has {} layers", clip.layers.len())))
        }
        _ => Ok(settings),
    }
}

/// The images of all eyes from left to right, as bytes red, green, blue; and the size of the whole.
fn side_by_side(eyes: &[Pixels]) -> (Vec<u8>, UVec2) {
    let size = eyes[0].size;
    let row = size.x as usize * 3;
    let images: Vec<Vec<u8>> = eyes.iter().map(Pixels::to_rgb8).collect();
    let rows = (0..size.y as usize).flat_map(|y| images.iter().map(move |image| &image[y * row..][..row]));
    (rows.flatten().copied().collect(), uvec2(size.x * eyes.len() as u32, size.y))
}
