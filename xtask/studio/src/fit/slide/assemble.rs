//! [`assemble`]: the background and the fitted parts become the segments of a field folder.
//!
//! A Gaussian belongs to the segment that `package --split` would give it: the lowest level whose segment holds its life.
//! Parts are read one after another, and a segment is written as soon as no later part can have a row of it.

use std::collections::BTreeMap;
use std::path::Path;

use codec::{ClipInfo, SegmentGrid};
use program::output;
use refine::fit::{Parameters, Timeline};

use super::rows::{joined, later, lives};
use super::windows::Windows;
use super::work_folder::WorkFolder;
use crate::fields::{FitRecord, fitted_field_file};
use crate::scene::FIELD_FOLDER;
use crate::segments::{FieldFolder, FolderEntry, Span, order_of};

/// What was written.
#[derive(Clone, Debug, Default)]
pub struct Assembled {
    /// Gaussians on each level.
    pub gaussians: Vec<usize>,
    /// Number of segments.
    pub segments: usize,
    /// Seconds of fitting the parts, by all processes.
    pub seconds: f64,
}

/// Writes the segments and `field.json` to the field folder, with the `info` of the take; `None` if nothing was fitted. A
/// segment records a graphics device if one computed steps of the background or of a part up to its end.
///
/// # Errors
/// [`Fault::Data`](program::Fault::Data) if a part is damaged; [`Fault::Usage`](program::Fault::Usage) if a file cannot be written.
pub(super) fn assemble(
    work: &WorkFolder,
    windows: &Windows,
    interval_s: f64,
    info: &ClipInfo,
    mut record: FitRecord,
) -> anyhow::Result<Option<Assembled>> {
    let duration_s = windows.duration_s;
    let grid = SegmentGrid::new(duration_s, windows.unit_s);
    let mut open: BTreeMap<(u8, u64), Parameters<f32>> = BTreeMap::new();
    let (mut entries, mut assembled) = (Vec::new(), Assembled::default());
    let add = |open: &mut BTreeMap<(u8, u64), Parameters<f32>>,
               part: &Parameters<f32>,
               [from_s, to_s]: [f64; 2]| {
        for (place, rows) in places(&grid, [from_s, duration_s], &lives(part, interval_s, [from_s, to_s])) {
            // In intervals of the segment.
            let shift = (grid.span(place.0, place.1).0 - from_s) / interval_s;
            let all = open.remove(&place).unwrap_or_default();
            open.insert(place, joined(all, later(part.select(&rows), shift)));
        }
    };
    let background = work.fitted_background()?;
    record.device = background.device;
    add(&mut open, &background.finished, [0.0, duration_s]);
    for part in 0..windows.count {
        let fitted = work.part(part)?;
        assembled.seconds += fitted.seconds;
        record.device = record.device.or(fitted.device);
        add(&mut open, &fitted.finished, windows.span_s(part));
        let until_s = windows.final_until_s(part);
        let closed: Vec<(u8, u64)> = open
            .keys()
            .copied()
            .filter(|&(level, number)| {
                let (start_s, duration) = grid.span(level, number);
                start_s + duration <= until_s
            })
            .collect();
        for place in closed {
            let rows = open.remove(&place).expect("it is open");
            let level = usize::from(place.0);
            assembled.gaussians.resize(assembled.gaussians.len().max(level + 1), 0);
            assembled.gaussians[level] += rows.len();
            entries.push(write_segment(&work.out, &grid, place, &rows, interval_s, (info, &record))?);
        }
    }
    if entries.is_empty() {
        return Ok(None);
    }
    let spans: Vec<Span> = entries.iter().map(FolderEntry::span).collect();
    let entries: Vec<FolderEntry> =
        order_of(duration_s, &spans).into_iter().map(|i| entries[i].clone()).collect();
    assembled.segments = entries.len();
    let manifest = FieldFolder::manifest(duration_s, info.fps, entries);
    output::write_durable(&work.out.join(FIELD_FOLDER), manifest.as_bytes())?;
    Ok(Some(assembled))
}

/// The rows of each segment, by the lives of all rows of a part. A row that was fitted from second `from_s` on counts as
/// alive until then, because segments that end before are written. A row that is never alive belongs to no segment.
fn places(
    grid: &SegmentGrid,
    [from_s, duration_s]: [f64; 2],
    lives: &[Option<[f64; 2]>],
) -> BTreeMap<(u8, u64), Vec<usize>> {
    let mut rows_of: BTreeMap<(u8, u64), Vec<usize>> = BTreeMap::new();
    for (row, life) in lives.iter().enumerate() {
        let Some([birth_s, death_s]) = *life else { continue };
        let within = [birth_s.max(0.0), death_s.max(from_s).min(duration_s)];
        if within[0] <= within[1] {
            rows_of.entry(grid.place(within)).or_default().push(row);
        }
    }
    rows_of
}

/// Writes the field file of a segment, whose rows have times in its intervals.
fn write_segment(
    out: &Path,
    grid: &SegmentGrid,
    (level, number): (u8, u64),
    rows: &Parameters<f32>,
    interval_s: f64,
    (info, record): (&ClipInfo, &FitRecord),
) -> anyhow::Result<FolderEntry> {
    let (start_s, duration_s) = grid.span(level, number);
    let field = rows.to_field(Timeline { frames: 2, intervals: duration_s / interval_s });
    let info = ClipInfo { duration_s: duration_s as f32, ..info.clone() };
    let file = format!("segment-{level:02}-{number:06}.ply");
    output::write_durable(&out.join(&file), &fitted_field_file(&field, &info, record))?;
    Ok(FolderEntry { file, start_s, duration_s, level, plate: None })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_that_dies_before_its_part_goes_to_no_segment_that_is_written() {
        let grid = SegmentGrid::new(20.0, 1.0);
        // The part has photographs from second 9.75 on; segments that end before are written.
        let lives = [Some([2.1, 2.5]), Some([9.0, 9.9]), Some([-3.0, 30.0]), None];
        let rows_of = places(&grid, [9.75, 20.0], &lives);
        for (place, rows) in &rows_of {
            let (start_s, duration_s) = grid.span(place.0, place.1);
            assert!(start_s + duration_s > 9.75, "{place:?}: {rows:?}");
        }
        assert_eq!(rows_of.values().map(Vec::len).sum::<usize>(), 3);
        assert_eq!(rows_of[&(0, 9)], [1]);
    }
}
