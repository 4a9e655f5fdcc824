//! `cargo xtask fit` into a field folder: its cost before it begins, its progress and its result.

use std::path::Path;
use std::time::{Duration, Instant};

use indicatif::HumanDuration;
use serde_json::json;

use crate::capture::CaptureFiles;
use crate::fit::{FitRuntime, Segments, SlidField, SlidePlan, SlideProgress, WorkFolder, slide, slide_cost};
use crate::messages::count;
use crate::takes::Shard;

use super::fit_progress::fit_bar;

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

/// Fits parts of a field folder, all or the parts of a shard, with a progress bar.
pub(super) fn fit_folder(
    out: &Path,
    plan: &SlidePlan,
    capture_files: &CaptureFiles,
    runtime: FitRuntime,
    work: WorkFolder,
    segments: Option<(&Segments, Shard)>,
) -> anyhow::Result<SlidField> {
    let cost = slide_cost(plan, capture_files);
    eprintln!(
        "note: {}: {}, about {:.0} MB of memory and {:.0} MB of disk",
        out.display(),
        count(cost.parts, "part"),
        cost.memory_bytes * 1e-6,
        cost.disk_bytes * 1e-6
    );
    let seconds_per_step = capture_files.capture.duration_s() / (cost.parts as u64 * plan.fit.steps) as f64;
    let bar = fit_bar(plan.fit.steps);
    let mut pace = Pace::default();
    let slid = slide(plan, capture_files, runtime, work, segments, &mut |progress| {
        let SlideProgress { part, done, steps, fit } = *progress;
        bar.set_length(steps);
        bar.set_position(done);
        let held = fit.held_psnr_db.map_or(String::new(), |psnr| format!(", held {psnr:.2} dB"));
        let Some(part) = part else {
            bar.set_message(format!("background, loss {:.4}, {} Gaussians", fit.loss, fit.gaussians));
            return;
        };
        let (is_first, steps_per_s) = pace.after(done);
        // A note about what is nearly done would only be noise.
        if is_first && (steps - done) as f64 > NOTED_S * steps_per_s {
            let left = (steps - done) as f64 / steps_per_s;
            let left = Duration::try_from_secs_f64(left).unwrap_or(Duration::MAX);
            bar.suspend(|| eprintln!("note: {}: about {} more", out.display(), HumanDuration(left)));
        }
        let seconds_per_hour = 3600.0 * steps_per_s * seconds_per_step;
        bar.set_message(format!(
            "part {part} of {}, loss {:.4}{held}, {} Gaussians, {seconds_per_hour:.1} s of the take per hour",
            cost.parts, fit.loss, fit.gaussians
        ));
    })?;
    bar.finish_and_clear();
    Ok(slid)
}

/// Says that `out` is complete: other processes left nothing to do.
pub(super) fn report_finished(out: &Path, is_json: bool) {
    match is_json {
        true => println!("{:#}", json!({ "out": out, "is_finished": true })),
        false => println!("{}: it is finished already", out.display()),
    }
}

/// Prints what was written to `out`.
pub(super) fn report_folder(out: &Path, slid: &SlidField, duration_s: f64, is_json: bool) {
    let SlidField { assembled, parts, fitted, resumed_at } = slid;
    if is_json {
        println!(
            "{:#}",
            json!({
                "out": out, "duration_s": duration_s, "parts": parts, "fitted": fitted, "resumed_at": resumed_at,
                "segments": assembled.as_ref().map(|assembled| assembled.segments),
                "gaussians_by_level": assembled.as_ref().map(|assembled| &assembled.gaussians),
                "seconds": assembled.as_ref().map(|assembled| assembled.seconds),
            })
        );
        return;
    }
    if *resumed_at > 0 {
        println!("resumed          with {resumed_at} of {} fitted", count(*parts, "part"));
    }
    let Some(assembled) = assembled else {
        let whole = match fitted == parts {
            true => "; another process completes it, and if none does, repeat this",
            false => "",
        };
        println!("{}: {fitted} of {} fitted{whole}", out.display(), count(*parts, "part"));
        return;
    };
    let levels = assembled.gaussians.iter().enumerate().filter(|(_, gaussians)| **gaussians > 0);
    let levels: Vec<String> =
        levels.map(|(level, gaussians)| format!("{gaussians} on level {level}")).collect();
    println!("Gaussians        {}", levels.join(", "));
    println!("segments         {}", assembled.segments);
    println!("{}: {duration_s:.2} s, fitted in {:.1} s", out.display(), assembled.seconds);
}
