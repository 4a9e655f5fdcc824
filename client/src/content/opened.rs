//! [`OpenTake`]: what plays: a take whose head is in memory, and whose segments are read and decoded one at a time. A clip
//! is a take of one segment, and so is a field of another program.

use std::num::NonZero;
#[cfg(feature = "xr")]
use std::ops::ControlFlow;
use std::path::Path;
#[cfg(feature = "xr")]
use std::sync::Arc;
use std::sync::{Mutex, OnceLock, PoisonError};
use std::thread;

use codec::{
    Clip, ClipInfo, Error, FormatError, LayerEnd, Layers, Limits, PixelFilter, Surroundings, Take, package,
};
use glam::DVec3;
use program::{Fault, Subject};
use shaders::{Features, Motion};

use super::advice::advice;
use super::plan::{Want, rows_wanted, span};
use super::progress::Traffic;
use super::source::TakeSource;
use crate::audio::SoundTrack;
use crate::gpu::{PackedLayers, PackedSegment, PlateLayout, TakeLayout};
#[cfg(feature = "xr")]
use crate::worker::apart;

/// Bytes that are read first: they say how long the head is.
const HEAD_BYTES: usize = 16;

/// Parts of the memory that a decoder may use: what is resident, one segment that waits for room, one that waits for
/// the player, and one that is decoded.
const MEMORY_PARTS: usize = 4;

/// Plates that are resident at once: the drawn plate, and the next.
const PLATES: usize = 2;

/// What was loaded of a segment.
pub(crate) struct Loaded {
    /// What was wanted, or more layers of it.
    pub(crate) want: Want,
    pub(crate) packed: PackedWant,
    /// What came from a server for it.
    pub(crate) traffic: Traffic,
}

/// Why layers of a segment cannot be loaded.
#[derive(Debug)]
pub(crate) enum LoadError {
    /// They cannot be read. A network or a disk that comes back has them.
    Unread(Fault),
    /// What was read cannot be decoded or packed, and will not be when it is read again.
    Damaged(Fault),
}

impl LoadError {
    /// The fault to end with.
    pub(crate) fn into_fault(self) -> Fault {
        let (LoadError::Unread(fault) | LoadError::Damaged(fault)) = self;
        fault
    }
}

/// Layers of a segment, packed.
pub(crate) enum PackedWant {
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
    layout: TakeLayout,
    /// The first layers of the only segment, until they are loaded.
    decoded: Mutex<Option<Clip>>,
    /// A field without a package: the only segment.
    field: Option<Clip>,
    /// The sounds of the segments that were loaded.
    pub(crate) sound: SoundTrack,
    subject: OnceLock<Subject>,
}

impl OpenTake {
    /// Opens a file.
    ///
    /// # Errors
    /// [`Fault::Data`] if it cannot be read, or is too large for `limits`.
    pub fn open(path: &Path, limits: &Limits) -> Result<OpenTake, Fault> {
        if path.is_dir() {
            let path = path.display();
            return Err(Fault::Data(format!("{path}: is a folder: name an .aarc file in it")));
        }
        OpenTake::from_source(TakeSource::open(path)?, limits)
    }

    /// As [`OpenTake::open`], of any source. Of a take of one segment the first layers are decoded, or all layers if its
    /// file is at hand.
    ///
    /// # Errors
    /// As there; [`Fault::Network`] if its head or these layers do not arrive.
    pub(crate) fn from_source(source: TakeSource, limits: &Limits) -> Result<OpenTake, Fault> {
        let (take, head) = read_head(&source, limits)?;
        let is_only = take.segments.len() == 1;
        source.set_head(&head, is_only);
        let fault = |reason: String| Fault::Data(format!("{}: {reason}", source.name()));
        let package_bytes = take.package_bytes();
        let length = source.length()?.unwrap_or(package_bytes);
        // A server may announce more than it sends.
        if length > package_bytes && !source.is_remote() {
            let rest = length - package_bytes;
            return Err(fault(format!("{rest} extra bytes after the last segment: copy it again")));
        }
        let most = limits.max_bytes / memory_parts(&take);
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
            let remedy = source.remedy();
            return Err(fault(format!("the file is cut short before its first layer ends: {remedy}")));
        }
        let mut opened = OpenTake::new(take, source, layers, limits);
        if let [layers] = opened.layers[..] {
            let want =
                Want { segment: 0, from: 0, layers: if opened.source.is_remote() { 1 } else { layers } };
            let (clip, bytes) = opened.read_segment(want).map_err(LoadError::into_fault)?;
            opened.add_sound(0, &bytes);
            opened.set_only(&clip);
            opened.decoded = Mutex::new(Some(clip));
        }
        opened.find_opening()?;
        opened.source.on_opened(length >= package_bytes);
        Ok(opened)
    }

    /// A decoded clip without a package, named `name` in messages.
    ///
    /// # Errors
    /// None: nothing is read.
    #[cfg(feature = "formats")]
    pub(crate) fn from_clip(name: String, clip: Clip, limits: &Limits) -> Result<OpenTake, Fault> {
        let source = TakeSource::Memory(name, (&[][..]).into());
        let mut opened = OpenTake::new(Take::from(&clip), source, vec![clip.layers.len()], limits);
        opened.set_only(&clip);
        opened.field = Some(clip);
        opened.find_opening()?;
        Ok(opened)
    }

    /// Nothing is decoded yet. `layers` is the number of layers of each segment that `source` holds.
    fn new(take: Take, source: TakeSource, layers: Vec<usize>, limits: &Limits) -> OpenTake {
        OpenTake {
            layout: layout(&take, limits),
            take,
            source,
            layers,
            limits: *limits,
            decoded: Mutex::default(),
            field: None,
            sound: SoundTrack::default(),
            subject: OnceLock::new(),
        }
    }

    /// Takes in what the only segment has, by its first layers: no room is left for anything else.
    fn set_only(&mut self, clip: &Clip) {
        self.layout = TakeLayout { duration_s: self.take.duration_s, ..TakeLayout::for_clip(clip) };
    }

    /// Adds the opening view to a take without viewpoints.
    fn find_opening(&mut self) -> Result<(), Fault> {
        if self.take.info.viewpoints.is_empty() {
            self.subject = Subject::with_opening(&self.surroundings()?, &mut self.take.info).into();
        }
        Ok(())
    }

    /// Axes, frames per second, viewpoints. There is at least one viewpoint.
    pub(crate) fn info(&self) -> &ClipInfo {
        &self.take.info
    }

    /// Duration in seconds.
    pub(crate) fn duration_s(&self) -> f64 {
        self.take.duration_s
    }

    /// Most layers of a segment that the file holds.
    pub(crate) fn layer_count(&self) -> usize {
        self.layers.iter().copied().max().unwrap_or(0)
    }

    /// Number of Gaussians of all segments, plates included.
    pub(crate) fn gaussians(&self) -> usize {
        self.layer_ends().last().copied().unwrap_or(0)
    }

    /// Whether there is nothing to play: the image is the same at all times, and silent.
    #[cfg(any(test, feature = "window", feature = "xr"))]
    pub(crate) fn is_static(&self) -> bool {
        let TakeLayout { features, room, .. } = self.layout;
        // Of several segments, only their heads say. One with sound plays, although nothing moves.
        !features.segmented && room.dynamic_count == 0 && self.sound.is_empty()
    }

    /// Name of the take for messages.
    pub(crate) fn name(&self) -> String {
        self.source.name()
    }

    /// Number of layers of each segment that can be loaded; 0 for a segment that is missing.
    pub fn layers(&self) -> &[usize] {
        &self.layers
    }

    /// Says that the file is cut short, if it is.
    pub(crate) fn truncation(&self) -> Option<String> {
        let all = |(segment, layers): (&codec::Segment, &usize)| segment.layers.len() == *layers;
        let (count, whole) = (
            self.layers.len(),
            self.take.segments.iter().zip(&self.layers).filter(|pair| all(*pair)).count(),
        );
        let there = match (self.layers.as_slice(), self.take.segments.as_slice()) {
            ([layers], [segment]) => format!("{layers} of {} layers play", segment.layers.len()),
            _ => format!("{whole} of {count} segments are whole"),
        };
        (whole < count)
            .then(|| format!("{}: the file is cut short, {there}: copy it again for the rest", self.name()))
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
        let start = self.source.read(0..layer_end(first, first.layers.first()?)).ok()?;
        codec::poster(&start, &self.limits).ok().flatten()
    }

    /// The upright frame of the take at its start. Found by the first call, which may read: it belongs on a thread that
    /// loads, before a player does.
    ///
    /// # Errors
    /// As [`TakeSource::read`]; the next call reads again.
    pub(crate) fn subject(&self) -> Result<Subject, Fault> {
        if let Some(subject) = self.subject.get() {
            return Ok(*subject);
        }
        let subject = Subject::new(&self.take.info, &self.surroundings()?);
        Ok(*self.subject.get_or_init(|| subject))
    }

    /// As [`OpenTake::subject`], until it `is_overtaken`, which is looked at every 50 ms. The take is closed then.
    ///
    /// # Errors
    /// As there; [`Fault::Network`] if it is overtaken.
    #[cfg(feature = "xr")]
    pub(crate) fn subject_unless(
        self: &Arc<OpenTake>,
        is_overtaken: &dyn Fn() -> bool,
    ) -> Result<Subject, Fault> {
        let ours = self.clone();
        let found = apart(move |_| ours.subject(), &mut |()| ControlFlow::Continue(()), is_overtaken)
            .map_err(|error| Fault::Device(format!("cannot start a thread: {error}")))?;
        found.unwrap_or_else(|| {
            self.source.close();
            Err(Fault::Network("cancelled".into()))
        })
    }

    /// Those at the start, by the first layers there that can be decoded.
    fn surroundings(&self) -> Result<Surroundings, Fault> {
        if let Some(clip) = &self.field {
            return Ok(clip.surroundings());
        }
        if let Some(clip) = &*self.decoded.lock().unwrap_or_else(PoisonError::into_inner) {
            return Ok(clip.surroundings());
        }
        let mut clips = Vec::new();
        for segment in self.take.at(0.0).filter(|&segment| self.layers[segment] > 0) {
            match self.read_segment(Want { segment, from: 0, layers: 1 }) {
                Ok((clip, _)) => clips.push((segment, clip)),
                Err(LoadError::Unread(fault)) => return Err(fault),
                // The rest plays.
                Err(LoadError::Damaged(_)) => {}
            }
        }
        Ok(self.take.surroundings(&clips))
    }

    /// Reads and decodes the first `layers` layers of a segment.
    ///
    /// # Errors
    /// [`Fault::Data`] with the place of the segment in the take; [`Fault::Network`] if it does not arrive.
    ///
    /// # Panics
    /// If there is no such segment, or it has fewer layers.
    pub fn segment(&self, segment: usize, layers: usize) -> Result<Clip, Fault> {
        let read = self.read_segment(Want { segment, from: 0, layers });
        read.map(|(clip, _)| clip).map_err(LoadError::into_fault)
    }

    /// The layout in GPU memory.
    pub(crate) fn layout(&self) -> TakeLayout {
        self.layout
    }

    /// Where its bytes come from.
    pub(crate) fn source(&self) -> &TakeSource {
        &self.source
    }

    /// Whether the file is another version by now. Asks the disk, but no server.
    pub fn is_replaced(&self) -> bool {
        self.source.is_replaced()
    }

    /// Reads, decodes and packs the wanted layers of a segment, or more if these were decoded before.
    ///
    /// # Errors
    /// [`LoadError::Unread`] as [`TakeSource::read`]; [`LoadError::Damaged`] with the place of the segment in the take.
    pub(crate) fn load(&self, want: Want) -> Result<Loaded, LoadError> {
        let layout = &self.layout;
        let span = span(&self.take.segments[want.segment]);
        let named = |fault: Fault| LoadError::Damaged(fault.about(&self.name()));
        let segment = |clip: &Clip| {
            PackedSegment::new(clip, span, layout).map(|segment| PackedWant::Segment(Box::new(segment)))
        };
        if want.from == 0 {
            let decoded = self.decoded.lock().unwrap_or_else(PoisonError::into_inner).take();
            if let Some(clip) = decoded.as_ref().or(self.field.as_ref()) {
                let want = Want { layers: clip.layers.len(), ..want };
                return Ok(Loaded {
                    want,
                    packed: segment(clip).map_err(named)?,
                    traffic: Traffic::default(),
                });
            }
        }
        let before = self.source.traffic();
        let packed = match want.from {
            0 => {
                let (clip, bytes) = self.read_segment(want)?;
                self.add_sound(want.segment, &bytes);
                segment(&clip)
            }
            _ => PackedLayers::new(&self.read_layers(want)?, span, layout)
                .map(|layers| PackedWant::Layers(Box::new(layers))),
        };
        let traffic = self.source.traffic() - before;
        Ok(Loaded { want, packed: packed.map_err(named)?, traffic })
    }

    /// Adds the sound of a segment to the track. What is wrong with its head, the decoder says.
    fn add_sound(&self, index: usize, bytes: &[u8]) {
        let limits = self.segment_limits();
        if let Ok(head) = self.take.segment_contents(index, bytes, &limits) {
            self.sound.add(&head, bytes, &limits, index, self.take.segments[index].start_s);
        }
    }

    /// Reads the segment up to the wanted layers, with the layers before, which a cache has.
    fn read(&self, want: Want) -> Result<Vec<u8>, LoadError> {
        let start = self.take.segments[want.segment].offset;
        let ends = self.layer_ends_of(want);
        let bytes = self.source.read_parts(start, &ends).map_err(LoadError::Unread)?;
        if ends.last().is_some_and(|end| (bytes.len() as u64) < end - start) {
            // Its first layers alone would decode without an error.
            return Err(self.damaged(want, "the file was cut short while it played: open it again"));
        }
        Ok(bytes)
    }

    /// Offsets in the file of the ends of the wanted layers of a segment, and of the layers before.
    fn layer_ends_of(&self, want: Want) -> Vec<u64> {
        let segment = &self.take.segments[want.segment];
        segment.layers[..want.layers].iter().map(|layer| layer_end(segment, layer)).collect()
    }

    /// Reads and decodes a segment up to the wanted layers; also returns its bytes.
    fn read_segment(&self, want: Want) -> Result<(Clip, Vec<u8>), LoadError> {
        let limits = self.segment_limits();
        self.read_decoded(want, |bytes| self.take.decode_segment(want.segment, bytes, &limits, threads()))
    }

    /// Reads and decodes the wanted layers of a segment alone.
    fn read_layers(&self, want: Want) -> Result<Layers, LoadError> {
        let (Want { segment, from, .. }, limits) = (want, self.segment_limits());
        let decode = |bytes: &[u8]| self.take.decode_segment_layers(segment, bytes, from, &limits, threads());
        self.read_decoded(want, decode).map(|(layers, _)| layers)
    }

    /// Reads the wanted layers and decodes them, and reads them again where the source says so. Also returns their
    /// bytes.
    fn read_decoded<T>(
        &self,
        want: Want,
        decode: impl Fn(&[u8]) -> Result<T, Error>,
    ) -> Result<(T, Vec<u8>), LoadError> {
        let segment = &self.take.segments[want.segment];
        let ends = self.layer_ends_of(want);
        loop {
            let bytes = self.read(want)?;
            match decode(&bytes) {
                Ok(decoded) => {
                    let is_last = want.layers == segment.layers.len();
                    self.source.on_decoded(segment.offset, &ends, want.from, is_last);
                    return Ok((decoded, bytes));
                }
                Err(error)
                    if contradicts_checksums(&error) && self.source.on_undecodable(segment.offset, &ends) => {
                }
                Err(error) => return Err(self.undecodable(want, &error)),
            }
        }
    }

    /// The limits of a segment.
    fn segment_limits(&self) -> Limits {
        Limits { max_bytes: self.limits.max_bytes / memory_parts(&self.take), ..self.limits }
    }

    fn undecodable(&self, want: Want, error: &Error) -> LoadError {
        let advice = match error {
            Error::Format { error: FormatError::Segment { .. } | FormatError::Magic, .. } => {
                "the file is another one or damaged: open it again"
            }
            error => advice(error, self.source.remedy()),
        };
        self.damaged(want, &format!("{error}: {advice}"))
    }

    fn damaged(&self, want: Want, reason: &str) -> LoadError {
        let (name, number) = (self.name(), want.segment);
        let start_s = self.take.segments[number].start_s;
        let place = match self.take.segments.len() {
            1 => String::new(),
            _ => format!("segment {number}, at {start_s:.3} s: "),
        };
        LoadError::Damaged(Fault::Data(format!("{name}: {place}{reason}")))
    }
}

/// Whether bytes with this error are others than the checksums of the head announce. What these confirm would be the same
/// if it was read again.
fn contradicts_checksums(error: &Error) -> bool {
    match error {
        Error::Format { error, .. } => matches!(
            error,
            FormatError::Crc { .. }
                | FormatError::Segment { .. }
                // Found before a checksum is.
                | FormatError::Magic
                | FormatError::Truncated { .. }
        ),
        Error::Version { .. } => true,
        Error::Limits { .. } => false,
    }
}

/// Threads that decode: all but the thread that draws.
fn threads() -> NonZero<usize> {
    let all = thread::available_parallelism().map_or(1, NonZero::get);
    NonZero::new(all - 1).unwrap_or(NonZero::<usize>::MIN)
}

/// Reads the head of a package; also returns its bytes.
fn read_head(source: &TakeSource, limits: &Limits) -> Result<(Take, Vec<u8>), Fault> {
    let mut head = source.read(0..HEAD_BYTES as u64)?;
    let found = loop {
        match package(&head, limits) {
            Err(Error::Format { error: FormatError::Truncated { needed, .. }, .. })
                if needed > limits.max_bytes =>
            {
                let limit = limits.max_bytes;
                break Err(Error::Limits { offset: 0, quantity: "bytes", needed, limit });
            }
            Err(Error::Format { error: FormatError::Truncated { needed, .. }, .. })
                if needed > head.len() =>
            {
                let longer = source.read(0..needed as u64)?;
                if longer.len() == head.len() {
                    break package(&head, limits);
                }
                head = longer;
            }
            found => break found,
        }
    };
    let take = found.map_err(|error| {
        let reason = match error {
            Error::Format { error: FormatError::Magic, .. } => source.format_reason(&head),
            _ => format!("{error}: {}", advice(&error, source.remedy())),
        };
        Fault::Data(format!("{}: {reason}", source.name()))
    })?;
    Ok((take, head))
}

/// Into how many parts the memory of the decoder is divided. The only segment has all of it.
fn memory_parts(take: &Take) -> usize {
    if take.segments.len() == 1 { 1 } else { MEMORY_PARTS }
}

/// The layout of a take of several segments in GPU memory: rows for what playing wants at any instant, and for gaps between
/// segments of the size of the largest.
fn layout(take: &Take, limits: &Limits) -> TakeLayout {
    let largest = take.segments.iter().map(|segment| segment.gaussians()).max().unwrap_or(0);
    let rows = rows_wanted(take).saturating_add(largest);
    let [low, high] = take.bounds.map(|corner| DVec3::from_array(corner.map(f64::from)));
    let features = |sh_degree, motion, filter| Features {
        sh_degree,
        motion,
        mip: filter == PixelFilter::Mip,
        segmented: true,
    };
    let motion = Motion { order: take.motion_order, rotates: take.rotation_rates };
    let layout = TakeLayout {
        features: features(take.sh_degree, Some(motion), take.filter),
        near: take.near,
        origin: 0.5 * (low + high),
        bounds: take.bounds,
        room: LayerEnd::default(),
        duration_s: take.duration_s,
        plate: (take.plate_len > 0).then(|| PlateLayout {
            features: features(take.plate_sh_degree, None, take.plate_filter),
            rows: PLATES * take.plate_len,
        }),
    };
    layout.with_rows(rows.min(limits.max_gaussians).max(take.resident_max()))
}

/// Offset in the file of the end of a layer.
fn layer_end(segment: &codec::Segment, layer: &codec::SegmentLayer) -> u64 {
    segment.offset.saturating_add(layer.bytes as u64)
}

/// Number of layers of each segment in the first `length` bytes of a take.
fn layers_within(take: &Take, length: u64) -> Vec<usize> {
    let layers = |segment: &codec::Segment| {
        let is_within = |layer: &&codec::SegmentLayer| layer_end(segment, layer) <= length;
        segment.layers.iter().take_while(is_within).count()
    };
    take.segments.iter().map(layers).collect()
}

#[cfg(test)]
mod tests;
