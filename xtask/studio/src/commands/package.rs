//! `aarc-studio package`: makes a package from a fitted field or a capture.

use std::collections::BTreeMap;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::time::Instant;

use crate::capture::{CaptureFiles, CaptureSound};
use crate::fit::{self, FitPlan, PlatePlan, Refinement, RefinementReport, TrainingViews};
use crate::messages::decimal;
use crate::package::{
    Coding, Counts, DropPart, LensFragments, PackageReport, PackageSettings, QUALITY_DB, SegmentReport,
    SegmentSources, Snapped, TakeReport, blind_viewpoints, package_take, package_with,
};
use crate::playlist;
use crate::progress::StagedProgress;
use crate::scene::Scene;
use crate::segments::FieldFolder;
use crate::sound::{SoundReport, Soundtrack};
use crate::takes::{List, ListedTake, OutputState, Record, key};
use anyhow::bail;
use clap::{ArgGroup, ValueEnum};
use program::{Fault, output};
use refine::code::JOINT_ROUNDS;
use refine::fit::Backend;
use refine::prune::Ranking;
use serde_json::{Value, json};

use super::audio::AudioOptions;
use super::backend::{BackendOption, OpenBackend};
use super::capture::{FrameSelection, note_assumed_fps};
use super::fit_plate::PlateWhen;
use super::fit_setting::fragment_weight;
use super::fit_source::FitSource;
use super::options::JsonOption;
use super::takes::{self, TakeCommand, TakeOptions, part_seconds};

/// Most rounds of joint rounding. The gain falls off long before.
const JOINT_ROUNDS_MAX: usize = 1000;

/// Fidelity in dB below which the report suggests `--recolor`.
const RECOLOR_BELOW_DB: f64 = 40.0;

/// The section of `--help` about scenes.
const SCENE_HELP: &str = r#"A scene folder may hold scene.json, every key optional, in the axes and units of the field:
  {"duration_s": 1.32, "fps": 25, "up": [0, -1, 0], "metres_per_unit": 1, "viewpoints": [
    {"name": "front", "position": [0, 0, -3], "target": [0, 0, 0], "fov_y_deg": 50}]}"#;

/// The command in the record of a field that is fitted for a package.
const FIELD_OF_PACKAGE: &str = "package: field";

/// Make a package from a fitted field, or from a capture that it fits one to first.
#[derive(clap::Args, Clone, Debug)]
#[command(after_help = SCENE_HELP, group(ArgGroup::new("pruned").args(["budget", "fragments"]).multiple(true)))]
pub struct Args {
    /// Fitted field file, or a folder holding one, perhaps with plate.ply and scene.json; or a field folder, as
    /// `join` makes it, which becomes a take; or a capture, to which a field is fitted first, beside the package, as
    /// `fit` does by default
    #[arg(required_unless_present = "list", conflicts_with = "list")]
    scene: Option<PathBuf>,
    #[command(flatten)]
    many: TakeOptions,
    /// Most Gaussians to keep, of a take at any instant; all that can be seen by default
    #[arg(long, value_name = "N", value_parser = budget)]
    budget: Option<NonZeroUsize>,
    /// Ranking that selects Gaussians for a budget: auto tries all, with and without the topology floor, and
    /// takes the ranking whose package looks most like the whole field
    #[arg(long, value_name = "auto|NAME", default_value = "auto", value_parser = rank)]
    rank: Rank,
    /// Prune by the ranking alone, although limbs may break off
    #[arg(long, requires = "pruned")]
    no_floor: bool,
    /// Most fragments to keep, as a fraction of the fragments of the retained Gaussians, 0.01 to 1: leaves out the
    /// Gaussians that show least for the pixels that they cover
    #[arg(long, value_name = "FRACTION", value_parser = fragments)]
    fragments: Option<f64>,
    /// Fit the colours of the retained Gaussians to pictures of the whole field
    #[arg(long, requires = "pruned")]
    recolor: bool,
    /// Refine the retained Gaussians for N steps on the photographs of the capture that the field was
    /// fitted to
    #[arg(long, value_name = "N", conflicts_with = "recolor",
          value_parser = clap::value_parser!(u64).range(1..=1_000_000_000))]
    refine: Option<u64>,
    /// Weight of the area that Gaussians cover in the loss of the refinement, 0 to 1: a headset pays for it. By default as `fit`
    /// has it: 0.001, or 0.0025 for whole photographs
    #[arg(long, value_name = "W", requires = "refine", value_parser = fragment_weight)]
    fragment_weight: Option<f64>,
    /// Folder of that capture; SCENE itself by default
    #[arg(long, value_name = "DIR", requires = "refine", conflicts_with = "list")]
    capture: Option<PathBuf>,
    /// Split the field into segments, as a take: on level l one begins at every multiple of 2^l S seconds, and lasts
    /// twice that; 1 to 2 suit windows of a few frames
    #[arg(long, value_name = "S", value_parser = part_seconds)]
    split: Option<f64>,
    /// Coder of the Gaussians
    #[arg(long, value_enum, default_value_t = Coder::Rans)]
    coder: Coder,
    #[arg(long, value_name = "DB", value_parser = quality, help = format!(
        "Target PSNR of the coder rans against the field before coding, in dB: 20 to 100, by default {QUALITY_DB}; of a \
         take in every segment"
    ))]
    quality: Option<f64>,
    #[arg(long, value_name = "N", value_parser = joint_rounds, help = format!(
        "Rounds in which the coder rans rounds the numbers of all Gaussians jointly, so that their errors cancel in \
         pictures, by default {JOINT_ROUNDS}; 0 rounds each alone"
    ))]
    joint_rounds: Option<usize>,
    #[command(flatten)]
    backend: BackendOption,
    /// Remove a part; repeatable
    #[arg(long, value_enum, value_name = "PART")]
    drop: Vec<DropPart>,
    /// Refuse a field with rows that need a repair or have to be dropped, and a package below its --quality
    #[arg(long)]
    strict: bool,
    #[command(flatten)]
    json: JsonOption,
    #[command(flatten)]
    sound: AudioOptions,
    #[command(flatten, next_help_heading = "Of the capture, where one is looked at")]
    selection: FrameSelection,
}

/// A ranking, or none in particular.
#[derive(Clone, Copy, Debug)]
struct Rank(Option<Ranking>);

pub(super) fn budget(text: &str) -> Result<NonZeroUsize, String> {
    text.parse().map_err(|_| "not a number of Gaussians, 1 or more".into())
}

fn fragments(text: &str) -> Result<f64, String> {
    let fraction = text.parse().ok().filter(|fraction| (0.01..=1.0).contains(fraction));
    fraction.ok_or_else(|| "a fraction from 0.01 to 1".into())
}

fn rank(text: &str) -> Result<Rank, String> {
    let named = Ranking::ALL.into_iter().find(|ranking| ranking.name() == text);
    match (text, named) {
        ("auto", _) => Ok(Rank(None)),
        (_, Some(ranking)) => Ok(Rank(Some(ranking))),
        _ => Err(format!("choose auto, {}", Ranking::ALL.map(Ranking::name).join(", "))),
    }
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Coder {
    /// Quantisation below visibility, adaptive entropy coder
    Rans,
    /// FP16 and INT8 attributes, motion at 10 bits, zstd
    Fixed,
}

fn quality(text: &str) -> Result<f64, String> {
    let db = text.parse().ok().filter(|db| (20.0..=100.0).contains(db));
    db.ok_or_else(|| "a number of dB from 20 to 100".into())
}

fn joint_rounds(text: &str) -> Result<usize, String> {
    let rounds = text.parse().ok().filter(|rounds| *rounds <= JOINT_ROUNDS_MAX);
    rounds.ok_or_else(|| format!("a number of rounds from 0 to {JOINT_ROUNDS_MAX}"))
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    args.check_effects()?;
    args.sound.check(args.many.list.is_some())?;
    match args.many.list_and_folder() {
        Some((list, folder)) => run_many(args, list, folder),
        None => run_one(args),
    }
}

fn run_one(args: &Args) -> anyhow::Result<()> {
    let start = Instant::now();
    if let Some(sources) = args.take()? {
        let written = write_take(args, &sources)?;
        match args.json.is_given {
            true => println!("{:#}", written.to_json()?),
            false => written.print(start.elapsed().as_secs_f64()),
        }
        return Ok(());
    }
    let written = write_package(args)?;
    if args.json.is_given {
        println!("{:#}", written.to_json()?);
    } else {
        println!("{}", written.scene);
        print_report(&written.report);
        print_sound(written.sound.as_ref());
        println!("{}, written in {:.1} s", written.out.display(), start.elapsed().as_secs_f64());
    }
    Ok(())
}

/// Makes a package of each take of a list, and a playlist of all.
fn run_many(args: &Args, list: &Path, folder: &Path) -> anyhow::Result<()> {
    let list = List::read(list)?;
    let playlist = playlist::from_clips(list.takes.iter().map(|take| format!("{}.aarc", take.name)))?;
    output::make_folder(folder)?;
    let job = TakeCommand {
        command: "package",
        ending: "aarc",
        options: format!("{:?}", args.options()),
        inputs: Vec::new(),
        forget: |_| Ok(()),
        json: args.json.is_given,
    };
    // All shards write the same playlist, in any order.
    output::write(&folder.join(playlist::FILE), &playlist)?;
    takes::run(&list, args.many.shard, folder, &job, &mut |take: &ListedTake, out: &Path| {
        let many = TakeOptions { out: Some(out.into()), ..args.many.clone() };
        let args = Args { scene: Some(take.path.clone()), many, ..args.clone() };
        if let Some(sources) = args.take()? {
            return write_take(&args, &sources)?.to_json();
        }
        write_package(&args)?.to_json()
    })
}

/// A package that was written.
struct WrittenPackage {
    /// The scene and its format.
    scene: String,
    out: PathBuf,
    report: PackageReport,
    sound: Option<SoundReport>,
}

impl WrittenPackage {
    fn to_json(&self) -> anyhow::Result<Value> {
        let mut object = serde_json::to_value(&self.report)?;
        object["out"] = json!(self.out);
        object["audio"] = json!(self.sound);
        Ok(object)
    }
}

impl Args {
    fn scene(&self) -> &Path {
        self.scene.as_deref().expect("there is a scene where there is no list")
    }

    /// Refuses options that would have no effect beside another one.
    fn check_effects(&self) -> Result<(), Fault> {
        let is_fixed = matches!(self.coder, Coder::Fixed);
        let others = [
            (is_fixed && self.quality.is_some(), "--quality", "--coder fixed has one quality"),
            (
                is_fixed && self.joint_rounds.is_some(),
                "--joint-rounds",
                "--coder fixed rounds each number alone",
            ),
        ];
        match others.into_iter().find(|(is_given, ..)| *is_given) {
            Some((_, option, why)) => Err(Fault::Usage(format!("{option}: {why}; leave one of them out"))),
            None => Ok(()),
        }
    }

    /// The segments of a field folder, or of a field to be split; `None` for what becomes an ordinary clip.
    ///
    /// # Errors
    /// [`Fault::Usage`] that names an option which takes do not have; the errors of [`SegmentSources`].
    fn take(&self) -> anyhow::Result<Option<SegmentSources>> {
        let (scene, is_folder) = (self.scene(), FieldFolder::is_one(self.scene()));
        if !is_folder && self.split.is_none() {
            return Ok(None);
        }
        let name = scene.display();
        let others = [
            (is_folder && self.split.is_some(), "--split", "it is a take of segments already"),
            (self.refine.is_some(), "--refine", "a take has the photographs of several fits"),
            (!self.selection.is_default(), "--frames", "a take looks at no photographs"),
        ];
        if let Some((_, option, why)) = others.into_iter().find(|(is_given, ..)| *is_given) {
            bail!(Fault::Usage(format!("{option}: {name}: {why}; leave it out")));
        }
        let Some(unit_s) = self.split else { return Ok(Some(SegmentSources::of_folder(scene)?)) };
        if Scene::is_capture(scene) {
            bail!(Fault::Usage(format!("--split: {name} is a capture; fit a field first, and split that")));
        }
        Ok(Some(SegmentSources::of_scene(Scene::load(scene)?, unit_s, self.strict)?))
    }

    fn settings(&self) -> PackageSettings {
        PackageSettings {
            budget: self.budget.map(NonZeroUsize::get),
            rank: self.rank.0,
            no_floor: self.no_floor,
            fragments: self.fragments,
            recolor: self.recolor,
            coding: match self.coder {
                Coder::Rans => Coding::ToQuality {
                    quality_db: self.quality.unwrap_or(QUALITY_DB),
                    joint_rounds: self.joint_rounds.unwrap_or(JOINT_ROUNDS),
                },
                Coder::Fixed => Coding::Fixed,
            },
            drop: self.drop.clone(),
            strict: self.strict,
        }
    }

    /// Opens the back end.
    ///
    /// # Errors
    /// [`Fault::Usage`] if there is nothing for a device to compute; the errors of [`BackendOption::open`].
    fn open_backend(&self) -> Result<Box<dyn Backend>, Fault> {
        let rounds = matches!(self.coder, Coder::Rans) && self.joint_rounds != Some(0);
        if !(rounds || self.refine.is_some() || Scene::is_capture(self.scene())) {
            return self.backend.unneeded("nothing is fitted, refined or rounded jointly");
        }
        let OpenBackend { backend, choice } = self.backend.open()?;
        if let Some(choice) = choice.filter(|_| backend.device().is_some()) {
            eprintln!("note: {choice}");
        }
        Ok(backend)
    }

    /// The options that apply to every take.
    fn options(&self) -> Args {
        Args { scene: None, many: TakeOptions::default(), json: JsonOption::default(), ..self.clone() }
    }
}

/// Makes and writes a package.
fn write_package(args: &Args) -> anyhow::Result<WrittenPackage> {
    if let Some(out) = &args.many.out {
        output::check(out)?;
    }
    let captured = Captured::open(args)?;
    let mut backend = args.open_backend()?;
    let scene = match &captured {
        Some(captured) if captured.is_scene => {
            Scene::load_with(args.scene(), &captured.fit(args, &mut *backend)?)?
        }
        _ => Scene::load(args.scene())?,
    };
    let out = args.many.out.clone().unwrap_or_else(|| PathBuf::from(format!("{}.aarc", scene.name)));
    output::check(&out)?;
    let of_capture = captured.as_ref().and_then(|captured| captured.sound(&scene, args));
    let of_capture = of_capture.as_ref().map(|(sound, first_s)| (sound, *first_s));
    let soundtrack = args.sound.soundtrack(of_capture, scene.info.duration_s.into())?;
    let settings = args.settings();
    let progress = StagedProgress::visible();
    let views = match (&captured, args.refine) {
        (Some(captured), Some(_)) => Some(captured.photographs(&scene, args)?),
        _ => None,
    };
    let refinement = views.as_ref().zip(args.refine).map(|(views, steps)| {
        let plate = scene.plate.as_ref().map(|plate| &plate.field).filter(|_| views.are_whole());
        let by_default = || fit::default_fragment_weight(plate.is_some());
        Refinement { views, plate, steps, fragment_weight: args.fragment_weight.unwrap_or_else(by_default) }
    });
    let mut package = package_with(&scene, &settings, refinement.as_ref(), &mut *backend, &progress)?;
    if let Some(miss) = package.report.miss.as_ref().filter(|miss| args.strict && miss.is_below) {
        bail!("{}: {}; --strict refuses it, choose a lower --quality", scene.name, miss.text);
    }
    match &soundtrack {
        Some(soundtrack) => {
            let bytes = soundtrack.put_into(&package.bytes, &out)?;
            package.report.bytes = bytes.len();
            output::write(&out, &bytes)?;
        }
        None => output::write(&out, &package.bytes)?,
    }
    for (part, imported) in [("", Some(&scene.subject)), (" (plate)", scene.plate.as_ref())] {
        for note in imported.iter().flat_map(|imported| imported.account.notes()) {
            eprintln!("note: {}{part}: {note}", scene.name);
        }
    }
    print_blind_viewpoints(&scene);
    Ok(WrittenPackage {
        scene: format!("{}: {}", scene.name, scene.subject.format),
        out,
        report: package.report,
        sound: soundtrack.map(|soundtrack| soundtrack.report().clone()),
    })
}

/// Makes and writes a take.
fn write_take(args: &Args, sources: &SegmentSources) -> anyhow::Result<WrittenTake> {
    let out = args.many.out.clone().unwrap_or_else(|| PathBuf::from(format!("{}.aarc", sources.name)));
    output::check(&out)?;
    let soundtrack = args.sound.soundtrack(None, sources.duration_s)?;
    let report =
        package_take(sources, &args.settings(), &mut *args.open_backend()?, soundtrack.as_ref(), &out)?;
    let sound = soundtrack.as_ref().map(Soundtrack::report).cloned();
    Ok(WrittenTake { scene: format!("{}: {}", sources.name, sources.format()), out, report, sound })
}

/// A take that was written.
struct WrittenTake {
    /// The source and its format.
    scene: String,
    out: PathBuf,
    report: TakeReport,
    sound: Option<SoundReport>,
}

impl WrittenTake {
    fn to_json(&self) -> anyhow::Result<Value> {
        let mut object = serde_json::to_value(&self.report)?;
        object["out"] = json!(self.out);
        object["audio"] = json!(self.sound);
        Ok(object)
    }

    /// Prints the report on a take that took so many seconds to make.
    fn print(&self, seconds: f64) {
        let report = &self.report;
        println!("{}", self.scene);
        println!("{:16} {} in, {} out", "Gaussians", report.gaussians_in, report.gaussians_out);
        print_reasons("  dropped", &report.dropped);
        print_reasons("  repaired", &report.repaired);
        println!("{:16} {} at the fullest instant", "resident", report.resident_max);
        for tried in &report.tried {
            let mark = if tried.chosen { '*' } else { ' ' };
            println!("{:16} {mark} {:20} {:.2} dB", "ranking", tried.ranking, tried.psnr_db);
        }
        println!(
            "{:>16} {:>10} {:>6} {:>10} {:>10} {:>8} {:>8}",
            "from, s", "to, s", "level", "Gaussians", "bytes", "dB", "recall"
        );
        for SegmentReport { start_s, level, package, .. } in &report.segments {
            println!(
                "{start_s:>16.3} {:>10.3} {level:>6} {:>10} {:>10} {:>8.2} {:>8.3}",
                start_s + f64::from(package.duration_s),
                package.subject.gaussians_out,
                package.bytes,
                package.self_psnr_db,
                package.topology.recall
            );
        }
        for (i, segment) in report.segments.iter().enumerate() {
            if let Some(miss) = &segment.package.miss {
                println!("{:16} segment {i}: {}", "quality", miss.text);
            }
        }
        for [from, to] in &report.gaps {
            println!("{:16} from {from:.3} to {to:.3} s", "nothing is shown");
        }
        println!(
            "{:16} {:.1} dB in the worst segment, number {}, {:.1} dB in the median one, by coder {}",
            "self PSNR", report.self_psnr_db, report.worst_segment, report.median_psnr_db, report.coder
        );
        let mbps = report.bytes as f64 * 8e-6 / report.duration_s;
        let per_gaussian = report.bytes as f64 / report.gaussians_out as f64;
        println!(
            "{:16} {}, {:.3} times those of its segments, {per_gaussian:.1} per Gaussian, {mbps:.1} Mbps over {} s",
            "bytes",
            report.bytes,
            report.bytes as f64 / report.segment_bytes as f64,
            decimal(report.duration_s, 3)
        );
        print_sound(self.sound.as_ref());
        println!("{}, written in {seconds:.1} s", self.out.display());
    }
}

/// The sound, and what was done to it.
fn print_sound(sound: Option<&SoundReport>) {
    let Some(sound) = sound else { return };
    println!("{:16} {}", "sound", sound.describe());
    sound.notes.iter().for_each(|note| println!("{:16} {note}", ""));
}

/// The capture that a field is fitted to or refined on.
struct Captured {
    folder: PathBuf,
    capture_files: CaptureFiles,
    /// Whether the scene has no field, so that one is fitted first.
    is_scene: bool,
    /// What this fit makes of the background.
    plate: PlatePlan,
}

impl Captured {
    /// Opens the capture that the arguments need, if any.
    fn open(args: &Args) -> anyhow::Result<Option<Captured>> {
        let is_scene = Scene::is_capture(args.scene());
        let folder = match (&args.capture, args.refine) {
            (Some(_), _) if is_scene => {
                bail!(Fault::Usage(format!("--capture: {} is a capture itself; leave --capture out", args.scene().display())))
            }
            (Some(folder), _) => folder.as_path(),
            (None, Some(_)) if !args.scene().is_dir() => bail!(Fault::Usage(
                "--refine takes the photographs that the field was fitted to; name their folder with --capture"
                    .into()
            )),
            (None, None) if !is_scene => {
                if !args.selection.is_default() {
                    bail!(Fault::Usage(
                        "--frames, --size, --cameras, --held-cameras and --holdout select photographs, which a field \
                         needs for --refine only; add --refine, or leave them out"
                            .into()
                    ));
                }
                return Ok(None);
            }
            (None, _) => args.scene(),
        };
        let mut capture_files = args.selection.open(folder)?;
        let plate = match is_scene {
            true => PlateWhen::Auto.find(&mut capture_files, args.selection.holdout_of_fit())?,
            false => PlatePlan::None,
        };
        let captured = Captured { folder: folder.to_owned(), capture_files, is_scene, plate };
        // With a list, records decide what is resumed and what is replaced.
        if is_scene && args.many.list.is_none() {
            let field = field_path(args);
            if field.exists() {
                bail!(already_exists(&field));
            }
            fit::check_checkpoint(&captured.plan(args)?, &field)?;
        }
        Ok(Some(captured))
    }

    /// The plan of the fit of a capture.
    fn plan(&self, args: &Args) -> Result<FitPlan, Fault> {
        let plan = FitPlan::default_for(&self.capture_files, args.selection.holdout_of_fit(), self.plate)?;
        Ok(plan.with_coarse_steps(&self.capture_files))
    }

    /// Fits a field to the capture, to a file beside the package; with a list, unless that is done.
    fn fit(&self, args: &Args, backend: &mut dyn Backend) -> anyhow::Result<PathBuf> {
        let out = field_path(args);
        let plan = self.plan(args)?;
        if args.many.list.is_none() {
            self.fit_to(&out, &plan, backend)?;
            return Ok(out);
        }
        let key = key(FIELD_OF_PACKAGE, &format!("{plan:?}"), &[args.scene()])?;
        match Record::state(&out, FIELD_OF_PACKAGE, &key)? {
            OutputState::Done => return Ok(out),
            OutputState::Begun => {}
            OutputState::Stale => fit::remove_checkpoint(&out)?,
            OutputState::Unknown if out.exists() => bail!(already_exists(&out)),
            OutputState::Unknown => {}
        }
        Record::begin(&out, FIELD_OF_PACKAGE, &key)?;
        self.fit_to(&out, &plan, backend)?;
        Record::complete(&out, FIELD_OF_PACKAGE, &key, Value::Null)?;
        Ok(out)
    }

    fn fit_to(&self, out: &Path, plan: &FitPlan, backend: &mut dyn Backend) -> anyhow::Result<()> {
        note_assumed_fps(&self.capture_files, "duration_s and fps in scene.json state others");
        super::fit::by_default(&self.capture_files, plan, backend, out)
    }

    /// The sound of the capture, and the second of the capture at which `scene` begins.
    fn sound(&self, scene: &Scene, args: &Args) -> Option<(CaptureSound, f64)> {
        let sound = self.capture_files.sound.clone()?;
        let path = if self.is_scene { field_path(args) } else { args.scene().to_owned() };
        let fitted = FitSource::of_scene(&path, scene).record.frames.clone();
        // --frames selects the frames of the field: its first frame is the first one selected.
        let first = fitted.filter(|_| args.selection.is_whole()).map_or(0, |frames| frames.start);
        Some((sound, self.capture_files.second_of(first)))
    }

    /// The photographs for the refinement of `scene`.
    fn photographs(&self, scene: &Scene, args: &Args) -> anyhow::Result<TrainingViews> {
        // The cameras that a fit learned are beside its field.
        let path = if self.is_scene { field_path(args) } else { args.scene().to_owned() };
        args.selection.photographs_of(&self.folder, &path, scene)
    }
}

/// Path of the field of a capture.
fn field_path(args: &Args) -> PathBuf {
    match &args.many.out {
        Some(out) => out.with_extension("ply"),
        None => PathBuf::from(format!("{}.ply", super::fit::name_of(args.scene()))),
    }
}

fn already_exists(field: &Path) -> Fault {
    let field = field.display();
    Fault::Usage(format!("{field} is there already; package that, or remove it to fit anew"))
}

/// Says which viewpoints show next to nothing.
fn print_blind_viewpoints(scene: &Scene) {
    let blind = blind_viewpoints(scene);
    if !blind.is_empty() {
        eprintln!(
            "note: {}: next to nothing is seen from the viewpoint{} \"{}\"; scene.json can place {} elsewhere",
            scene.name,
            if blind.len() == 1 { "" } else { "s" },
            blind.join("\", \""),
            if blind.len() == 1 { "it" } else { "them" }
        );
    }
}

fn print_report(report: &PackageReport) {
    print_counts("Gaussians", &report.subject);
    if let Some(plate) = &report.plate {
        print_counts("plate", plate);
    }
    print_reasons("parts removed", &report.parts_removed);
    if !report.assumed.is_empty() {
        println!("{:16} {}; scene.json can say otherwise", "assumed", report.assumed.join(", "));
    }
    let layers: Vec<String> = report.layers.iter().map(usize::to_string).collect();
    println!("{:16} {}, most important first by {}", "layers", layers.join(", "), report.layer_ranking);
    print_choice(report);
    if report.unseen > 0 {
        println!(
            "{:16} {} of all Gaussians show from nowhere people stand, but for rims: they are kept, coded coarsely; --drop unseen leaves them out",
            "unseen", report.unseen
        );
    }
    print_lens_fragments(report);
    print_refined(report);
    print_snapped(report.snapped);
    let mbps = report.bytes as f64 * 8e-6 / f64::from(report.duration_s);
    let per_gaussian = report.bytes as f64 / report.subject.gaussians_out as f64;
    println!(
        "{:16} {}, {per_gaussian:.1} per Gaussian, {mbps:.1} Mbps over {} s",
        "bytes",
        report.bytes,
        decimal(f64::from(report.duration_s), 3)
    );
    print_fidelity(report);
}

/// What the package costs a headset.
fn print_lens_fragments(report: &PackageReport) {
    let count =
        |count: &LensFragments| format!("{} {:.1} of {:.1}", count.standpoint, count.after, count.before);
    let counts: Vec<String> = report.lens_fragments.iter().map(count).collect();
    println!("{:16} {} per pixel of a Quest 3", "fragments", counts.join(", "));
}

/// How close the package comes to the field before coding.
fn print_fidelity(report: &PackageReport) {
    println!(
        "{:16} {:.1} dB against the field before coding, {:.1} dB where it covers a view, by coder {}",
        "self PSNR", report.self_psnr_db, report.covered_psnr_db, report.coder
    );
    if let Some(worst) = &report.worst_view {
        let [x, y, z] = worst.position;
        println!(
            "{:16} {:.1} dB, from ({x:.2}, {y:.2}, {z:.2}) at {:.2} s",
            "worst view", worst.psnr_db, worst.time_s
        );
    }
    if let Some(alone) = report.bytes_alone {
        let saved = 100.0 * (1.0 - report.bytes as f64 / alone as f64);
        println!("{:16} {saved:.1} % of {alone} bytes saved", "joint rounding");
    }
    let views =
        [(report.steering_views, "steer"), (report.rounding_views, "round"), (report.judging_views, "judge")];
    let views: Vec<String> = views
        .into_iter()
        .filter(|(count, _)| *count > 0)
        .map(|(count, what)| format!("{count} {what}"))
        .collect();
    println!("{:16} {}, none in common", "views", views.join(", "));
    if let Some(miss) = &report.miss {
        println!("{:16} {}", "quality", miss.text);
    }
}

/// What was tried for the budget, and what it cost.
fn print_choice(report: &PackageReport) {
    let Some(psnr) = report.whole_psnr_db else { return };
    if !report.tried.is_empty() {
        println!(
            "{:22} {:>8} {:>7} {:>10} {:>10} {:>7} {:>9}",
            "tried", "dB", "recall", "precision", "preserved", "drift", "restored"
        );
    }
    for tried in &report.tried {
        let topology = tried.topology;
        let mark = if tried.chosen { '*' } else { ' ' };
        println!(
            "{mark} {:20} {:>8.2} {:>7.3} {:>10.3} {:>10.3} {:>7.4} {:>9}",
            format!("{}{}", tried.ranking, if tried.floor { " + floor" } else { "" }),
            tried.psnr_db,
            topology.recall,
            topology.precision,
            topology.preserved,
            topology.saddle_drift,
            tried.restored
        );
    }
    if let Some(why) = &report.why {
        println!("{:16} {why}", "chosen");
    }
    print_orders(report);
    match report.recolor_gain_db {
        Some(gain) => {
            println!("{:16} {gain:+.2} dB{}", "recolored", if gain > 0.0 { "" } else { ", not used" });
        }
        None if psnr < RECOLOR_BELOW_DB && report.refined.is_none() => {
            println!("{:16} not asked for; --recolor helps at this fidelity", "recolored");
        }
        None => {}
    }
    println!("{:16} {psnr:.2} dB against the whole field, in further views", "fidelity");
}

/// The orders that were tried for the layers, by the fidelity of the first layers.
fn print_orders(report: &PackageReport) {
    if report.tried_orders.is_empty() {
        return;
    }
    let ends = report.layers.iter().map(|end| format!(" {end:>8}"));
    println!("{:22}{}", "order, dB in the first", ends.take(report.layers.len() - 1).collect::<String>());
    for order in &report.tried_orders {
        let mark = if order.chosen { '*' } else { ' ' };
        let psnrs: String = order.prefix_psnr_db.iter().map(|psnr_db| format!(" {psnr_db:>8.2}")).collect();
        println!("{mark} {:20}{psnrs}", order.ranking);
    }
}

/// What moving towards the photographs did.
fn print_refined(report: &PackageReport) {
    let Some(RefinementReport { steps, photographs, held_before_db, held_after_db, non_finite }) =
        report.refined
    else {
        return;
    };
    print!("{:16} {steps} steps towards {photographs} photographs", "refined");
    if let (Some(before), Some(after)) = (held_before_db, held_after_db) {
        print!("; the subject in a few held ones {before:.2} dB before, {after:.2} dB after");
    }
    println!();
    if non_finite > 0 {
        println!("{:16} {non_finite} gradients that were not finite", "left out");
    }
}

/// What no longer changes in the package.
fn print_snapped(Snapped { made_static, made_motionless }: Snapped) {
    if made_static + made_motionless > 0 {
        println!("{:16} {made_static} made static, {made_motionless} made motionless", "snapped");
    }
}

fn print_counts(what: &str, counts: &Counts) {
    println!("{what:16} {} in, {} out", counts.gaussians_in, counts.gaussians_out);
    print_reasons("  dropped", &counts.dropped);
    print_reasons("  repaired", &counts.repaired);
}

fn print_reasons(what: &str, reasons: &BTreeMap<&str, usize>) {
    if !reasons.is_empty() {
        let reasons: Vec<String> = reasons.iter().map(|(reason, rows)| format!("{rows} {reason}")).collect();
        println!("{what:16} {}", reasons.join(", "));
    }
}
