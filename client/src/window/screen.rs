//! [`Screen`]: the graphics device of a window, and all that is bound to the device but not to a clip.

use std::sync::Arc;
use std::thread::sleep;
use std::time::{Duration, Instant};

use egui::ViewportId;
use program::Fault;
use winit::window::{Theme, Window};

use super::style;
use crate::folders;
use crate::fonts;
use crate::gpu::{ChannelDepth, Gpu, Picture, SurfaceFrame, UiPainter, WindowSurface, choose_f16};
use crate::pipeline_folder::PipelineFolder;

/// Longest wait for the loader to release a lost device.
const RELEASE_TIMEOUT: Duration = Duration::from_secs(5);

/// The device of a window and its resources.
pub(super) struct Screen {
    pub(super) picture: Picture,
    pub(super) input: egui_winit::State,
    pub(super) painter: UiPainter,
    pub(super) gpu: Arc<Gpu>,
    /// Dropped last, see [`Screen::drop`].
    pub(super) surface: WindowSurface,
    /// Frames shown.
    frames: u64,
}

impl Screen {
    /// Opens a device for a window.
    ///
    /// # Errors
    /// [`Fault::Device`] if no device can present to it.
    pub(super) fn open(window: &Arc<Window>) -> Result<Screen, Fault> {
        let (mut gpu, surface) = WindowSurface::open(window.clone())?;
        if let Some(folder) = folders::pipelines() {
            gpu.keep_pipelines(Arc::new(PipelineFolder::new(folder)));
        }
        choose_f16(&mut gpu, ChannelDepth::Eight)?;
        let ctx = egui::Context::default();
        style::apply(&ctx);
        fonts::add_fallback(&ctx);
        Ok(Screen {
            picture: Picture::new(&gpu, surface.format(), [1, 1])?,
            input: egui_winit::State::new(
                ctx,
                ViewportId::ROOT,
                window,
                Some(window.scale_factor() as f32),
                Some(Theme::Dark),
                Some(gpu.caps.max_image_side as usize),
            ),
            painter: UiPainter::new(&gpu, surface.format()),
            gpu: Arc::new(gpu),
            surface,
            frames: 0,
        })
    }

    /// Presents `frame`, whose commands have been submitted.
    pub(super) fn present(&mut self, frame: SurfaceFrame) {
        self.surface.present(&self.gpu, frame);
        self.frames = self.frames.saturating_add(1);
    }

    /// Whether the device is lost and has shown enough frames to expect another to work.
    pub(super) fn is_worth_replacing(&self) -> bool {
        self.gpu.is_worth_replacing(self.frames)
    }
}

impl Drop for Screen {
    /// Waits until the loader releases a lost device: until then, the device holds images of the window.
    fn drop(&mut self) {
        let start = Instant::now();
        while self.gpu.is_lost() && Arc::strong_count(&self.gpu) > 1 && start.elapsed() < RELEASE_TIMEOUT {
            sleep(Duration::from_millis(1));
        }
    }
}
