//! [`GpuClip`]: a clip, or what is resident of a take, in GPU memory, with the columns that the CPU culls and sorts by.
//!
//! Its Gaussians belong to segments, each with a [`Span`] and a clip time of its own, in up to [`SLOTS`] slots. A clip
//! is one segment that spans all of it. So there is one path from the instant to the sorted rows.

use std::sync::Arc;

use glam::DVec3;
use shaders::layout::{self, Ranges};
use shaders::{ROW_BITS, SLOTS};

use super::alive::Rows;
use super::evaluate::Buffers;
use crate::gpu::span::Span;

/// A clip, or what is resident of a take, in GPU memory. Columns that it lacks take no memory. A clone shares the
/// memory.
#[derive(Clone)]
pub struct GpuClip {
    /// Origin of the centres in GPU memory, in the world of the clip.
    pub(in crate::gpu) origin: DVec3,
    /// Depth before an eye from which on Gaussians are drawn whole; 0 if none fades.
    pub(in crate::gpu) near: f32,
    /// Duration in the unit of the spans.
    pub(in crate::gpu) duration_s: f64,
    pub(in crate::gpu) clip: GaussianSet,
    pub(in crate::gpu) plate: Option<GaussianSet>,
}

/// Gaussians that are sorted together: the clip's, or its plate's.
#[derive(Clone)]
pub(in crate::gpu) struct GaussianSet {
    pub(in crate::gpu) buffers: Buffers,
    pub(in crate::gpu) slots: [Option<Slot>; SLOTS as usize],
}

/// A segment that is drawn while its span holds the instant.
#[derive(Clone)]
pub(in crate::gpu) struct Slot {
    pub(in crate::gpu) span: Span,
    pub(in crate::gpu) segment: Arc<GpuSegment>,
}

/// Where the rows of a segment are. Those of layers that are not there yet have their room, too.
pub(in crate::gpu) struct GpuSegment {
    pub(in crate::gpu) rows: Rows,
    /// First row in the buffers.
    pub(in crate::gpu) first: u32,
    pub(in crate::gpu) motion_units: [f32; 3],
    /// The room in the buffers, shared by all states of the segment: it is taken as long as one of them is referred to.
    pub(in crate::gpu) _room: Arc<()>,
}

impl GpuClip {
    /// GPU memory of the clip, or of all that may be resident of the take, in bytes.
    pub fn bytes(&self) -> u64 {
        self.sets().map(|set| set.buffers.bytes()).sum()
    }

    /// The sets back to front: the plate, if there is one, then the clip.
    pub(in crate::gpu) fn sets(&self) -> impl Iterator<Item = &GaussianSet> {
        self.plate.iter().chain([&self.clip])
    }
}

impl GaussianSet {
    /// The segments whose span holds the instant `t_s` of a take of `duration_s`, with their slots and their clip times.
    pub(in crate::gpu) fn at(
        &self,
        t_s: f64,
        duration_s: f64,
    ) -> impl Iterator<Item = (usize, &GpuSegment, f64)> {
        let clip_time = move |slot: &Slot| slot.span.holds(t_s, duration_s).then(|| slot.span.clip_time(t_s));
        self.slots.iter().enumerate().filter_map(move |(number, slot)| {
            let slot = slot.as_ref()?;
            Some((number, &*slot.segment, clip_time(slot)?))
        })
    }
}

/// No segment in any slot.
pub(in crate::gpu) const NO_SLOTS: [Option<Slot>; SLOTS as usize] = [const { None }; SLOTS as usize];

impl GpuSegment {
    /// The entry of the draw order for the first row of the segment in slot `number`.
    pub(in crate::gpu) fn first_entry(&self, number: usize) -> u32 {
        (number as u32) << ROW_BITS | self.first
    }

    /// What the shaders read of the segment at clip time `t`.
    pub(in crate::gpu) fn uniform(&self, t: f64) -> layout::Slot {
        let time = t as f32;
        let first_dynamic = self.first + self.rows.first_dynamic;
        let ranges = Ranges { motion_units: self.motion_units, first_dynamic };
        layout::Slot { ranges, time, time_rest: (t - f64::from(time)) as f32, ..Default::default() }
    }
}
