//! `cargo xtask bench`: the benches as one table, then counts; or the bench of a fit alone.
//!
//! Times depend on the machine, which the header names. Counts do not. They are of the real clip if its
//! data is beside the repository, else of the demo clip.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context, bail};
use serde::Deserialize;
use serde_json::{Value, json};
use xtask::workspace;

/// The real clip, relative to the root of the repository.
const REAL_CLIP: &str = "../shared/data/spacetime-spinach/spinach_4.splatv";

/// Gaussians kept of it.
const BUDGET: &str = "40000";

/// Size of the counted frames in pixels.
const SIZE: &str = "1024x1024";

/// Clip times of the counted frames.
const TIMES: [f64; 5] = [0.1, 0.3, 0.5, 0.7, 0.9];

/// The player's benches need no window, which takes longer to build than all else.
const WITHOUT_WINDOW: &str = "--no-default-features";

/// Run the benches and print one table, then machine-independent counts
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Measure a part alone: `fit`, a step of a fit on the CPU and on a graphics device
    #[arg(value_enum)]
    part: Option<BenchPart>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum BenchPart {
    /// A step of a fit on the CPU and on a graphics device, for three sizes
    Fit,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    match args.part {
        Some(BenchPart::Fit) => bench_fit(args.json),
        None => bench_all(args.json),
    }
}

/// Runs the bench of a fit, which prints its table or JSON itself.
fn bench_fit(is_json: bool) -> anyhow::Result<()> {
    let mut bench = workspace::cargo();
    bench.args(["bench", "--quiet", "--package", "refine", "--features", "gpu", "--bench", "fit", "--"]);
    let status = bench.args(is_json.then_some("--json")).stdin(Stdio::null()).status();
    if !status.context("cannot run cargo")?.success() {
        bail!("the bench failed; its messages are above");
    }
    Ok(())
}

fn bench_all(is_json: bool) -> anyhow::Result<()> {
    let folder = tempfile::tempdir()?;
    // A fresh folder, so that it holds no results of earlier runs.
    let results = folder.path().join("criterion");
    run_benches(&results)?;
    let benches = read_results(&results)?;
    let clip = package(folder.path())?;
    let counts = render(folder.path(), &clip)?;
    let played = play(folder.path(), &clip);

    if is_json {
        let rows: Vec<Value> = benches.iter().map(Bench::to_json).collect();
        let object = json!({
            "machine": counts["adapter"], "benches": rows, "clip": clip.name, "package": clip.report,
            "reference": counts, "played": played.as_ref().ok(),
        });
        println!("{object:#}");
        return Ok(());
    }
    println!("machine  {}", text(&counts["adapter"]));
    match &played {
        Ok(stats) => println!("adapter  {}, {}", text(&stats["adapter"]), text(&stats["driver"])),
        Err(error) => println!("adapter  none: {error:#}"),
    }
    println!("\n{:<40}{:>12}{:>12}{:>16}", "bench", "median", "spread", "throughput");
    for bench in &benches {
        println!("{}", bench.row());
    }
    println!();
    print_counts(&clip, &counts, played.as_ref().ok());
    Ok(())
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
    fn to_json(&self) -> Value {
        let median = self.estimates.median.point_estimate;
        json!({
            "name": self.id.full_id, "median_ns": median, "spread_ns": self.estimates.median_abs_dev.point_estimate,
            "mb_per_s": self.bytes().map(|bytes| bytes * 1e3 / median),
        })
    }

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

/// The package whose frames are counted.
struct Clip {
    name: &'static str,
    path: PathBuf,
    /// The report of `package --json`.
    report: Value,
}

impl Clip {
    /// The counted instants in seconds, separated by commas.
    fn times(&self) -> String {
        let duration_s = self.report["duration_s"].as_f64().unwrap_or_default();
        TIMES.map(|t| (t * duration_s).to_string()).join(",")
    }
}

/// Packages the real clip, or the demo scene where there is none, into `folder`.
fn package(folder: &Path) -> anyhow::Result<Clip> {
    let path = folder.join("clip.aarc");
    let real = workspace::root().join(REAL_CLIP);
    let (name, field, pruning) = if real.exists() {
        ("spinach", real, Some(["--budget", BUDGET, "--no-floor"]))
    } else {
        let field = folder.join("demo.ply");
        output(workspace::studio("release")?.args(["synth", "clip", "-o"]).arg(&field))?;
        ("demo", field, None)
    };
    let mut package = workspace::studio("release")?;
    package.arg("package").arg(field).args(["--rank", "mass", "--json", "-o"]).arg(&path);
    let report = output(package.args(pruning.into_iter().flatten()))?;
    Ok(Clip { name, path, report: serde_json::from_slice(&report)? })
}

/// Renders the counted frames with the reference renderer and returns its counts.
fn render(folder: &Path, clip: &Clip) -> anyhow::Result<Value> {
    let stats = folder.join("reference.json");
    let mut render = workspace::studio("release")?;
    render.arg("render").arg(&clip.path).args(["--size", SIZE, "--time", &clip.times()]);
    output(render.arg("--out").arg(folder.join("reference")).arg("--stats").arg(&stats))?;
    Ok(serde_json::from_slice(&fs::read(stats)?)?)
}

/// Draws the counted frames with the player and returns its statistics.
fn play(folder: &Path, clip: &Clip) -> anyhow::Result<Value> {
    let stats = folder.join("stats.json");
    let mut cargo = workspace::cargo();
    cargo.args(["run", "--quiet", "--release", "--package", "client", WITHOUT_WINDOW, "--"]);
    cargo.arg(&clip.path).args(["--headless", "--size", SIZE, "--time", &clip.times()]);
    output(cargo.arg("--out").arg(folder.join("frames")).arg("--stats").arg(&stats))?;
    Ok(serde_json::from_slice(&fs::read(stats)?)?)
}

/// Runs a program and returns its standard output.
///
/// # Errors
/// The last line of its standard error where it fails.
fn output(command: &mut Command) -> anyhow::Result<Vec<u8>> {
    let output = command.stdin(Stdio::null()).output().context("cannot run a program")?;
    if !output.status.success() {
        let message = String::from_utf8_lossy(&output.stderr);
        bail!("{}", message.lines().last().unwrap_or("a program failed without a message"));
    }
    Ok(output.stdout)
}

/// Prints the cost of drawing each frame: `counts` by the reference renderer, `stats` by the player.
fn print_counts(clip: &Clip, counts: &Value, stats: Option<&Value>) {
    let number = |value: &Value| value.as_f64().unwrap_or(f64::NAN);
    let n = number(&clip.report["gaussians_out"]);
    println!(
        "{}: {n} Gaussians, {} bytes, {:.1} per Gaussian, self PSNR {:.1} dB; first viewpoint at {SIZE}",
        clip.name,
        clip.report["bytes"],
        number(&clip.report["bytes"]) / n,
        number(&clip.report["self_psnr_db"]),
    );
    println!(
        "fragments in quads that extend to alpha 1/255 (exact), at most to 2 sqrt 2 sigma (capped), always to \
         2 sqrt 2 sigma (fixed)"
    );
    println!(
        "{:<8}{:>8}{:>8}{:>8}{:>9}{:>12}{:>12}{:>12}{:>13}{:>14}",
        "time", "alive", "sorted", "drawn", "of N", "exact", "capped", "fixed", "exact/fixed", "capped/fixed"
    );
    for (i, frame) in counts["frames"].as_array().into_iter().flatten().enumerate() {
        let sorted = stats.map_or_else(|| "-".into(), |stats| stats["frames"][i]["sorted"].to_string());
        let of_fixed = |key: &str| number(&frame[key]) / number(&frame["fragments_fixed"]);
        println!(
            "{:<8}{:>8}{sorted:>8}{:>8}{:>7.1} %{:>12}{:>12}{:>12}{:>13.3}{:>14.3}",
            format!("{:.2} s", number(&frame["time"])),
            frame["alive"].to_string(),
            frame["drawn"].to_string(),
            100.0 * number(&frame["drawn"]) / n,
            frame["fragments"].to_string(),
            frame["fragments_capped"].to_string(),
            frame["fragments_fixed"].to_string(),
            of_fixed("fragments"),
            of_fixed("fragments_capped"),
        );
    }
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
