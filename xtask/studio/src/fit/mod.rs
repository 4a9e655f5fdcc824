//! Fitting: the photographs of a capture become a field.
//!
//! ```text
//! CaptureFiles -> TrainingViews -> anchor | field ------------> Fit -> field
//!              -> plates        -> anchor -> Fit -> static rows -^  -> plate behind it
//! ```
//!
//! Beside the field it writes a table of its progress, a picture and, until it is done, a checkpoint from
//! which it resumes.

mod cameras;
mod checkpoint;
pub mod log;
mod plan;
mod plate;
mod refinement;
mod slide;
mod start;
mod stored;
mod strangers;
mod training_views;

use std::path::Path;
use std::time::{Duration, Instant};

use codec::{ClipInfo, Field, Surroundings};
use formats::up_of;
use image::RgbImage;
use program::{Fault, output};
use rayon::prelude::*;
use refine::capture::CalibratedCamera;
use refine::fit::{Backend, DeviceError, Fit, Lpips, RenderedImage, Run, TrainingView};

use crate::capture::CaptureFiles;
use crate::scene::{DEFAULT_DURATION_S, DEFAULT_METRES_PER_UNIT, DEFAULT_UP, plate_path};
pub use cameras::learned_cameras;
use checkpoint::{Checkpoint, Tally};
use log::LogEntry;
pub use plan::{Coarse, DepthScale, FitPlan, FitStart, PlatePlan, crc, default_fragment_weight, file_crc};
pub use plate::fit_plate;
pub use refinement::{Refinement, RefinementReport};
pub use slide::{Assembled, Segments, SlidField, SlidePlan, SlideProgress, WorkFolder, slide, slide_cost};
pub use start::FittedPlate;
pub use strangers::name_covered;
pub(crate) use training_views::evenly;
use training_views::mean_psnr;
pub use training_views::{TrainingViews, train_frames};

/// Default time between two checkpoints.
pub const CHECKPOINT_EVERY: Duration = Duration::from_secs(120);

/// Maximum number of suggested viewpoints: eight cameras of a ring show the subject from all sides.
const VIEWPOINTS_MAX: usize = 8;

/// Number of lines of the table.
const LINES: u64 = 50;

/// Time between two calls of `on_progress`.
const PROGRESS_EVERY: Duration = Duration::from_millis(200);

/// The means of a fit, which a checkpoint does not hold.
pub struct FitRuntime<'a> {
    /// Renders and computes gradients.
    pub backend: &'a mut dyn Backend,
    /// The LPIPS network; `None` leaves the LPIPS term out of the loss.
    pub lpips: Option<&'a Lpips<f32>>,
    /// Time between two checkpoints.
    pub checkpoint_every: Duration,
}

/// Progress of a fit.
#[derive(Clone, Copy, Debug)]
pub struct FitProgress {
    /// Steps done.
    pub step: u64,
    /// Loss of the last step.
    pub loss: f64,
    /// Held-out PSNR of the last line of the table, in dB.
    pub held_psnr_db: Option<f64>,
    /// Number of Gaussians.
    pub gaussians: usize,
}

/// A fitted field, with the record of its fit.
#[derive(Debug)]
pub struct Fitted {
    /// The fit after its last step.
    pub fit: Fit,
    /// The table.
    pub entries: Vec<LogEntry>,
    /// Steps done by earlier runs.
    pub resumed_at: u64,
    /// Mean time of a step of this run in milliseconds, without rendering and writing for the table.
    pub ms_per_step: f64,
    /// Name of the back end and its device.
    pub backend: String,
    /// Peak device memory in bytes; `None` on the CPU.
    pub peak_device_bytes: Option<u64>,
}

/// Fits a field to the photographs of `views`. `out` is the path of the field: the table, the picture and
/// the checkpoint are written beside it; the caller writes the field. With a `plate`, its rows and the field's are
/// fitted together to whole photographs, and `views` only tell where the first Gaussians of the field are.
///
/// # Errors
/// A [`Fault`] if there is no Gaussian to start from, a file cannot be read or written, or the device
/// fails. The last checkpoint stays.
pub fn fit(
    plan: &FitPlan,
    capture_files: &CaptureFiles,
    views: &TrainingViews,
    plate: Option<&FittedPlate>,
    runtime: FitRuntime,
    out: &Path,
    on_progress: &mut dyn FnMut(&FitProgress),
) -> anyhow::Result<Fitted> {
    let start = |_: &mut dyn Backend| start::start(plan, capture_files, views, plate).map(Some);
    let fitted = match plate {
        None => fit_from(plan, capture_files, views, runtime, out, on_progress, start)?,
        Some(_) => {
            let whole = views.whole(capture_files, plan.holdout)?;
            strangers::name_dark(&whole, &capture_files.capture.cameras);
            fit_from(plan, capture_files, &whole, runtime, out, on_progress, start)?
        }
    };
    Ok(fitted.expect("there is something to fit"))
}

impl Fitted {
    /// Name of the graphics device that computed steps, if any did.
    pub fn device(&self) -> Option<String> {
        self.entries.iter().find_map(|entry| entry.backend.strip_prefix("gpu, ").map(str::to_owned))
    }
}

/// [`fit`], from what `start` makes where there is no checkpoint; `None` if that is nothing.
// Long: the loop over steps with its checkpoints and table shares all of its state.
fn fit_from(
    plan: &FitPlan,
    capture_files: &CaptureFiles,
    views: &TrainingViews,
    runtime: FitRuntime,
    out: &Path,
    on_progress: &mut dyn FnMut(&FitProgress),
    start: impl FnOnce(&mut dyn Backend) -> anyhow::Result<Option<Fit>>,
) -> anyhow::Result<Option<Fitted>> {
    let FitRuntime { lpips, backend, checkpoint_every } = runtime;
    if let Some(lpips) = lpips {
        for camera in &capture_files.capture.cameras {
            let (width, height) = (camera.camera.width as usize, camera.camera.height as usize);
            lpips.check_size(width, height).map_err(|error| Fault::Usage(error.to_string()))?;
        }
    }
    let path = checkpoint::path_for(out);
    let Checkpoint { fit, seconds: earlier_seconds, mut entries, mut tally, .. } =
        match Checkpoint::load(&path, plan)? {
            Some(checkpoint) => checkpoint,
            None => {
                let Some(fit) = start(&mut *backend)? else { return Ok(None) };
                Checkpoint {
                    plan: plan.clone(),
                    fit,
                    seconds: 0.0,
                    entries: Vec::new(),
                    tally: Tally::default(),
                }
            }
        };
    let resumed_at = fit.steps_done();
    let mut run = Run::start(fit, backend).map_err(on_device)?;
    let train: Vec<&TrainingView> = views.train.iter().map(|(_, view)| view).collect();
    let Coarse { factor, steps: coarse_steps } = plan.coarse;
    let small: Vec<TrainingView> = match resumed_at < coarse_steps {
        true => train.par_iter().map(|view| view.shrunk(factor)).collect(),
        false => Vec::new(),
    };
    let coarse: Vec<&TrainingView> = small.iter().collect();
    let start = Instant::now();
    let (mut saved_at, mut reported_at) = (start, start);
    let every = (plan.steps / LINES).max(1);
    let mut step_time = Duration::ZERO;
    // Of the last step that has ended.
    let mut loss = None;
    while !run.is_done() {
        let step_start = Instant::now();
        let views_now = if run.steps_done() < coarse_steps { &coarse } else { &train };
        let mut ended = run.step(views_now, lpips).map_err(on_device)?;
        tally.density.add(run.density_change());
        let done = run.steps_done();
        let is_line_due = done % every == 0 || run.is_done();
        let is_saving_due = saved_at.elapsed() >= checkpoint_every && !run.is_done();
        if is_line_due || is_saving_due {
            ended.extend(run.settle().map_err(on_device)?);
        }
        step_time += step_start.elapsed();
        for step in ended {
            tally.loss += step.loss;
            tally.drawn += step.drawn;
            tally.steps += 1;
            loss = Some(step.loss);
        }
        if is_line_due {
            let seconds = earlier_seconds + start.elapsed().as_secs_f64();
            let pictures: Result<Vec<RenderedImage<f32>>, DeviceError> =
                views.held.iter().map(|view| run.render(view)).collect();
            let pictures = pictures.map_err(on_device)?;
            let held_psnr_db = mean_psnr(views, &pictures);
            let gaussians = run.len();
            entries.push(LogEntry {
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
            let preview = preview(&mut run, views, &pictures)?;
            output::write_png(&log::preview_path(out), &preview, preview.dimensions())?;
        }
        if is_saving_due {
            let seconds = earlier_seconds + start.elapsed().as_secs_f64();
            let fit = run.pause().map_err(on_device)?;
            let checkpoint = Checkpoint { plan: plan.clone(), fit, seconds, entries, tally };
            checkpoint.save(&path)?;
            entries = checkpoint.entries;
            run = Run::start(checkpoint.fit, backend).map_err(on_device)?;
            saved_at = Instant::now();
        }
        if let Some(loss) = loss.filter(|_| reported_at.elapsed() >= PROGRESS_EVERY) {
            reported_at = Instant::now();
            on_progress(&FitProgress {
                step: done,
                loss,
                held_psnr_db: entries.last().and_then(|entry| entry.held_psnr_db),
                gaussians: run.len(),
            });
        }
    }
    let fit = run.pause().map_err(on_device)?;
    Ok(Some(Fitted {
        fit,
        entries,
        resumed_at,
        ms_per_step: 1e3 * step_time.as_secs_f64() / (plan.steps - resumed_at).max(1) as f64,
        backend: backend.name(),
        peak_device_bytes: backend.peak_device_bytes(),
    }))
}

pub(super) fn on_device(error: DeviceError) -> Fault {
    Fault::Device(match error {
        DeviceError::TooLarge { .. } | DeviceError::Memory { .. } => {
            format!("{error}, or choose --backend cpu")
        }
        DeviceError::Missing(_) | DeviceError::Lost { .. } => error.to_string(),
    })
}

/// The picture beside the field: of a held-out photograph if there is one. `pictures` are the renderings
/// of the held-out photographs.
fn preview(run: &mut Run, views: &TrainingViews, pictures: &[RenderedImage<f32>]) -> Result<RgbImage, Fault> {
    let held = views.held.len() / 2;
    Ok(match (views.held.get(held), pictures.get(held)) {
        (Some(view), Some(picture)) => log::preview(view, picture),
        _ => {
            let view = &views.train[views.train.len() / 2].1;
            log::preview(view, &run.render(view).map_err(on_device)?)
        }
    })
}

/// Checks, before the photographs are read, that a checkpoint of the field `out` is intact and has this
/// plan. Returns the steps that it has done: 0 without a checkpoint.
///
/// # Errors
/// [`Fault::Data`] if it is damaged, [`Fault::Usage`] if it has another plan.
pub fn check_checkpoint(plan: &FitPlan, out: &Path) -> Result<u64, Fault> {
    let checkpoint = Checkpoint::load(&checkpoint::path_for(out), plan)?;
    Ok(checkpoint.map_or(0, |checkpoint| checkpoint.fit.steps_done()))
}

/// Removes the checkpoints of the finished field at `out` and of its plate, if there are any.
///
/// # Errors
/// [`Fault::Usage`] if one cannot be removed.
pub fn remove_checkpoint(out: &Path) -> Result<(), Fault> {
    for path in [checkpoint::path_for(out), checkpoint::path_for(&plate_path(out))] {
        output::remove(&path)?;
    }
    Ok(())
}

/// Metadata of a clip of this capture: its duration and frame rate, its up direction or else the mean of its cameras', its
/// scale, and viewpoints at some of the cameras that it is fitted to and that see the content of the `fields` before their
/// `plate`, if any does. The fields are shown at once, each in a range of its clip time.
pub fn clip_info(
    capture_files: &CaptureFiles,
    fields: &[(&Field, [f64; 2])],
    plate: Option<&Field>,
) -> ClipInfo {
    let cameras = &capture_files.capture.cameras;
    let duration_s = capture_files.capture.duration_s();
    let up = match capture_files.stated_up {
        Some(up) => up.map(|x| x as f32),
        None => up_of(cameras.iter().map(|camera| &camera.camera)).unwrap_or(DEFAULT_UP),
    };
    let surroundings = Surroundings::from_parts(fields, plate, up);
    // A held camera may stand where no other looks.
    let mut fitted: Vec<&CalibratedCamera> = cameras.iter().filter(|camera| !camera.held).collect();
    let is_shown = surroundings.which_show_content(fitted.iter().map(|camera| &camera.camera));
    fitted = fitted
        .into_iter()
        .zip(is_shown)
        .filter(|(_, is_shown)| *is_shown)
        .map(|(camera, _)| camera)
        .collect();
    let views = fitted.len().min(VIEWPOINTS_MAX);
    let viewpoint = |i: usize| {
        let CalibratedCamera { name, camera, .. } = fitted[i * fitted.len() / views];
        surroundings.viewpoint(name, camera)
    };
    ClipInfo {
        duration_s: if duration_s > 0.0 { duration_s as f32 } else { DEFAULT_DURATION_S },
        fps: capture_files.fps() as f32,
        up,
        metres_per_unit: capture_files
            .metres_per_unit
            .map_or(DEFAULT_METRES_PER_UNIT, |metres| metres as f32),
        viewpoints: (0..views).map(viewpoint).collect(),
    }
}
