//! [`WindowSurface`]: a window as something to draw into.

use std::sync::Arc;

use program::Fault;
use winit::window::Window;

use super::device::{Failures, Gpu, Loss};
use super::ui::UiTarget;

/// Formats that take display-referred colours as they are, in the order of preference.
const FORMATS: [wgpu::TextureFormat; 2] = [wgpu::TextureFormat::Bgra8Unorm, wgpu::TextureFormat::Rgba8Unorm];

/// The interface is drawn over a picture that is copied in.
const USAGES: wgpu::TextureUsages =
    wgpu::TextureUsages::RENDER_ATTACHMENT.union(wgpu::TextureUsages::COPY_DST);

/// How the colours of an image are stored.
pub(crate) type Format = wgpu::TextureFormat;

/// The images that a window shows.
pub(crate) struct WindowSurface {
    instance: wgpu::Instance,
    surface: wgpu::Surface<'static>,
    window: Arc<Window>,
    format: wgpu::TextureFormat,
    alpha_mode: wgpu::CompositeAlphaMode,
    /// Size that the surface is configured for; `None` where it must be configured anew.
    configured: Option<[u32; 2]>,
    failures: Failures,
}

/// An image of the window, to be drawn and shown.
pub(crate) struct SurfaceFrame {
    /// Until it is shown.
    texture: Option<wgpu::SurfaceTexture>,
    loss: Loss,
    /// What to draw into.
    pub(crate) view: wgpu::TextureView,
    /// Width and height in pixels.
    pub(crate) size: [u32; 2],
}

impl WindowSurface {
    /// Opens the fastest device that can show on `window`.
    ///
    /// # Errors
    /// [`Fault::Device`] if there is none.
    pub(crate) fn open(window: Arc<Window>) -> Result<(Gpu, WindowSurface), Fault> {
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle_from_env());
        // Where it fails for want of a driver, that is the thing to say.
        let surface = create(&instance, &window)
            .or_else(|fault| Gpu::from_instance(&instance, None).and(Err(fault)))?;
        let gpu = Gpu::from_instance(&instance, Some(&surface))?;
        let offered = surface.get_capabilities(&gpu.adapter);
        let format =
            FORMATS.into_iter().find(|format| offered.formats.contains(format)).ok_or_else(|| {
                Fault::Device(format!(
                    "{} shows no 8-bit images in windows; try --headless",
                    gpu.adapter_name
                ))
            })?;
        let opaque = wgpu::CompositeAlphaMode::Opaque;
        let surface = WindowSurface {
            instance,
            surface,
            window,
            format,
            alpha_mode: if offered.alpha_modes.contains(&opaque) { opaque } else { Default::default() },
            configured: None,
            failures: Failures::watch(&gpu),
        };
        Ok((gpu, surface))
    }

    /// The format that renderers must draw in.
    pub(crate) fn format(&self) -> Format {
        self.format
    }

    /// The next image of the window, at its present size. Waits until the display takes one more;
    /// `None` while there is nothing to show it on.
    ///
    /// # Errors
    /// [`Fault::Device`] if the device was lost or has failed.
    pub(crate) fn acquire(&mut self, gpu: &Gpu) -> Result<Option<SurfaceFrame>, Fault> {
        self.failures.check(gpu)?;
        let size = <[u32; 2]>::from(self.window.inner_size()).map(|side| side.min(gpu.caps.max_image_side));
        if size.contains(&0) {
            return Ok(None);
        }
        // A second try after the surface was made anew; after that, the next frame.
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

    /// Shows `frame`, all of whose drawing has been submitted.
    pub(crate) fn present(&self, gpu: &Gpu, mut frame: SurfaceFrame) {
        self.window.pre_present_notify();
        if !gpu.is_lost()
            && let Some(texture) = frame.texture.take()
        {
            gpu.queue.present(texture);
        }
    }

    /// Whether it worked: a window that is being resized or closed may refuse.
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
                // What a hand does shows in the next image; the processor's part of a frame is short.
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

    /// The interface goes over what was drawn.
    pub(crate) fn ui_target(&self) -> UiTarget<'_> {
        UiTarget { view: &self.view, size: self.size, keeps: true }
    }

    pub(super) fn texture(&self) -> &wgpu::Texture {
        self.view.texture()
    }
}

impl Drop for SurfaceFrame {
    fn drop(&mut self) {
        if let Some(texture) = self.texture.take() {
            self.loss.let_go(texture);
        }
    }
}

fn create(instance: &wgpu::Instance, window: &Arc<Window>) -> Result<wgpu::Surface<'static>, Fault> {
    instance
        .create_surface(window.clone())
        .map_err(|error| Fault::Device(format!("cannot draw into a window: {error}; try --headless")))
}
