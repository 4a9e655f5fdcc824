//! [`Take`]: the head of a take and its table of segments, with the rules that a table obeys.
//!
//! A segment is a clip package with a place in time, its *span*. At an instant the picture is the union of the
//! segments that hold it. An ordinary clip is a take of one segment.

use std::cmp::Ordering;

use crate::{
    Clip, ClipInfo, Coder, Contents, Field, LayerEnd, PixelFilter, Surroundings,
    columns::{PackageColumns, TemporalColumns},
    format::{FIXED_BYTES, LAYERS_MAX, RESIDENT_MAX, SEGMENTS_MAX, VERSION_MINOR},
    take::span::{Resident, span_holds},
};

/// The head of a take: metadata and the table of segments.
///
/// What [`package`](crate::package()) reads of a take obeys the rules of FORMAT.md. All methods also work for a take
/// that was put together otherwise and does not.
#[derive(Clone, Debug, PartialEq)]
pub struct Take {
    /// Minor version of the format.
    pub version_minor: u16,
    /// Axes, frames per second, viewpoints. Those in the heads of the segments do not matter.
    pub info: ClipInfo,
    /// Duration in seconds; [`ClipInfo::duration_s`] is this number rounded.
    pub duration_s: f64,
    /// Corners of the box around all centres while alive: `[min, max]`, in source units.
    pub bounds: [[f32; 3]; 2],
    /// Coding of all Gaussians.
    pub coder: Coder,
    /// Degree of the spherical harmonics of every decoded segment, 0 to 3, apart from its plate.
    pub sh_degree: u8,
    /// Highest power of time in the trajectories of every decoded segment, 0 to 3.
    pub motion_order: u8,
    /// Whether decoded segments have rotation rates.
    pub rotation_rates: bool,
    /// Filter of all Gaussians but the plates.
    pub filter: PixelFilter,
    /// Number of Gaussians in the largest plate; 0 if no segment has one.
    pub plate_len: usize,
    /// Degree of the spherical harmonics of every decoded plate, 0 to 3.
    pub plate_sh_degree: u8,
    /// Filter of the plates; the default without one.
    pub plate_filter: PixelFilter,
    /// Whether a graphics device computed numbers of a segment; see [`Contents::by_device`](crate::Contents::by_device).
    pub by_device: bool,
    /// [`Field::near`](crate::Field::near) of every decoded segment: the largest that a segment has.
    pub near: f32,
    /// The segments in file order: those that span the whole take, then the others; both by their start, longer
    /// ones first.
    pub segments: Vec<Segment>,
    /// Length of the head in bytes: the offset of the first segment. 0 for an ordinary clip, whose head belongs to
    /// its segment.
    pub head_bytes: usize,
    /// Memory of the table in bytes, which counts towards the limits of decoding a segment.
    pub(crate) table_bytes: usize,
}

/// An entry of the table of segments: a clip package that plays during a span of the take.
#[derive(Clone, Debug, PartialEq)]
pub struct Segment {
    /// Time of the take in seconds at which clip time is 0. Negative if the take was cut out of a longer one.
    pub start_s: f64,
    /// Seconds from clip time 0 to clip time 1, above 0.
    pub duration_s: f64,
    /// Level on the dyadic grid, 0 for the shortest segments. For information only.
    pub level: u8,
    /// Offset of the segment's package in the take, in bytes.
    pub offset: u64,
    /// CRC-32 that the head of the segment's package ends with.
    pub head_crc: u32,
    /// Prefixes of the segment's package, one for each of its 1 to 16 layers; the last is the whole package.
    pub layers: Vec<SegmentLayer>,
}

/// A prefix of a segment's package, up to the end of a layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SegmentLayer {
    /// Length of the prefix in bytes.
    pub bytes: usize,
    /// Number of Gaussians in it, the plate included.
    pub gaussians: usize,
}

impl Segment {
    /// End of the span in seconds: the time of the take at which clip time is 1.
    pub fn end_s(&self) -> f64 {
        self.start_s + self.duration_s
    }

    /// The segment's clip time at time `t_s` of the take: 0 at its start, 1 at its end, not cut to either.
    pub fn clip_time(&self, t_s: f64) -> f64 {
        (t_s - self.start_s) / self.duration_s
    }

    /// Length of the segment's package in bytes.
    pub fn bytes(&self) -> usize {
        self.layers.last().map_or(0, |layer| layer.bytes)
    }

    /// Number of Gaussians in the whole segment, the plate included.
    pub fn gaussians(&self) -> usize {
        self.layers.last().map_or(0, |layer| layer.gaussians)
    }

    /// Start and duration in seconds.
    fn span(&self) -> (f64, f64) {
        (self.start_s, self.duration_s)
    }
}

impl Take {
    /// Whether segment `index` is seen at time `t_s` of the take, as [`span_holds`] has it.
    ///
    /// # Panics
    /// If there is no such segment.
    pub fn holds(&self, index: usize, t_s: f64) -> bool {
        let segment = &self.segments[index];
        span_holds(segment.start_s, segment.end_s(), self.duration_s, t_s)
    }

    /// Numbers of the segments that are seen at time `t_s` of the take, which is cut to `[0, duration_s]`,
    /// ascending.
    pub fn at(&self, t_s: f64) -> impl Iterator<Item = usize> + '_ {
        (0..self.segments.len()).filter(move |&index| self.holds(index, t_s))
    }

    /// Where the content is at the start, and where people stand to look at it. `clips` are segments that are seen there
    /// ([`Take::at`]), as decoded, with their numbers: they are looked at until the first of them ends. Without any, the
    /// box around all centres is the content.
    ///
    /// # Panics
    /// If there is no segment of such a number.
    pub fn surroundings(&self, clips: &[(usize, Clip)]) -> Surroundings {
        if clips.is_empty() {
            return Surroundings::from_box(self.bounds, self.info.up);
        }
        let ends = clips.iter().map(|(number, _)| self.segments[*number].end_s());
        let end_s = ends.fold(f64::INFINITY, f64::min);
        let ranges = clips
            .iter()
            .map(|(number, clip)| (clip, [0.0, end_s].map(|t_s| self.segments[*number].clip_time(t_s))));
        Surroundings::from_clips(&ranges.collect::<Vec<_>>(), self.info.up)
    }

    /// Length of the whole package in bytes.
    pub fn package_bytes(&self) -> u64 {
        self.segments
            .last()
            .map_or(self.head_bytes as u64, |segment| segment.offset.saturating_add(segment.bytes() as u64))
    }

    /// Largest number of Gaussians in the segments that hold one instant, plates included, without the tolerance of
    /// [`span_holds`].
    pub fn resident_max(&self) -> usize {
        let (mut resident, mut largest) = (Resident::default(), 0);
        for (i, segment) in self.segments.iter().enumerate() {
            resident.enter(i, segment.start_s, segment.end_s());
            let gaussians = resident.numbers().map(|number| self.segments[number].gaussians());
            largest = largest.max(gaussians.fold(0, usize::saturating_add));
        }
        largest
    }

    /// The columns of every decoded segment.
    pub(crate) fn columns(&self) -> PackageColumns {
        PackageColumns {
            sh_degree: self.sh_degree,
            temporal: TemporalColumns {
                motion_order: self.motion_order,
                rotation_rates: self.rotation_rates,
            },
            plate_sh_degree: self.plate_sh_degree,
        }
    }

    /// Checks the rules of a table, for reading and writing alike.
    ///
    /// # Errors
    /// The first rule that is broken.
    pub(crate) fn check(&self) -> Result<(), BrokenRule> {
        let broken = |segment, field, value: &dyn std::fmt::Debug| {
            Err(BrokenRule { segment, field, value: format!("{value:?}") })
        };
        if !(1..=SEGMENTS_MAX).contains(&self.segments.len()) {
            return broken(None, "number of segments", &self.segments.len());
        }
        let mut resident = Resident::default();
        let mut previous: Option<(f64, f64)> = None;
        for (i, segment) in self.segments.iter().enumerate() {
            let Segment { start_s, duration_s, .. } = *segment;
            // A short duration may vanish in the sum.
            let is_span = duration_s.is_finite() && start_s < segment.end_s() && segment.end_s().is_finite();
            if !is_span || start_s >= self.duration_s || segment.end_s() <= 0.0 {
                return broken(Some(i), "span of a segment (start, duration)", &segment.span());
            }
            if !(1..=LAYERS_MAX).contains(&segment.layers.len()) {
                return broken(Some(i), "number of layers", &segment.layers.len());
            }
            let mut before = SegmentLayer { bytes: FIXED_BYTES, gaussians: 0 };
            for layer in &segment.layers {
                if layer.bytes <= before.bytes || layer.gaussians <= before.gaussians {
                    return broken(Some(i), "layer of a segment", layer);
                }
                before = *layer;
            }
            if previous.is_some_and(|previous| {
                compare_spans(self.duration_s, previous, segment.span()) == Ordering::Greater
            }) {
                return broken(Some(i), "order of segments", &segment.span());
            }
            previous = Some(segment.span());
            resident.enter(i, start_s, segment.end_s());
            let held = resident.numbers().len();
            if held > RESIDENT_MAX {
                return broken(Some(i), "number of segments that hold one instant", &held);
            }
        }
        Ok(())
    }
}

/// A rule of a table that is broken.
#[derive(Debug)]
pub(crate) struct BrokenRule {
    /// Number of the segment that breaks it.
    pub(crate) segment: Option<usize>,
    pub(crate) field: &'static str,
    pub(crate) value: String,
}

impl From<&Contents> for Take {
    /// The take of an ordinary clip: one segment that spans it.
    fn from(contents: &Contents) -> Take {
        let duration_s = f64::from(contents.info.duration_s);
        let segment = Segment {
            start_s: 0.0,
            duration_s,
            level: 0,
            offset: 0,
            head_crc: contents.head_crc,
            layers: prefixes(contents),
        };
        Take {
            version_minor: contents.version_minor,
            info: contents.info.clone(),
            duration_s,
            bounds: contents.bounds,
            coder: contents.coder,
            sh_degree: contents.sh_degree,
            motion_order: contents.motion_order,
            rotation_rates: contents.rotation_rates,
            filter: contents.filter,
            plate_len: contents.plate_len,
            plate_sh_degree: contents.plate_sh_degree,
            plate_filter: contents.plate_filter,
            by_device: contents.by_device,
            near: contents.near,
            table_bytes: size_of::<Segment>() + segment.layers.len() * size_of::<SegmentLayer>(),
            segments: vec![segment],
            head_bytes: 0,
        }
    }
}

impl From<&Clip> for Take {
    /// The take of a decoded clip: one segment that spans it, without bytes.
    fn from(clip: &Clip) -> Take {
        let duration_s = f64::from(clip.info.duration_s);
        let temporal = clip.dynamic_field.temporal.as_ref();
        let plate = clip.plate.as_ref().filter(|plate| !plate.is_empty());
        let plate_len = plate.map_or(0, Field::len);
        let layer = |end: &LayerEnd| SegmentLayer { bytes: 0, gaussians: end.total() + plate_len };
        let layers = clip.layers_announced.iter().map(layer).collect();
        let segment = Segment { start_s: 0.0, duration_s, level: 0, offset: 0, head_crc: 0, layers };
        Take {
            version_minor: VERSION_MINOR,
            info: clip.info.clone(),
            duration_s,
            bounds: clip.bounds,
            coder: Coder::default(),
            sh_degree: clip.sh_degree(),
            motion_order: temporal.map_or(0, |temporal| temporal.motion_order),
            rotation_rates: temporal.is_some_and(|temporal| temporal.rotation_rates.is_some()),
            filter: clip.filter(),
            plate_len,
            plate_sh_degree: plate.map_or(0, |plate| plate.sh_degree),
            plate_filter: plate.map_or(PixelFilter::default(), |plate| plate.filter),
            by_device: false,
            near: clip.near(),
            table_bytes: 0,
            segments: vec![segment],
            head_bytes: 0,
        }
    }
}

/// The prefixes of a clip package that end with a layer; the last is the whole package.
pub(crate) fn prefixes(contents: &Contents) -> Vec<SegmentLayer> {
    let mut bytes = contents.layer_bytes();
    // Sections of unknown kinds may follow the last layer.
    if let Some(last) = bytes.last_mut() {
        *last = contents.package_bytes();
    }
    let prefix = |(bytes, end): (usize, &crate::LayerEnd)| SegmentLayer {
        bytes,
        gaussians: end.total() + contents.plate_len,
    };
    bytes.into_iter().zip(&contents.layers).map(prefix).collect()
}

/// Compares two spans, `(start, duration)` in seconds, in the order of a table for a take of `duration_s` seconds.
fn compare_spans(duration_s: f64, a: (f64, f64), b: (f64, f64)) -> Ordering {
    let spans_take = |(start, duration): (f64, f64)| start <= 0.0 && start + duration >= duration_s;
    let order = |x: f64, y: f64| x.partial_cmp(&y).unwrap_or(Ordering::Equal);
    spans_take(b).cmp(&spans_take(a)).then(order(a.0, b.0)).then(order(b.1, a.1))
}

/// Returns the order in which a take of `duration_s` seconds stores segments with these spans, `(start,
/// duration)` in
/// seconds, as numbers of spans.
#[cfg(feature = "encode")]
pub fn take_order(duration_s: f64, spans: &[(f64, f64)]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..spans.len()).collect();
    order.sort_by(|&a, &b| compare_spans(duration_s, spans[a], spans[b]));
    order
}
