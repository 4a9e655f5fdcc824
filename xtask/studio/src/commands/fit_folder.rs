//! `cargo xtask fit` into a field folder: its cost before it begins, its progress and its result.

use std::path::Path;
use std::time::{Duration, Instant};

use indicatif::HumanDuration;
use serde_json::json;

use crate::capture::CaptureFiles;
use crate::fit::{FitRuntime, SlidField, SlidePlan, WorkFolder, slide, slide_cost};
use crate::messages::count;
use crate::progress::counting;

/// Remaining seconds from which a note says how long it takes.
const NOTED_S: f64 = 10.0;

/// How fast a fit goes.
#[derive(Default)]
struct Pace {
    /// When the first steps were done, and how many these were.
    first: Option<(Instant, u64)>,
    is_known: bool,
}

impl Pace {
    /// Steps after which the pace is known.
    const STEPS: u64 = 50;

    /// Whether the pace is known for the first time after `done` steps, and steps per second so far.
    fn after(&mut self, done: u64) -> (bool, f64) {
        let (start, before) = *self.first.get_or_insert((Instant::now(), done));
        let is_known = done >= before + Pace::STEPS;
        let is_first = is_known && !self.is_known;
        self.is_known |= is_known;
        (is_first, (done - before) as f64 / start.elapsed().as_secs_f64().max(1e-9))
    }
}

/// Fits a field folder with a progress bar.
pub(super) fn fit_folder(
    out: &Path,
    plan: &SlidePlan,
    capture_files: &CaptureFiles,
    runtime: FitRuntime,
    work: WorkFolder,
) -> anyhow::Result<SlidField> {
    let cost = slide_cost(plan, capture_files);
    eprintln!(
        "note: {}: {}, about {:.0} MB of memory and {:.0} MB of disk",
        out.display(),
        count(cost.steps, "step"),
        cost.memory_bytes * 1e-6,
        cost.disk_bytes * 1e-6
    );
    let duration_s = capture_files.capture.duration_s();
    let all = cost.steps as u64 * plan.fit.steps;
    let bar = counting(all, "steps");
    let mut pace = Pace::default();
    let slid = slide(plan, capture_files, runtime, work, &mut |progress| {
        let fit = &progress.fit;
        let done = progress.step as u64 * plan.fit.steps + fit.step;
        bar.set_position(done);
        let (is_first, steps_per_s) = pace.after(done);
        // A note about what is nearly done would only be noise.
        if is_first && (all - done) as f64 > NOTED_S * steps_per_s {
            let left =
                Duration::try_from_secs_f64((all - done) as f64 / steps_per_s).unwrap_or(Duration::MAX);
            bar.suspend(|| eprintln!("note: {}: about {} more", out.display(), HumanDuration(left)));
        }
        let held = fit.held_psnr_db.map_or(String::new(), |psnr| format!(", held {psnr:.2} dB"));
        let seconds_per_hour = 3600.0 * steps_per_s * duration_s / all as f64;
        bar.set_message(format!(
            "part {} of {}, loss {:.4}{held}, {} Gaussians, {seconds_per_hour:.1} s of the take per hour",
            progress.step + 1,
            cost.steps,
            fit.loss,
            fit.gaussians
        ));
    })?;
    bar.finish_and_clear();
    Ok(slid)
}

/// Prints what was written to `out`.
pub(super) fn report_folder(out: &Path, slid: &SlidField, duration_s: f64, is_json: bool) {
    if is_json {
        println!(
            "{:#}",
            json!({
                "out": out, "duration_s": duration_s, "segments": slid.assembled.segments,
                "gaussians_by_level": slid.assembled.gaussians, "steps": slid.steps, "resumed_at": slid.resumed_at,
                "seconds": slid.seconds,
            })
        );
        return;
    }
    let levels = slid.assembled.gaussians.iter().enumerate().filter(|(_, gaussians)| **gaussians > 0);
    let levels: Vec<String> =
        levels.map(|(level, gaussians)| format!("{gaussians} on level {level}")).collect();
    println!("Gaussians        {}", levels.join(", "));
    println!("segments         {}", slid.assembled.segments);
    if slid.resumed_at > 0 {
        println!("resumed          at part {}", slid.resumed_at + 1);
    }
    println!("{}: {duration_s:.2} s, fitted in {:.1} s", out.display(), slid.seconds);
}
