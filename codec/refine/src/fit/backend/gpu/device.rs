//! [`Device`]: the graphics device, its memory and its failures.

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
    /// Bytes of the largest buffer.
    pub(super) max_bytes: u64,
    meter: Arc<Meter>,
    failure: Arc<Mutex<Option<String>>>,
}

/// How much memory is taken, in bytes.
#[derive(Default)]
struct Meter {
    now: AtomicU64,
    peak: AtomicU64,
}

/// Memory of the device.
pub(super) struct Buffer {
    pub(super) raw: wgpu::Buffer,
    meter: Arc<Meter>,
}

impl Drop for Buffer {
    fn drop(&mut self) {
        self.meter.now.fetch_sub(self.raw.size(), Ordering::Relaxed);
    }
}

impl Device {
    /// The fastest device of the machine.
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
        let failure = watch(&device);
        let max_bytes = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
        Ok(Device { device, queue, name, max_bytes, meter: Arc::default(), failure })
    }

    /// Room for `bytes` of `what`, which is zeros at first.
    pub(super) fn room(&self, what: &'static str, bytes: u64) -> Result<Buffer, DeviceError> {
        let storage = wgpu::BufferUsages::STORAGE;
        self.allocate(what, bytes, storage | wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST)
    }

    /// Room for a struct that all threads read.
    pub(super) fn uniform<T: Pod>(&self) -> Result<Buffer, DeviceError> {
        let usage = wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST;
        self.allocate("settings", size_of::<T>() as u64, usage)
    }

    /// Room for `bytes` that come back from the device.
    pub(super) fn landing(&self, bytes: u64) -> Result<Buffer, DeviceError> {
        let usage = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
        self.allocate("what is read back", bytes, usage)
    }

    fn allocate(
        &self,
        what: &'static str,
        bytes: u64,
        usage: wgpu::BufferUsages,
    ) -> Result<Buffer, DeviceError> {
        // What a kernel binds holds one item at least; the largest is a splat.
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
        let now = self.meter.now.fetch_add(size, Ordering::Relaxed) + size;
        self.meter.peak.fetch_max(now, Ordering::Relaxed);
        Ok(Buffer { raw, meter: self.meter.clone() })
    }

    /// Most memory that was taken at once, in bytes.
    pub(super) fn peak_bytes(&self) -> u64 {
        self.meter.peak.load(Ordering::Relaxed)
    }

    /// Hands numbers to the device, which sees them before what is submitted next.
    pub(super) fn write<T: Pod>(&self, buffer: &Buffer, offset: u64, values: &[T]) {
        if !values.is_empty() {
            self.queue.write_buffer(&buffer.raw, offset, bytemuck::cast_slice(values));
        }
    }

    pub(super) fn encoder(&self) -> wgpu::CommandEncoder {
        self.device.create_command_encoder(&Default::default())
    }

    /// Carries out what was recorded, and then brings the first numbers of `buffer` to `landing` and here.
    pub(super) fn submit_and_read<T: Pod>(
        &self,
        mut encoder: wgpu::CommandEncoder,
        buffer: &Buffer,
        landing: &Buffer,
        count: usize,
    ) -> Result<Vec<T>, DeviceError> {
        let bytes = (count * size_of::<T>()) as u64;
        if bytes == 0 {
            return Ok(Vec::new());
        }
        encoder.copy_buffer_to_buffer(&buffer.raw, 0, &landing.raw, 0, Some(bytes));
        self.queue.submit([encoder.finish()]);
        let slice = landing.raw.slice(..bytes);
        let failure = self.failure.clone();
        slice.map_async(wgpu::MapMode::Read, move |outcome| {
            if let Err(error) = outcome {
                keep(&failure, &error.to_string());
            }
        });
        self.wait()?;
        if let Some(failure) = self.failure.lock().unwrap_or_else(PoisonError::into_inner).take() {
            return Err(self.lost(failure));
        }
        let mapped = slice.get_mapped_range().map_err(|error| self.lost(error.to_string()))?;
        let values = mapped.chunks_exact(size_of::<T>()).map(bytemuck::pod_read_unaligned).collect();
        drop(mapped);
        landing.raw.unmap();
        Ok(values)
    }

    /// Waits until all that was submitted is done.
    fn wait(&self) -> Result<(), DeviceError> {
        let wait = || self.device.poll(wgpu::PollType::wait_indefinitely());
        // A device that is lost at that moment makes the graphics interface panic.
        match catch_unwind(AssertUnwindSafe(wait)) {
            Ok(waited) => waited.map(|_| ()).map_err(|error| self.lost(error.to_string())),
            Err(_) => Err(self.lost("the driver gave it up".into())),
        }
    }

    /// The first `count` numbers of `buffer`.
    pub(super) fn read<T: Pod>(&self, buffer: &Buffer, count: usize) -> Result<Vec<T>, DeviceError> {
        let landing = self.landing((count * size_of::<T>()) as u64)?;
        self.submit_and_read(self.encoder(), buffer, &landing, count)
    }

    pub(super) fn too_large(&self, what: &'static str, bytes: u64) -> DeviceError {
        DeviceError::TooLarge { device: self.name.clone(), what, bytes, limit: self.max_bytes }
    }

    fn lost(&self, message: String) -> DeviceError {
        DeviceError::Lost { device: self.name.clone(), message }
    }
}

/// Keeps a failure, in one line, unless there was one before.
fn keep(failure: &Mutex<Option<String>>, message: &str) {
    let line = message.split_whitespace().collect::<Vec<_>>().join(" ");
    failure.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(line);
}

/// The first failure that a device reports by itself, which would otherwise end the program in a panic.
fn watch(device: &wgpu::Device) -> Arc<Mutex<Option<String>>> {
    let failure: Arc<Mutex<Option<String>>> = Arc::default();
    let uncaptured = failure.clone();
    device.on_uncaptured_error(Arc::new(move |error| keep(&uncaptured, &error.to_string())));
    let lost = failure.clone();
    device.set_device_lost_callback(move |reason, message| {
        if reason != wgpu::DeviceLostReason::Destroyed {
            keep(&lost, &format!("lost: {message}"));
        }
    });
    failure
}
