//! `cargo xtask package`: a fitted field, or a capture, becomes a package.

use std::collections::BTreeMap;
use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::time::Instant;

use anyhow::bail;
use clap::ValueEnum;
use indicatif::{ProgressBar, ProgressStyle};
use refine::prune::Ranking;
use serde_json::json;
use xtask::fault::Fault;
use xtask::output;
use xtask::package::{Coding, Counts, Part, QUALITY_DB, Report, Rung, Settings, ladder, package_showing};
use xtask::scene::Scene;

use super::fit;

/// Most that a part of a package may be worse than a package of its size, in dB.
const LADDER_LOSS_DB: f64 = 0.5;

/// Fidelity below which fitting colours anew is worth a hint, in dB: what is left out shows.
const REFIT_BELOW_DB: f64 = 40.0;

/// What `--help` says of scenes, at its end.
const SCENE_HELP: &str = r#"A scene folder may hold scene.json, every key optional, in the axes and units of the field:
  {"duration_s": 1.32, "fps": 25, "up": [0, -1, 0], "metres_per_unit": 1, "viewpoints": [
    {"name": "front", "position": [0, 0, -3], "target": [0, 0, 0], "fov_y_deg": 50}]}"#;

/// Make a package from a fitted field, or from a capture that it fits one to first.
#[derive(clap::Args)]
#[command(after_help = SCENE_HELP)]
pub(crate) struct Args {
    /// Fitted field file, or a folder holding one, perhaps with plate.ply and scene.json; or a capture,
    /// to which a field is fitted first, beside the package, as `fit` does by default
    scene: PathBuf,
    /// Package to write; SCENE's name with .aarc in the current folder by default
    #[arg(short, long, value_name = "PATH")]
    out: Option<PathBuf>,
    /// Most Gaussians to keep; all that can be seen by default
    #[arg(long, value_name = "N")]
    budget: Option<NonZeroUsize>,
    /// What decides which Gaussians a budget keeps: auto tries all rankings, with and without the
    /// topology floor, and takes the one whose package looks most like the whole field
    #[arg(long, value_name = "auto|NAME", default_value = "auto", value_parser = rank)]
    rank: Rank,
    /// Let the ranking alone decide, though limbs break off
    #[arg(long)]
    no_floor: bool,
    /// Fit the colours of what a budget keeps to pictures of the whole field
    #[arg(long, requires = "budget")]
    refit: bool,
    /// How the Gaussians are coded
    #[arg(long, value_enum, default_value_t = Coder::Context)]
    coder: Coder,
    /// PSNR that the coder context is to reach, in dB, against the field before coding: 20 to 100
    #[arg(long, value_name = "DB", default_value_t = QUALITY_DB, value_parser = quality)]
    quality: f64,
    /// Remove a part; may be given several times
    #[arg(long, value_enum, value_name = "PART")]
    drop: Vec<Part>,
    /// Refuse a field of which a row needs a repair or has to be left out
    #[arg(long)]
    strict: bool,
    /// Then check that each first part of the package is as good as a package of its size
    #[arg(long)]
    ladder: bool,
    /// Print the report as JSON
    #[arg(long)]
    json: bool,
}

/// A ranking, or none in particular.
#[derive(Clone, Copy)]
struct Rank(Option<Ranking>);

fn rank(text: &str) -> Result<Rank, String> {
    let named = Ranking::ALL.into_iter().find(|ranking| ranking.name() == text);
    match (text, named) {
        ("auto", _) => Ok(Rank(None)),
        (_, Some(ranking)) => Ok(Rank(Some(ranking))),
        _ => Err(format!("choose auto, {}", Ranking::ALL.map(Ranking::name).join(", "))),
    }
}

#[derive(Clone, Copy, ValueEnum)]
enum Coder {
    /// As coarsely as nobody sees, and an adaptive range coder
    Context,
    /// FP16 and INT8 attributes, motion at 10 bits, zstd
    Fixed,
}

fn quality(text: &str) -> Result<f64, String> {
    let db = text.parse().ok().filter(|db| (20.0..=100.0).contains(db));
    db.ok_or_else(|| "a number of dB from 20 to 100".into())
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let start = Instant::now();
    if let Some(out) = &args.out {
        output::check(out)?;
    }
    let scene = match Scene::is_capture(&args.scene) {
        true => Scene::load_with(&args.scene, &fit_first(args)?)?,
        false => Scene::load(&args.scene)?,
    };
    let out = args.out.clone().unwrap_or_else(|| PathBuf::from(format!("{}.aarc", scene.name)));
    output::check(&out)?;
    let settings = Settings {
        budget: args.budget.map(NonZeroUsize::get),
        rank: args.rank.0,
        no_floor: args.no_floor,
        refit: args.refit,
        coding: match args.coder {
            Coder::Context => Coding::Context { quality_db: args.quality },
            Coder::Fixed => Coding::Fixed,
        },
        drop: args.drop.clone(),
        strict: args.strict,
    };
    // Drawn on a terminal's standard error only.
    let style = ProgressStyle::with_template("{bar:30} {percent:>3} %  {eta} left  {prefix}{msg}")?;
    let progress = ProgressBar::new(1).with_style(style);
    let package = package_showing(&scene, &settings, &progress)?;
    progress.finish_and_clear();
    output::write(&out, &package.bytes)?;
    let rungs = match args.ladder {
        true => Some(ladder(&scene, &settings, &package, &progress)?),
        false => None,
    };
    let report = package.report;
    if args.json {
        let mut object = serde_json::to_value(&report)?;
        object["out"] = json!(out);
        if let Some(rungs) = &rungs {
            object["ladder"] = json!(rungs);
        }
        println!("{object:#}");
    } else {
        println!("{}: {}", scene.name, scene.subject.format);
        print_report(&report);
        print_ladder(rungs.as_deref().unwrap_or_default());
        println!("{}, written in {:.1} s", out.display(), start.elapsed().as_secs_f64());
    }
    let mut failed = rungs.iter().flatten().filter(|rung| rung.loss_db > LADDER_LOSS_DB);
    match failed.next() {
        None => Ok(()),
        Some(Rung { gaussians, loss_db, .. }) => bail!(
            "the first {gaussians} Gaussians are {loss_db:.2} dB worse than a package of as many; \
             {LADDER_LOSS_DB} dB are allowed"
        ),
    }
}

/// Fits the capture that stands where a field should, to a field file beside the package.
fn fit_first(args: &Args) -> anyhow::Result<PathBuf> {
    let field = match &args.out {
        Some(out) => out.with_extension("ply"),
        None => PathBuf::from(format!("{}.ply", fit::name_of(&args.scene))),
    };
    if field.exists() {
        let field = field.display();
        bail!(Fault::Usage(format!("{field} is there already: package that, or remove it to fit anew")));
    }
    fit::by_default(&args.scene, &field)?;
    Ok(field)
}

fn print_report(report: &Report) {
    print_counts("Gaussians", &report.subject);
    if let Some(plate) = &report.plate {
        print_counts("plate", plate);
    }
    print_reasons("parts removed", &report.parts_removed);
    if !report.assumed.is_empty() {
        println!("{:16} {}; scene.json can say otherwise", "assumed", report.assumed.join(", "));
    }
    let layers: Vec<String> = report.layers.iter().map(usize::to_string).collect();
    println!("{:16} {}, most important first by {}", "layers", layers.join(", "), report.ranking);
    print_choice(report);
    let mbps = report.bytes as f64 * 8e-6 / f64::from(report.duration_s);
    let per_gaussian = report.bytes as f64 / report.subject.gaussians_out as f64;
    println!(
        "{:16} {}, {per_gaussian:.1} per Gaussian, {mbps:.1} Mbps over {} s",
        "bytes", report.bytes, report.duration_s
    );
    println!(
        "{:16} {:.1} dB against the field before coding, by coder {}",
        "self PSNR", report.self_psnr_db, report.coder
    );
}

/// How good the first layers are beside packages of their size.
fn print_ladder(rungs: &[Rung]) {
    if !rungs.is_empty() {
        println!("{:16} {:>9} {:>8} {:>13} {:>8} {:>8}", "ladder", "bytes", "dB", "own bytes", "dB", "loss");
    }
    for rung in rungs {
        println!(
            "{:16} {:>9} {:>8.2} {:>13} {:>8.2} {:>8.2}",
            format!("  {}", rung.gaussians),
            rung.prefix_bytes,
            rung.prefix_psnr_db,
            rung.own_bytes,
            rung.own_psnr_db,
            rung.loss_db
        );
    }
}

/// What was tried for the budget, and what it cost.
fn print_choice(report: &Report) {
    let Some(psnr) = report.whole_psnr_db else { return };
    println!(
        "{:22} {:>8} {:>7} {:>10} {:>7} {:>9}",
        "tried", "dB", "recall", "precision", "drift", "restored"
    );
    for tried in &report.tried {
        let topology = tried.topology;
        let mark = if tried.chosen { '*' } else { ' ' };
        println!(
            "{mark} {:20} {:>8.2} {:>7.3} {:>10.3} {:>7.4} {:>9}",
            format!("{}{}", tried.ranking, if tried.floor { " + floor" } else { "" }),
            tried.psnr_db,
            topology.recall,
            topology.precision,
            topology.saddle_drift,
            tried.restored
        );
    }
    if let Some(why) = &report.why {
        println!("{:16} {why}", "chosen");
    }
    match report.refit_gain_db {
        Some(gain) => {
            println!("{:16} {gain:+.2} dB{}", "colour refit", if gain > 0.0 { "" } else { ", not used" });
        }
        None if psnr < REFIT_BELOW_DB => {
            println!("{:16} not asked for; --refit helps where so much is left out", "colour refit");
        }
        None => {}
    }
    println!("{:16} {psnr:.2} dB against the whole field", "fidelity");
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
