//! [`Slots`]: the segments of a take in GPU memory, while it plays.
//!
//! Buffers have a fixed size. A segment takes a range of rows for all its layers, the first gap that is large enough. Its
//! layers come one after the other; their upload is spread over frames, and only complete ones are drawn.
//!
//! A range is written again while earlier frames may be drawn from it. That is safe: a queue runs writes and
//! submissions in the order of the calls, so what a submitted frame reads changes only after it. A frame that was prepared
//! but not yet submitted has no such place in the queue, hence the rule that slots change between frames. A picture that
//! another thread draws of the take holds its segments ([`GpuClip`] is shared), and their ranges wait for it.

use std::collections::VecDeque;
use std::ops::Range;
use std::sync::Arc;

use codec::{Clip, LayerEnd};
use program::Fault;
use shaders::{Features, ROW_BITS, SLOTS};

use super::device::Gpu;
use super::segment::{PackedLayers, PackedRun, PackedSegment, TakeLayout};
use super::span::Span;
use super::stages::alive::{LayerRows, Rows};
use super::stages::clip::{GaussianSet, GpuClip, GpuSegment, NO_SLOTS, Slot};
use super::stages::evaluate::Buffers;

// An instant of a take is held by no more segments.
const _: () = assert!(SLOTS as usize >= codec::RESIDENT_MAX);

/// A segment in [`Slots`]. Never equal to the id of another segment of the same take, also after its removal.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct SlotId {
    number: usize,
    /// Number of segments and layers that came before it.
    serial: u64,
}

/// The resident segments of a take. Change them between frames only: after one was submitted, before the next one is
/// prepared.
pub struct Slots {
    clip: Arc<GpuClip>,
    taken: [Option<Taken>; SLOTS as usize],
    /// Number of segments and layers that came so far.
    serials: u64,
}

/// A slot that is not free.
struct Taken {
    serial: u64,
    span: Span,
    /// Whether it was removed. A picture on another thread may still draw it.
    is_leaving: bool,
    clip: ResidentRows,
    plate: Option<ResidentRows>,
    /// What is uploaded, the first layers first.
    uploads: VecDeque<Upload>,
    /// Layers that are there or being uploaded end here.
    end: LayerEnd,
}

/// A segment's rows in the buffers of a set, with room for all its layers.
struct ResidentRows {
    rows: Range<usize>,
    first_dynamic: u32,
    motion_units: [f32; 3],
    room: Arc<()>,
    /// The layers that are complete, once the first are.
    drawn: Option<Arc<GpuSegment>>,
}

/// Layers on the way to the GPU.
struct Upload {
    /// Number of uploads that began before.
    serial: u64,
    clip: RunUpload,
    plate: Option<RunUpload>,
}

/// A [`PackedRun`], and the number of its bytes that are uploaded.
struct RunUpload {
    run: PackedRun,
    done: usize,
}

impl Slots {
    /// Buffers of a take of `layout`, without segments.
    ///
    /// # Errors
    /// [`Fault::Device`] if the buffers do not fit the device, or there is not enough memory.
    pub(super) fn new(gpu: &Gpu, layout: &TakeLayout) -> Result<Slots, Fault> {
        let set = |features: Features, room: LayerEnd, motion_units| {
            let rows = room.total();
            if features.segmented && rows > 1 << ROW_BITS {
                return Err(Fault::Device(format!(
                    "the take has {rows} Gaussians at once, and at most {} can be drawn: package it with a smaller \
                     --budget",
                    1 << ROW_BITS
                )));
            }
            Ok(GaussianSet { buffers: Buffers::new(gpu, features, room, motion_units)?, slots: NO_SLOTS })
        };
        let plate = layout.plate.map(|plate| {
            let room = LayerEnd { static_count: plate.rows, dynamic_count: 0 };
            set(plate.features, room, [1.0; 3])
        });
        let clip = GpuClip {
            origin: layout.origin,
            near: layout.near,
            duration_s: layout.duration_s,
            clip: set(layout.features, layout.room, layout.format().motion_units)?,
            plate: plate.transpose()?,
        };
        Ok(Slots { clip: Arc::new(clip), taken: [const { None }; SLOTS as usize], serials: 0 })
    }

    /// What is drawn: the complete segments.
    pub(super) fn clip(&self) -> &Arc<GpuClip> {
        &self.clip
    }

    /// Takes a slot for `packed`, and rows for all layers of its segment. [`Slots::upload`] then writes those that are
    /// packed. `None` if there is no room.
    pub fn insert(&mut self, packed: PackedSegment) -> Option<SlotId> {
        let (number, firsts) = self.place(&packed)?;
        let serial = self.next_serial();
        let PackedSegment { span, clip, plate, room, motion_units } = packed;
        let resident = |first: usize, count: usize, first_dynamic: usize, motion_units| ResidentRows {
            rows: first..first + count,
            // Rows are at most 2^26.
            first_dynamic: first_dynamic as u32,
            motion_units,
            room: Arc::default(),
            drawn: None,
        };
        let of_plate = |plate: &PackedRun| resident(firsts[1], plate.rows.len(), plate.rows.len(), [1.0; 3]);
        self.taken[number] = Some(Taken {
            serial,
            span,
            is_leaving: false,
            clip: resident(firsts[0], room.total(), room.static_count, motion_units),
            plate: plate.as_ref().map(of_plate),
            end: clip.rows.end(),
            uploads: [Upload { serial, clip: RunUpload::new(clip), plate: plate.map(RunUpload::new) }].into(),
        });
        Some(SlotId { number, serial })
    }

    /// Adds layers to the segment, which has room for them. They are drawn once [`Slots::upload`] has written them; those
    /// before are drawn until then and after.
    ///
    /// # Panics
    /// If the segment was removed, or they do not follow its last layer.
    pub fn append(&mut self, id: SlotId, layers: PackedLayers) {
        let serial = self.next_serial();
        let run = layers.run;
        let taken = self.taken[id.number].as_mut().filter(|taken| taken.serial == id.serial);
        let taken = taken.filter(|taken| !taken.is_leaving).expect("the segment is resident");
        assert_eq!(run.rows.before(), taken.end, "further layers follow the last one");
        taken.end = run.rows.end();
        taken.uploads.push_back(Upload { serial, clip: RunUpload::new(run), plate: None });
    }

    /// Whether there is room for `packed`.
    pub fn has_room(&mut self, packed: &PackedSegment) -> bool {
        self.place(packed).is_some()
    }

    /// Whether something still draws a removed segment.
    pub fn is_any_leaving(&self) -> bool {
        self.taken.iter().flatten().any(|taken| taken.is_leaving)
    }

    /// Writes at most `budget` bytes of what is not complete, what came first first, for the next submission. Returns the
    /// number of bytes.
    pub fn upload(&mut self, gpu: &Gpu, budget: usize) -> usize {
        let mut written = 0;
        while let Some(number) = self.next_upload() {
            let taken = self.taken[number].as_mut().expect("it is uploaded");
            let upload = taken.uploads.front_mut().expect("it is uploaded");
            written += upload.clip.write(gpu, &self.clip.clip.buffers, &taken.clip, budget - written);
            if let (Some(run), Some(rows), Some(set)) = (&mut upload.plate, &taken.plate, &self.clip.plate) {
                written += run.write(gpu, &set.buffers, rows, budget - written);
            }
            if ![Some(&upload.clip), upload.plate.as_ref()].into_iter().flatten().all(RunUpload::is_done) {
                break;
            }
            self.finish(number);
        }
        written
    }

    /// Whether the segment is drawn while its span holds the instant, by its first layers at least.
    pub fn is_drawn(&self, id: SlotId) -> bool {
        self.find(id).is_some_and(|taken| taken.clip.drawn.is_some())
    }

    /// Whether the segment is drawn with all layers that were inserted and appended.
    pub fn is_ready(&self, id: SlotId) -> bool {
        self.find(id).is_some_and(|taken| !taken.is_leaving && taken.uploads.is_empty())
    }

    /// Removes a segment; without effect if it was removed before.
    pub fn remove(&mut self, id: SlotId) {
        let Some(taken) = self.taken[id.number].as_mut().filter(|taken| taken.serial == id.serial) else {
            return;
        };
        taken.is_leaving = true;
        taken.uploads.clear();
        taken.clip.drawn = None;
        if let Some(plate) = &mut taken.plate {
            plate.drawn = None;
        }
        self.draw(id.number);
        self.sweep();
    }

    /// A free slot and the first rows for the clip and the plate of `packed`.
    fn place(&mut self, packed: &PackedSegment) -> Option<(usize, [usize; 2])> {
        self.sweep();
        let number = self.taken.iter().position(Option::is_none)?;
        let taken = self.taken.iter().flatten();
        let ranges = taken.clone().map(|taken| taken.clip.rows.clone());
        let clip = first_gap(ranges, packed.room.total(), self.clip.clip.buffers.rows)?;
        let ranges = taken.filter_map(|taken| taken.plate.as_ref()).map(|plate| plate.rows.clone());
        let plate = match (&packed.plate, &self.clip.plate) {
            (Some(plate), Some(set)) => first_gap(ranges, plate.rows.len(), set.buffers.rows)?,
            (None, _) => 0,
            (Some(_), None) => return None,
        };
        Some((number, [clip, plate]))
    }

    fn next_serial(&mut self) -> u64 {
        self.serials += 1;
        self.serials - 1
    }

    /// The slot to upload to next.
    fn next_upload(&self) -> Option<usize> {
        let uploading = self.taken.iter().enumerate().filter_map(|(number, taken)| {
            let upload = taken.as_ref()?.uploads.front()?;
            Some((upload.serial, number))
        });
        uploading.min().map(|(_, number)| number)
    }

    /// Draws the layers in slot `number` that are complete now from the next frame on.
    fn finish(&mut self, number: usize) {
        let taken = self.taken[number].as_mut().expect("it was uploaded");
        let Upload { clip, plate, .. } = taken.uploads.pop_front().expect("it was uploaded");
        taken.clip.join(clip.run.rows);
        if let (Some(rows), Some(plate)) = (&mut taken.plate, plate) {
            rows.join(plate.run.rows);
        }
        self.draw(number);
    }

    /// Draws what is complete in slot `number` from the next frame on.
    fn draw(&mut self, number: usize) {
        let taken = self.taken[number].as_ref().expect("it is taken");
        let slot = |rows: &ResidentRows| rows.drawn.clone().map(|segment| Slot { span: taken.span, segment });
        let clip = Arc::make_mut(&mut self.clip);
        clip.clip.slots[number] = slot(&taken.clip);
        if let Some(plate) = &mut clip.plate {
            plate.slots[number] = taken.plate.as_ref().and_then(slot);
        }
    }

    /// Frees the slots of removed segments that nothing draws.
    fn sweep(&mut self) {
        for taken in &mut self.taken {
            let is_free = |rows: &ResidentRows| Arc::strong_count(&rows.room) == 1;
            let is_unused = |taken: &Taken| {
                taken.is_leaving && [&taken.clip].into_iter().chain(&taken.plate).all(is_free)
            };
            if taken.as_ref().is_some_and(is_unused) {
                *taken = None;
            }
        }
    }

    fn find(&self, id: SlotId) -> Option<&Taken> {
        self.taken[id.number].as_ref().filter(|taken| taken.serial == id.serial)
    }
}

impl GpuClip {
    /// Packs and uploads the layers of `clip` as the only segment, into buffers with room for all that are announced.
    ///
    /// # Errors
    /// [`Fault::Device`] if the clip does not fit the device with all its layers.
    pub fn upload(gpu: &Gpu, clip: &Clip) -> Result<Arc<GpuClip>, Fault> {
        let layout = TakeLayout::for_clip(clip);
        let mut slots = Slots::new(gpu, &layout)?;
        slots.insert(PackedSegment::new(clip, Span::WHOLE, &layout)?).expect("it has its room");
        gpu.allocate("the clip", || slots.upload(gpu, usize::MAX))?;
        Ok(slots.clip)
    }
}

impl ResidentRows {
    /// Adds layers that are complete to those that are drawn.
    fn join(&mut self, rows: LayerRows) {
        let rows = match &self.drawn {
            Some(segment) => segment.rows.followed_by(rows),
            None => Rows::new(rows, self.first_dynamic),
        };
        self.drawn = Some(Arc::new(GpuSegment {
            rows,
            first: self.rows.start as u32,
            motion_units: self.motion_units,
            _room: self.room.clone(),
        }));
    }
}

impl RunUpload {
    fn new(run: PackedRun) -> RunUpload {
        RunUpload { run, done: 0 }
    }

    /// Writes at most `budget` further bytes to the room of `rows`, and returns how many.
    fn write(&mut self, gpu: &Gpu, buffers: &Buffers, rows: &ResidentRows, budget: usize) -> usize {
        let firsts = [rows.rows.start, rows.first_dynamic as usize];
        let written = buffers.write(gpu, &self.run.packed, firsts, self.done, budget);
        self.done += written;
        written
    }

    fn is_done(&self) -> bool {
        self.done == self.run.packed.bytes()
    }
}

/// The first row of the first gap of `count` of `rows` rows that no range of `taken` is in.
fn first_gap(taken: impl Iterator<Item = Range<usize>> + Clone, count: usize, rows: usize) -> Option<usize> {
    let mut first = 0;
    // A gap cannot begin before the end of a range that is in its way, so each round passes one for good.
    while let Some(in_the_way) = taken.clone().find(|range| first < range.end && range.start < first + count)
    {
        first = in_the_way.end;
    }
    (first + count <= rows).then_some(first)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_gap_that_is_large_enough() {
        // In the order of slots, not of rows.
        let taken = [40..50, 0..10, 13..30];
        let gap = |count, rows| first_gap(taken.iter().cloned(), count, rows);
        assert_eq!([1, 3, 4, 10, 11].map(|count| gap(count, 61)), [10, 10, 30, 30, 50].map(Some));
        assert_eq!([gap(12, 61), gap(11, 60), gap(11, 61)], [None, None, Some(50)]);
        assert_eq!(first_gap([].into_iter(), 7, 7), Some(0));
        assert_eq!(first_gap([].into_iter(), 8, 7), None);
    }
}
