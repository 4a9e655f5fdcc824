//! `cargo xtask fit`: fits a field to the photographs of a capture.

use std::convert::Infallible;
use std::ffi::OsStr;
use std::num::NonZero;
use std::path::{Path, PathBuf};
use std::thread::available_parallelism;
use std::time::Instant;

use crate::capture::{BackgroundSource, CameraCorrections, CameraPart, CaptureFiles};
use crate::eval::{HeldCameras, Subject, fragments_per_lit_pixel, held_photos, judge_held_cameras};
use crate::fields::{FitRecord, fitted_field_file};
use crate::fit::{
    self, FitPlan, FitRuntime, FitStart, Fitted, FittedPlate, PlatePlan, Segments, SlidePlan, TrainingViews,
    WorkFolder, log,
};
use crate::input::{Input, check_one_field};
use crate::messages::count;
use crate::progress::counting;
use crate::scene::{cameras_path, learned_cameras_of, plate_path};
use crate::segments::FieldFolder;
use crate::takes::{List, ListedTake, Shard};
use anyhow::{Context, bail};
use clap::builder::PossibleValue;
use clap::{Args as _, FromArgMatches, ValueEnum};
use program::{Fault, output};
use refine::capture::Holdout;
use refine::fit::{Backend, DensityRule, Learned, Lpips};
use refine::reference::RenderScene;
use serde_json::{Value, json};

use super::backend::{BackendOption, OpenBackend};
use super::capture::{FrameSelection, LpipsOption, describe, load_training_views, note_assumed_fps};
use super::fit_folder::{fit_folder, report_finished, report_folder};
use super::fit_plate::{PlateWhen, fit_plate, settle_plate, write_plate};
use super::fit_progress::{fit_bar, show};
use super::fit_setting::{self, FitConstants, FitSetting, Subjects, check_settings, fit_setting};
use super::fit_source::FitSource;
use super::options::JsonOption;
use super::takes::{self, TakeCommand, TakeOptions, part_seconds};

/// Fit a field to the photographs of a capture.
///
/// The table and the picture of the fit (.fit.csv, .fit.png) are written beside the field file and, until it is done, a
/// .checkpoint, from which the same command resumes. An output without extension is a field folder: the fit slides along
/// the capture, with the memory of a few seconds, and the same command resumes it.
#[derive(clap::Args, Clone, Debug)]
pub struct Args {
    /// Folder of the capture: its cameras and photographs (layouts: xtask/CAPTURE.md)
    #[arg(required_unless_present = "list", conflicts_with = "list")]
    capture: Option<PathBuf>,
    #[command(flatten)]
    many: TakeOptions,
    #[command(flatten)]
    selection: FrameSelection,
    /// Source of the first Gaussians: the visual hull of the masks (hull), refined where the photographs agree (sweep);
    /// random positions (none); or a folder of depth maps with the names of the photographs, 16-bit PNG in thousandths of a
    /// unit, PFM or NPY
    #[arg(long, value_name = "sweep|hull|none|DIR", default_value = "sweep", value_parser = anchor)]
    anchor: Anchor,
    /// Fitted field or package to start from instead of an anchor
    #[arg(long, value_name = "FIELD", conflicts_with_all = ["anchor", "sh_degree", "list"])]
    from: Option<PathBuf>,
    /// Cameras as an earlier fit learned them, a file .cameras.json: this fit starts from them
    #[arg(long, value_name = "FILE", conflicts_with = "list")]
    learned: Option<PathBuf>,
    /// Seconds of a part of a field folder, and of the grid of its segments; --steps and --gaussians are of a part
    #[arg(long, value_name = "S", value_parser = part_seconds, conflicts_with = "list")]
    split: Option<f64>,
    /// Fit only these parts of a field folder, while other machines fit the rest: even parts, each by itself; then odd
    /// parts, each between two even ones; or the parts A to B - 1, one after another. --shard deals out even or odd parts.
    /// The last process completes the folder
    #[arg(long, value_name = "even|odd|A..B", group = "shared", requires = "out")]
    segments: Option<Segments>,
    #[command(flatten)]
    options: FitOptions,
    #[command(flatten)]
    json: JsonOption,
}

/// The options of a fit to any capture, which `report --fit` shares.
#[derive(clap::Args, Clone, Debug)]
pub(super) struct FitOptions {
    /// Number of steps; by default 5600 per training frame, at most 96000, and 13000 for whole photographs with a plate
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1_000_000_000))]
    steps: Option<u64>,
    /// Number of Gaussians below which pruning stops, and approximate number at the start; by default 12000
    /// per training frame, at most 200000; for whole photographs 3000 per training frame, at most 90000, beside the
    /// Gaussians of the plate; fewer for photographs below 512x375
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    gaussians: Option<u32>,
    /// How Gaussians are added and removed
    #[arg(long, value_enum, default_value_t = Rule::Floor)]
    rule: Rule,
    /// Degree of view-dependent colour; 3 by default, 0 for whole photographs, and with --from the degree of FIELD
    #[arg(long, value_name = "0..3", value_parser = clap::value_parser!(u8).range(0..=3))]
    sh_degree: Option<u8>,
    #[command(flatten)]
    pub(super) lpips: LpipsOption,
    #[command(flatten)]
    pub(super) backend: BackendOption,
    /// What to learn of each camera beside the field; by default what capture.json names, else gains of whole photographs whose
    /// cameras disagree about colours. A file .cameras.json is written beside the field, where `eval` and `package --refine` find it
    #[arg(long, value_enum, value_name = "PART[,PART..]|none", value_delimiter = ',')]
    learn: Vec<Learn>,
    /// Whether a plate is fitted: a static field of what is behind the subject. It becomes a file .plate.ply beside the
    /// field, where all commands find it
    #[arg(long, value_enum, value_name = "WHEN", default_value_t = PlateWhen::Auto)]
    pub(super) plate: PlateWhen,
    #[arg(long = "set", value_name = "KEY=VALUE", value_parser = fit_setting, help = fit_setting::HELP)]
    pub(super) settings: Vec<FitSetting>,
}

/// Source of the first Gaussians.
#[derive(Clone, Debug)]
enum Anchor {
    /// The visual hull of the masks, refined where the photographs agree.
    Sweep,
    /// The visual hull of the masks.
    Hull,
    /// None: Gaussians at random positions.
    None,
    /// A folder of depth maps.
    Depths(PathBuf),
}

fn anchor(text: &str) -> Result<Anchor, Infallible> {
    Ok(match text {
        "sweep" => Anchor::Sweep,
        "hull" => Anchor::Hull,
        "none" => Anchor::None,
        folder => Anchor::Depths(folder.into()),
    })
}

/// A part of a camera, or none.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Learn {
    Part(CameraPart),
    None,
}

impl ValueEnum for Learn {
    fn value_variants<'a>() -> &'a [Learn] {
        use CameraPart::{Colors, Exposures, Focals, Gains, Offsets, Poses};
        const {
            &[
                Learn::Part(Offsets),
                Learn::Part(Gains),
                Learn::Part(Colors),
                Learn::Part(Exposures),
                Learn::Part(Poses),
                Learn::Part(Focals),
                Learn::None,
            ]
        }
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        match self {
            Learn::Part(part) => part.to_possible_value(),
            Learn::None => Some(PossibleValue::new("none").help("Nothing: cameras are as the capture says")),
        }
    }
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Rule {
    /// Split, clone and prune, but never below --gaussians
    Floor,
    /// The same, and make all nearly transparent every 3000 steps, as the schedule of the paper does
    Paper,
    /// Relocate dead Gaussians to where they are needed; their number stays
    Relocate,
}

/// Fits a capture with the defaults of `fit`, and judges held cameras; its plates are found if the plan has one.
pub(super) fn by_default(
    capture_files: &CaptureFiles,
    plan: &FitPlan,
    backend: &mut dyn Backend,
    out: &Path,
) -> anyhow::Result<()> {
    fn runtime(backend: &mut dyn Backend) -> FitRuntime<'_> {
        FitRuntime { backend, lpips: None, checkpoint_every: fit::CHECKPOINT_EVERY }
    }
    announce(plan, capture_files, fit::check_checkpoint(plan, out)?, backend);
    let mut capture_files = capture_files.clone();
    let mut views = load_training_views(&plan.start_files(&capture_files), plan.holdout)?;
    let plate = fit_plate(plan, &mut capture_files, &mut views, runtime(backend), out)?;
    fit_and_write(out, plan, &capture_files, &views, plate.as_ref(), runtime(backend))?;
    if let Some(held_cameras) = judged_after_fit(out, capture_files, plan.holdout) {
        eprint!("{}", held_cameras.table());
    }
    Ok(())
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let has_depths = matches!(args.anchor, Anchor::Depths(_));
    args.options.check_settings(args.no_anchor(), args.from.is_some(), has_depths)?;
    match args.many.list_and_folder() {
        Some(_) if has_depths => {
            bail!(Fault::Usage(
                "--anchor: a folder has the depth maps of one capture; leave --list out".into()
            ))
        }
        Some((list, folder)) => run_many(args, list, folder),
        None => run_one(args),
    }
}

fn run_one(args: &Args) -> anyhow::Result<()> {
    let start = Instant::now();
    let default = || PathBuf::from(format!("{}.ply", name_of(args.capture())));
    let out = args.many.out.clone().unwrap_or_else(default);
    if out.extension().is_none() {
        return slide(args, &out);
    }
    let of_folders = [
        (args.split.map(|seconds| seconds.to_string()), "--split"),
        (args.segments.as_ref().map(Segments::to_string), "--segments"),
    ];
    if let Some((Some(value), option)) = of_folders.iter().find(|(value, _)| value.is_some()) {
        bail!(Fault::Usage(format!(
            "{option} {value}: {} is one field; name a folder to fit a field folder, or leave {option} out",
            out.display()
        )));
    }
    let result = fit_capture(args, &out)?;
    report(args, &result, &out, start)
}

/// Fits a field to each capture of a list.
fn run_many(args: &Args, list: &Path, folder: &Path) -> anyhow::Result<()> {
    let job = TakeCommand {
        command: "fit",
        ending: "ply",
        options: format!("{:?}", args.for_any_capture()),
        inputs: args.options.lpips.lpips_weights.iter().map(PathBuf::as_path).collect(),
        forget: fit::remove_checkpoint,
        json: args.json.is_given,
    };
    takes::run(&List::read(list)?, args.many.shard, folder, &job, &mut |take: &ListedTake, out: &Path| {
        fit_capture(&Args { capture: Some(take.path.clone()), ..args.clone() }, out)?.to_json(out)
    })
}

impl Args {
    fn capture(&self) -> &Path {
        self.capture.as_deref().expect("there is a capture where there is no list")
    }

    /// Why there is no anchor, if there is none.
    fn no_anchor(&self) -> Option<&'static str> {
        match self.anchor {
            _ if self.from.is_some() => Some("a fit that starts from a field has no anchor"),
            Anchor::None => Some("--anchor none starts at random positions"),
            _ => None,
        }
    }

    /// The options that affect the result, for any capture.
    fn for_any_capture(&self) -> Args {
        Args {
            capture: None,
            many: TakeOptions::default(),
            options: FitOptions {
                // `TakeCommand::inputs` holds them, as their contents count.
                lpips: LpipsOption::default(),
                settings: self.options.settings_of_result(),
                ..self.options.clone()
            },
            json: JsonOption::default(),
            ..self.clone()
        }
    }
}

impl FitOptions {
    /// Opens the back end, and says what was chosen if the user did not choose.
    ///
    /// # Errors
    /// Those of [`BackendOption::open`].
    pub(super) fn open_backend(&self) -> Result<Box<dyn Backend>, Fault> {
        let OpenBackend { backend, choice } = self.backend.open()?;
        if let Some(choice) = choice {
            eprintln!("note: {choice}");
        }
        Ok(backend)
    }

    /// Whether no option is given, or only defaults.
    pub(super) fn is_default(&self) -> bool {
        let none = FitOptions::augment_args(clap::Command::new("fit")).get_matches_from([""; 0]);
        FitOptions::from_arg_matches(&none).is_ok_and(|default| format!("{default:?}") == format!("{self:?}"))
    }

    /// Refuses settings that would have no effect, where there is no anchor for a reason, and perhaps a field to start from
    /// or depth maps.
    pub(super) fn check_settings(
        &self,
        no_anchor: Option<&'static str>,
        has_field: bool,
        has_depths: bool,
    ) -> Result<(), Fault> {
        let prunes = !matches!(self.rule, Rule::Relocate);
        check_settings(&self.settings, Subjects { no_anchor, has_field, has_depths, prunes })
    }

    /// Checks the frame rate, and states it to a capture that does not.
    pub(super) fn state_fps(&self, capture_files: &mut CaptureFiles) -> Result<(), Fault> {
        FitConstants::new(&self.settings).fps.map_or(Ok(()), |fps| capture_files.state_fps(fps))
    }

    /// The plan of these options for a capture whose background `plate` tells, with the default anchor and the floor.
    pub(super) fn plan(
        &self,
        capture_files: &CaptureFiles,
        holdout: Holdout,
        plate: PlatePlan,
    ) -> Result<FitPlan, Fault> {
        let plan = self.plan_from(FitPlan::default_for(capture_files, holdout, plate)?)?;
        Ok(plan.with_coarse_steps(capture_files))
    }

    /// The settings that affect the result.
    fn settings_of_result(&self) -> Vec<FitSetting> {
        let is_of_result = |setting: &&FitSetting| !matches!(setting, FitSetting::CheckpointEvery(_));
        self.settings.iter().filter(is_of_result).cloned().collect()
    }

    /// `default`, with what these options state instead.
    fn plan_from(&self, default: FitPlan) -> Result<FitPlan, Fault> {
        let FitConstants {
            anchor_cameras,
            mirror,
            motion_start,
            filter,
            has_floor,
            fragment_weight,
            seed,
            ..
        } = FitConstants::new(&self.settings);
        let gaussians = self.gaussians.map_or(default.gaussians, |n| n as usize);
        Ok(FitPlan {
            lpips: self.lpips.record()?,
            steps: self.steps.unwrap_or(default.steps),
            anchor_cameras,
            mirror,
            motion_start,
            filter,
            gaussians,
            floor: if has_floor { gaussians } else { 0 },
            rule: match self.rule {
                Rule::Floor => DensityRule::Floor,
                Rule::Paper => DensityRule::Paper,
                Rule::Relocate => DensityRule::Relocate,
            },
            fragment_weight: fragment_weight.unwrap_or(match self.rule {
                Rule::Paper => 0.0,
                Rule::Floor | Rule::Relocate => default.fragment_weight,
            }),
            sh_degree: self.sh_degree.unwrap_or(default.sh_degree),
            seed,
            learned: self.learned(default.learned)?,
            learns_disagreement: default.learns_disagreement && self.learn.is_empty(),
            ..default
        })
    }

    /// What is learned of cameras, where the capture asks for `asked`.
    fn learned(&self, asked: Learned) -> Result<Learned, Fault> {
        let parts: Vec<CameraPart> = self
            .learn
            .iter()
            .filter_map(|learn| match learn {
                Learn::Part(part) => Some(*part),
                Learn::None => None,
            })
            .collect();
        match (self.learn.contains(&Learn::None), parts.is_empty()) {
            (true, false) => {
                Err(Fault::Usage("--learn: none stands alone; leave it or the others out".into()))
            }
            (false, true) => Ok(asked),
            _ => Ok(CameraPart::learned(&parts)),
        }
    }

    /// What a fit runs with.
    pub(super) fn runtime<'a>(
        &self,
        backend: &'a mut dyn Backend,
        lpips: Option<&'a Lpips<f32>>,
    ) -> FitRuntime<'a> {
        let FitConstants { checkpoint_every, .. } = FitConstants::new(&self.settings);
        FitRuntime { backend, lpips, checkpoint_every }
    }
}

/// Fits a field to a capture and writes it.
fn fit_capture(args: &Args, out: &Path) -> anyhow::Result<FitResult> {
    output::check(out)?;
    if out.extension() != Some(OsStr::new("ply")) {
        bail!(Fault::Usage(format!("cannot write {}: a field file ends in .ply; name it so", out.display())));
    }
    let (mut capture_files, holdout) = match &args.from {
        None => (args.selection.open(args.capture())?, args.selection.holdout_of_fit()),
        Some(from) => open_for_start(args, from)?,
    };
    args.options.state_fps(&mut capture_files)?;
    correct(args, &mut capture_files)?;
    let splits = describe(&capture_files, holdout)?;
    let lpips = args.options.lpips.load()?;
    let plate = plate_plan(args, &mut capture_files, holdout)?;
    let plan = plan(args, args.options.plan(&capture_files, holdout, plate)?)?;
    let done = fit::check_checkpoint(&plan, out)?;
    let mut backend = args.options.open_backend()?;
    announce(&plan, &capture_files, done, &*backend);
    let runtime = args.options.runtime(&mut *backend, lpips.as_ref());
    let mut views = load_training_views(&plan.start_files(&capture_files), holdout)?;
    let plate = fit_plate(&plan, &mut capture_files, &mut views, runtime, out)?;
    let runtime = args.options.runtime(&mut *backend, lpips.as_ref());
    note_assumed_fps(&capture_files, "--set fps=N states another number");
    let fitted = fit_and_write(out, &plan, &capture_files, &views, plate.as_ref(), runtime)?;
    let step = (views.train.len() / COUNTED_VIEWS).max(1);
    let counted = views.train.iter().step_by(step).map(|(photo_id, _)| photo_id);
    let field = fitted.fit.to_field();
    let scene = RenderScene::from(&field);
    let fragments_per_lit_pixel = fragments_per_lit_pixel(&scene, &capture_files, counted);
    let held_cameras = judged_after_fit(out, capture_files, holdout);
    Ok(FitResult { plan, fitted, splits, fragments_per_lit_pixel, held_cameras })
}

/// Says in two lines what is the subject of a fit of whole photographs, if no earlier fit has told, and what the fit does
/// after `done` steps; on the CPU also how long it takes.
fn announce(plan: &FitPlan, capture_files: &CaptureFiles, done: u64, backend: &dyn Backend) {
    if plan.plate == PlatePlan::Fitted {
        if !matches!(plan.start, FitStart::Field(..)) {
            let subject = if capture_files.has_mattes() { "what moves" } else { "what masks show" };
            eprintln!(
                "note: {subject} is the subject, in front of a plate of the rest; --plate off fits it alone"
            );
        }
        let is_cpu = backend.device().is_none();
        let cores = is_cpu.then(|| available_parallelism().map_or(1, NonZero::get));
        eprintln!("note: {}", plan.describe_whole(capture_files, done, cores));
    }
}

/// [`held_cameras`]; the field is written, so a photograph that cannot be read does not undo it.
fn judged_after_fit(out: &Path, capture_files: CaptureFiles, holdout: Holdout) -> Option<HeldCameras> {
    held_cameras(out, capture_files, holdout).unwrap_or_else(|error| {
        eprintln!("note: held cameras are not judged: {error:#}");
        None
    })
}

/// Compares the field that was written to `out` with a few photographs of held cameras, as `eval` does: with the plate behind
/// it, by the cameras that were learned with it.
fn held_cameras(
    out: &Path,
    mut capture_files: CaptureFiles,
    holdout: Holdout,
) -> anyhow::Result<Option<HeldCameras>> {
    let photos = held_photos(&capture_files.capture).len();
    if photos == 0 {
        return Ok(None);
    }
    let input = Input::load(out)?;
    if let Some(learned) = learned_cameras_of(out) {
        capture_files.correct(&CameraCorrections::read(&learned)?, &learned)?;
    }
    if input.has_plate() {
        capture_files.keep_background();
    }
    let progress = counting(photos as u64, "photographs of held cameras");
    let subject = Subject::Drawn(Box::new(input));
    let held = judge_held_cameras(&subject, &capture_files, holdout, || progress.inc(1));
    progress.finish_and_clear();
    held
}

/// What a fit makes of the background, whose plates are found if it needs them. Without a word on it, one that starts from
/// a field goes on as that was fitted, and other starts than an anchor at surfaces are of the whole scene.
fn plate_plan(args: &Args, capture_files: &mut CaptureFiles, holdout: Holdout) -> anyhow::Result<PlatePlan> {
    let is_whole = matches!(args.anchor, Anchor::Depths(_) | Anchor::None);
    let has_plate = |from: &Path| Input::load(from).map(|input| input.has_plate());
    match (args.options.plate, &args.from) {
        // With `--plate on`, photographs with masks were fitted whole, too.
        (PlateWhen::Auto, Some(from))
            if has_plate(from)?
                && matches!(
                    capture_files.background_source(holdout)?,
                    BackgroundSource::Plates | BackgroundSource::Masks
                ) =>
        {
            capture_files.find_plates(holdout)?;
            Ok(PlatePlan::Fitted)
        }
        (PlateWhen::Auto, Some(_)) if capture_files.has_mattes() => Ok(PlatePlan::Mattes),
        (PlateWhen::On, Some(from)) if !has_plate(from)? => bail!(Fault::Usage(format!(
            "--plate on: {} has no plate to go on from; leave --plate out, or fit without --from",
            from.display()
        ))),
        (PlateWhen::Auto, from) if is_whole || from.is_some() => PlateWhen::Off.find(capture_files, holdout),
        (when, _) => when.find(capture_files, holdout),
    }
}

/// Corrects the cameras by the file that `--learned` names.
fn correct(args: &Args, capture_files: &mut CaptureFiles) -> Result<(), Fault> {
    let Some(path) = &args.learned else { return Ok(()) };
    capture_files.correct(&CameraCorrections::read(path)?, path)
}

/// Opens the capture for a fit that starts from a field; one that moves is fitted to its own frames. Frames that were held out
/// from its fit are held out from this one, unless others are named.
fn open_for_start(args: &Args, from: &Path) -> anyhow::Result<(CaptureFiles, Holdout)> {
    check_one_field(from)?;
    let input = Input::load(from)?;
    let source = FitSource::new(from, &input);
    let (holdout, note) = source.held_frames(args.selection.holdout());
    if let Some(note) = note.filter(|_| source.record.holdout.is_some()) {
        eprintln!("note: {note}");
    }
    let capture_files = match input.is_static() {
        true => {
            let mut capture_files = args.selection.open(args.capture())?;
            source.prepare(&mut capture_files, holdout)?;
            capture_files
        }
        false => args.selection.open_for(args.capture(), &source, holdout)?,
    };
    source.note_static(&capture_files);
    Ok((capture_files, holdout))
}

/// The results of a finished fit.
pub(super) struct FitResult {
    pub(super) plan: FitPlan,
    pub(super) fitted: Fitted,
    /// Numbers of cameras, frames and photographs of each split, in a line.
    pub(super) splits: String,
    /// What the field costs a player; `None` if it shows nothing, or was not counted.
    pub(super) fragments_per_lit_pixel: Option<f64>,
    /// How well the field shows what held cameras saw; `None` if there are none, or they were not judged.
    pub(super) held_cameras: Option<HeldCameras>,
}

/// Default length of a part of a field folder in seconds.
const UNIT_S: f64 = 1.0;

/// About as many photographs, evenly, tell what a field costs a player.
const COUNTED_VIEWS: usize = 8;

/// Fits a field with a progress bar and writes it to `out`; with the `plate` behind it, that too, beside it.
pub(super) fn fit_and_write(
    out: &Path,
    plan: &FitPlan,
    capture_files: &CaptureFiles,
    views: &TrainingViews,
    plate: Option<&FittedPlate>,
    runtime: FitRuntime,
) -> anyhow::Result<Fitted> {
    let bar = fit_bar(plan.steps);
    bar.println(describe(capture_files, plan.holdout)?);
    let fitted =
        fit::fit(plan, capture_files, views, plate, runtime, out, &mut |progress| show(&bar, progress))?;
    bar.finish_and_clear();
    let [moving, still] = fitted.fit.to_field_and_plate();
    if moving.is_empty() {
        // To go on from it would end the same.
        fit::remove_checkpoint(out)?;
        let what = "no Gaussian is left to show the subject: leave --set floor=off out, or fit all as one, --plate off";
        bail!(Fault::Data(what.into()));
    }
    let cameras = fit::learned_cameras(capture_files, &fitted.fit, views.timeline);
    if let Some(cameras) = &cameras {
        output::write_durable(&cameras_path(out), cameras.to_json().as_bytes())?;
    }
    // The checkpoint goes only when the field is safe.
    let record = FitRecord { device: fitted.device(), ..capture_files.fit_record(plan.holdout) };
    let info = fit::clip_info(capture_files, &[(&moving, [0.0, 1.0])], plate.map(|_| &still));
    if plate.is_some() {
        write_plate(&plate_path(out), &still, &info)?;
    }
    output::write_durable(out, &fitted_field_file(&moving, &info, &record))?;
    if cameras.is_none() && output::remove(&cameras_path(out))? {
        eprintln!("note: {} was of an earlier fit, and is removed", cameras_path(out).display());
    }
    settle_plate(plan, out)?;
    fit::remove_checkpoint(out)?;
    Ok(fitted)
}

fn plan(args: &Args, plan: FitPlan) -> anyhow::Result<FitPlan> {
    let FitConstants { depth_scale, .. } = FitConstants::new(&args.options.settings);
    let start = match (&args.from, &args.anchor) {
        (Some(path), _) => FitStart::Field(path.to_string_lossy().into_owned(), fit::file_crc(path)?),
        (None, Anchor::Depths(folder)) => {
            FitStart::Depths(folder.to_string_lossy().into_owned(), depth_scale)
        }
        (None, Anchor::Sweep) => FitStart::Sweep,
        (None, Anchor::Hull) => FitStart::Hull,
        (None, Anchor::None) => FitStart::Scatter,
    };
    Ok(plan.starting_from(start))
}

/// Fits a field folder to a capture.
fn slide(args: &Args, out: &Path) -> anyhow::Result<()> {
    takes::check_apart(args.capture(), out)?;
    output::check_folder(out)?;
    let others = [(args.from.is_some(), "--from"), (matches!(args.anchor, Anchor::None), "--anchor none")];
    if let Some((_, option)) = others.iter().find(|(is_given, _)| *is_given) {
        bail!(Fault::Usage(format!(
            "{option}: a field folder starts from an anchor; leave it out, or name a field file (.ply)"
        )));
    }
    if args.options.plate == PlateWhen::On {
        bail!(Fault::Usage(
            "--plate on: a field folder has no plate; fit one with a few seconds, `fit CAPTURE --frames A..B -o a.ply`, \
             and leave --plate out here: photographs without masks get mattes"
                .into()
        ));
    }
    let shard = args.many.shard;
    if matches!(args.segments, Some(Segments::Range(_))) && shard.is_some() {
        bail!(Fault::Usage("--shard deals --segments even or odd out; leave it out for a range".into()));
    }
    let segments = args.segments.as_ref().map(|segments| (segments, shard.unwrap_or(Shard::ALL)));
    WorkFolder::tidy(out)?;
    if segments.is_some() && FieldFolder::is_one(out) {
        report_finished(out, args.json.is_given);
        return Ok(());
    }
    let mut capture_files = args.selection.open(args.capture())?;
    args.options.state_fps(&mut capture_files)?;
    correct(args, &mut capture_files)?;
    let holdout = args.selection.holdout_of_fit();
    let duration_s = capture_files.capture.duration_s();
    if fit::train_frames(&capture_files, holdout)?.len() < 2 || duration_s <= 0.0 {
        bail!(Fault::Usage(format!(
            "{}: one frame to fit to has no time to slide along; name a field file (.ply)",
            out.display()
        )));
    }
    let lpips = args.options.lpips.load()?;
    let plan = folder_plan(args, &mut capture_files, holdout)?;
    let work = WorkFolder::open(&plan, &capture_files, out, segments.is_some())?;
    let mut backend = args.options.open_backend()?;
    let runtime = args.options.runtime(&mut *backend, lpips.as_ref());
    note_assumed_fps(&capture_files, "--set fps=N states another number");
    eprintln!("note: {}", describe(&capture_files, holdout)?);
    let slid = fit_folder(out, &plan, &capture_files, runtime, work, segments)?;
    if args.learned.is_some() {
        output::write(&cameras_path(out), capture_files.corrections().to_json().as_bytes())?;
    }
    report_folder(out, &slid, capture_files.capture.duration_s(), args.json.is_given);
    Ok(())
}

/// The plan of a field folder; the plates of the capture are found if it needs them.
fn folder_plan(args: &Args, capture_files: &mut CaptureFiles, holdout: Holdout) -> anyhow::Result<SlidePlan> {
    let unit_s = args.split.unwrap_or(UNIT_S).min(capture_files.capture.duration_s());
    let default = FitPlan::default_for_seconds(capture_files, holdout, unit_s)?;
    let fit = plan(args, args.options.plan_from(default)?)?;
    let is_asked = args.options.learn.iter().any(|learn| *learn != Learn::None);
    if is_asked || !(fit.learned.is_nothing() || args.learned.is_some()) {
        let asked = if is_asked { "--learn" } else { "learn in capture.json" };
        bail!(Fault::Usage(format!(
            "{asked}: a field folder takes its cameras as they are; learn them from some seconds, `fit CAPTURE --frames \
             A..B -o a.ply`, and name them: --learned a.cameras.json; or choose --learn none"
        )));
    }
    let plate = match plate_plan(args, capture_files, holdout)? {
        PlatePlan::Fitted => PlatePlan::Mattes,
        plate => plate,
    };
    Ok(SlidePlan { fit: FitPlan { learned: Learned::default(), plate, ..fit }, unit_s })
}

impl FitResult {
    fn last(&self) -> anyhow::Result<&log::LogEntry> {
        self.fitted.entries.last().context("a fit has at least one step")
    }

    /// Number of Gaussians of the plate, if one was fitted.
    fn plate(&self) -> Option<usize> {
        Some(self.fitted.fit.plate_len()).filter(|gaussians| *gaussians > 0)
    }

    pub(super) fn to_json(&self, out: &Path) -> anyhow::Result<Value> {
        let FitResult { plan, fitted, splits, fragments_per_lit_pixel, held_cameras } = self;
        let plate = self.plate();
        let last = self.last()?;
        Ok(json!({
            "out": out, "steps": plan.steps, "fragment_weight": plan.fragment_weight, "resumed_at": fitted.resumed_at,
            "gaussians_at_start": fitted.fit.initial_count(), "gaussians": fitted.fit.len(),
            "loss": last.loss, "held_psnr_db": last.held_psnr_db, "seconds": last.seconds,
            "ms_per_step": fitted.ms_per_step, "non_finite": fitted.fit.non_finite(), "splits": splits,
            "fragments_per_lit_pixel": fragments_per_lit_pixel,
            "plate_gaussians": plate, "held_cameras": held_cameras, "lpips": plan.lpips, "backend": fitted.backend,
            "peak_device_bytes": fitted.peak_device_bytes,
        }))
    }
}

fn report(args: &Args, result: &FitResult, out: &Path, start: Instant) -> anyhow::Result<()> {
    if args.json.is_given {
        println!("{:#}", result.to_json(out)?);
        return Ok(());
    }
    let FitResult { plan, fitted, splits, fragments_per_lit_pixel, held_cameras } = result;
    let (last, ms_per_step) = (result.last()?, fitted.ms_per_step);
    println!("{splits}");
    match &plan.lpips {
        Some(net) => println!("loss             0.8 L1 + 0.2 D-SSIM + 0.1 LPIPS by {net}"),
        None => println!("loss             0.8 L1 + 0.2 D-SSIM; its LPIPS part takes --lpips-weights"),
    }
    println!("Gaussians        {} at the start, {} at the end", fitted.fit.initial_count(), fitted.fit.len());
    if let Some(gaussians) = result.plate() {
        println!("plate            {gaussians} Gaussians, {}", plate_path(out).display());
    }
    if let Some(fragments) = fragments_per_lit_pixel {
        println!("fragments        {fragments:.1} per lit pixel, in pictures 512 pixels wide");
    }
    if let Some(psnr) = last.held_psnr_db {
        println!("held             {psnr:.2} dB in a few held-out photographs; `eval` measures all");
    }
    if fitted.fit.non_finite() > 0 {
        println!("left out         {}, not finite", count(fitted.fit.non_finite() as usize, "gradient"));
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
    if let Some(held_cameras) = held_cameras {
        print!("\n{}", held_cameras.table());
    }
    Ok(())
}

/// The name of a folder, also for paths such as `.` and `..`.
pub(super) fn name_of(folder: &Path) -> String {
    let absolute = std::fs::canonicalize(folder).unwrap_or_else(|_| folder.to_owned());
    absolute.file_name().map_or_else(|| "field".into(), |name| name.to_string_lossy().into_owned())
}
