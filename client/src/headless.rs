//! Renders images and statistics of a clip, through the renderer that a window uses.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use codec::{Camera, Clip};
use glam::{UVec2, uvec2};

use crate::args::Args;
use crate::fault::Fault;
use crate::gpu::{Gpu, GpuClip, Offscreen, Pixels, Renderer, Settings};
use crate::output;
use crate::source::News;
use crate::stats::{FrameStats, LoadingStats, Stats, Summary};
use crate::terminal::Reporter;
use crate::view::View;
use crate::{source, viewpoint};

/// Size of images where nothing says another.
const DEFAULT_SIZE: UVec2 = uvec2(1280, 720);

/// Distance between the eyes, the mean of adults.
const EYE_DISTANCE_M: f32 = 0.063;

/// Does what `args` ask for.
///
/// # Errors
/// The [`Fault`] that says what is wrong; images written before it stay.
pub fn run(args: &Args) -> Result<(), Fault> {
    let out = args.out.as_ref().ok_or_else(|| Fault::Usage("--headless needs --out PATH".into()))?;
    let many = args.time.len() > 1 || args.frames.as_ref().is_some_and(|frames| frames.len() > 1);
    if many {
        output::check_folder(out)?
    } else {
        output::check(out)?
    }
    args.stats.as_ref().map_or(Ok(()), |path| output::check(path))?;

    let (clip, loading) = load(args)?;
    let times = times(args, &clip)?;
    let views = views(args, &clip)?;
    let settings = settings(args, &clip)?;

    let gpu = Gpu::new_headless()?;
    let image = Offscreen::new(&gpu, views[0].size, views.len() as u32, args.target)?;
    let start = Instant::now();
    let on_gpu = Arc::new(GpuClip::upload(&gpu, &clip)?);
    let upload_ms = start.elapsed().as_secs_f64() * 1e3;
    let mut renderer = Renderer::new(&gpu, on_gpu, args.target.format(), views.len())?;

    if many {
        output::make_folder(out)?;
    }
    let mut frames = Vec::new();
    for (i, &time) in times.iter().enumerate() {
        let t = clip_time(&clip, time);
        if args.stats.is_some() {
            if i == 0 {
                // Drivers finish their compiling in the first frame: keep that out of the timings.
                image.render(&gpu, &mut renderer, t, &views, &settings)?;
            }
            frames.push(measure(&gpu, &mut renderer, &image, time, t, &views, &settings)?);
        } else {
            image.render(&gpu, &mut renderer, t, &views, &settings)?;
        }
        let (rgb, size) = side_by_side(&image.read(&gpu)?);
        let path = if many { out.join(format!("frame_{i:04}.png")) } else { PathBuf::from(out) };
        output::write_png(&path, &rgb, size.x, size.y)?;
    }

    if let Some(path) = &args.stats {
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

/// Waits for the whole clip, with its progress on the terminal.
fn load(args: &Args) -> Result<(Clip, LoadingStats), Fault> {
    let start = Instant::now();
    let elapsed_ms = || start.elapsed().as_secs_f64() * 1e3;
    let (mut reporter, mut playable_ms) = (Reporter::new(), None);
    let clip = source::open(args.clip.as_deref(), source::kept())?.wait(None, |news| {
        if let News::Clip(_) = news {
            playable_ms.get_or_insert_with(elapsed_ms);
        }
        reporter.tell(news);
    })?;
    let whole_ms = elapsed_ms();
    Ok((clip, LoadingStats { playable_ms: playable_ms.unwrap_or(whole_ms), whole_ms }))
}

/// Draws a frame and measures it.
fn measure(
    gpu: &Gpu,
    renderer: &mut Renderer,
    image: &Offscreen,
    time: f64,
    t: f64,
    views: &[View],
    settings: &Settings,
) -> Result<FrameStats, Fault> {
    let start = Instant::now();
    let counts = image.render(gpu, renderer, t, views, settings)?;
    let wall_ms = start.elapsed().as_secs_f64() * 1e3 - counts.alive_ms - counts.sort_ms;
    let draw_ms = renderer.gpu_ms().unwrap_or(wall_ms);
    let coverage = renderer.count(gpu, t, views, settings)?;
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

/// The times to render, in seconds from the start of the clip.
fn times(args: &Args, clip: &Clip) -> Result<Vec<f64>, Fault> {
    let captured_fps = f64::from(clip.info.fps);
    let times = match &args.frames {
        Some(frames) => {
            let fps = args.fps.unwrap_or(captured_fps);
            frames.clone().map(|frame| f64::from(frame) / fps).collect()
        }
        None if args.time.is_empty() => vec![0.0],
        None => args.time.clone(),
    };
    // Times are often rounded in text: half a captured frame beyond the end is still the end.
    let duration = f64::from(clip.info.duration_s);
    let slack = if captured_fps > 0.0 { 0.5 / captured_fps } else { 0.0 };
    match times.iter().find(|&&time| !(0.0..=duration + slack).contains(&time)) {
        Some(time) => {
            Err(Fault::Usage(format!("time {time} s is outside the clip, which lasts {duration} s")))
        }
        None => Ok(times),
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
pub(crate) fn settings(args: &Args, clip: &Clip) -> Result<Settings, Fault> {
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
