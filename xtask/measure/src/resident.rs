//! [`ResidentSegments`]: plays a take as a player does at least, with the segments of one instant resident.

use client::gpu::{Gpu, PackedSegment, Renderer, SlotId, Span, TakeLayout};
use codec::Clip;
use program::Fault;

/// The segments of a take that are resident.
pub struct ResidentSegments {
    layout: TakeLayout,
    slots: Vec<Option<SlotId>>,
}

impl ResidentSegments {
    /// None, of a take of `layout` with `segments` segments.
    pub fn new(layout: TakeLayout, segments: usize) -> ResidentSegments {
        ResidentSegments { layout, slots: vec![None; segments] }
    }

    /// Removes the segments that do not hold the instant `t_s`, and inserts and uploads those that do, in pieces of
    /// `piece` bytes. `renderer` draws the take. Returns the number of segments that came or went.
    ///
    /// # Errors
    /// If a segment cannot be packed, or there is no room.
    ///
    /// # Panics
    /// If `renderer` draws a clip.
    pub fn seek(
        &mut self,
        gpu: &Gpu,
        renderer: &mut Renderer,
        segments: &[(Span, Clip)],
        t_s: f64,
        piece: usize,
    ) -> Result<usize, Fault> {
        let take_s = self.layout.duration_s;
        let slots = renderer.slots().expect("it draws a take");
        let mut changes = 0;
        for ((span, _), resident) in segments.iter().zip(&mut self.slots) {
            if !span.holds(t_s, take_s)
                && let Some(id) = resident.take()
            {
                slots.remove(id);
                changes += 1;
            }
        }
        for ((span, clip), resident) in segments.iter().zip(&mut self.slots) {
            if span.holds(t_s, take_s) && resident.is_none() {
                let packed = PackedSegment::new(clip, *span, &self.layout)?;
                let id = slots.insert(packed).ok_or_else(|| Fault::Device("no room".into()))?;
                *resident = Some(id);
                changes += 1;
            }
        }
        while slots.upload(gpu, piece) > 0 {}
        Ok(changes)
    }
}
