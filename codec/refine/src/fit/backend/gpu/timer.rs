//! [`Timer`]: how long the parts of steps take on the device.

use super::device::{Buffer, Device};
use super::plan::StepPart;
use crate::fit::backend::DeviceError;

/// Most parts of a step.
const PARTS_MAX: u32 = 16;

/// Timestamps around the parts of a step, summed over steps.
pub(super) struct Timer {
    queries: wgpu::QuerySet,
    resolved: Buffer,
    /// Nanoseconds of a unit of the timestamps.
    unit_ns: f64,
    /// Names of the parts, in order, and their milliseconds so far.
    parts: Vec<(&'static str, f64)>,
}

impl Timer {
    /// `None` if the device has no timestamps.
    pub(super) fn new(device: &Device) -> Result<Option<Timer>, DeviceError> {
        if !device.device.features().contains(wgpu::Features::TIMESTAMP_QUERY) {
            return Ok(None);
        }
        let descriptor =
            wgpu::QuerySetDescriptor { label: None, ty: wgpu::QueryType::Timestamp, count: 2 * PARTS_MAX };
        Ok(Some(Timer {
            queries: device.device.create_query_set(&descriptor),
            resolved: device.resolved(u64::from(2 * PARTS_MAX) * u64::from(wgpu::QUERY_SIZE))?,
            unit_ns: device.queue.get_timestamp_period().into(),
            parts: Vec::new(),
        }))
    }

    /// The timestamps around the part of this number.
    pub(super) fn around(&self, part: usize) -> wgpu::ComputePassTimestampWrites<'_> {
        let first = 2 * part as u32;
        wgpu::ComputePassTimestampWrites {
            query_set: &self.queries,
            beginning_of_pass_write_index: Some(first),
            end_of_pass_write_index: Some(first + 1),
        }
    }

    /// Ends the commands of so many parts.
    pub(super) fn resolve(&self, encoder: &mut wgpu::CommandEncoder, parts: usize) {
        encoder.resolve_query_set(&self.queries, 0..2 * parts as u32, &self.resolved.raw, 0);
    }

    /// Adds the times of these parts, whose commands are done.
    pub(super) fn add<'a>(
        &mut self,
        device: &Device,
        parts: impl Iterator<Item = &'a StepPart>,
    ) -> Result<(), DeviceError> {
        let stamps: Vec<u64> = device.read(&self.resolved, 2 * PARTS_MAX as usize)?;
        for (i, (part, pair)) in parts.zip(stamps.chunks_exact(2)).enumerate() {
            if i == self.parts.len() {
                self.parts.push((part.name, 0.0));
            }
            self.parts[i].1 += pair[1].saturating_sub(pair[0]) as f64 * self.unit_ns * 1e-6;
        }
        Ok(())
    }

    /// Milliseconds of the parts so far, in order.
    pub(super) fn parts(&self) -> &[(&'static str, f64)] {
        &self.parts
    }
}
