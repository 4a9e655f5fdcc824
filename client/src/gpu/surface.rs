//! [`WindowSurface`]: the swapchain of a window.

use std::sync::Arc;

use program::Fault;
use winit::window::Window;

use super::device::{Failures, Gpu, Loss};
use super::ui::UiTarget;

/// Formats without colour conversion, in the order of preference.
const FORMATS: [wgpu::TextureFormat; 2] = [wgpu::TextureFormat::Bgra8Unorm, wgpu::TextureFormat::Rgba8Unorm];

/// The picture is copied into the image, and the user interface is drawn over it.
const USAGES: wgpu::TextureUsages =
    wgpu::TextureUsages::RENDER_ATTACHMENT.union(wgpu::TextureUsages::COPY_DST);

/// Pixel format of an image.
pub(crate) type Format = wgpu::TextureFormat;

/// The swapchain of a window.
pub(crate) struct WindowSurface {
    instance: wgpu::Instance,
    surface: wgpu::Surface<'static>,
    window: Arc<Window>,
    format: wgpu::TextureFormat,
    alpha_mode: wgpu::CompositeAlphaMode,
    /// Configured size; `None` if the surface must be configured again.
    configured: Option<[u32; 2]>,
    failures: Failures,
}

/// An acquired image of the window.
pub(crate) struct SurfaceFrame {
    /// `None` once presented.
    texture: Option<wgpu::SurfaceTexture>,
    loss: Loss,
    /// Render target.
    pub(crate) view: wgpu::TextureView,
    /// Width and height in pixels.
    pub(crate) size: [u32; 2],
}

impl WindowSurface {
    /// Opens the fastest device that can present to `window`.
    ///
    /// # Errors
    /// [`Fault::Device`] if there is none.
    pub(crate) fn open(window: Arc<Window>) -> Result<(Gpu, WindowSurface), Fault> {
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle_from_env());
        // Without a driver, report that as the cause.
        let surface = create(&instance, &window)
            .or_else(|fault| Gpu::from_instance(&instance, None).and(Err(fault)))?;
        let gpu = Gpu::from_instance(&instance, Some(&surface))?;
        let offered = surface.get_capabilities(&gpu.adapter);
        let format =
            FORMATS.into_iter().find(|format| offered.formats.contains(format)).ok_or_else(|| {
                Fault::Device(format!("{} has no 8-bit images for windows: try --headless", gpu.adapter_name))
            })?;
        let opaque = wgpu::CompositeAlphaMode::Opaque;
        let surface = WindowSurface {
            instance,
            surface,
            window,
            format,
            alpha_mode: if offered.alpha_modes.contains(&opaque) { opaque } else { Default::default() },
            configured: None,
            failures: Failures::collect(&gpu),
        };
        Ok((gpu, surface))
    }

    /// Format of the window's images.
    pub(crate) fn format(&self) -> Format {
        self.format
    }

    /// Acquires the next image at the present size of the window, waiting for the display. `None` if the
    /// window cannot show an image now.
    ///
    /// # Errors
    /// [`Fault::Device`] if the device was lost or has failed.
    pub(crate) fn acquire(&mut self, gpu: &Gpu) -> Result<Option<SurfaceFrame>, Fault> {
        self.failures.check(gpu)?;
        let size = <[u32; 2]>::from(self.window.inner_size()).map(|side| side.min(gpu.caps.max_image_side));
        if size.contains(&0) {
            return Ok(None);
        }
        // One retry after the surface was configured again; then the next frame retries.
        for _ in 0..2 {
            if self.configured != Some(size) && !self.configure(gpu, size) {
                return Ok(None);
            }
            match self.surface.get_current_texture() {
                wgpu::CurrentSurfaceTexture::Success(texture) => {
                    return Ok(Some(SurfaceFrame::new(gpu, texture, size)));
                }
                wgpu::CurrentSurfaceTexture::Suboptimal(texture) => {
                    self.configured = None;
                    return Ok(Some(SurfaceFrame::new(gpu, texture, size)));
                }
                wgpu::CurrentSurfaceTexture::Outdated => self.configured = None,
                wgpu::CurrentSurfaceTexture::Lost => {
                    self.surface = create(&self.instance, &self.window)?;
                    self.configured = None;
                }
                wgpu::CurrentSurfaceTexture::Timeout
                | wgpu::CurrentSurfaceTexture::Occluded
                | wgpu::CurrentSurfaceTexture::Validation => return Ok(None),
            }
        }
        Ok(None)
    }

    /// Presents `frame`, after all its drawing was submitted.
    pub(crate) fn present(&self, gpu: &Gpu, mut frame: SurfaceFrame) {
        self.window.pre_present_notify();
        if !gpu.is_lost()
            && let Some(texture) = frame.texture.take()
        {
            gpu.queue.present(texture);
        }
    }

    /// Configures the surface and returns whether that succeeded; a window that is being resized or closed
    /// may refuse.
    fn configure(&mut self, gpu: &Gpu, size: [u32; 2]) -> bool {
        let [width, height] = size;
        let refused = gpu.device.push_error_scope(wgpu::ErrorFilter::Validation);
        self.surface.configure(
            &gpu.device,
            &wgpu::SurfaceConfiguration {
                usage: USAGES,
                format: self.format,
                color_space: wgpu::SurfaceColorSpace::Auto,
                width,
                height,
                present_mode: wgpu::PresentMode::Fifo,
                // For low input latency; the CPU's part of a frame is short.
                desired_maximum_frame_latency: 1,
                alpha_mode: self.alpha_mode,
                view_formats: vec![],
            },
        );
        let refused = pollster::block_on(refused.pop());
        if let Some(error) = &refused {
            log::warn!("window surface of {width}x{height}: {error}");
        }
        self.configured = refused.is_none().then_some(size);
        refused.is_none()
    }
}

impl SurfaceFrame {
    fn new(gpu: &Gpu, texture: wgpu::SurfaceTexture, size: [u32; 2]) -> SurfaceFrame {
        let view = texture.texture.create_view(&Default::default());
        SurfaceFrame { texture: Some(texture), loss: gpu.loss.clone(), view, size }
    }

    /// Target for the user interface, drawn over the image.
    pub(crate) fn ui_target(&self) -> UiTarget<'_> {
        UiTarget { view: &self.view, size: self.size, draws_over: true }
    }

    pub(super) fn texture(&self) -> &wgpu::Texture {
        self.view.texture()
    }
}

impl Drop for SurfaceFrame {
    fn drop(&mut self) {
        if let Some(texture) = self.texture.take() {
            self.loss.release(texture);
        }
    }
}

fn create(instance: &wgpu::Instance, window: &Arc<Window>) -> Result<wgpu::Surface<'static>, Fault> {
    instance
        .create_surface(window.clone())
        .map_err(|error| Fault::Device(format!("cannot draw into a window: {error}: try --headless")))
}
