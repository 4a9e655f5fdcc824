//! crates.io `wgpu-3dgs-viewer`: a static field, such as an instant of a dynamic one.
//!
//! With a support radius of `sqrt(8)` its falloff is a Gaussian; at its default of 3 images are blurred. All
//! other settings are its defaults.

use std::path::Path;

use anyhow::Context;
use codec::Camera;
use glam::camera::lh::proj::directx::perspective;
use glam::{Mat4, UVec2, Vec4};
use wgpu_3dgs_viewer::core::{
    GaussianDisplayMode, GaussianMaxStdDev, GaussianShDegree, Gaussians, GaussiansSource,
};
use wgpu_3dgs_viewer::{CameraTrait, Viewer};

use super::renderer::PeerRenderer;
use crate::workload::{WorkFrame, Workload};

/// 8 bits per channel, as windows have.
const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;

/// Near and far plane, in units of the field.
const DEPTHS: [f32; 2] = [0.1, 1000.0];

struct PeerViewer {
    adapter: wgpu::AdapterInfo,
    device: wgpu::Device,
    queue: wgpu::Queue,
    peer: Viewer,
    size: UVec2,
    image: wgpu::Texture,
    readback: wgpu::Buffer,
}

/// Opens the PLY file at `path`.
pub(super) fn open(path: &Path, work: &Workload) -> anyhow::Result<Box<dyn PeerRenderer>> {
    let gaussians = Gaussians::read_from_file(path, GaussiansSource::Ply)?;
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle_from_env());
    let options = wgpu::RequestAdapterOptions {
        power_preference: wgpu::PowerPreference::HighPerformance,
        ..Default::default()
    };
    let adapter = pollster::block_on(instance.request_adapter(&options))?;
    let descriptor = wgpu::DeviceDescriptor { required_limits: adapter.limits(), ..Default::default() };
    let (device, queue) = pollster::block_on(adapter.request_device(&descriptor))?;

    let mut peer: Viewer = Viewer::new(&device, FORMAT, &gaussians)?;
    let support_radius = GaussianMaxStdDev::new(8f32.sqrt()).context("a supported radius")?;
    let degree = GaussianShDegree::new(3).context("a supported degree")?;
    peer.update_gaussian_transform(&queue, 1.0, GaussianDisplayMode::Splat, degree, false, support_radius);

    let size = UVec2::new(work.width, work.height);
    let image = device.create_texture(&wgpu::TextureDescriptor {
        label: Some("image"),
        size: wgpu::Extent3d { width: size.x, height: size.y, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: FORMAT,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
        view_formats: &[],
    });
    let readback = device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("image"),
        size: u64::from(bytes_per_row(size)) * u64::from(size.y),
        usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
        mapped_at_creation: false,
    });
    Ok(Box::new(PeerViewer { adapter: adapter.get_info(), device, queue, peer, size, image, readback }))
}

impl PeerRenderer for PeerViewer {
    fn device(&self) -> String {
        let wgpu::AdapterInfo { name, driver, driver_info, .. } = &self.adapter;
        format!("{name}, {driver} {driver_info}")
    }

    fn draw(&mut self, frame: &WorkFrame) -> anyhow::Result<()> {
        self.peer.update_camera(&self.queue, &ViewerCamera(&frame.camera), self.size);
        let mut encoder = self.device.create_command_encoder(&Default::default());
        self.peer.render(&mut encoder, &self.image.create_view(&Default::default()));
        self.queue.submit([encoder.finish()]);
        self.device.poll(wgpu::PollType::wait_indefinitely())?;
        Ok(())
    }

    fn read(&mut self) -> anyhow::Result<Vec<u8>> {
        let mut encoder = self.device.create_command_encoder(&Default::default());
        let layout = wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(bytes_per_row(self.size)),
            rows_per_image: None,
        };
        let buffer = wgpu::TexelCopyBufferInfo { buffer: &self.readback, layout };
        encoder.copy_texture_to_buffer(self.image.as_image_copy(), buffer, self.image.size());
        self.queue.submit([encoder.finish()]);
        self.readback.slice(..).map_async(wgpu::MapMode::Read, |_| {});
        self.device.poll(wgpu::PollType::wait_indefinitely())?;
        let mapped = self.readback.slice(..).get_mapped_range()?;
        let rows = mapped.chunks_exact(bytes_per_row(self.size) as usize);
        let rgb = rows
            .flat_map(|row| row[..4 * self.size.x as usize].chunks_exact(4))
            .flat_map(|pixel| [pixel[0], pixel[1], pixel[2]])
            .collect();
        drop(mapped);
        self.readback.unmap();
        Ok(rgb)
    }
}

/// Bytes of an image row in a buffer, padded to the alignment of the graphics API.
fn bytes_per_row(size: UVec2) -> u32 {
    (4 * size.x).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT)
}

/// Converts a camera to the viewer's axes: y up, z forward.
struct ViewerCamera<'a>(&'a Camera);

impl CameraTrait for ViewerCamera<'_> {
    fn view(&self) -> Mat4 {
        let m = self.0.camera_from_world.map(|row| row.map(|x| x as f32));
        let view_from_world = Mat4::from_cols_array_2d(&m).transpose();
        Mat4::from_diagonal(Vec4::new(1.0, -1.0, 1.0, 1.0)) * view_from_world
    }

    fn projection(&self, aspect_ratio: f32) -> Mat4 {
        let fov_y = 2.0 * (0.5 * f64::from(self.0.height) / self.0.k[1][1]).atan();
        perspective(fov_y as f32, aspect_ratio, DEPTHS[0], DEPTHS[1])
    }
}
