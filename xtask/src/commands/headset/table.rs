//! [`Table`]: what the player measured, as Markdown.

use std::fmt::Write;

use anyhow::Context;
use serde::Deserialize;

use super::target::Played;

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
    f16: bool,
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
            let Stats { headset, runtime, adapter, driver, f16, width, height, .. } = &stats;
            let fragments = if *f16 { "fragments in f16" } else { "fragments in f32" };
            let (version, seconds) = (env!("CARGO_PKG_VERSION"), self.seconds);
            let about = format!(
                "{headset}, {runtime}, {width}x{height} pixels an eye, {adapter}, {driver}, {fragments}; aarc \
                 {version}; {seconds} s each\n\n"
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_strange_file_is_an_error_and_no_row() {
        let mut table = Table::new(1.0);
        assert!(table.add("a", "near", &Played { stats: b"{}".into(), clocks: None }).is_err());
        assert!(table.len() == 0 && table.text().is_empty());
    }
}
