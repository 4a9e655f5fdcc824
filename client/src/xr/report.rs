//! [`Report`]: the run that `--frames`, `--stats` and `--out` ask for: its length, its counts, and the last
//! images of the eyes and the panel.

use std::path::Path;
use std::time::Instant;

use codec::Camera;
use glam::UVec2;
use program::{Fault, counted, output};
use serde::Serialize;

use super::runtime::Runtime;
use super::tracking::eye;
use crate::args::Args;
use crate::gpu::{Coverage, FrameCounts, Gpu, Level, Pixels, RenderSettings};
use crate::headset::pacing::Pacing;
use crate::headset::show::Show;
use crate::stats::{FrameStats, Latest, Summary, TakeStats};
use crate::view::View;

/// File names of the eyes.
const EYES: [&str; 2] = ["left", "right"];

/// Most frames with recorded times: the latest ones.
const CAPACITY: usize = 1 << 16;

/// Seconds at the start of a run by [`Length::Seconds`] that the statistics leave out: pipelines are compiled, clocks
/// rise, and the quality finds its level.
const WARM_UP_S: f64 = 2.0;

/// When a run ends, and which part of it the statistics leave out.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Length {
    Endless,
    /// After `last` frames with the clip; the statistics leave the first `skipped` out.
    Frames {
        skipped: u64,
        last: u64,
    },
    /// After [`WARM_UP_S`] and then so many seconds with the clip.
    Seconds(f64),
}

impl Length {
    fn from_args(args: &Args) -> Length {
        match (&args.frames, args.seconds) {
            (Some(frames), _) => {
                Length::Frames { skipped: u64::from(frames.start), last: u64::from(frames.end) }
            }
            (None, Some(length_s)) => Length::Seconds(length_s),
            (None, None) => Length::Endless,
        }
    }
}

/// The state of a run.
pub(super) struct Report {
    length: Length,
    measures: bool,
    captures: bool,
    started: Instant,
    first_frame_ms: Option<f64>,
    first_picture_ms: Option<f64>,
    drawn_frames: u64,
    /// Display time of the frame before, if it showed the clip, and the sum of the times between such frames.
    drawn_at_ns: Option<i64>,
    drawn_ns: i64,
    measured: Measured,
    empty: u64,
    unseen: u64,
    sessions_lost: u64,
    missed_before: u64,
    pacing: Pacing,
    period_ns: i64,
    cpu_ms: Latest<CAPACITY>,
    alive_ms: Latest<CAPACITY>,
    sort_ms: Latest<CAPACITY>,
    gpu_ms: Latest<CAPACITY>,
    loading: WhileLoading,
    /// Number of frames at each level, and the last frame.
    levels: [u64; Level::ALL.len()],
    drawn: Drawn,
    capture: Option<EyeImages>,
}

/// Cost of a frame.
pub(super) struct Work {
    /// Seconds of the frame outside the runtime and the driver.
    pub(super) cpu_s: f64,
    pub(super) display_ns: i64,
    pub(super) period_ns: i64,
    /// Whether a clip was being loaded.
    pub(super) loading: bool,
}

/// How the clip was drawn.
#[derive(Clone, Copy, Default)]
pub(super) struct Drawn {
    pub(super) level: Level,
    /// Size of an eye's image in pixels.
    pub(super) size: UVec2,
    pub(super) settings: RenderSettings,
    pub(super) counts: FrameCounts,
}

/// The images of a frame.
pub(super) struct EyeImages {
    pub(super) views: [View; 2],
    /// Seconds from the start of the clip.
    pub(super) position_s: f64,
    pub(super) coverage: Coverage,
    /// Image of each eye.
    pub(super) pixels: Vec<Pixels>,
    /// Image of the panel, if it was drawn.
    pub(super) panel: Option<Pixels>,
}

fn seconds(ns: i64) -> f64 {
    ns as f64 * 1e-9
}

impl Report {
    /// A run as `args` ask for, of a program that was started at `started`.
    pub(super) fn new(args: &Args, started: Instant) -> Report {
        Report {
            length: Length::from_args(args),
            measures: args.stats.is_some(),
            captures: args.out.is_some(),
            started,
            first_frame_ms: None,
            first_picture_ms: None,
            drawn_frames: 0,
            drawn_at_ns: None,
            drawn_ns: 0,
            measured: Measured::default(),
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

    /// Counts a frame that was not visible.
    pub(super) fn on_unseen_frame(&mut self) {
        self.unseen += 1;
        self.drawn_at_ns = None;
        self.pacing.rest();
    }

    /// Counts a frame without a clip.
    pub(super) fn on_empty_frame(&mut self, work: Work) {
        self.empty += 1;
        self.drawn_at_ns = None;
        self.seen(&work);
    }

    /// Counts a frame with the clip; returns how many times the display repeated the frame before.
    pub(super) fn on_frame(&mut self, work: Work, drawn: Drawn) -> u64 {
        let missed = self.seen(&work);
        if work.loading {
            self.loading.frames += 1;
            self.loading.missed += missed;
        }
        self.first_picture_ms.get_or_insert_with(|| self.started.elapsed().as_secs_f64() * 1e3);
        self.drawn_frames += 1;
        let step_ns = self.drawn_at_ns.replace(work.display_ns).map_or(0, |before| work.display_ns - before);
        self.drawn_ns += step_ns;
        if self.is_skipped() {
            self.missed_before = self.pacing.missed();
        } else {
            self.measured.frames += 1;
            self.measured.seconds += seconds(step_ns);
        }
        self.drawn = drawn;
        self.levels[drawn.level as usize] += 1;
        if self.measures && !self.is_skipped() {
            self.cpu_ms.push(work.cpu_s * 1e3);
            self.alive_ms.push(drawn.counts.alive_ms);
            self.sort_ms.push(drawn.counts.sort_ms);
        }
        missed
    }

    /// Takes in the GPU's milliseconds for a frame, both eyes, that was measured since the last one; `None` if there is
    /// none, or it has no timestamps.
    pub(super) fn on_measured(&mut self, gpu_ms: Option<f64>) {
        if self.measures && !self.is_skipped() {
            gpu_ms.into_iter().for_each(|ms| self.gpu_ms.push(ms));
        }
    }

    /// Number of repeated frames before this one.
    fn seen(&mut self, work: &Work) -> u64 {
        self.first_frame_ms.get_or_insert_with(|| self.started.elapsed().as_secs_f64() * 1e3);
        let missed = self.pacing.missed();
        self.pacing.frame(work.display_ns, work.period_ns);
        self.period_ns = work.period_ns;
        self.pacing.missed() - missed
    }

    /// Stores the images of the last frame.
    pub(super) fn capture(&mut self, images: EyeImages) {
        self.capture = Some(images);
    }

    /// Counts a lost session.
    pub(super) fn lose_session(&mut self) {
        self.sessions_lost += 1;
        self.drawn_at_ns = None;
        self.pacing.rest();
    }

    /// Whether the statistics leave the latest frame with the clip out.
    fn is_skipped(&self) -> bool {
        match self.length {
            Length::Endless => false,
            Length::Frames { skipped, .. } => self.drawn_frames <= skipped,
            Length::Seconds(_) => seconds(self.drawn_ns) <= WARM_UP_S,
        }
    }

    /// Whether to capture the next frame with the clip.
    pub(super) fn is_last(&self) -> bool {
        self.captures && matches!(self.length, Length::Frames { last, .. } if self.drawn_frames + 1 == last)
    }

    /// Whether all that was requested was drawn.
    pub(super) fn is_complete(&self) -> bool {
        match self.length {
            Length::Endless => false,
            Length::Frames { last, .. } => self.drawn_frames >= last,
            Length::Seconds(length_s) => self.measured.seconds >= length_s,
        }
    }

    /// Number of frames so far: with the clip, without one, and not visible.
    pub(super) fn frames(&self) -> u64 {
        self.drawn_frames + self.empty + self.unseen
    }

    /// Number of frames with the clip so far.
    pub(super) fn frames_drawn(&self) -> u64 {
        self.drawn_frames
    }

    /// Writes the requested files.
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
        let drawn = match self.length {
            _ if self.is_complete() => return Ok(()),
            Length::Endless => return Ok(()),
            Length::Frames { last, .. } => {
                format!("{} of {}", self.drawn_frames, counted(last as usize, "frame"))
            }
            Length::Seconds(length_s) => format!("{:.1} of {length_s} s", self.measured.seconds),
        };
        Err(Fault::Device(format!("the session ended after {drawn}: start it again")))
    }

    fn write_eyes(&self, folder: &Path) -> Result<(), Fault> {
        let Some(images) = &self.capture else { return Ok(()) };
        output::make_folder(folder)?;
        for ((eye, view), pixels) in EYES.into_iter().zip(&images.views).zip(&images.pixels) {
            let picture = folder.join(format!("{eye}.png"));
            output::write_png(&picture, &pixels.to_rgb8(), pixels.size.into())?;
            let camera = EyeCamera { camera: eye::camera(view), time: images.position_s };
            let mut json = serde_json::to_vec_pretty(&camera).expect("numbers serialise");
            json.push(b'\n');
            output::write(&folder.join(format!("{eye}.json")), &json)?;
        }
        if let Some(panel) = &images.panel {
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
            inset: settings.inset,
            cutoff_sigma: settings.cutoff.radius_max(),
            layers: settings.layers,
            alive: counts.alive,
            sorted: counts.sorted,
        }
    }

    fn stats(&self, runtime: &Runtime, gpu: &Gpu, show: &mut Show) -> Result<XrStats, Fault> {
        let mut frames = Vec::new();
        let gaussians = show.gaussians();
        let (mut passes, mut gpu_bytes) = (0, 0);
        if let Some(renderer) = show.renderer() {
            passes = renderer.passes();
            gpu_bytes = renderer.clip().bytes();
            if let Some(EyeImages { position_s, coverage, .. }) = &self.capture {
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
            f16: gpu.caps.f16,
            take: show.take_counts().map(TakeStats::from),
            width: runtime.eye_size.x,
            height: runtime.eye_size.y,
            passes,
            gaussians,
            gpu_bytes,
            display_hz: if self.period_ns > 0 { 1e9 / self.period_ns as f64 } else { 0.0 },
            first_frame_ms: self.first_frame_ms,
            first_picture_ms: self.first_picture_ms,
            frames_drawn: self.drawn_frames,
            frames_empty: self.empty,
            frames_unseen: self.unseen,
            frames_missed: self.pacing.missed() - self.missed_before,
            measured: self.measured,
            while_loading: self.loading,
            sessions_lost: self.sessions_lost,
            quality: self.quality(),
            cpu_ms: self.cpu_ms.summary().unwrap_or_default(),
            alive_ms: self.alive_ms.summary().unwrap_or_default(),
            sort_ms: self.sort_ms.summary().unwrap_or_default(),
            gpu_ms: self.gpu_ms.summary(),
            frames,
        })
    }
}

/// The part of a run that the statistics are about.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
struct Measured {
    /// Number of frames with the clip, and the sum of the display times between them.
    frames: u64,
    seconds: f64,
}

/// Frames with a clip while another one was being loaded.
#[derive(Clone, Copy, Default, Serialize)]
struct WhileLoading {
    frames: u64,
    /// Number of repeated frames before them.
    missed: u64,
}

/// Quality of the last frame, and the Gaussians that it left out.
#[derive(Serialize)]
struct QualityStats {
    level: &'static str,
    /// Number of frames at each level, from the best down.
    frames: [u64; Level::ALL.len()],
    /// Viewport of an eye in pixels.
    width: u32,
    height: u32,
    /// Side of the inset as a fraction of the viewport's sides; `null` where all of it has full resolution.
    inset: Option<f32>,
    /// Largest extent of a Gaussian in standard deviations.
    #[serde(rename = "reach_sigma")]
    cutoff_sigma: f32,
    /// Number of drawn layers; null for all.
    layers: Option<usize>,
    alive: u32,
    sorted: u32,
}

/// A camera file with the time of the image.
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
    /// Whether the fragment stage calculated in f16; else in f32.
    f16: bool,
    /// Size of an eye's image in pixels.
    width: u32,
    height: u32,
    /// The segments of a take; absent for a clip.
    #[serde(skip_serializing_if = "Option::is_none")]
    take: Option<TakeStats>,
    /// Render passes for both eyes.
    passes: usize,
    /// Number of Gaussians of the clip, plate included.
    gaussians: usize,
    gpu_bytes: u64,
    /// Images per second of the display, as the runtime reports.
    display_hz: f64,
    /// Milliseconds from the start of the program to the first frame, and to the first one with the clip.
    first_frame_ms: Option<f64>,
    first_picture_ms: Option<f64>,
    /// Number of frames with the clip, without one, and of frames that were not visible.
    #[serde(rename = "frames_shown")]
    frames_drawn: u64,
    frames_empty: u64,
    frames_unseen: u64,
    /// Number of repeated frames, after the initial ones left out.
    frames_missed: u64,
    measured: Measured,
    while_loading: WhileLoading,
    sessions_lost: u64,
    quality: QualityStats,
    /// Milliseconds of a frame outside the runtime and the driver.
    cpu_ms: Summary,
    alive_ms: Summary,
    sort_ms: Summary,
    /// For both eyes, if the GPU has timestamps.
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
        report.on_unseen_frame();
        report.on_empty_frame(work(1));
        for (number, last) in [(2, false), (3, false), (4, false), (8, true)] {
            assert!(report.is_last() == last && !report.is_complete(), "{number}");
            report.on_frame(work(number), Drawn::default());
        }
        assert!(report.is_complete());
        assert_eq!((report.drawn_frames, report.empty, report.unseen), (4, 1, 1));
        assert_eq!(report.cpu_ms.values.len(), 2, "the first two are left out");
        assert_eq!(report.pacing.missed() - report.missed_before, 3);
    }

    #[test]
    fn a_run_of_some_seconds_starts_anew_after_the_warm_up() {
        let mut report = report("aarc --xr --seconds 3 --stats s");
        let frame = |report: &mut Report, at_s: f64| {
            let work = Work { display_ns: (at_s * 1e9) as i64, period_ns: 500_000_000, ..work(0) };
            report.on_frame(work, Drawn::default());
        };
        for at_s in [10.0, 11.0, 12.0] {
            frame(&mut report, at_s);
            assert_eq!(report.measured, Measured::default(), "it warms up");
        }
        assert_eq!(report.pacing.missed(), 2);
        // Time during which nothing of the clip was visible does not count.
        report.on_unseen_frame();
        for (at_s, seconds, is_complete) in
            [(50.0, 0.0, false), (50.5, 0.5, false), (51.5, 1.5, false), (53.0, 3.0, true)]
        {
            frame(&mut report, at_s);
            assert_eq!((report.measured.seconds, report.is_complete()), (seconds, is_complete), "{at_s}");
        }
        assert_eq!((report.measured.frames, report.pacing.missed() - report.missed_before), (3, 3));
        assert_eq!(report.cpu_ms.values.len(), 3);
    }

    #[test]
    fn frames_missed_while_a_clip_loads_are_counted_apart() {
        let mut report = report("aarc --xr --frames 0..9");
        for (number, loading) in [(1, true), (2, true), (5, true), (6, false), (9, false), (11, true)] {
            report.on_frame(Work { loading, ..work(number) }, Drawn::default());
        }
        assert_eq!((report.loading.frames, report.loading.missed), (4, 3));
        assert_eq!(report.pacing.missed(), 5);
    }

    #[test]
    fn an_endless_run_stores_little() {
        let mut report = report("aarc --xr");
        for number in 0..10 {
            report.on_frame(work(number), Drawn::default());
        }
        assert!(!report.is_complete() && !report.is_last() && report.cpu_ms.summary().is_none());
    }
}
