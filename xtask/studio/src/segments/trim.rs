//! [`trim`]: a part of a take as a take of its own, without coding anything anew.
//!
//! Segments that overlap the part are copied byte for byte but for the poster, and their starts move; the others are left
//! out. So a segment at either end keeps what it shows outside the part. Checksums are compared before a segment is copied, so
//! that damage is named by the command that meets it first.

use std::path::Path;

use codec::{Contents, Limits, Poster, Take};
use program::{Fault, output};

use super::file::TakeFile;
use super::span::{Span, order_of};
use super::writer::head;

/// Times are rounded to this many parts of a second, so that moving a segment is exact and no gap opens between two.
const PARTS_PER_SECOND: f64 = (1u32 << 20) as f64;

/// What a trimmed take holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrimmedTake {
    /// Duration in seconds.
    pub duration_s: f64,
    /// Duration in seconds of the take that it was cut out of.
    pub source_s: f64,
    /// Number of its segments.
    pub segments: usize,
    /// Number of segments of the take that it was cut out of.
    pub source_segments: usize,
    /// Size in bytes.
    pub bytes: u64,
    /// Longest time before its start, in seconds, at which a segment still holds something.
    pub before_s: f64,
    /// Longest time after its end.
    pub after_s: f64,
    /// Whether the take had a poster that the part has not, because it is of another time.
    pub is_poster_lost: bool,
}

/// Writes the part of a take from second `from_s` to second `to_s` to `out`.
///
/// # Errors
/// [`Fault::Usage`] if the part is empty or not in the take, or `out` cannot be written; [`Fault::Data`] that names a
/// segment that is missing or damaged, or if no segment overlaps the part.
pub fn trim(file: &TakeFile, from_s: f64, to_s: f64, out: &Path) -> anyhow::Result<TrimmedTake> {
    let take = file.take();
    let [from_s, to_s] = part(from_s, to_s, take.duration_s)?;
    let duration_s = to_s - from_s;
    let kept = overlapping(take, from_s, to_s);
    if kept.is_empty() {
        let name = file.path().display();
        let what = format!("{name}: nothing is shown from {from_s} to {to_s} s; choose another part");
        return Err(Fault::Data(what).into());
    }
    let spans: Vec<Span> = kept.iter().map(|(_, span)| *span).collect();
    let order: Vec<(usize, Span)> = order_of(duration_s, &spans).into_iter().map(|i| kept[i]).collect();
    let segments = order
        .iter()
        .map(|(index, span)| {
            file.check_present(*index, take.segments[*index].bytes())?;
            Ok((*span, file.contents(*index)?))
        })
        .collect::<Result<Vec<(Span, Contents)>, Fault>>()?;
    let mut start = head(out, &take.info, duration_s, &segments)?;
    start.extend(file.read_checked(order[0].0, &segments[0].1)?);
    // A poster that is damaged stays so with its segment.
    let before = file.poster().unwrap_or_default();
    let poster = before.map(|poster| Poster { time_s: poster.time_s - from_s, ..poster });
    let poster = poster.filter(|poster| (0.0..=duration_s).contains(&poster.time_s));
    // Segments that become the first may have had one, which was not used.
    let is_other = |of_start: &Option<Poster>| *of_start != poster;
    if codec::poster(&start, &Limits::default()).is_ok_and(|of_start| is_other(&of_start)) {
        start = codec::with_poster(&start, poster.as_ref(), &Limits::default())
            .map_err(|error| Fault::Defect(format!("{}: the poster: {error}", out.display())))?;
    }
    let mut bytes = start.len() as u64;
    output::write_parts(out, |output| {
        output.write(&start)?;
        for ((index, _), (_, contents)) in order.iter().zip(&segments).skip(1) {
            let segment = file.read_checked(*index, contents)?;
            bytes += segment.len() as u64;
            output.write(&segment)?;
        }
        Ok::<(), Fault>(())
    })?;
    let most = |beyond: fn(&Span, f64) -> f64| {
        order.iter().map(|(_, span)| beyond(span, duration_s)).fold(0.0, f64::max)
    };
    Ok(TrimmedTake {
        duration_s,
        source_s: take.duration_s,
        segments: order.len(),
        source_segments: take.segments.len(),
        bytes,
        before_s: most(|span, _| -span.start_s),
        after_s: most(|span, duration_s| span.end_s() - duration_s),
        is_poster_lost: before.is_some() && poster.is_none(),
    })
}

/// The segments that overlap the part from `from_s` to `to_s`, with their spans in it.
fn overlapping(take: &Take, from_s: f64, to_s: f64) -> Vec<(usize, Span)> {
    let duration_s = to_s - from_s;
    let moved = |span: Span| {
        let mut moved = Span { start_s: span.start_s - from_s, ..span };
        // The last instant must not fall to rounding.
        while span.end_s() >= to_s && moved.end_s() < duration_s {
            moved.duration_s = moved.duration_s.next_up();
        }
        moved
    };
    let spans = take.segments.iter().map(Span::from).enumerate();
    spans
        .filter(|(_, span)| span.start_s < to_s && span.end_s() > from_s)
        .map(|(index, span)| (index, moved(span)))
        .filter(|(_, span)| span.start_s < duration_s && span.end_s() > 0.0)
        .collect()
}

/// The part from `from_s` to `to_s`, with both rounded.
///
/// # Errors
/// [`Fault::Usage`] if it is empty or not in a take of `take_s` seconds.
fn part(from_s: f64, to_s: f64, take_s: f64) -> Result<[f64; 2], Fault> {
    // A duration in text is often rounded. The end of the take stays exact.
    const SLACK_S: f64 = 5e-4;
    let round = |t_s: f64| (t_s * PARTS_PER_SECOND).round() / PARTS_PER_SECOND;
    let is_end = (to_s - take_s).abs() <= SLACK_S;
    let [first_s, last_s] = [round(from_s), if is_end { take_s } else { round(to_s) }];
    match 0.0 <= first_s && first_s < last_s && last_s <= take_s {
        true => Ok([first_s, last_s]),
        false => Err(Fault::Usage(format!(
            "--from {from_s} --to {to_s}: choose a part of the {take_s} s, the start before the end"
        ))),
    }
}
