//! Measures other players and coders, interleaved with this project's, on the same fields, cameras, times and
//! image sizes. `README.md` describes the comparison.

mod coding;
mod median_range;
mod native;
mod player;
mod playing;
mod report;
mod workload;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use clap::{Parser, Subcommand};
use indicatif::{ProgressBar, ProgressStyle};
use program::Fault;
use studio::machine::machine;

use coding::ComparedField;
use player::{PlayerKind, WebGl, web_folder};
use report::PeerReport;
use workload::Workload;

/// Clip time of the frozen instant.
const INSTANT: f64 = 0.5;

/// Frames per round.
const FRAMES: usize = 12;

/// Rounds of playing and decoding: enough for a median with a minimum and a maximum.
const ROUNDS: usize = 5;

/// Size of the images.
const SIZE: [u32; 2] = [640, 480];

/// Players of dynamic fields.
const DYNAMIC: [PlayerKind; 4] =
    [PlayerKind::Ours, PlayerKind::OursSqrt8, PlayerKind::Gsplat, PlayerKind::GsplatMended];

/// Players of static fields; ours plays the clip at one instant.
const FROZEN: [PlayerKind; 4] =
    [PlayerKind::Ours, PlayerKind::OursSqrt8, PlayerKind::Viewer, PlayerKind::Spark];

/// Measures other players and coders, interleaved with this project's.
#[derive(Parser)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
struct Cli {
    #[command(subcommand)]
    command: Option<PeerCommand>,
    #[command(flatten)]
    measure: Option<MeasureArgs>,
}

#[derive(clap::Args)]
struct MeasureArgs {
    /// Fitted field file, folder holding one, or package
    input: PathBuf,
    /// Folder for the tables, the images, and the played and coded files
    #[arg(short, long, value_name = "DIR")]
    out: PathBuf,
    /// Use only the N Gaussians that contribute most to images
    #[arg(long, value_name = "N")]
    budget: Option<usize>,
    /// WebGL driver
    #[arg(long, value_enum, default_value_t)]
    webgl: WebGl,
}

#[derive(Subcommand)]
enum PeerCommand {
    /// Runs one player; started by a measurement
    #[command(hide = true)]
    Play { kind: PlayerKind, folder: PathBuf },
}

fn main() -> ExitCode {
    let start = Instant::now();
    let result = match Cli::parse() {
        Cli { command: Some(PeerCommand::Play { kind, folder }), .. } => native::answer(kind, &folder, start),
        Cli { measure: Some(measure), .. } => run(&measure),
        Cli { command: None, measure: None } => unreachable!("one of both is required"),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::from(error.downcast_ref::<Fault>().map_or(1, Fault::exit_code))
        }
    }
}

fn run(args: &MeasureArgs) -> anyhow::Result<()> {
    let modules = web_folder().with_file_name("node_modules");
    if !modules.is_dir() {
        let folder = modules.with_file_name("").display().to_string();
        return Err(Fault::Device(format!("the peers of npm are missing: run `npm ci` in {folder}")).into());
    }
    let progress = ProgressBar::new_spinner();
    progress.set_style(ProgressStyle::with_template("{elapsed_precise} {msg}")?);
    progress.enable_steady_tick(Duration::from_secs(1));

    let compared = ComparedField::load(&args.input, args.budget, &progress)?;
    let ComparedField { name, info, field: _, package, clip } = &compared;
    let viewpoint = &info.viewpoints[0];
    let dynamic = Workload::swinging(viewpoint, info, SIZE, FRAMES, |part| part);
    let frozen = Workload::swinging(viewpoint, info, SIZE, FRAMES, |_| INSTANT);
    let played = clip.merged();
    let splatv = formats::write_splatv(&played, info);
    let ply = formats::write_static_ply(&formats::frozen(&played, INSTANT), None);
    let coded = created(&args.out.join("coding"))?;
    let [dynamic_folder, frozen_folder] = [("moving", &dynamic), ("frozen", &frozen)].map(|(name, work)| {
        let folder = created(&args.out.join(name))?;
        fs::write(folder.join(PlayerKind::Ours.field()), package)?;
        work.write(&folder)?;
        anyhow::Ok(folder)
    });
    let (dynamic_folder, frozen_folder) = (dynamic_folder?, frozen_folder?);
    fs::write(dynamic_folder.join(PlayerKind::Gsplat.field()), &splatv)?;
    fs::write(frozen_folder.join(PlayerKind::Viewer.field()), ply)?;

    let options = (ROUNDS, args.webgl);
    let report = PeerReport {
        name: name.clone(),
        gaussians: clip.len(),
        package_bytes: package.len(),
        splatv_bytes: splatv.len(),
        machine: machine(),
        size: SIZE,
        frames: FRAMES,
        rounds: ROUNDS,
        dynamic: playing::compare(&DYNAMIC, (clip, &dynamic), &dynamic_folder, options, &progress)?,
        frozen: playing::compare(&FROZEN, (clip, &frozen), &frozen_folder, options, &progress)?,
        coding: coding::compare(&compared, INSTANT, &coded, ROUNDS, &progress)?,
    };
    progress.finish_and_clear();
    fs::write(args.out.join("peers.json"), serde_json::to_vec_pretty(&report)?)?;
    fs::write(args.out.join("peers.md"), report.text())?;
    print!("{}", report.text());
    Ok(())
}

/// Creates the folder if it is missing, and returns its absolute path.
fn created(folder: &Path) -> anyhow::Result<PathBuf> {
    let fault = |error: std::io::Error| Fault::Data(format!("{}: {error}", folder.display()));
    fs::create_dir_all(folder).map_err(fault)?;
    Ok(folder.canonicalize().map_err(fault)?)
}
