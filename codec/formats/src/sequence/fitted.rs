//! [`fitted`]: one moving field of frames whose rows correspond.

use std::mem;
use std::num::NonZero;
use std::ops::Range;
use std::thread::{self, available_parallelism};

use codec::{Field, Surroundings, sh_coefficients};

use crate::limits::ImportBudget;
use crate::up_axis::DEFAULT_UP;

use super::lost::LostRows;
use super::samples::{Filled, Samples};
use super::track::{Piece, Track};

/// Tolerance of positions, relative to the size of the field: a pixel where it fills an image of a thousand.
pub(super) const TOLERANCE: f64 = 1e-3;

/// Most rows that a thread fits at a time.
const ROWS_PER_THREAD: usize = 256;

/// Most bytes of tracks in memory, if one track has fewer: a row may become as many Gaussians as there are frames.
const TRACKS_BYTES: usize = 64 << 20;

/// Most bytes of a track for a frame: a piece, in a vector that has just grown, and the errors; and of what a fit needs
/// beside, in tracks.
const TRACK_BYTES_PER_FRAME: usize =
    2 * mem::size_of::<Piece>() + mem::size_of::<Option<f64>>() + mem::size_of::<f64>();
const TRACKS_PER_FIT: usize = 4;

/// The frames of a sequence whose rows correspond.
#[derive(Default)]
pub(super) struct Frames {
    /// Clip times, ascending.
    pub(super) times: Vec<f64>,
    /// The frames, with constant colours.
    pub(super) frames: Vec<Field>,
    /// Number of frames, missing ones included.
    pub(super) steps: usize,
    /// SH degree of the sequence.
    pub(super) sh_degree: u8,
    /// Sums of the SH coefficients over the frames, as [`Field::sh`] has them.
    pub(super) sh_sums: Vec<[f32; 3]>,
    /// Rows that cannot be used in some frames; their SH coefficients are 0 there.
    pub(super) lost: LostRows,
}

/// The errors of a fit over all rows and frames.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct FitError {
    position_squares: f64,
    positions: f64,
    opacity_squares: f64,
    opacities: f64,
    /// Largest distance in source units.
    pub(super) position_max: f64,
    /// Size of the field in source units.
    pub(super) size: f64,
    /// Rows that no frame shows.
    pub(super) invisible: usize,
    /// Rows that are further off than the tolerances.
    pub(super) rough: usize,
}

impl FitError {
    fn add(&mut self, track: &Track) {
        for distance in track.distances.iter().flatten() {
            self.position_squares += distance * distance;
            self.positions += 1.0;
            self.position_max = self.position_max.max(*distance);
        }
        self.opacity_squares += track.opacities.iter().map(|x| x * x).sum::<f64>();
        self.opacities += track.opacities.len() as f64;
        self.invisible += usize::from(track.pieces.is_empty());
        self.rough += usize::from(track.is_rough);
    }

    /// Root mean square distance in source units.
    pub(super) fn position_rms(&self) -> f64 {
        (self.position_squares / self.positions.max(1.0)).sqrt()
    }

    /// Root mean square difference of opacity.
    pub(super) fn opacity_rms(&self) -> f64 {
        (self.opacity_squares / self.opacities.max(1.0)).sqrt()
    }
}

/// Fits trajectories and windows to every row.
///
/// # Errors
/// If the field exceeds `budget`.
pub(super) fn fitted(frames: &Frames, budget: &mut ImportBudget) -> Result<(Field, FitError), String> {
    let size = size_of(&frames.frames[frames.frames.len() / 2]);
    let mut error = FitError { size, ..FitError::default() };
    let rows = frames.frames[0].len();
    let mut pieces = budget.field(rows, frames.sh_degree)?;
    let mut temporal = budget.temporal(rows, 3)?;
    let mut rates = budget.vec(rows)?;
    let coefficients = sh_coefficients(frames.sh_degree);
    let filled = Filled::new(&frames.times, frames.steps);
    let fit = |row: usize| {
        let samples = Samples::of_row(&filled, &frames.frames, row);
        Track::fit(&samples, TOLERANCE * size, frames.steps)
    };
    let at_once = rows_at_once(frames.steps).min(rows);
    let track_bytes = frames.steps.saturating_mul(TRACK_BYTES_PER_FRAME);
    budget.spend((TRACKS_PER_FIT * at_once).saturating_mul(track_bytes) as u64)?;
    let threads = available_parallelism().map_or(1, NonZero::get).min(at_once.max(1));
    let per_thread = (at_once / threads).clamp(1, ROWS_PER_THREAD);
    let batches = (0..rows).step_by(per_thread * threads);
    let tracks = batches
        .flat_map(|first| in_parallel(first..rows.min(first + per_thread * threads), per_thread, &fit));
    for (row, track) in tracks.enumerate() {
        error.add(&track);
        let scale = 1.0 / (frames.frames.len() - frames.lost.of_row(row)).max(1) as f32;
        // The first piece of each row is counted already.
        let further = track.pieces.len().saturating_sub(1) as u64;
        budget.spend(further * 4 * (11 + 3 * coefficients as u64 + 15))?;
        for piece in &track.pieces {
            let values = piece.to_row();
            pieces.centers.push(values.center);
            pieces.rotations.push(values.rotation);
            pieces.log_scales.push(values.log_scales);
            pieces.opacities.push(piece.window.peak as f32);
            pieces.sh.push(values.color);
            let sums = &frames.sh_sums[row * coefficients..(row + 1) * coefficients];
            pieces.sh.extend(sums[1..].iter().map(|sum| sum.map(|x| scale * x)));
            temporal.tau.push(piece.window.tau as f32);
            temporal.s.push(piece.window.s as f32);
            temporal.motion.extend(values.motion);
            rates.push(values.rotation_rate);
        }
    }
    temporal.rotation_rates = Some(rates);
    pieces.temporal = Some(temporal);
    pieces.filter = frames.frames[0].filter;
    Ok((pieces, error))
}

/// Most rows whose tracks are in memory at a time, in a sequence of `steps` frames.
fn rows_at_once(steps: usize) -> usize {
    (TRACKS_BYTES / (steps * TRACK_BYTES_PER_FRAME)).max(1)
}

/// The results of `of_row` for each of `rows`, in order, with a thread for every `per_thread`.
fn in_parallel<T: Send>(
    rows: Range<usize>,
    per_thread: usize,
    of_row: &(impl Fn(usize) -> T + Sync),
) -> Vec<T> {
    let parts: Vec<Range<usize>> =
        rows.clone().step_by(per_thread).map(|first| first..rows.end.min(first + per_thread)).collect();
    thread::scope(|scope| {
        let part = |part: Range<usize>| scope.spawn(move || part.map(of_row).collect::<Vec<T>>());
        let running: Vec<_> = parts.into_iter().map(part).collect();
        let result = |thread: thread::ScopedJoinHandle<Vec<T>>| {
            thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
        };
        running.into_iter().flat_map(result).collect()
    })
}

/// Diagonal of the box around the content; its radius where all of it is at one point. Above 0.
pub(super) fn size_of(field: &Field) -> f64 {
    let surroundings = Surroundings::new(field, None, DEFAULT_UP);
    let [low, high] = surroundings.content_bounds();
    let diagonal = (0..3).map(|axis| (high[axis] - low[axis]).powi(2)).sum::<f64>().sqrt();
    if diagonal > 0.0 { diagonal } else { surroundings.content_radius() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::limits::ImportLimits;

    #[test]
    fn tracks_of_many_frames_are_counted() {
        let bytes = |steps: usize| rows_at_once(steps) * steps * TRACK_BYTES_PER_FRAME;
        for steps in [3, 300, 30_000] {
            assert!((TRACKS_BYTES / 2..=TRACKS_BYTES).contains(&bytes(steps)), "{steps}");
        }
        assert_eq!(rows_at_once(1_000_000), 1);
        // Three frames of a clip of a million: the rows fit, the tracks do not.
        let row = Field {
            centers: vec![[0.0; 3]],
            rotations: vec![[1.0, 0.0, 0.0, 0.0]],
            log_scales: vec![[0.0; 3]],
            opacities: vec![1.0],
            sh: vec![[0.0; 3]],
            ..Field::default()
        };
        let frames = Frames {
            times: vec![0.0, 0.5, 1.0],
            frames: vec![row; 3],
            steps: 1_000_000,
            sh_sums: vec![[0.0; 3]],
            ..Frames::default()
        };
        let mut budget = ImportBudget::new(ImportLimits { max_bytes: 1 << 30 });
        assert!(fitted(&frames, &mut budget).unwrap_err().contains("MB is the limit"));
    }
}
