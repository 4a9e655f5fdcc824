//! Fitting: the photographs of a capture become a field.
//!
//! ```text
//! Footage -> Shots -> anchor | field -> Fit -> field
//! ```
//!
//! Beside the field it leaves a table of its progress, a picture, and, until it is done, a checkpoint
//! from which it goes on where it was.

mod checkpoint;
pub mod log;
mod plan;
mod refinement;
mod shots;
mod start;

use std::path::Path;
use std::time::{Duration, Instant};

use codec::{ClipInfo, Field, Viewpoint};
use image::RgbImage;
use program::{Fault, output};
use refine::capture::CalibratedCamera;
use refine::fit::{Backend, DeviceError, Lpips, RenderedImage, Run, TrainingView};

use crate::capture::Footage;
use crate::scene::{DEFAULT_DURATION_S, DEFAULT_METRES_PER_UNIT, DEFAULT_UP};
use checkpoint::{Checkpoint, Tally};
use log::Entry;
pub use plan::{DepthScale, SH_DEGREE, Settings, Start, crc};
pub use refinement::{Refinement, RefinementReport};
pub use shots::Shots;
use shots::mean_psnr;

/// Time between two checkpoints, unless told otherwise.
pub const CHECKPOINT_EVERY: Duration = Duration::from_secs(120);

/// Most viewpoints that a clip of a capture suggests: those of a ring show its subject from all sides.
const VIEWPOINTS: usize = 8;

/// Lines of the table over a whole fit.
const LINES: u64 = 50;

/// Time between two calls to the caller, which draws progress.
const SHOW_EVERY: Duration = Duration::from_millis(200);

/// With what a fit is carried out.
pub struct Runtime<'a> {
    /// Draws.
    pub backend: &'a mut dyn Backend,
    /// The network of LPIPS; without it the loss is without that part.
    pub lpips: Option<&'a Lpips<f32>>,
    /// Time between two checkpoints.
    pub checkpoint_every: Duration,
}

/// How far a fit is.
#[derive(Clone, Copy, Debug)]
pub struct Progress {
    /// Steps done.
    pub step: u64,
    /// Loss of the last step.
    pub loss: f64,
    /// PSNR of the last line of the table.
    pub held_psnr_db: Option<f64>,
    /// Gaussians.
    pub gaussians: usize,
}

/// A fitted field, and how it came about.
#[derive(Debug)]
pub struct Fitted {
    /// The field.
    pub field: Field,
    /// The table.
    pub entries: Vec<Entry>,
    /// Gradients and moments that were not finite, and so were left out.
    pub non_finite: u64,
    /// Steps that were done before this run.
    pub resumed_at: u64,
    /// Gaussians at the start.
    pub started_with: usize,
    /// Mean time of the steps of this run, without pictures and files between them.
    pub ms_per_step: f64,
    /// What drew, and on which device.
    pub backend: String,
    /// Most memory of the device that was taken at once, in bytes; `None` without one.
    pub peak_device_bytes: Option<u64>,
}

/// Fits a field to the photographs of `shots`, as `settings` say. `out` is the path of the field,
/// beside which the table, the picture and the checkpoint go; the field itself is left to the caller.
///
/// # Errors
/// A [`Fault`] where there is nothing to start from, a file cannot be read or written, or the device
/// fails; what was done up to the last checkpoint is then kept.
pub fn fit(
    settings: &Settings,
    footage: &Footage,
    shots: &Shots,
    runtime: Runtime,
    out: &Path,
    on_progress: &mut dyn FnMut(&Progress),
) -> anyhow::Result<Fitted> {
    let Runtime { lpips, backend, checkpoint_every } = runtime;
    if let Some(lpips) = lpips {
        for camera in &footage.capture.cameras {
            let (width, height) = (camera.camera.width as usize, camera.camera.height as usize);
            lpips.check_size(width, height).map_err(|error| Fault::Usage(error.to_string()))?;
        }
    }
    let path = checkpoint::path_for(out);
    let Checkpoint { fit, seconds: before, mut entries, mut tally, .. } =
        match Checkpoint::load(&path, settings)? {
            Some(checkpoint) => checkpoint,
            None => {
                let fit = start::start(settings, footage, shots)?;
                Checkpoint {
                    settings: settings.clone(),
                    fit,
                    seconds: 0.0,
                    entries: Vec::new(),
                    tally: Tally::default(),
                }
            }
        };
    let (resumed_at, started_with) = (fit.steps_done(), fit.initial_count());
    let mut run = Run::start(fit, backend).map_err(on_device)?;
    let train: Vec<&TrainingView> = shots.train.iter().map(|(_, shot)| shot).collect();
    let start = Instant::now();
    let (mut saved, mut shown) = (start, start);
    let every = (settings.steps / LINES).max(1);
    let mut stepping = Duration::ZERO;
    while !run.is_done() {
        let begun = Instant::now();
        let step = run.step(&train, lpips).map_err(on_device)?;
        stepping += begun.elapsed();
        tally.loss += step.loss;
        tally.drawn += step.drawn;
        tally.density.add(run.density_change());
        tally.steps += 1;
        let done = run.steps_done();
        if done % every == 0 || run.is_done() {
            let seconds = before + start.elapsed().as_secs_f64();
            let pictures: Result<Vec<RenderedImage<f32>>, DeviceError> =
                shots.held.iter().map(|shot| run.render(shot)).collect();
            let pictures = pictures.map_err(on_device)?;
            let held_psnr_db = mean_psnr(shots, &pictures);
            let gaussians = run.len();
            entries.push(Entry {
                step: done,
                seconds,
                loss: tally.loss / f64::from(tally.steps),
                held_psnr_db,
                gaussians,
                drawn: tally.drawn / tally.steps as usize,
                density: tally.density,
                backend: run.backend(),
            });
            tally = Tally::default();
            output::write(&log::table_path(out), log::csv(&entries).as_bytes())?;
            let preview = preview(&mut run, shots, &pictures)?;
            output::write_png(&log::preview_path(out), &preview, preview.dimensions())?;
        }
        if saved.elapsed() >= checkpoint_every && !run.is_done() {
            let seconds = before + start.elapsed().as_secs_f64();
            let fit = run.pause().map_err(on_device)?;
            let checkpoint = Checkpoint { settings: settings.clone(), fit, seconds, entries, tally };
            checkpoint.save(&path)?;
            entries = checkpoint.entries;
            run = Run::start(checkpoint.fit, backend).map_err(on_device)?;
            saved = Instant::now();
        }
        if shown.elapsed() >= SHOW_EVERY {
            shown = Instant::now();
            on_progress(&Progress {
                step: done,
                loss: step.loss,
                held_psnr_db: entries.last().and_then(|entry| entry.held_psnr_db),
                gaussians: run.len(),
            });
        }
    }
    let fit = run.pause().map_err(on_device)?;
    Ok(Fitted {
        field: fit.to_field(),
        entries,
        non_finite: fit.non_finite(),
        resumed_at,
        started_with,
        ms_per_step: 1e3 * stepping.as_secs_f64() / (settings.steps - resumed_at) as f64,
        backend: backend.name(),
        peak_device_bytes: backend.peak_device_bytes(),
    })
}

fn on_device(error: DeviceError) -> Fault {
    Fault::Device(error.to_string())
}

/// The picture that is left beside the field: of a held photograph where there is one. `pictures` are
/// those of the held ones.
fn preview(run: &mut Run, shots: &Shots, pictures: &[RenderedImage<f32>]) -> Result<RgbImage, Fault> {
    let held = shots.held.len() / 2;
    Ok(match (shots.held.get(held), pictures.get(held)) {
        (Some(shot), Some(picture)) => log::preview(shot, picture),
        _ => {
            let shot = &shots.train[shots.train.len() / 2].1;
            log::preview(shot, &run.render(shot).map_err(on_device)?)
        }
    })
}

/// Checks, before the photographs are read, that a fit of `out` with `settings` can begin or go on: a
/// checkpoint that is there is whole and of these settings.
///
/// # Errors
/// [`Fault::Data`] where it is damaged, [`Fault::Usage`] where it is of other settings.
pub fn check_checkpoint(settings: &Settings, out: &Path) -> Result<(), Fault> {
    Checkpoint::load(&checkpoint::path_for(out), settings).map(drop)
}

/// Checks that `field`, which somebody calls `name`, and a capture count the same frames: its windows
/// and trajectories would mean other times otherwise. `frames` is what the field says of itself, if
/// it does. A field without time fits any capture; that it stays so is said on stderr.
///
/// # Errors
/// [`Fault::Usage`] that says how many frames there are of each.
pub fn check_frames(
    name: &Path,
    field: &Field,
    frames: Option<usize>,
    footage: &Footage,
) -> Result<(), Fault> {
    let (name, of_capture) = (name.display(), footage.capture.times.len());
    match frames {
        _ if field.temporal.is_none() => {
            if of_capture > 1 {
                eprintln!("note: {name} does not move, and is not made to");
            }
            Ok(())
        }
        Some(frames) if frames != of_capture => Err(Fault::Usage(format!(
            "{name} is of {frames} frames (duration_s times fps), the capture of {of_capture}: choose its \
             frames with --frames"
        ))),
        _ => Ok(()),
    }
}

/// Removes the checkpoint of the field at `out`, which is done.
///
/// # Errors
/// [`Fault::Usage`] where it is there and cannot be removed.
pub fn forget_checkpoint(out: &Path) -> Result<(), Fault> {
    let path = checkpoint::path_for(out);
    match std::fs::remove_file(&path) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
            Err(Fault::Usage(format!("cannot remove {}: {error}", path.display())))
        }
        _ => Ok(()),
    }
}

/// What a clip of this capture is, as far as a capture tells: its frames at `fps`, upwards as its
/// cameras are held, and the views of its first camera and of a few others, from wherever they stand.
pub fn info(footage: &Footage, fps: f32) -> ClipInfo {
    let cameras = &footage.capture.cameras;
    let mut up = [0.0; 3];
    for CalibratedCamera { camera, .. } in cameras {
        (0..3).for_each(|axis| up[axis] -= camera.camera_from_world[1][axis]);
    }
    let length = up.iter().map(|x| x * x).sum::<f64>().sqrt();
    let up = if length > 1e-6 { up.map(|x| (x / length) as f32) } else { DEFAULT_UP };
    let frames = footage.capture.times.len();
    let views = cameras.len().min(VIEWPOINTS);
    ClipInfo {
        duration_s: if frames > 1 { (frames - 1) as f32 / fps } else { DEFAULT_DURATION_S },
        fps,
        up: upright(up),
        metres_per_unit: DEFAULT_METRES_PER_UNIT,
        viewpoints: (0..views).map(|i| viewpoint(&cameras[i * cameras.len() / views])).collect(),
    }
}

/// The axis that `up` is nearly along, if there is one: nobody holds a camera exactly level.
fn upright(up: [f32; 3]) -> [f32; 3] {
    let nearly = (0..3).find(|&axis| up[axis].abs() > 0.9);
    nearly.map_or(up, |axis| std::array::from_fn(|i| if i == axis { up[axis].signum() } else { 0.0 }))
}

fn viewpoint(camera: &CalibratedCamera) -> Viewpoint {
    let CalibratedCamera { name, camera, .. } = camera;
    let (position, forward) = (camera.position(), camera.camera_from_world[2]);
    // As far as it stands from the world's origin, which captures put near their subject.
    let distance = position.iter().map(|x| x * x).sum::<f64>().sqrt().max(1e-3);
    Viewpoint {
        name: name.clone(),
        position: position.map(|x| x as f32),
        target: std::array::from_fn(|axis| (position[axis] + distance * forward[axis]) as f32),
        fov_y: (2.0 * (0.5 * f64::from(camera.height) / camera.k[1][1]).atan()) as f32,
    }
}
