//! [`OpenTake`]: a take whose head is in memory, and whose segments are read and decoded one at a time.

use std::num::NonZero;
use std::path::Path;
use std::sync::OnceLock;
use std::thread;

use codec::{Clip, Error, FormatError, LayerEnd, Layers, Limits, PixelFilter, Surroundings, Take, package};
use glam::DVec3;
use program::{Fault, Subject};
use shaders::{Features, Motion};

use super::layers::Traffic;
use super::plan::{Want, rows_wanted, span};
use super::source::TakeSource;
use crate::audio::SoundTrack;
use crate::clips::advice;
use crate::gpu::{PackedLayers, PackedSegment, PlateLayout, TakeLayout};

/// Bytes that are read to find a head: heads of clips, and of takes of some 500 segments.
const HEAD_BYTES: u64 = 32 << 10;

/// Parts of the memory that a decoder may use: what is resident, one segment that waits for room, one that waits for
/// the player, and one that is decoded.
const MEMORY_PARTS: usize = 4;

/// Plates that are resident at once: the drawn plate, and the next.
const PLATES: usize = 2;

/// What was loaded of a segment.
pub(super) enum PackedWant {
    /// The segment with its first layers.
    Segment(Box<PackedSegment>),
    /// Layers behind those that were loaded before.
    Layers(Box<PackedLayers>),
}

/// A take whose head is in memory.
#[derive(Debug)]
pub struct OpenTake {
    pub(crate) take: Take,
    source: TakeSource,
    /// Number of layers of each segment that the file holds; 0 for a segment beyond its end.
    layers: Vec<usize>,
    limits: Limits,
    /// The sounds of the segments that were loaded.
    pub(crate) sound: SoundTrack,
    subject: OnceLock<Subject>,
}

impl OpenTake {
    /// Opens a file if it is a take; `None` if it is anything else.
    ///
    /// # Errors
    /// [`Fault::Data`] if it is a take that cannot be read, or one too large for `limits`.
    pub fn open(path: &Path, limits: &Limits) -> Result<Option<OpenTake>, Fault> {
        OpenTake::from_source(TakeSource::open(path)?, limits)
    }

    /// As [`OpenTake::open`], of any source.
    ///
    /// # Errors
    /// As there; [`Fault::Network`] if its head does not arrive.
    pub(crate) fn from_source(source: TakeSource, limits: &Limits) -> Result<Option<OpenTake>, Fault> {
        let fault = |reason: String| Fault::Data(format!("{}: {reason}", source.name()));
        let mut head = source.read(0..HEAD_BYTES)?;
        let found = match package(&head, limits) {
            Err(Error::Format { error: FormatError::Truncated { needed, .. }, .. })
                if needed > head.len() && needed <= limits.max_bytes =>
            {
                head = source.read(0..needed as u64)?;
                package(&head, limits)
            }
            found => found,
        };
        let take = match found {
            // What is wrong with anything else, a clip's decoder says.
            Ok(take) if take.head_bytes == 0 => return Ok(None),
            Ok(take) => take,
            Err(_) if !looks_like_take(&head) => return Ok(None),
            Err(error) => return Err(fault(format!("{error}: {}", advice(&error, "copy it again")))),
        };
        let package_bytes = take.package_bytes();
        let length = source.length()?.unwrap_or(package_bytes);
        if length > package_bytes {
            let rest = length - package_bytes;
            return Err(fault(format!("{rest} extra bytes after the last segment: copy it again")));
        }
        let most = limits.max_bytes / MEMORY_PARTS;
        if let Some(segment) = take.segments.iter().find(|segment| segment.bytes() > most) {
            return Err(fault(format!(
                "the segment at {:.3} s has {} MiB, and at most {} are read: package it with a smaller --budget",
                segment.start_s,
                segment.bytes() >> 20,
                most >> 20
            )));
        }
        if take.resident_max() > limits.max_gaussians {
            return Err(fault(format!(
                "{} Gaussians at one instant, and at most {} are played: package it with a smaller --budget",
                take.resident_max(),
                limits.max_gaussians
            )));
        }
        let layers = layers_within(&take, length);
        if layers.iter().all(|layers| *layers == 0) {
            return Err(fault("the file is cut short before its first layer ends: copy it again".into()));
        }
        let (sound, subject) = (SoundTrack::default(), OnceLock::new());
        let mut opened = OpenTake { take, source, layers, limits: *limits, sound, subject };
        if opened.take.info.viewpoints.is_empty() {
            opened.subject = Subject::with_opening(&opened.surroundings(), &mut opened.take.info).into();
        }
        Ok(Some(opened))
    }

    /// Name of the take for messages.
    pub(crate) fn name(&self) -> String {
        self.source.name()
    }

    /// Number of layers of each segment that can be loaded; 0 for a segment that is missing.
    pub(crate) fn layers(&self) -> &[usize] {
        &self.layers
    }

    /// Says that the file is cut short, if it is.
    pub(crate) fn truncation(&self) -> Option<String> {
        let all = |(segment, layers): (&codec::Segment, &usize)| segment.layers.len() == *layers;
        let (count, whole) = (
            self.layers.len(),
            self.take.segments.iter().zip(&self.layers).filter(|pair| all(*pair)).count(),
        );
        (whole < count).then(|| {
            let name = self.name();
            format!(
                "{name}: the file is cut short, {whole} of {count} segments are whole: copy it again for the rest"
            )
        })
    }

    /// Number of Gaussians of all segments in their first k layers, for k from 1; plates are counted in each.
    pub(crate) fn layer_ends(&self) -> Vec<usize> {
        let most = self.take.segments.iter().map(|segment| segment.layers.len()).max().unwrap_or(1);
        let end = |layers: usize| {
            let ends = self.take.segments.iter().filter_map(|segment| {
                segment.layers.get(layers - 1).or(segment.layers.last()).map(|layer| layer.gaussians)
            });
            ends.fold(0, usize::saturating_add)
        };
        (1..=most).map(end).collect()
    }

    /// The time and view that stand for the take; `None` if it states none that can be read.
    #[cfg(not(target_os = "android"))]
    pub(crate) fn poster(&self) -> Option<codec::Poster> {
        let first = self.take.segments.first()?;
        let length = first.layers.first()?.bytes as u64;
        let start = self.source.read(0..first.offset.saturating_add(length)).ok()?;
        codec::poster(&start, &self.limits).ok().flatten()
    }

    /// The upright frame of the take at its start. Found by the first call, which belongs on a thread that loads.
    pub(crate) fn subject(&self) -> Subject {
        *self.subject.get_or_init(|| Subject::new(&self.take.info, &self.surroundings()))
    }

    /// Those at the start, by the first layers there that can be decoded.
    fn surroundings(&self) -> Surroundings {
        let wants = self.take.at(0.0).filter(|&segment| self.layers[segment] > 0);
        let clips: Vec<(usize, Clip)> = wants
            .map(|segment| Want { segment, from: 0, layers: 1 })
            .filter_map(|want| Some((want.segment, self.decode_segment(want, &self.read(want).ok()?).ok()?)))
            .collect();
        self.take.surroundings(&clips)
    }

    /// The layout of the take in GPU memory: rows for what playing wants at any instant, and for gaps between segments of
    /// the size of the largest.
    pub(crate) fn layout(&self) -> TakeLayout {
        let largest = self.take.segments.iter().map(|segment| segment.gaussians()).max().unwrap_or(0);
        let rows = rows_wanted(&self.take).saturating_add(largest);
        let Take { bounds, plate_len, .. } = self.take;
        let [low, high] = bounds.map(|corner| DVec3::from_array(corner.map(f64::from)));
        let features = |sh_degree, motion, filter| Features {
            sh_degree,
            motion,
            mip: filter == PixelFilter::Mip,
            segmented: true,
        };
        let motion = Motion { order: self.take.motion_order, rotates: self.take.rotation_rates };
        let layout = TakeLayout {
            features: features(self.take.sh_degree, Some(motion), self.take.filter),
            near: self.take.near,
            origin: 0.5 * (low + high),
            bounds,
            room: LayerEnd::default(),
            duration_s: self.take.duration_s,
            plate: (plate_len > 0).then(|| PlateLayout {
                features: features(self.take.plate_sh_degree, None, self.take.plate_filter),
                rows: PLATES * plate_len,
            }),
        };
        layout.with_rows(rows.min(self.limits.max_gaussians).max(self.take.resident_max()))
    }

    /// Whether the file is another version by now. Asks the disk, but no server.
    pub(super) fn is_replaced(&self) -> bool {
        self.source.is_replaced()
    }

    /// Whether another version that was found is complete, as far as can be told.
    pub(super) fn has_settled(&self) -> bool {
        self.source.has_settled()
    }

    /// Whether it comes from a server, part by part.
    pub(super) fn has_ranges(&self) -> bool {
        self.source.has_ranges()
    }

    /// Ends a read that waits for a server, and those that follow, until [`OpenTake::resume`].
    pub(super) fn cancel(&self) {
        self.source.cancel();
    }

    /// Ends a read that waits for a server for good.
    pub(super) fn close(&self) {
        self.source.close();
    }

    /// Takes back [`OpenTake::cancel`].
    pub(super) fn resume(&self) {
        self.source.resume();
    }

    /// Reads, decodes and packs the wanted layers of a segment. Also returns what came from a server for them.
    ///
    /// # Errors
    /// [`Fault::Data`] with the place of the segment in the take; [`Fault::Network`] if it does not arrive.
    pub(super) fn load(&self, want: Want, layout: &TakeLayout) -> Result<(PackedWant, Traffic), Fault> {
        let span = span(&self.take.segments[want.segment]);
        let before = self.source.traffic();
        let bytes = self.read(want)?;
        let traffic = self.source.traffic() - before;
        if want.from == 0 {
            self.add_sound(want.segment, &bytes);
        }
        let packed = match want.from {
            0 => PackedSegment::new(&self.decode_segment(want, &bytes)?, span, layout)
                .map(|segment| PackedWant::Segment(Box::new(segment))),
            _ => PackedLayers::new(&self.decode_layers(want, &bytes)?, span, layout)
                .map(|layers| PackedWant::Layers(Box::new(layers))),
        };
        Ok((packed.map_err(|fault| fault.about(&self.name()))?, traffic))
    }

    /// Adds the sound of a segment to the track. What is wrong with its head, the decoder says.
    fn add_sound(&self, index: usize, bytes: &[u8]) {
        let limits = self.segment_limits();
        if let Ok(head) = self.take.segment_contents(index, bytes, &limits) {
            self.sound.add(&head, bytes, &limits, index, self.take.segments[index].start_s);
        }
    }

    /// Reads the segment up to the wanted layers, with the layers before, which a cache has.
    fn read(&self, want: Want) -> Result<Vec<u8>, Fault> {
        let segment = &self.take.segments[want.segment];
        let length = segment.layers[want.layers - 1].bytes;
        let bytes = self.source.read(segment.offset..segment.offset.saturating_add(length as u64))?;
        if bytes.len() < length {
            // Its first layers alone would decode without an error.
            return Err(self.segment_fault(want, "the file was cut short while it played: open it again"));
        }
        Ok(bytes)
    }

    fn decode_segment(&self, want: Want, bytes: &[u8]) -> Result<Clip, Fault> {
        let decoded = self.take.decode_segment(want.segment, bytes, &self.segment_limits(), threads());
        decoded.map_err(|error| self.undecodable(want, &error))
    }

    fn decode_layers(&self, want: Want, bytes: &[u8]) -> Result<Layers, Fault> {
        let Want { segment, from, .. } = want;
        let decoded =
            self.take.decode_segment_layers(segment, bytes, from, &self.segment_limits(), threads());
        decoded.map_err(|error| self.undecodable(want, &error))
    }

    /// The limits of a segment.
    fn segment_limits(&self) -> Limits {
        Limits { max_bytes: self.limits.max_bytes / MEMORY_PARTS, ..self.limits }
    }

    fn undecodable(&self, want: Want, error: &Error) -> Fault {
        let advice = match error {
            Error::Format { error: FormatError::Segment { .. } | FormatError::Magic, .. } => {
                "the file is another one or damaged: open it again"
            }
            error => advice(error, "copy it again"),
        };
        self.segment_fault(want, &format!("{error}: {advice}"))
    }

    fn segment_fault(&self, want: Want, reason: &str) -> Fault {
        let (name, number) = (self.name(), want.segment);
        let start_s = self.take.segments[number].start_s;
        Fault::Data(format!("{name}: segment {number}, at {start_s:.3} s: {reason}"))
    }
}

/// Threads that decode: all but the thread that draws.
fn threads() -> NonZero<usize> {
    let all = thread::available_parallelism().map_or(1, NonZero::get);
    NonZero::new(all - 1).unwrap_or(NonZero::<usize>::MIN)
}

/// Whether `bytes` begin as a take does, right or wrong.
fn looks_like_take(bytes: &[u8]) -> bool {
    const LAYERS_OFFSET: usize = 64;
    bytes.starts_with(b"AARC") && bytes.get(LAYERS_OFFSET) == Some(&0)
}

/// Number of layers of each segment in the first `length` bytes of a take.
fn layers_within(take: &Take, length: u64) -> Vec<usize> {
    let layers = |segment: &codec::Segment| {
        let is_within =
            |layer: &&codec::SegmentLayer| segment.offset.saturating_add(layer.bytes as u64) <= length;
        segment.layers.iter().take_while(is_within).count()
    };
    take.segments.iter().map(layers).collect()
}

#[cfg(test)]
mod tests;
