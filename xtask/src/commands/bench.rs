//! `cargo xtask bench`: the benches as one table, then counts.
//!
//! Times depend on the machine, which the header names. Counts do not. They are of the real clip if its
//! data is beside the repository, else of the demo clip.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::process::Stdio;

use anyhow::{Context, bail};
use codec::{Clip, Limits};
use refine::prune::Ranking;
use refine::reference::{Radius, RenderScene as Drawing, coverage};
use serde::Deserialize;
use serde_json::Value;
use studio::machine::machine;
use studio::package::{Package, Settings, package};
use studio::scene::Scene;
use studio::synth::juggler;
use xtask::workspace;

/// The real clip, relative to the root of the repository.
const REAL_CLIP: &str = "../shared/data/spacetime-spinach/spinach_4.splatv";

/// Gaussians that are kept of the real clip.
const BUDGET: usize = 40_000;

/// Width and height of the counted frames in pixels.
const SIZE: u32 = 1024;

/// Clip times of the counted frames.
const TIMES: [f64; 5] = [0.1, 0.3, 0.5, 0.7, 0.9];

/// Half the side of the quads that other players commonly draw, in standard deviations.
const FIXED_RADIUS: f64 = 2.0 * std::f64::consts::SQRT_2;

/// The player's benches need no window, the slowest part of the build.
const WITHOUT_WINDOW: &str = "--no-default-features";

/// Run the benches and print one table, then machine-independent counts
#[derive(clap::Args)]
pub(crate) struct Args {}

pub(crate) fn run(_args: &Args) -> anyhow::Result<()> {
    let folder = tempfile::tempdir()?;
    // A fresh folder, so that it holds no results of earlier runs.
    let results = folder.path().join("criterion");
    run_benches(&results)?;
    let benches = read_results(&results)?;
    let (name, clip) = subject()?;
    let path = folder.path().join("clip.aarc");
    fs::write(&path, &clip.bytes)?;
    let played = play(&path, &clip, folder.path());

    println!("machine  {}", machine());
    match &played {
        Ok(stats) => println!("adapter  {}, {}", text(&stats["adapter"]), text(&stats["driver"])),
        Err(error) => println!("adapter  none: {error:#}"),
    }
    println!("\n{:<40}{:>12}{:>12}{:>16}", "bench", "median", "spread", "throughput");
    for bench in &benches {
        println!("{}", bench.row());
    }
    println!();
    print_counts(&name, &clip, played.as_ref().ok())
}

/// A bench and its result.
struct Bench {
    id: Id,
    estimates: Estimates,
}

/// The fields of Criterion's `benchmark.json` that are used.
#[derive(Deserialize)]
struct Id {
    full_id: String,
    throughput: Option<Value>,
}

/// The fields of Criterion's `estimates.json` that are used, in nanoseconds per iteration.
#[derive(Deserialize)]
struct Estimates {
    median: Estimate,
    median_abs_dev: Estimate,
}

#[derive(Deserialize)]
struct Estimate {
    point_estimate: f64,
}

/// Runs the benches of all packages that have some, with results in the folder `results`.
fn run_benches(results: &Path) -> anyhow::Result<()> {
    let status = workspace::cargo()
        .args(["bench", "--package", "codec", "--package", "refine", "--package", "client", "--bench", "*"])
        .arg(WITHOUT_WINDOW)
        .env("CRITERION_HOME", results)
        .stdin(Stdio::null())
        .stdout(io::stderr())
        .status()
        .context("cannot run cargo")?;
    if !status.success() {
        bail!("the benches failed; their messages are above");
    }
    Ok(())
}

/// Reads Criterion's results in `results` and its subfolders, sorted by name of the bench.
fn read_results(results: &Path) -> anyhow::Result<Vec<Bench>> {
    let mut benches = Vec::new();
    let mut folders = vec![results.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).context("the benches left no results")? {
            folders.extend(Some(entry?.path()).filter(|path| path.is_dir()));
        }
        if folder.ends_with("new") && folder.join("benchmark.json").is_file() {
            let read = |name: &str| fs::read(folder.join(name));
            let id = serde_json::from_slice(&read("benchmark.json")?)?;
            let estimates = serde_json::from_slice(&read("estimates.json")?)?;
            benches.push(Bench { id, estimates });
        }
    }
    benches.sort_by(|a, b| a.id.full_id.cmp(&b.id.full_id));
    Ok(benches)
}

impl Bench {
    /// Row of the table.
    fn row(&self) -> String {
        let median = self.estimates.median.point_estimate;
        let spread = self.estimates.median_abs_dev.point_estimate;
        let throughput =
            self.bytes().map_or_else(String::new, |bytes| format!("{:.1} MB/s", bytes * 1e3 / median));
        let (median, spread) = (duration(median), format!("+-{}", duration(spread)));
        format!("{:<40}{median:>12}{spread:>12}{throughput:>16}", self.id.full_id)
    }

    /// Bytes per iteration, if the bench declares them.
    fn bytes(&self) -> Option<f64> {
        let throughput = self.id.throughput.as_ref()?;
        [&throughput["Bytes"], &throughput["ElementsAndBytes"]["bytes"]].into_iter().find_map(Value::as_f64)
    }
}

/// Formats nanoseconds in a readable unit.
fn duration(ns: f64) -> String {
    match ns {
        ns if ns >= 1e9 => format!("{:.2} s", ns * 1e-9),
        ns if ns >= 1e6 => format!("{:.2} ms", ns * 1e-6),
        ns if ns >= 1e3 => format!("{:.2} us", ns * 1e-3),
        ns => format!("{ns:.1} ns"),
    }
}

/// Name and package of the clip that is counted.
fn subject() -> anyhow::Result<(String, Package)> {
    let path = workspace::root().join(REAL_CLIP);
    let (scene, budget) = if path.exists() {
        (Scene::load(&path)?, Some(BUDGET))
    } else {
        let (field, info) = juggler::clip();
        (Scene::made("demo", field, info), None)
    };
    let package = package(
        &scene,
        &Settings { budget, rank: Some(Ranking::Mass), no_floor: true, ..Settings::default() },
    )?;
    Ok((scene.name, package))
}

/// Renders the counted frames with the player and returns its statistics.
fn play(path: &Path, clip: &Package, folder: &Path) -> anyhow::Result<Value> {
    let duration = f64::from(clip.report.duration_s);
    let times: Vec<String> = TIMES.iter().map(|t| (t * duration).to_string()).collect();
    let stats = folder.join("stats.json");
    let output = workspace::cargo()
        .args(["run", "--quiet", "--release", "--package", "client", WITHOUT_WINDOW, "--"])
        .arg(path)
        .args(["--headless", "--size", &format!("{SIZE}x{SIZE}"), "--time", &times.join(",")])
        .args([PathBuf::from("--out"), folder.join("frames"), PathBuf::from("--stats"), stats.clone()])
        .stdin(Stdio::null())
        .output()
        .context("cannot run cargo")?;
    if !output.status.success() {
        let message = String::from_utf8_lossy(&output.stderr);
        bail!("{}", message.lines().last().unwrap_or("the player failed without a message"));
    }
    Ok(serde_json::from_slice(&fs::read(stats)?)?)
}

/// Prints counts of each frame. `stats` are the player's.
fn print_counts(name: &str, package: &Package, stats: Option<&Value>) -> anyhow::Result<()> {
    let Package { bytes, report } = package;
    let clip: Clip = codec::decode(bytes, &Limits::default())?;
    let n = clip.len();
    let viewpoint = &clip.info.viewpoints[0];
    let per_gaussian = bytes.len() as f64 / n as f64;
    println!(
        "{name}: {n} Gaussians, {} bytes, {per_gaussian:.1} per Gaussian, self PSNR {:.1} dB; \
         \"{}\" at {SIZE}x{SIZE}",
        bytes.len(),
        report.self_psnr_db,
        viewpoint.name,
    );
    println!(
        "fragments in quads that extend to alpha 1/255 (exact), to that but at most 2 sqrt 2 sigma (capped), \
         to 2 sqrt 2 sigma (fixed)"
    );
    println!(
        "{:<8}{:>8}{:>8}{:>8}{:>9}{:>12}{:>12}{:>12}{:>13}{:>14}",
        "time", "alive", "sorted", "drawn", "of N", "exact", "capped", "fixed", "exact/fixed", "capped/fixed"
    );
    let camera = viewpoint.camera(clip.info.up, SIZE, SIZE);
    let drawing = Drawing::from(&clip);
    for (i, &t) in TIMES.iter().enumerate() {
        let [exact, capped, fixed] =
            [Radius::Exact, Radius::AtMost(FIXED_RADIUS), Radius::Fixed(FIXED_RADIUS)]
                .map(|radius| coverage(&drawing, &camera, t, radius));
        let sorted = stats.map_or_else(|| "-".into(), |stats| stats["frames"][i]["sorted"].to_string());
        let of_fixed = |fragments: u64| fragments as f64 / fixed.fragments as f64;
        println!(
            "{:<8}{:>8}{sorted:>8}{:>8}{:>7.1} %{:>12}{:>12}{:>12}{:>13.3}{:>14.3}",
            format!("{:.2} s", t * f64::from(clip.info.duration_s)),
            exact.alive,
            exact.drawn,
            100.0 * exact.drawn as f64 / n as f64,
            exact.fragments,
            capped.fragments,
            fixed.fragments,
            of_fixed(exact.fragments),
            of_fixed(capped.fragments),
        );
    }
    Ok(())
}

fn text(value: &Value) -> &str {
    value.as_str().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Criterion 0.8's files, without unused fields.
    #[test]
    fn results_become_rows() {
        let results = tempfile::tempdir().unwrap();
        let write = |bench: &str, median: f64, throughput: &str| {
            for version in ["base", "new"] {
                let folder = results.path().join(bench).join(version);
                fs::create_dir_all(&folder).unwrap();
                let name = bench.replace('_', "/");
                let id = format!(
                    r#"{{"group_id": "g", "function_id": null, "throughput": {throughput}, "full_id": "{name}"}}"#
                );
                fs::write(folder.join("benchmark.json"), id).unwrap();
                let estimates = format!(
                    r#"{{"mean": {{"point_estimate": 9.0}}, "median": {{"point_estimate": {median:?}}},
                        "median_abs_dev": {{"point_estimate": 25000.0}}}}"#
                );
                fs::write(folder.join("estimates.json"), estimates).unwrap();
            }
        };
        write("sort_40k", 380_000.0, "null");
        write("codec_sh0/decode", 5e6, r#"{"ElementsAndBytes": {"elements": 40000, "bytes": 1000000}}"#);
        let rows: Vec<String> = read_results(results.path()).unwrap().iter().map(Bench::row).collect();
        let words: Vec<Vec<&str>> = rows.iter().map(|row| row.split_whitespace().collect()).collect();
        assert_eq!(words[0], ["codec/sh0/decode", "5.00", "ms", "+-25.00", "us", "200.0", "MB/s"]);
        assert_eq!(words[1], ["sort/40k", "380.00", "us", "+-25.00", "us"]);
        assert_eq!(rows.len(), 2, "one row per bench, of the last run");
    }

    #[test]
    fn no_results_are_an_error() {
        assert!(
            read_results(Path::new("no such folder"))
                .is_err_and(|error| error.to_string().contains("no results"))
        );
    }
}
