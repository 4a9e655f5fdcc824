//! `cargo xtask fit`: fits a field to the photographs of a capture.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use crate::capture::CaptureFiles;
use crate::export::fitted_field_file;
use crate::fit::{self, DepthScale, FitPlan, FitProgress, FitRuntime, FitStart, Fitted, TrainingViews, log};
use crate::input::Input;
use crate::messages::{count, unreadable};
use crate::progress::counting;
use crate::takes::{List, Take};
use anyhow::{Context, bail};
use clap::ValueEnum;
use indicatif::ProgressBar;
use program::{Fault, output};
use refine::anchor::Mirror;
use refine::capture::Holdout;
use refine::fit::{Backend, Cpu, DensityRule};
use serde_json::{Value, json};

use super::capture::{
    FrameSelection, HeldFrames, describe, load_lpips, load_training_views, note_assumed_fps,
};
use super::fit_source::FitSource;
use super::takes::{self, TakeCommand, TakeOptions};

/// Fit a field to the photographs of a capture.
#[derive(clap::Args, Clone, Debug)]
pub struct Args {
    /// Folder of the capture: its cameras and photographs (layouts: xtask/CAPTURE.md)
    #[arg(required_unless_present = "list", conflicts_with = "list")]
    capture: Option<PathBuf>,
    /// Field file (.ply) to write; CAPTURE's name with .ply in the current folder by default. The table and
    /// the picture of the fit (.fit.csv, .fit.png) are written beside it and, until it is done, a
    /// .checkpoint, from which the same command resumes
    #[arg(short, long, value_name = "PATH")]
    out: Option<PathBuf>,
    #[command(flatten)]
    many: TakeOptions,
    /// Number of steps; 5600 per training frame, at most 96000, by default
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1_000_000_000))]
    steps: Option<u64>,
    #[command(flatten)]
    selection: FrameSelection,
    /// Frames that are held out from fitting; the field file records them, and `eval` measures them separately
    #[arg(long, value_enum, default_value_t = HeldFrames::None)]
    holdout: HeldFrames,
    /// Source of the first Gaussians
    #[arg(long, value_enum, default_value_t = Anchor::Sweep)]
    anchor: Anchor,
    /// Cameras whose pixels become Gaussians of the anchor, by name, like the paper's frontal ones; all by
    /// default
    #[arg(long, value_name = "NAME[,NAME..]", value_delimiter = ',')]
    anchor_cameras: Vec<String>,
    /// Whether the anchor's visible side is mirrored to its hidden side: auto mirrors in clips of at most
    /// nine frames whose cameras are all on one side
    #[arg(long, value_enum, default_value_t = MirrorWhen::Auto)]
    mirror: MirrorWhen,
    /// Folder of depth maps to anchor with, with the names of the photographs: 16-bit PNG in thousandths
    /// of a unit, PFM or NPY
    #[arg(long, value_name = "DIR", conflicts_with_all = ["anchor", "list"])]
    depths: Option<PathBuf>,
    /// How depth maps are scaled to the units of the cameras
    #[arg(long, value_enum, default_value_t = DepthScale::Auto, requires = "depths")]
    depth_scale: DepthScale,
    /// Fitted field or package to start from instead of an anchor
    #[arg(long, value_name = "FIELD",
          conflicts_with_all = ["anchor", "depths", "anchor_cameras", "mirror", "list"])]
    from: Option<PathBuf>,
    /// Number of Gaussians below which pruning stops, and approximate number at the start; by default 12000
    /// per training frame, at most 200000, and fewer for photographs below 512x375
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    gaussians: Option<u32>,
    /// Prune without that lower limit
    #[arg(long)]
    no_floor: bool,
    /// How Gaussians are added and removed
    #[arg(long, value_enum, default_value_t = Rule::Floor)]
    rule: Rule,
    /// Degree of view-dependent colour; with --from, the degree of FIELD
    #[arg(long, value_name = "0..3", default_value_t = fit::SH_DEGREE, conflicts_with = "from",
          value_parser = clap::value_parser!(u8).range(0..=3))]
    sh_degree: u8,
    /// LPIPS weights (AlexNet or VGG16) as safetensors; without them the loss has no LPIPS term
    #[arg(long, value_name = "FILE")]
    lpips_weights: Option<PathBuf>,
    /// Back end that renders and computes gradients
    #[arg(long, value_enum, default_value_t = Engine::Cpu)]
    backend: Engine,
    /// Captured frames per second, of a capture that does not state them; 30 by default
    #[arg(long, value_parser = positive)]
    fps: Option<f64>,
    /// Seconds between checkpoints
    #[arg(long, value_name = "S", default_value_t = fit::CHECKPOINT_EVERY.as_secs_f64(),
          value_parser = positive)]
    checkpoint_every: f64,
    /// Seed of the random numbers
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Anchor {
    /// The visual hull of the masks, refined where the photographs agree
    Sweep,
    /// The visual hull of the masks
    Hull,
    /// None: Gaussians at random positions
    None,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum MirrorWhen {
    Auto,
    On,
    Off,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Rule {
    /// Split, clone and prune, but never below --gaussians (the paper)
    Floor,
    /// Relocate dead Gaussians to where they are needed; their number stays
    Relocate,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Engine {
    /// All CPU cores; the result is bit-identical for any number of cores
    Cpu,
    /// The GPU; results differ from the CPU's in their last digits. Needs a build with --features gpu
    Gpu,
}

fn positive(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|x| (1e-3..=1e6).contains(x));
    number.ok_or_else(|| "a number from 0.001 to 1000000".into())
}

/// Fits a capture with the defaults of `fit`.
pub(super) fn by_default(
    capture_files: &CaptureFiles,
    views: &TrainingViews,
    plan: &FitPlan,
    out: &Path,
) -> anyhow::Result<()> {
    let runtime =
        FitRuntime { backend: &mut Cpu::default(), lpips: None, checkpoint_every: fit::CHECKPOINT_EVERY };
    fit_and_write(out, plan, capture_files, views, runtime).map(drop)
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    match args.many.list_and_folder(&args.out) {
        Some((list, folder)) => run_many(args, list, folder),
        None => run_one(args),
    }
}

fn run_one(args: &Args) -> anyhow::Result<()> {
    let start = Instant::now();
    let default = || PathBuf::from(format!("{}.ply", name_of(args.capture())));
    let out = args.out.clone().unwrap_or_else(default);
    let result = fit_capture(args, &out)?;
    report(args, &result, &out, start)
}

/// Fits a field to each capture of a list.
fn run_many(args: &Args, list: &Path, folder: &Path) -> anyhow::Result<()> {
    let job = TakeCommand {
        command: "fit",
        ending: "ply",
        options: format!("{:?}", args.options()),
        inputs: args.lpips_weights.iter().map(PathBuf::as_path).collect(),
        forget: fit::remove_checkpoint,
        json: args.json,
    };
    takes::run(&List::read(list)?, args.many.shard, folder, &job, &mut |take: &Take, out: &Path| {
        fit_capture(&Args { capture: Some(take.path.clone()), ..args.clone() }, out)?.to_json(out)
    })
}

impl Args {
    fn capture(&self) -> &Path {
        self.capture.as_deref().expect("there is a capture where there is no list")
    }

    /// The options that affect the result, for any capture.
    fn options(&self) -> Args {
        Args {
            capture: None,
            out: None,
            many: TakeOptions::default(),
            // `TakeCommand::inputs` holds it, as its contents count.
            lpips_weights: None,
            checkpoint_every: 0.0,
            json: false,
            ..self.clone()
        }
    }
}

/// Fits a field to a capture and writes it.
fn fit_capture(args: &Args, out: &Path) -> anyhow::Result<FitResult> {
    output::check(out)?;
    if out.extension() != Some(OsStr::new("ply")) {
        bail!(Fault::Usage(format!("cannot write {}: a field file ends in .ply; name it so", out.display())));
    }
    let mut capture_files = match &args.from {
        None => args.selection.open(args.capture())?,
        Some(from) => open_for_start(args, from)?,
    };
    if let Some(fps) = args.fps {
        capture_files.state_fps(fps)?;
    }
    let holdout = Holdout::from(args.holdout);
    let splits = describe(&capture_files, holdout)?;
    let lpips = load_lpips(args.lpips_weights.as_deref())?;
    let plan = plan(args, &capture_files)?;
    fit::check_checkpoint(&plan, out)?;
    let views = load_training_views(&capture_files, holdout)?;
    let mut backend = open_backend(args.backend)?;
    let runtime = FitRuntime {
        backend: &mut *backend,
        lpips: lpips.as_ref(),
        checkpoint_every: Duration::try_from_secs_f64(args.checkpoint_every).unwrap_or(Duration::MAX),
    };
    note_assumed_fps(&capture_files, "--fps states another number");
    let fitted = fit_and_write(out, &plan, &capture_files, &views, runtime)?;
    Ok(FitResult { plan, fitted, splits })
}

/// Opens the capture for a fit that starts from a field; one that moves is fitted to its own frames.
fn open_for_start(args: &Args, from: &Path) -> anyhow::Result<CaptureFiles> {
    let input = Input::load(from)?;
    let source = FitSource::of(from, &input);
    let capture_files = match input.is_static() {
        true => args.selection.open(args.capture())?,
        false => args.selection.open_for(args.capture(), &source)?,
    };
    source.note_static(&capture_files);
    Ok(capture_files)
}

/// The results of a finished fit.
struct FitResult {
    plan: FitPlan,
    fitted: Fitted,
    splits: String,
}

/// Fits a field with a progress bar and writes it to `out`.
fn fit_and_write(
    out: &Path,
    plan: &FitPlan,
    capture_files: &CaptureFiles,
    views: &TrainingViews,
    runtime: FitRuntime,
) -> anyhow::Result<Fitted> {
    let bar = counting(plan.steps, "steps");
    bar.println(describe(capture_files, plan.holdout)?);
    let fitted = fit::fit(plan, capture_files, views, runtime, out, &mut |progress| show(&bar, progress))?;
    bar.finish_and_clear();
    let info = fit::clip_info(capture_files);
    // The checkpoint goes only when the field is safe.
    let record = capture_files.fit_record(plan.holdout);
    output::write_durable(out, &fitted_field_file(&fitted.field, &info, &record))?;
    fit::remove_checkpoint(out)?;
    Ok(fitted)
}

/// Opens the back end.
fn open_backend(engine: Engine) -> Result<Box<dyn Backend>, Fault> {
    match engine {
        Engine::Cpu => Ok(Box::new(Cpu::default())),
        Engine::Gpu => open_gpu(),
    }
}

#[cfg(feature = "gpu")]
fn open_gpu() -> Result<Box<dyn Backend>, Fault> {
    match refine::fit::gpu::Gpu::open() {
        Ok(gpu) => Ok(Box::new(gpu)),
        Err(error) => Err(Fault::Device(error.to_string())),
    }
}

#[cfg(not(feature = "gpu"))]
fn open_gpu() -> Result<Box<dyn Backend>, Fault> {
    Err(Fault::Usage(
        "--backend gpu: this build has no GPU back end; \
         run `cargo run --release --package studio --features gpu -- fit ...`"
            .into(),
    ))
}

fn plan(args: &Args, capture_files: &CaptureFiles) -> anyhow::Result<FitPlan> {
    let default = FitPlan::default_for(capture_files, args.holdout.into())?;
    let gaussians = args.gaussians.map_or(default.gaussians, |n| n as usize);
    let start = match (&args.depths, &args.from) {
        (Some(folder), _) => FitStart::Depths(folder.to_string_lossy().into_owned(), args.depth_scale),
        (_, Some(path)) => FitStart::Field(path.to_string_lossy().into_owned(), checksum(path)?),
        _ => match args.anchor {
            Anchor::Sweep => FitStart::Sweep,
            Anchor::Hull => FitStart::Hull,
            Anchor::None => FitStart::Scatter,
        },
    };
    let lpips = match &args.lpips_weights {
        Some(weights) => Some(format!("{}, {:08x}", weights.display(), checksum(weights)?)),
        None => None,
    };
    Ok(FitPlan {
        lpips,
        steps: args.steps.unwrap_or(default.steps),
        start,
        anchor_cameras: args.anchor_cameras.clone(),
        mirror: match args.mirror {
            MirrorWhen::Auto => Mirror::Auto,
            MirrorWhen::On => Mirror::On,
            MirrorWhen::Off => Mirror::Off,
        },
        gaussians,
        floor: if args.no_floor { 0 } else { gaussians },
        rule: match args.rule {
            Rule::Floor => DensityRule::Floor,
            Rule::Relocate => DensityRule::Relocate,
        },
        sh_degree: args.sh_degree,
        seed: args.seed,
        ..default
    })
}

fn checksum(path: &Path) -> Result<u32, Fault> {
    let bytes = std::fs::read(path);
    bytes.map(|bytes| fit::crc(&bytes)).map_err(|error| unreadable(path, &error))
}

fn show(bar: &ProgressBar, progress: &FitProgress) {
    bar.set_position(progress.step);
    let held = progress.held_psnr_db.map_or(String::new(), |psnr| format!(", held {psnr:.2} dB"));
    bar.set_message(format!("loss {:.4}{held}, {} Gaussians", progress.loss, progress.gaussians));
}

impl FitResult {
    fn last(&self) -> anyhow::Result<&log::LogEntry> {
        self.fitted.entries.last().context("a fit has at least one step")
    }

    fn to_json(&self, out: &Path) -> anyhow::Result<Value> {
        let FitResult { plan, fitted, splits } = self;
        let last = self.last()?;
        Ok(json!({
            "out": out, "steps": plan.steps, "resumed_at": fitted.resumed_at,
            "gaussians_at_start": fitted.initial_count, "gaussians": fitted.field.len(),
            "loss": last.loss, "held_psnr_db": last.held_psnr_db, "seconds": last.seconds,
            "ms_per_step": fitted.ms_per_step, "non_finite": fitted.non_finite, "splits": splits,
            "lpips": plan.lpips, "backend": fitted.backend,
            "peak_device_bytes": fitted.peak_device_bytes,
        }))
    }
}

fn report(args: &Args, result: &FitResult, out: &Path, start: Instant) -> anyhow::Result<()> {
    if args.json {
        println!("{:#}", result.to_json(out)?);
        return Ok(());
    }
    let FitResult { plan, fitted, splits } = result;
    let (last, ms_per_step) = (result.last()?, fitted.ms_per_step);
    println!("{splits}");
    match &plan.lpips {
        Some(net) => println!("loss             0.8 L1 + 0.2 D-SSIM + 0.1 LPIPS by {net}"),
        None => println!("loss             0.8 L1 + 0.2 D-SSIM; its LPIPS part takes --lpips-weights"),
    }
    println!("Gaussians        {} at the start, {} at the end", fitted.initial_count, fitted.field.len());
    if let Some(psnr) = last.held_psnr_db {
        println!(
            "held             {psnr:.2} dB, the subject in a few held-out photographs; `eval` measures all"
        );
    }
    if fitted.non_finite > 0 {
        println!("left out         {}, not finite", count(fitted.non_finite as usize, "gradient"));
    }
    if fitted.resumed_at > 0 {
        println!("resumed          at step {}", fitted.resumed_at);
    }
    println!("steps            {}, {ms_per_step:.1} ms each by {}", plan.steps, fitted.backend);
    if let Some(bytes) = fitted.peak_device_bytes {
        println!("peak device memory {:.1} MB", bytes as f64 * 1e-6);
    }
    println!(
        "{}, {}, {}, written in {:.1} s",
        out.display(),
        log::table_path(out).display(),
        log::preview_path(out).display(),
        start.elapsed().as_secs_f64()
    );
    Ok(())
}

/// The name of a folder, also for paths such as `.` and `..`.
pub(super) fn name_of(folder: &Path) -> String {
    let absolute = std::fs::canonicalize(folder).unwrap_or_else(|_| folder.to_owned());
    absolute.file_name().map_or_else(|| "field".into(), |name| name.to_string_lossy().into_owned())
}
