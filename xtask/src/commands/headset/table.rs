//! [`Table`]: what the player measured, as Markdown; and [`Clocks`], which Meta's runtime logs.

use std::fmt::Write;

use anyhow::Context;
use serde::Deserialize;

use super::Played;

/// Names of the quality levels, from the best down, as the player counts their frames.
const LEVELS: [&str; 6] = ["Exact", "Fine", "Good", "Fair", "Light", "Least"];

const COLUMNS: &str = "\
| clip | Gaussians | distance | frames/s | display Hz | missed | CPU ms, median / p95 | GPU ms, median / p95 | \
quality | CPU / GPU MHz |
|---|--:|---|--:|--:|--:|--:|--:|---|--:|
";

/// The player's statistics, as far as the table shows them.
#[derive(Deserialize)]
struct Stats {
    runtime: String,
    headset: String,
    adapter: String,
    driver: String,
    width: u32,
    height: u32,
    gaussians: usize,
    display_hz: f64,
    frames_missed: u64,
    measured: Measured,
    quality: Quality,
    cpu_ms: Summary,
    gpu_ms: Option<Summary>,
}

#[derive(Deserialize)]
struct Measured {
    frames: u64,
    seconds: f64,
}

#[derive(Deserialize)]
struct Quality {
    /// Number of frames at each level.
    frames: [u64; LEVELS.len()],
}

#[derive(Deserialize)]
struct Summary {
    median: f64,
    p95: f64,
}

/// The table, which grows row by row.
pub(super) struct Table {
    seconds: f64,
    text: String,
    rows: usize,
    /// Length of the text before the latest row.
    before: usize,
}

impl Table {
    /// An empty table of runs of so many seconds.
    pub(super) fn new(seconds: f64) -> Table {
        Table { seconds, text: String::new(), rows: 0, before: 0 }
    }

    /// Number of rows.
    pub(super) fn len(&self) -> usize {
        self.rows
    }

    /// The whole table.
    pub(super) fn text(&self) -> &str {
        &self.text
    }

    /// The lines that the latest row added.
    pub(super) fn latest(&self) -> &str {
        &self.text[self.before..]
    }

    /// Adds a row; before the first one, lines about the headset and the columns.
    ///
    /// # Errors
    /// If the statistics are not the player's.
    pub(super) fn add(&mut self, clip: &str, distance: &str, played: &Played) -> anyhow::Result<()> {
        let stats: Stats = serde_json::from_slice(&played.stats)
            .context("the player's statistics cannot be read: install the player of this version")?;
        self.before = self.text.len();
        if self.rows == 0 {
            let Stats { headset, runtime, adapter, driver, width, height, .. } = &stats;
            let (version, seconds) = (env!("CARGO_PKG_VERSION"), self.seconds);
            let about = format!(
                "{headset}, {runtime}, {width}x{height} pixels an eye, {adapter}, {driver}; aarc {version}; {seconds} s \
                 each\n\n"
            );
            self.text.push_str(&about);
            self.text.push_str(COLUMNS);
        }
        self.rows += 1;
        let clip = clip.replace('|', "\\|");
        let Measured { frames, seconds } = stats.measured;
        let rate = if seconds > 0.0 { frames as f64 / seconds } else { 0.0 };
        let due = (frames + stats.frames_missed).max(1);
        let missed =
            format!("{} ({:.1} %)", stats.frames_missed, 100.0 * stats.frames_missed as f64 / due as f64);
        let summary = |summary: &Summary| format!("{:.2} / {:.2}", summary.median, summary.p95);
        let gpu = stats.gpu_ms.as_ref().map_or("-".into(), summary);
        let clocks =
            played.clocks.map_or("-".into(), |clocks| format!("{} / {}", clocks.cpu_mhz, clocks.gpu_mhz));
        writeln!(
            self.text,
            "| {clip} | {} | {distance} | {rate:.1} | {:.0} | {missed} | {} | {gpu} | {} | {clocks} |",
            stats.gaussians,
            stats.display_hz,
            summary(&stats.cpu_ms),
            stats.quality.most_frequent(),
        )
        .expect("strings grow");
        Ok(())
    }
}

impl Quality {
    /// The level of most frames, and their share.
    fn most_frequent(&self) -> String {
        let all: u64 = self.frames.iter().sum();
        match self.frames.iter().zip(LEVELS).max_by_key(|(frames, _)| **frames) {
            Some((frames, level)) if all > 0 => {
                format!("{level} ({:.0} %)", 100.0 * *frames as f64 / all as f64)
            }
            _ => "-".into(),
        }
    }
}

/// Clocks of the headset's processor: medians over a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Clocks {
    pub(super) cpu_mhz: u32,
    pub(super) gpu_mhz: u32,
}

impl Clocks {
    /// Reads the lines that Meta's runtime logs once a second, the last `seconds` of them; `None` without any.
    pub(super) fn of(log: &str, seconds: f64) -> Option<Clocks> {
        let lines = log.lines().rev().filter_map(Clocks::of_line).take(seconds.ceil() as usize);
        let (mut cpu, mut gpu): (Vec<u32>, Vec<u32>) =
            lines.map(|clocks| (clocks.cpu_mhz, clocks.gpu_mhz)).unzip();
        Some(Clocks { cpu_mhz: median(&mut cpu)?, gpu_mhz: median(&mut gpu)? })
    }

    /// The clocks in `FPS=72/72,...,CPU4/GPU=2/4,1651/670MHz,OC=FF,...`: the field after the levels.
    fn of_line(line: &str) -> Option<Clocks> {
        let mut fields = line.split(',').skip_while(|field| !field.contains("/GPU="));
        let (cpu, gpu) = fields.nth(1)?.strip_suffix("MHz")?.split_once('/')?;
        Some(Clocks { cpu_mhz: cpu.parse().ok()?, gpu_mhz: gpu.parse().ok()? })
    }
}

fn median(numbers: &mut [u32]) -> Option<u32> {
    numbers.sort_unstable();
    numbers.get(numbers.len() / 2).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clocks_are_medians_of_the_end_of_the_log() {
        let line =
            |cpu: u32, gpu: u32| format!("FPS=72/72,Prd=38ms,CPU4/GPU=2/4,{cpu}/{gpu}MHz,OC=FF,App=4.49ms\n");
        let log = ["--------- beginning of main\n".into(), line(9, 9), line(9, 9), line(9, 9)].concat();
        let log =
            [log, line(1651, 670), "other,CPU4/GPU=2/4\n".into(), line(1171, 441), line(1651, 670)].concat();
        assert_eq!(Clocks::of(&log, 2.5), Some(Clocks { cpu_mhz: 1651, gpu_mhz: 670 }));
        assert_eq!(Clocks::of(&log, 60.0), Some(Clocks { cpu_mhz: 1171, gpu_mhz: 441 }));
        assert_eq!(Clocks::of("--------- beginning of main\n", 60.0), None);
    }

    #[test]
    fn a_strange_file_is_an_error_and_no_row() {
        let mut table = Table::new(1.0);
        assert!(table.add("a", "near", &Played { stats: b"{}".into(), clocks: None }).is_err());
        assert!(table.len() == 0 && table.text().is_empty());
    }
}
