//! [`course`]: what a take asks of a player and of the network over time.

use codec::{Segment, Take};
use serde::Serialize;

/// Largest number of rows of the table.
const ROWS_MAX: f64 = 60.0;

/// What a take asks for over time.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Course {
    /// Size of the segments that hold the first instant, in bytes.
    pub startup_bytes: u64,
    /// Most Gaussians of segments that hold one instant, plates included.
    pub resident_max: usize,
    /// Bit rate over the whole duration in Mbit/s.
    pub mean_mbps: f64,
    /// Mbit of the segments that begin within one second, where that is most, without the first instant's.
    pub peak_mbps: f64,
    /// Second at which that one second begins.
    pub peak_s: f64,
    /// Equal parts of the take, of one second or more.
    pub rows: Vec<CourseRow>,
}

/// A part of a take.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct CourseRow {
    /// Second at which it begins.
    pub from_s: f64,
    /// Second at which it ends.
    pub to_s: f64,
    /// Most segments that hold one instant of it.
    pub segments: usize,
    /// Most Gaussians of segments that hold one instant of it.
    pub gaussians: usize,
    /// Size of the segments that begin in it, in bytes; in the first row also of the segments of the first instant.
    pub bytes: u64,
    /// Gaussians of these segments, which a player decodes.
    pub decoded: usize,
    /// These bytes in Mbit per second of it.
    pub mbps: f64,
}

/// The course of a take.
pub(crate) fn course(take: &Take) -> Course {
    let rows = rows(take);
    let is_first = |segment: &&Segment| segment.start_s <= 0.0;
    let (peak_bytes, peak_s) = peak(take);
    Course {
        startup_bytes: take.segments.iter().filter(is_first).map(|segment| segment.bytes() as u64).sum(),
        resident_max: rows.iter().map(|row| row.gaussians).max().unwrap_or(0),
        mean_mbps: mbit(take.package_bytes()) / take.duration_s,
        peak_mbps: mbit(peak_bytes),
        peak_s,
        rows,
    }
}

fn mbit(bytes: u64) -> f64 {
    bytes as f64 * 8e-6
}

/// The rows of the table.
fn rows(take: &Take) -> Vec<CourseRow> {
    let length = (take.duration_s / ROWS_MAX).ceil().max(1.0);
    let count = (take.duration_s / length).ceil().max(1.0) as usize;
    let row_of = |t_s: f64| ((t_s / length) as usize).min(count - 1);
    let row = |i: usize| {
        let (from_s, to_s) = (i as f64 * length, ((i + 1) as f64 * length).min(take.duration_s));
        CourseRow { from_s, to_s, ..CourseRow::default() }
    };
    let mut rows: Vec<CourseRow> = (0..count).map(row).collect();
    // Ends come before starts at the same second: a segment does not hold its end.
    let mut changes: Vec<(f64, bool, usize)> = Vec::new();
    for segment in &take.segments {
        let start_s = segment.start_s.max(0.0);
        let row = &mut rows[row_of(start_s)];
        row.bytes += segment.bytes() as u64;
        row.decoded += segment.gaussians();
        changes.push((start_s, true, segment.gaussians()));
        if segment.end_s() < take.duration_s {
            changes.push((segment.end_s(), false, segment.gaussians()));
        }
    }
    changes.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let (mut segments, mut gaussians, mut row) = (0usize, 0usize, 0);
    let note = |row: &mut CourseRow, segments: usize, gaussians: usize| {
        row.segments = row.segments.max(segments);
        row.gaussians = row.gaussians.max(gaussians);
    };
    for (i, &(t_s, is_start, of_segment)) in changes.iter().enumerate() {
        // Rows that begin before hold what was held up to here.
        while row < row_of(t_s) {
            row += 1;
            if rows[row].from_s < t_s {
                note(&mut rows[row], segments, gaussians);
            }
        }
        match is_start {
            true => (segments, gaussians) = (segments + 1, gaussians.saturating_add(of_segment)),
            false => (segments, gaussians) = (segments - 1, gaussians.saturating_sub(of_segment)),
        }
        // After all changes of the same second.
        if changes.get(i + 1).is_none_or(|next| next.0 > t_s) {
            note(&mut rows[row], segments, gaussians);
        }
    }
    rows.iter_mut().skip(row + 1).for_each(|row| note(row, segments, gaussians));
    rows.iter_mut().for_each(|row| row.mbps = mbit(row.bytes) / (row.to_s - row.from_s));
    rows
}

/// Most bytes of segments that begin within one second after the first instant, and the start of that second.
fn peak(take: &Take) -> (u64, f64) {
    let later = take.segments.iter().filter(|segment| segment.start_s > 0.0);
    let mut starts: Vec<(f64, u64)> =
        later.map(|segment| (segment.start_s, segment.bytes() as u64)).collect();
    starts.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut peak, mut peak_s, mut end, mut within) = (0, 0.0, 0, 0);
    for &(start_s, bytes) in &starts {
        while let Some(next) = starts.get(end).filter(|next| next.0 < start_s + 1.0) {
            within += next.1;
            end += 1;
        }
        if within > peak {
            (peak, peak_s) = (within, start_s);
        }
        within -= bytes;
    }
    (peak, peak_s)
}
