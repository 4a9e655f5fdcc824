//! [`Slots`]: the segments of a take in GPU memory, while it plays.
//!
//! Buffers have a fixed size. A segment takes a range of rows, the first gap that is large enough; its upload is spread
//! over frames, and only a complete segment is drawn.
//!
//! A range is written again while earlier frames may be drawn from it. That is safe: a queue runs writes and
//! submissions in the order of the calls, so what a submitted frame reads changes only after it. A frame that was prepared
//! but not yet submitted has no such place in the queue, hence the rule that slots change between frames. A picture that
//! another thread draws of the take holds its segments ([`GpuClip`] is shared), and their ranges wait for it.

use std::ops::Range;
use std::sync::Arc;

use program::Fault;
use shaders::{ROW_BITS, SLOTS};

use super::clip::{GaussianSet, GpuClip, GpuSegment, NO_SLOTS, Slot};
use super::device::Gpu;
use super::pack::Packed;
use super::segment::{PackedPart, PackedSegment, TakeLayout};
use super::span::Span;
use super::stages::evaluate::Buffers;

// An instant of a take is held by no more segments.
const _: () = assert!(SLOTS as usize >= codec::RESIDENT_MAX);

/// A segment in [`Slots`]. Never equal to that of another segment of the same take, also after its removal.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct SlotId {
    number: usize,
    /// Number of segments inserted before it.
    serial: u64,
}

/// The resident segments of a take. Change them between frames only: after one was submitted, before the next one is
/// prepared.
pub struct Slots {
    clip: Arc<GpuClip>,
    taken: [Option<Taken>; SLOTS as usize],
    inserted: u64,
}

/// A slot that is not free.
struct Taken {
    serial: u64,
    span: Span,
    replaces: Option<SlotId>,
    state: State,
    clip: ResidentRows,
    plate: Option<ResidentRows>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Uploading,
    Ready,
    /// Removed, but drawn by a picture on another thread.
    Leaving,
}

/// A segment's rows in the buffers of a set.
struct ResidentRows {
    segment: Arc<GpuSegment>,
    rows: Range<usize>,
    /// What is uploaded, until all of it is, and the number of bytes that are.
    upload: Option<(Box<Packed>, usize)>,
}

impl Slots {
    /// Buffers of a take of `layout`, without segments.
    ///
    /// # Errors
    /// [`Fault::Device`] if the buffers do not fit the device, or there is not enough memory.
    pub(super) fn new(gpu: &Gpu, layout: &TakeLayout) -> Result<Slots, Fault> {
        let set = |features, rows: usize| {
            if rows > 1 << ROW_BITS {
                return Err(Fault::Device(format!(
                    "the take has {rows} Gaussians at once, and at most {} can be drawn: package it with a smaller \
                     --budget",
                    1 << ROW_BITS
                )));
            }
            Ok(GaussianSet { buffers: Buffers::with_capacity(gpu, features, rows)?, slots: NO_SLOTS })
        };
        let clip = GpuClip {
            origin: layout.origin,
            duration_s: layout.duration_s,
            clip: set(layout.features(), layout.rows)?,
            plate: layout.plate.map(|plate| set(plate.features(), plate.rows)).transpose()?,
        };
        Ok(Slots { clip: Arc::new(clip), taken: [const { None }; SLOTS as usize], inserted: 0 })
    }

    /// What is drawn: the complete segments.
    pub(super) fn clip(&self) -> &Arc<GpuClip> {
        &self.clip
    }

    /// Takes a slot and rows for `packed`, which [`Slots::upload`] then writes. `None` if there is no room.
    pub fn insert(&mut self, packed: PackedSegment) -> Option<SlotId> {
        self.insert_in_place_of(packed, None)
    }

    /// Inserts `packed` in place of `old`, which is drawn until `packed` is complete and removed then: the same segment
    /// with more layers. `None` if there is no room for both; `old` then stays.
    pub fn replace(&mut self, old: SlotId, packed: PackedSegment) -> Option<SlotId> {
        self.insert_in_place_of(packed, Some(old))
    }

    /// Whether there is room for `packed`.
    pub fn has_room(&mut self, packed: &PackedSegment) -> bool {
        self.place(packed).is_some()
    }

    /// Writes at most `budget` bytes of the segments that are not complete, the first inserted first, for the next
    /// submission. Returns the number of bytes.
    pub fn upload(&mut self, gpu: &Gpu, budget: usize) -> usize {
        let mut written = 0;
        while let Some(number) = self.next_upload() {
            let taken = self.taken[number].as_mut().expect("it is uploaded");
            written += taken.clip.write(gpu, &self.clip.clip.buffers, budget - written);
            if let (Some(part), Some(set)) = (&mut taken.plate, &self.clip.plate) {
                written += part.write(gpu, &set.buffers, budget - written);
            }
            if taken.parts().any(|part| part.upload.is_some()) {
                break;
            }
            self.finish(number);
        }
        written
    }

    /// Whether the segment is complete and drawn while its span holds the instant.
    pub fn is_ready(&self, id: SlotId) -> bool {
        self.find(id).is_some_and(|taken| taken.state == State::Ready)
    }

    /// Removes a segment; without effect if it was removed before.
    pub fn remove(&mut self, id: SlotId) {
        let Some(taken) = self.taken[id.number].as_mut().filter(|taken| taken.serial == id.serial) else {
            return;
        };
        if taken.state == State::Ready {
            let clip = Arc::make_mut(&mut self.clip);
            clip.clip.slots[id.number] = None;
            if let Some(plate) = &mut clip.plate {
                plate.slots[id.number] = None;
            }
        }
        taken.state = State::Leaving;
        self.sweep();
    }

    fn insert_in_place_of(&mut self, packed: PackedSegment, replaces: Option<SlotId>) -> Option<SlotId> {
        let (number, firsts) = self.place(&packed)?;
        let serial = self.inserted;
        self.inserted += 1;
        self.taken[number] = Some(Taken {
            serial,
            span: packed.span,
            replaces,
            state: State::Uploading,
            clip: ResidentRows::new(packed.clip, firsts[0]),
            plate: packed.plate.map(|plate| ResidentRows::new(plate, firsts[1])),
        });
        Some(SlotId { number, serial })
    }

    /// A free slot and the first rows for the clip and the plate of `packed`.
    fn place(&mut self, packed: &PackedSegment) -> Option<(usize, [usize; 2])> {
        self.sweep();
        let number = self.taken.iter().position(Option::is_none)?;
        let taken = self.taken.iter().flatten();
        let ranges = taken.clone().map(|taken| taken.clip.rows.clone());
        let clip = first_gap(ranges, packed.clip.rows.len(), self.clip.clip.buffers.rows)?;
        let ranges = taken.filter_map(|taken| taken.plate.as_ref()).map(|plate| plate.rows.clone());
        let plate = match (&packed.plate, &self.clip.plate) {
            (Some(plate), Some(set)) => first_gap(ranges, plate.rows.len(), set.buffers.rows)?,
            (None, _) => 0,
            (Some(_), None) => return None,
        };
        Some((number, [clip, plate]))
    }

    /// The slot to upload to next.
    fn next_upload(&self) -> Option<usize> {
        let uploading = self.taken.iter().enumerate().filter_map(|(number, taken)| {
            let taken = taken.as_ref().filter(|taken| taken.state == State::Uploading)?;
            Some((taken.serial, number))
        });
        uploading.min().map(|(_, number)| number)
    }

    /// Draws the complete segment in slot `number` from the next frame on.
    fn finish(&mut self, number: usize) {
        let taken = self.taken[number].as_mut().expect("it was uploaded");
        taken.state = State::Ready;
        let slot = |part: &ResidentRows| Slot { span: taken.span, segment: part.segment.clone() };
        let clip = Arc::make_mut(&mut self.clip);
        clip.clip.slots[number] = Some(slot(&taken.clip));
        if let Some(plate) = &mut clip.plate {
            plate.slots[number] = taken.plate.as_ref().map(slot);
        }
        if let Some(old) = taken.replaces.take() {
            self.remove(old);
        }
    }

    /// Frees the slots of removed segments that nothing draws.
    fn sweep(&mut self) {
        for taken in &mut self.taken {
            let is_free = |part: &ResidentRows| Arc::strong_count(&part.segment) == 1;
            if taken.as_ref().is_some_and(|taken| taken.state == State::Leaving && taken.parts().all(is_free))
            {
                *taken = None;
            }
        }
    }

    fn find(&self, id: SlotId) -> Option<&Taken> {
        self.taken[id.number].as_ref().filter(|taken| taken.serial == id.serial)
    }
}

impl Taken {
    fn parts(&self) -> impl Iterator<Item = &ResidentRows> {
        [&self.clip].into_iter().chain(&self.plate)
    }
}

impl ResidentRows {
    fn new(PackedPart { packed, rows }: PackedPart, first: usize) -> ResidentRows {
        ResidentRows {
            rows: first..first + rows.len(),
            // Rows are at most 2^26.
            segment: Arc::new(GpuSegment { rows, first: first as u32, ranges: packed.ranges }),
            upload: Some((Box::new(packed), 0)),
        }
    }

    /// Writes at most `budget` further bytes, and returns how many.
    fn write(&mut self, gpu: &Gpu, buffers: &Buffers, budget: usize) -> usize {
        let Some((packed, done)) = &mut self.upload else { return 0 };
        let written = buffers.write(gpu, packed, self.rows.start, *done, budget);
        *done += written;
        if *done == packed.bytes() {
            self.upload = None;
        }
        written
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
