//! [`GpuTimer`]: measures GPU times of frames without waiting for the GPU.
//!
//! Slots are used in turn. A frame writes two timestamps into a free slot and requests their mapping; a
//! later frame reads them.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use super::device::Gpu;

/// Frames that can be measured concurrently.
const SLOTS: usize = 4;

/// Timestamps per slot. Two are used, but Mesa's software driver writes one per eye of a multiview pass,
/// starting at the given index, also at the end of the pass.
const QUERIES: u32 = 3;

/// Bytes of two timestamps.
const BYTES: u64 = 16;

/// Timestamp queries of the frames in flight.
pub(super) struct GpuTimer {
    slots: Vec<Slot>,
    /// Milliseconds per tick.
    period_ms: f64,
    latest_ms: Option<f64>,
    /// The latest time, until it is taken.
    new_ms: Option<f64>,
}

struct Slot {
    queries: wgpu::QuerySet,
    resolved: wgpu::Buffer,
    readback: wgpu::Buffer,
    busy: bool,
    mapped: Arc<AtomicBool>,
}

impl GpuTimer {
    /// Creates a timer; `None` if the device has no timestamps.
    pub(super) fn new(gpu: &Gpu) -> Option<GpuTimer> {
        let buffer = |usage| gpu.empty_buffer("timing", BYTES, usage);
        let slot = |_| Slot {
            queries: gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("timing"),
                ty: wgpu::QueryType::Timestamp,
                count: QUERIES,
            }),
            resolved: buffer(wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC),
            readback: buffer(wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST),
            busy: false,
            mapped: Arc::default(),
        };
        gpu.caps.timestamps.then(|| GpuTimer {
            slots: (0..SLOTS).map(slot).collect(),
            period_ms: f64::from(gpu.queue.get_timestamp_period()) * 1e-6,
            latest_ms: None,
            new_ms: None,
        })
    }

    /// Collects finished measurements and returns the latest one in milliseconds; `None` before the first one, and
    /// while the device writes no time.
    pub(super) fn latest_ms(&mut self) -> Option<f64> {
        self.collect();
        self.latest_ms
    }

    /// As [`GpuTimer::latest_ms`], and returns each measurement once.
    pub(super) fn new_ms(&mut self) -> Option<f64> {
        self.collect();
        self.new_ms.take()
    }

    /// Collects finished measurements.
    pub(super) fn collect(&mut self) {
        for slot in self.slots.iter_mut().filter(|slot| slot.mapped.swap(false, Ordering::Acquire)) {
            if let Ok(mapped) = slot.readback.slice(..).get_mapped_range() {
                let ticks: &[u64] = bytemuck::cast_slice(&mapped);
                self.latest_ms =
                    elapsed_ticks([ticks[0], ticks[1]]).map(|ticks| ticks as f64 * self.period_ms);
                self.new_ms = self.latest_ms;
            }
            slot.readback.unmap();
            slot.busy = false;
        }
    }

    /// A free slot for the next frame; `None` if all are in flight.
    pub(super) fn free_slot(&self) -> Option<usize> {
        self.slots.iter().position(|slot| !slot.busy)
    }

    /// Timestamp writes of pass `pass` of `passes` for `slot`; `None` unless it is the first or the last.
    pub(super) fn writes(
        &self,
        slot: usize,
        pass: usize,
        passes: usize,
    ) -> Option<wgpu::RenderPassTimestampWrites<'_>> {
        let (is_first, is_last) = (pass == 0, pass + 1 == passes);
        (is_first || is_last).then(|| wgpu::RenderPassTimestampWrites {
            query_set: &self.slots[slot].queries,
            beginning_of_pass_write_index: is_first.then_some(0),
            end_of_pass_write_index: is_last.then_some(1),
        })
    }

    /// Records the readback of the timestamps of `slot`.
    pub(super) fn fetch(&mut self, encoder: &mut wgpu::CommandEncoder, slot: usize) {
        let slot = &mut self.slots[slot];
        encoder.resolve_query_set(&slot.queries, 0..2, &slot.resolved, 0);
        encoder.copy_buffer_to_buffer(&slot.resolved, 0, &slot.readback, 0, None);
        let mapped = slot.mapped.clone();
        encoder.map_buffer_on_submit(&slot.readback, wgpu::MapMode::Read, .., move |result| {
            mapped.store(result.is_ok(), Ordering::Release);
        });
        slot.busy = true;
    }
}

/// Ticks from the first timestamp to the second; `None` if a timestamp is 0, or the second not later: some drivers offer
/// timestamps and write none, and a frame without a duration would count as room for more quality.
fn elapsed_ticks([begin, end]: [u64; 2]) -> Option<u64> {
    end.checked_sub(begin).filter(|&ticks| begin > 0 && ticks > 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn timestamps_that_are_not_written_measure_nothing() {
        assert_eq!(elapsed_ticks([1_000, 1_250]), Some(250));
        for ticks in [[0, 0], [0, 1_250], [1_000, 0], [1_000, 1_000], [1_000, 999]] {
            assert_eq!(elapsed_ticks(ticks), None, "{ticks:?}");
        }
    }
}
