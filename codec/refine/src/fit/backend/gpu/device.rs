//! [`Device`]: the graphics device, its buffers and its failures.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use bytemuck::Pod;
use shaders::fit::SPLAT_BYTES;

use crate::fit::backend::DeviceError;

/// A graphics device.
pub(super) struct Device {
    pub(super) device: wgpu::Device,
    pub(super) queue: wgpu::Queue,
    /// Name of the adapter.
    pub(super) name: String,
    /// Size of the largest buffer in bytes.
    pub(super) max_bytes: u64,
    usage: Arc<MemoryUsage>,
    failure: Arc<Mutex<Option<String>>>,
}

/// Allocated memory in bytes.
#[derive(Default)]
struct MemoryUsage {
    now: AtomicU64,
    peak: AtomicU64,
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
        let name = adapter.get_info().name;
        let offered = adapter.limits();
        let limits = wgpu::Limits {
            max_buffer_size: offered.max_buffer_size,
            max_storage_buffer_binding_size: offered.max_storage_buffer_binding_size,
            ..wgpu::Limits::default()
        };
        let descriptor = wgpu::DeviceDescriptor { required_limits: limits.clone(), ..Default::default() };
        let (device, queue) = pollster::block_on(adapter.request_device(&descriptor))
            .map_err(|error| DeviceError::Missing(format!("graphics device {name}: {error}")))?;
        let failure = watch_failures(&device);
        let max_bytes = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
        Ok(Device { device, queue, name, max_bytes, usage: Arc::default(), failure })
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

    /// Peak of the allocated memory in bytes.
    pub(super) fn peak_bytes(&self) -> u64 {
        self.usage.peak.load(Ordering::Relaxed)
    }

    /// Writes `values` before the next submission runs.
    pub(super) fn write<T: Pod>(&self, buffer: &Buffer, offset: u64, values: &[T]) {
        if !values.is_empty() {
            self.queue.write_buffer(&buffer.raw, offset, bytemuck::cast_slice(values));
        }
    }

    pub(super) fn encoder(&self) -> wgpu::CommandEncoder {
        self.device.create_command_encoder(&Default::default())
    }

    /// Submits the recorded commands, then reads the first `count` items of `buffer` by way of `staging`.
    pub(super) fn submit_and_read<T: Pod>(
        &self,
        mut encoder: wgpu::CommandEncoder,
        buffer: &Buffer,
        staging: &Buffer,
        count: usize,
    ) -> Result<Vec<T>, DeviceError> {
        let bytes = (count * size_of::<T>()) as u64;
        if bytes == 0 {
            return Ok(Vec::new());
        }
        encoder.copy_buffer_to_buffer(&buffer.raw, 0, &staging.raw, 0, Some(bytes));
        self.queue.submit([encoder.finish()]);
        let slice = staging.raw.slice(..bytes);
        let failure = self.failure.clone();
        slice.map_async(wgpu::MapMode::Read, move |outcome| {
            if let Err(error) = outcome {
                record(&failure, &error.to_string());
            }
        });
        self.wait()?;
        if let Some(failure) = self.failure.lock().unwrap_or_else(PoisonError::into_inner).take() {
            return Err(self.lost(failure));
        }
        let mapped = slice.get_mapped_range().map_err(|error| self.lost(error.to_string()))?;
        let values = mapped.chunks_exact(size_of::<T>()).map(bytemuck::pod_read_unaligned).collect();
        drop(mapped);
        staging.raw.unmap();
        Ok(values)
    }

    /// Waits for all submitted work.
    fn wait(&self) -> Result<(), DeviceError> {
        let wait = || self.device.poll(wgpu::PollType::wait_indefinitely());
        // wgpu panics if the device is lost while it waits.
        match catch_unwind(AssertUnwindSafe(wait)) {
            Ok(waited) => waited.map(|_| ()).map_err(|error| self.lost(error.to_string())),
            Err(_) => Err(self.lost("the driver gave the device up".into())),
        }
    }

    /// Reads the first `count` items of `buffer`.
    pub(super) fn read<T: Pod>(&self, buffer: &Buffer, count: usize) -> Result<Vec<T>, DeviceError> {
        let staging = self.staging((count * size_of::<T>()) as u64)?;
        self.submit_and_read(self.encoder(), buffer, &staging, count)
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
