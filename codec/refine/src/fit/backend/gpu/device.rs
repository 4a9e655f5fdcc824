//! [`Device`]: the graphics device, its buffers and its failures.

use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use bytemuck::Pod;
use shaders::fit::SPLAT_BYTES;

use crate::fit::backend::DeviceError;

/// A graphics device.
pub(super) struct Device {
    pub(super) device: wgpu::Device,
    pub(super) queue: wgpu::Queue,
    /// Name of the adapter.
    pub(super) name: String,
    /// Whether it is a software driver.
    pub(super) is_software: bool,
    /// Size of the largest buffer in bytes.
    pub(super) max_bytes: u64,
    counts: Cell<DeviceCounts>,
    usage: Arc<MemoryUsage>,
    failure: Arc<Mutex<Option<String>>>,
}

/// Allocated memory in bytes.
#[derive(Default)]
struct MemoryUsage {
    now: AtomicU64,
    peak: AtomicU64,
}

/// What a device was asked to do since it was opened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DeviceCounts {
    /// Steps of fits.
    pub steps: u64,
    /// Steps that ran again, because they or one before had more pairs of Gaussians and tiles than their buffers held.
    pub repeats: u64,
    /// Batches of commands.
    pub submissions: u64,
    /// Times that the device had nothing to do until the host read its results.
    pub waits: u64,
    /// Kernels.
    pub dispatches: u64,
    /// Bytes that the host wrote.
    pub written_bytes: u64,
    /// Bytes that the kernels of steps read and wrote: each kernel what it needs, once.
    pub touched_bytes: u64,
}

/// A buffer, counted in the memory usage while it lives.
pub(super) struct Buffer {
    pub(super) raw: wgpu::Buffer,
    usage: Arc<MemoryUsage>,
}

impl Drop for Buffer {
    fn drop(&mut self) {
        self.usage.now.fetch_sub(self.raw.size(), Ordering::Relaxed);
    }
}

impl Device {
    /// Opens the fastest device of the machine.
    pub(super) fn open() -> Result<Device, DeviceError> {
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle_from_env());
        let options = wgpu::RequestAdapterOptions {
            power_preference: wgpu::PowerPreference::HighPerformance,
            ..Default::default()
        };
        let adapter = pollster::block_on(instance.request_adapter(&options)).map_err(|_| {
            DeviceError::Missing(
                "no graphics device was found: install a Vulkan driver \
                 (Debian and Ubuntu: apt-get install mesa-vulkan-drivers)"
                    .into(),
            )
        })?;
        let wgpu::AdapterInfo { name, device_type, .. } = adapter.get_info();
        let is_software = device_type == wgpu::DeviceType::Cpu;
        let offered = adapter.limits();
        let limits = wgpu::Limits {
            max_buffer_size: offered.max_buffer_size,
            max_storage_buffer_binding_size: offered.max_storage_buffer_binding_size,
            ..wgpu::Limits::default()
        };
        let descriptor = wgpu::DeviceDescriptor {
            required_features: adapter.features() & wgpu::Features::TIMESTAMP_QUERY,
            required_limits: limits.clone(),
            ..Default::default()
        };
        let (device, queue) = pollster::block_on(adapter.request_device(&descriptor))
            .map_err(|error| DeviceError::Missing(format!("graphics device {name}: {error}")))?;
        let failure = watch_failures(&device);
        let max_bytes = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
        Ok(Device {
            device,
            queue,
            name,
            is_software,
            max_bytes,
            counts: Cell::default(),
            usage: Arc::default(),
            failure,
        })
    }

    /// Allocates a storage buffer of zeros. `what` names its contents in errors.
    pub(super) fn storage(&self, what: &'static str, bytes: u64) -> Result<Buffer, DeviceError> {
        let storage = wgpu::BufferUsages::STORAGE;
        self.allocate(what, bytes, storage | wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST)
    }

    /// Allocates a uniform buffer.
    pub(super) fn uniform<T: Pod>(&self) -> Result<Buffer, DeviceError> {
        let usage = wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST;
        self.allocate("uniforms", size_of::<T>() as u64, usage)
    }

    /// Allocates a buffer for reading back.
    pub(super) fn staging(&self, bytes: u64) -> Result<Buffer, DeviceError> {
        let usage = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
        self.allocate("reading back", bytes, usage)
    }

    /// Allocates a buffer for timestamps.
    pub(super) fn resolved(&self, bytes: u64) -> Result<Buffer, DeviceError> {
        let usage = wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC;
        self.allocate("timestamps", bytes, usage)
    }

    fn allocate(
        &self,
        what: &'static str,
        bytes: u64,
        usage: wgpu::BufferUsages,
    ) -> Result<Buffer, DeviceError> {
        // A binding holds at least one item; a splat is the largest.
        let size = bytes.max(SPLAT_BYTES);
        if size > self.max_bytes {
            return Err(self.too_large(what, size));
        }
        let scope = self.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let descriptor = wgpu::BufferDescriptor { label: Some(what), size, usage, mapped_at_creation: false };
        let raw = self.device.create_buffer(&descriptor);
        if pollster::block_on(scope.pop()).is_some() {
            return Err(DeviceError::Memory { device: self.name.clone(), what });
        }
        let now = self.usage.now.fetch_add(size, Ordering::Relaxed) + size;
        self.usage.peak.fetch_max(now, Ordering::Relaxed);
        Ok(Buffer { raw, usage: self.usage.clone() })
    }

    /// What the device was asked to do so far.
    pub(super) fn counts(&self) -> DeviceCounts {
        self.counts.get()
    }

    pub(super) fn count(&self, change: impl FnOnce(&mut DeviceCounts)) {
        let mut counts = self.counts.get();
        change(&mut counts);
        self.counts.set(counts);
    }

    /// Peak of the allocated memory in bytes.
    pub(super) fn peak_bytes(&self) -> u64 {
        self.usage.peak.load(Ordering::Relaxed)
    }

    /// Writes `values` before the next submission runs.
    pub(super) fn write<T: Pod>(&self, buffer: &Buffer, offset: u64, values: &[T]) {
        if !values.is_empty() {
            let bytes = bytemuck::cast_slice(values);
            self.count(|counts| counts.written_bytes += bytes.len() as u64);
            self.queue.write_buffer(&buffer.raw, offset, bytes);
        }
    }

    pub(super) fn encoder(&self) -> wgpu::CommandEncoder {
        self.device.create_command_encoder(&Default::default())
    }

    /// Submits the recorded commands. Afterwards, `staging` can be read once the submission is done.
    pub(super) fn submit(&self, encoder: wgpu::CommandEncoder, staging: &Buffer) -> wgpu::SubmissionIndex {
        let submission = self.queue.submit([encoder.finish()]);
        self.count(|counts| counts.submissions += 1);
        let failure = self.failure.clone();
        staging.raw.map_async(wgpu::MapMode::Read, .., move |outcome| {
            if let Err(error) = outcome {
                record(&failure, &error.to_string());
            }
        });
        submission
    }

    /// Waits for a submission.
    pub(super) fn wait_for(&self, submission: wgpu::SubmissionIndex) -> Result<(), DeviceError> {
        let wait =
            || self.device.poll(wgpu::PollType::Wait { submission_index: Some(submission), timeout: None });
        // wgpu panics if the device is lost while it waits.
        match catch_unwind(AssertUnwindSafe(wait)) {
            Ok(waited) => waited.map(drop).map_err(|error| self.lost(error.to_string()))?,
            Err(_) => return Err(self.lost("the driver gave the device up".into())),
        }
        match self.failure.lock().unwrap_or_else(PoisonError::into_inner).take() {
            Some(failure) => Err(self.lost(failure)),
            None => Ok(()),
        }
    }

    /// The bytes that a submission, which is done, left in `staging`. The buffer can be submitted again.
    pub(super) fn take(&self, staging: &Buffer) -> Result<Vec<u8>, DeviceError> {
        let mapped = staging.raw.get_mapped_range(..).map_err(|error| self.lost(error.to_string()))?;
        let bytes = mapped.to_vec();
        drop(mapped);
        staging.raw.unmap();
        Ok(bytes)
    }

    /// Reads the first `count` items of `buffer`, after all commands before.
    pub(super) fn read<T: Pod>(&self, buffer: &Buffer, count: usize) -> Result<Vec<T>, DeviceError> {
        let size = (count * size_of::<T>()) as u64;
        if size == 0 {
            return Ok(Vec::new());
        }
        let staging = self.staging(size)?;
        let mut encoder = self.encoder();
        encoder.copy_buffer_to_buffer(&buffer.raw, 0, &staging.raw, 0, Some(size));
        let submission = self.submit(encoder, &staging);
        self.count(|counts| counts.waits += 1);
        self.wait_for(submission)?;
        let bytes = self.take(&staging)?;
        Ok(bytes.chunks_exact(size_of::<T>()).take(count).map(bytemuck::pod_read_unaligned).collect())
    }

    /// Bytes that the device reads and writes in a millisecond where it copies a buffer.
    pub(super) fn copied_bytes_a_ms(&self) -> Result<f64, DeviceError> {
        let bytes = (256 << 20).min(self.max_bytes);
        let buffers = [self.storage("a copy", bytes)?, self.storage("a copy", bytes)?];
        let mut ms = f64::INFINITY;
        for _ in 0..3 {
            let start = Instant::now();
            let mut encoder = self.encoder();
            for _ in 0..4 {
                encoder.copy_buffer_to_buffer(&buffers[0].raw, 0, &buffers[1].raw, 0, Some(bytes));
            }
            self.wait_for(self.queue.submit([encoder.finish()]))?;
            ms = ms.min(1e3 * start.elapsed().as_secs_f64());
        }
        Ok(2.0 * 4.0 * bytes as f64 / ms)
    }

    pub(super) fn too_large(&self, what: &'static str, bytes: u64) -> DeviceError {
        DeviceError::TooLarge { device: self.name.clone(), what, bytes, limit: self.max_bytes }
    }

    fn lost(&self, message: String) -> DeviceError {
        DeviceError::Lost { device: self.name.clone(), message }
    }
}

/// Records a failure, in one line, unless there was one before.
fn record(failure: &Mutex<Option<String>>, message: &str) {
    let line = message.split_whitespace().collect::<Vec<_>>().join(" ");
    failure.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(line);
}

/// Records the first failure that the device reports by itself. Without a handler, wgpu would panic.
fn watch_failures(device: &wgpu::Device) -> Arc<Mutex<Option<String>>> {
    let failure: Arc<Mutex<Option<String>>> = Arc::default();
    let uncaptured = failure.clone();
    device.on_uncaptured_error(Arc::new(move |error| record(&uncaptured, &error.to_string())));
    let lost = failure.clone();
    device.set_device_lost_callback(move |reason, message| {
        if reason != wgpu::DeviceLostReason::Destroyed {
            record(&lost, &format!("lost: {message}"));
        }
    });
    failure
}
