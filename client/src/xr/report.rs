//! [`Report`]: what `--frames`, `--stats` and `--out` ask of a run: how long it goes on, what it
//! counted, and what the eyes and the panel showed last.

use std::path::Path;
use std::time::Instant;

use codec::Camera;
use glam::UVec2;
use program::{Fault, output};
use serde::Serialize;

use super::eye;
use super::pacing::Pacing;
use super::runtime::Runtime;
use super::show::Show;
use crate::args::Args;
use crate::gpu::{FrameCounts, Gpu, Level, Pixels, RenderSettings};
use crate::stats::{FrameStats, Summary};
use crate::view::View;

/// Names of the eyes in files.
const EYES: [&str; 2] = ["left", "right"];

/// Frames whose times are kept, the latest ones.
const KEPT: usize = 1 << 16;

/// A run so far.
pub(super) struct Report {
    /// Frames of the clip after which to end; none to go on.
    last: Option<u64>,
    /// Frames of the clip that are left out of the statistics.
    skipped: u64,
    measures: bool,
    captures: bool,
    started: Instant,
    first_frame_ms: Option<f64>,
    first_picture_ms: Option<f64>,
    shown: u64,
    empty: u64,
    unseen: u64,
    sessions_lost: u64,
    missed_before: u64,
    pacing: Pacing,
    period_ns: i64,
    cpu_ms: Latest,
    alive_ms: Latest,
    sort_ms: Latest,
    gpu_ms: Latest,
    loading: WhileLoading,
    /// Frames at each level, and the last one.
    levels: [u64; Level::ALL.len()],
    drawn: Drawn,
    capture: Option<Shown>,
}

/// What a frame took.
pub(super) struct Work {
    /// Seconds from the beginning to the end of the frame, outside the runtime and the driver.
    pub(super) cpu_s: f64,
    pub(super) display_ns: i64,
    pub(super) period_ns: i64,
    /// Whether a clip was on its way.
    pub(super) loading: bool,
}

/// What was drawn of the clip.
#[derive(Clone, Copy, Default)]
pub(super) struct Drawn {
    pub(super) level: Level,
    /// Of an eye's image, in pixels.
    pub(super) size: UVec2,
    pub(super) settings: RenderSettings,
    pub(super) counts: FrameCounts,
    /// For both eyes, if the GPU can tell.
    pub(super) gpu_ms: Option<f64>,
}

/// What the eyes saw.
pub(super) struct Shown {
    pub(super) views: [View; 2],
    /// Clip time.
    pub(super) t: f64,
    /// Seconds from the start of the clip.
    pub(super) position_s: f64,
    pub(super) settings: RenderSettings,
    /// An image for each eye.
    pub(super) pixels: Vec<Pixels>,
    /// The panel, if there is one.
    pub(super) panel: Option<Pixels>,
}

/// The latest numbers of many, in a bounded space.
#[derive(Default)]
struct Latest {
    values: Vec<f64>,
    next: usize,
}

impl Latest {
    fn push(&mut self, value: f64) {
        if self.values.len() < KEPT {
            self.values.push(value);
        } else {
            self.values[self.next] = value;
            self.next = (self.next + 1) % KEPT;
        }
    }

    fn summary(&self) -> Summary {
        Summary::of(self.values.iter().copied())
    }
}

impl Report {
    /// For what `args` ask, of a program that was `started`.
    pub(super) fn new(args: &Args, started: Instant) -> Report {
        let frames = args.frames.as_ref();
        Report {
            last: frames.map(|frames| u64::from(frames.end)),
            skipped: frames.map_or(0, |frames| u64::from(frames.start)),
            measures: args.stats.is_some(),
            captures: args.out.is_some(),
            started,
            first_frame_ms: None,
            first_picture_ms: None,
            shown: 0,
            empty: 0,
            unseen: 0,
            sessions_lost: 0,
            missed_before: 0,
            pacing: Pacing::default(),
            period_ns: 0,
            cpu_ms: Latest::default(),
            alive_ms: Latest::default(),
            sort_ms: Latest::default(),
            gpu_ms: Latest::default(),
            loading: WhileLoading::default(),
            levels: Default::default(),
            drawn: Drawn::default(),
            capture: None,
        }
    }

    /// A frame that nobody saw.
    pub(super) fn unseen(&mut self) {
        self.unseen += 1;
        self.pacing.rest();
    }

    /// A frame that showed no clip, because there was none yet.
    pub(super) fn empty(&mut self, work: Work) {
        self.empty += 1;
        self.seen(&work);
    }

    /// A frame that showed the clip.
    pub(super) fn shown(&mut self, work: Work, drawn: Drawn) {
        let missed = self.seen(&work);
        if work.loading {
            self.loading.frames += 1;
            self.loading.missed += missed;
        }
        self.first_picture_ms.get_or_insert_with(|| self.started.elapsed().as_secs_f64() * 1e3);
        self.shown += 1;
        if self.shown == self.skipped {
            self.missed_before = self.pacing.missed();
        }
        self.drawn = drawn;
        self.levels[drawn.level as usize] += 1;
        if self.measures && self.shown > self.skipped {
            self.cpu_ms.push(work.cpu_s * 1e3);
            self.alive_ms.push(drawn.counts.alive_ms);
            self.sort_ms.push(drawn.counts.sort_ms);
            drawn.gpu_ms.into_iter().for_each(|ms| self.gpu_ms.push(ms));
        }
    }

    /// How often an old frame had to be shown before this one.
    fn seen(&mut self, work: &Work) -> u64 {
        self.first_frame_ms.get_or_insert_with(|| self.started.elapsed().as_secs_f64() * 1e3);
        let missed = self.pacing.missed();
        self.pacing.frame(work.display_ns, work.period_ns);
        self.period_ns = work.period_ns;
        self.pacing.missed() - missed
    }

    /// What the eyes saw in the frame that was the last.
    pub(super) fn capture(&mut self, shown: Shown) {
        self.capture = Some(shown);
    }

    /// A session was lost and another is opened.
    pub(super) fn lose_session(&mut self) {
        self.sessions_lost += 1;
        self.pacing.rest();
    }

    /// Whether the next frame that shows the clip is to be captured.
    pub(super) fn is_last(&self) -> bool {
        self.captures && self.last.is_some_and(|last| self.shown + 1 == last)
    }

    /// Whether all frames asked for were shown.
    pub(super) fn is_complete(&self) -> bool {
        self.last.is_some_and(|last| self.shown >= last)
    }

    /// Number of frames that have shown the clip.
    pub(super) fn frames_shown(&self) -> u64 {
        self.shown
    }

    /// Writes what was asked for.
    ///
    /// # Errors
    /// [`Fault::Usage`] if a file cannot be written, [`Fault::Device`] if the run ended early.
    pub(super) fn write(
        &self,
        args: &Args,
        runtime: &Runtime,
        gpu: &Gpu,
        show: &mut Show,
    ) -> Result<(), Fault> {
        if let Some(folder) = &args.out {
            self.write_eyes(folder)?;
        }
        if let Some(path) = &args.stats {
            let stats = self.stats(runtime, gpu, show)?;
            let mut json = serde_json::to_vec_pretty(&stats).expect("numbers and strings serialise");
            json.push(b'\n');
            output::write(path, &json)?;
        }
        match self.last {
            Some(last) if self.shown < last => {
                Err(Fault::Device(format!("the session ended after {} of {last} frames", self.shown)))
            }
            _ => Ok(()),
        }
    }

    fn write_eyes(&self, folder: &Path) -> Result<(), Fault> {
        let Some(shown) = &self.capture else { return Ok(()) };
        output::make_folder(folder)?;
        for ((eye, view), pixels) in EYES.into_iter().zip(&shown.views).zip(&shown.pixels) {
            let picture = folder.join(format!("{eye}.png"));
            output::write_png(&picture, &pixels.to_rgb8(), pixels.size.into())?;
            let camera = EyeCamera { camera: eye::camera(view), time: shown.position_s };
            let mut json = serde_json::to_vec_pretty(&camera).expect("numbers serialise");
            json.push(b'\n');
            output::write(&folder.join(format!("{eye}.json")), &json)?;
        }
        if let Some(panel) = &shown.panel {
            output::write_png(&folder.join("panel.png"), &panel.to_rgb8(), panel.size.into())?;
        }
        Ok(())
    }

    fn quality(&self) -> QualityStats {
        let Drawn { level, size, settings, counts, .. } = self.drawn;
        QualityStats {
            level: level.name(),
            frames: self.levels,
            width: size.x,
            height: size.y,
            reach_sigma: settings.cutoff.radius_max(),
            least_px: settings.min_contribution_px,
            layers: settings.layers,
            alive: counts.alive,
            faint: counts.culled,
            sorted: counts.sorted,
        }
    }

    fn stats(&self, runtime: &Runtime, gpu: &Gpu, show: &mut Show) -> Result<XrStats, Fault> {
        let mut frames = Vec::new();
        let gaussians = show.gaussians();
        let (mut passes, mut gpu_bytes) = (0, 0);
        if let Some(renderer) = show.renderer() {
            passes = 2 / renderer.eyes_per_pass();
            gpu_bytes = renderer.clip().bytes();
            if let Some(Shown { views, t, position_s, settings, .. }) = &self.capture {
                let coverage = renderer.count(gpu, *t, views, settings)?;
                frames.push(FrameStats {
                    time: *position_s,
                    alive: self.drawn.counts.alive,
                    sorted: self.drawn.counts.sorted,
                    drawn: coverage.drawn,
                    fragments: coverage.fragments,
                    alive_ms: self.drawn.counts.alive_ms,
                    sort_ms: self.drawn.counts.sort_ms,
                    draw_ms: renderer.gpu_ms().unwrap_or_default(),
                });
            }
        }
        Ok(XrStats {
            runtime: runtime.name.clone(),
            headset: runtime.headset.clone(),
            adapter: gpu.adapter_name.clone(),
            driver: gpu.driver.clone(),
            width: runtime.eye_size.x,
            height: runtime.eye_size.y,
            passes,
            gaussians,
            gpu_bytes,
            display_hz: if self.period_ns > 0 { 1e9 / self.period_ns as f64 } else { 0.0 },
            first_frame_ms: self.first_frame_ms,
            first_picture_ms: self.first_picture_ms,
            frames_shown: self.shown,
            frames_empty: self.empty,
            frames_unseen: self.unseen,
            frames_missed: self.pacing.missed() - self.missed_before,
            while_loading: self.loading,
            sessions_lost: self.sessions_lost,
            quality: self.quality(),
            cpu_ms: self.cpu_ms.summary(),
            alive_ms: self.alive_ms.summary(),
            sort_ms: self.sort_ms.summary(),
            gpu_ms: (!self.gpu_ms.values.is_empty()).then(|| self.gpu_ms.summary()),
            frames,
        })
    }
}

/// Frames that showed a clip while another was on its way.
#[derive(Clone, Copy, Default, Serialize)]
struct WhileLoading {
    frames: u64,
    /// Times at which the display had to show an old frame before one of them.
    missed: u64,
}

/// What the last frame was drawn with, and what that left out.
#[derive(Serialize)]
struct QualityStats {
    level: &'static str,
    /// Frames at each level, from the best down.
    frames: [u64; Level::ALL.len()],
    /// Of what was drawn of an eye's image, in pixels.
    width: u32,
    height: u32,
    /// Standard deviations that a Gaussian reaches at most.
    reach_sigma: f32,
    /// Pixels of alpha below which a Gaussian is left out.
    least_px: f32,
    /// Layers drawn; null for all.
    layers: Option<usize>,
    alive: u32,
    /// Those that were left out for `least_px`.
    faint: u32,
    sorted: u32,
}

/// A camera file with the time at which the eye saw.
#[derive(Serialize)]
struct EyeCamera {
    #[serde(flatten)]
    camera: Camera,
    /// Seconds from the start of the clip.
    time: f64,
}

/// What `--stats` writes with `--xr`.
#[derive(Serialize)]
struct XrStats {
    runtime: String,
    headset: String,
    adapter: String,
    driver: String,
    /// Of an eye's image, in pixels.
    width: u32,
    height: u32,
    /// That the eyes took.
    passes: u32,
    /// In the clip, plate included.
    gaussians: usize,
    gpu_bytes: u64,
    /// Images per second of the display, as the runtime says.
    display_hz: f64,
    /// From the start of the program until the first frame was handed over, and the first with
    /// the clip.
    first_frame_ms: Option<f64>,
    first_picture_ms: Option<f64>,
    /// With the clip; without it, while it was loaded; and those nobody saw.
    frames_shown: u64,
    frames_empty: u64,
    frames_unseen: u64,
    /// Times at which the display had to show an old frame, since the frames left out.
    frames_missed: u64,
    while_loading: WhileLoading,
    sessions_lost: u64,
    quality: QualityStats,
    /// From the beginning to the end of a frame, outside the runtime and the driver.
    cpu_ms: Summary,
    alive_ms: Summary,
    sort_ms: Summary,
    /// For both eyes, where the GPU can tell.
    gpu_ms: Option<Summary>,
    /// The last frame, if it was captured.
    frames: Vec<FrameStats>,
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    fn report(line: &str) -> Report {
        Report::new(&Args::parse_from(line.split(' ')), Instant::now())
    }

    fn work(number: i64) -> Work {
        Work { cpu_s: 0.001, display_ns: number * 1000, period_ns: 1000, loading: false }
    }

    #[test]
    fn a_run_ends_after_the_frames_asked_for_and_captures_the_last() {
        let mut report = report("aarc --xr --frames 2..4 --out o --stats s");
        report.unseen();
        report.empty(work(1));
        for (number, last) in [(2, false), (3, false), (4, false), (8, true)] {
            assert!(report.is_last() == last && !report.is_complete(), "{number}");
            report.shown(work(number), Drawn::default());
        }
        assert!(report.is_complete());
        assert_eq!((report.shown, report.empty, report.unseen), (4, 1, 1));
        assert_eq!(report.cpu_ms.values.len(), 2, "the first two are left out");
        assert_eq!(report.pacing.missed() - report.missed_before, 3);
    }

    #[test]
    fn what_is_missed_while_a_clip_loads_is_told_apart() {
        let mut report = report("aarc --xr --frames 0..9");
        for (number, loading) in [(1, true), (2, true), (5, true), (6, false), (9, false), (11, true)] {
            report.shown(Work { loading, ..work(number) }, Drawn::default());
        }
        assert_eq!((report.loading.frames, report.loading.missed), (4, 3));
        assert_eq!(report.pacing.missed(), 5);
    }

    #[test]
    fn without_a_bound_it_goes_on_and_keeps_little() {
        let mut report = report("aarc --xr");
        for number in 0..10 {
            report.shown(work(number), Drawn::default());
        }
        assert!(!report.is_complete() && !report.is_last() && report.cpu_ms.values.is_empty());
        let mut latest = Latest::default();
        (0..KEPT + 10).for_each(|i| latest.push(i as f64));
        assert_eq!(latest.values.len(), KEPT);
        assert!(!latest.values.contains(&9.0) && latest.values.contains(&10.0));
    }
}
