//! [`SequenceFrames`]: the frames that a moving field is written as, each a static PLY with the same rows.
//!
//! Rows that correspond let a reader fit trajectories to them, as this package's does. So a frame has the
//! Gaussians that are invisible then, too, with their tiny opacities, where they were or will be visible.

use codec::{ALPHA_MIN, ClipInfo, Field};

use crate::frozen::frozen_rows;
use crate::ply::write_static_ply;

use super::files::FRAMES_MIN;

/// Most frames that are written.
const FRAMES_MAX: f64 = 100_000.0;

/// A moving field at equal distances in time.
pub struct SequenceFrames<'f> {
    field: &'f Field,
    info: ClipInfo,
    /// Rows of the field that are visible in some frame.
    rows: Vec<usize>,
    /// Clip time of each frame.
    times: Vec<f64>,
}

impl<'f> SequenceFrames<'f> {
    /// The frames of a clip at `fps` frames per second, above 0: as many as fit into its duration.
    ///
    /// # Errors
    /// The end of a sentence, for fewer than 3 frames or more than 100,000.
    pub fn new(field: &'f Field, info: &ClipInfo, fps: f32) -> Result<SequenceFrames<'f>, String> {
        // A frame at the very end counts in spite of rounding.
        let duration = f64::from(info.duration_s);
        let intervals = (duration * f64::from(fps) + 1e-3).floor();
        if !((FRAMES_MIN - 1) as f64..FRAMES_MAX).contains(&intervals) {
            let frames = intervals + 1.0;
            return Err(format!("{frames} frames; choose a rate for {FRAMES_MIN} to {FRAMES_MAX} frames"));
        }
        let info = ClipInfo { fps, duration_s: (intervals / f64::from(fps)) as f32, ..info.clone() };
        let times: Vec<f64> =
            (0..=intervals as usize).map(|k| (k as f64 / f64::from(fps) / duration).min(1.0)).collect();
        let is_visible = |&row: &usize| times.iter().any(|&t| field.opacity_at(row, t) >= ALPHA_MIN);
        let rows = (0..field.len()).filter(is_visible).collect();
        Ok(SequenceFrames { field, info, rows, times })
    }

    /// Number of frames.
    pub fn count(&self) -> usize {
        self.times.len()
    }

    /// Number of Gaussians of each frame; none if no Gaussian is visible in any.
    pub fn rows(&self) -> usize {
        self.rows.len()
    }

    /// The files in order, each with its name.
    pub fn files(&self) -> impl Iterator<Item = (String, Vec<u8>)> {
        let digits = (self.count() - 1).to_string().len().max(4);
        self.times.iter().enumerate().map(move |(k, &t)| {
            (format!("frame_{k:0digits$}.ply"), write_static_ply(&self.frame(t), Some(&self.info)))
        })
    }

    fn frame(&self, t: f64) -> Field {
        // A trajectory may lead anywhere while its Gaussian is invisible.
        frozen_rows(self.field, &self.rows, t, |row| {
            self.field.alive_interval(row).map_or(t, |(first, last)| t.clamp(first, last))
        })
    }
}
