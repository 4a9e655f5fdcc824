//! [`Screen`]: the device that a window is drawn with, and what lasts as long as it, whatever plays.

use std::sync::Arc;
use std::thread::sleep;
use std::time::{Duration, Instant};

use egui::ViewportId;
use program::Fault;
use winit::window::{Theme, Window};

use super::style;
use crate::gpu::{Gpu, Picture, SurfaceFrame, UiPainter, WindowSurface};

/// Longest to wait for the loader.
const PATIENCE: Duration = Duration::from_secs(5);

/// What a window is drawn with.
pub(super) struct Screen {
    pub(super) picture: Picture,
    pub(super) input: egui_winit::State,
    pub(super) painter: UiPainter,
    pub(super) gpu: Arc<Gpu>,
    /// Put away last, see [`Screen::drop`].
    pub(super) surface: WindowSurface,
    /// Frames shown.
    frames: u64,
}

impl Screen {
    /// Opens a device for a window.
    ///
    /// # Errors
    /// [`Fault::Device`] if there is none that can show on it.
    pub(super) fn open(window: &Arc<Window>) -> Result<Screen, Fault> {
        let (gpu, surface) = WindowSurface::open(window.clone())?;
        let ctx = egui::Context::default();
        style::apply(&ctx);
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

    /// Shows `frame`, all of whose drawing has been submitted.
    pub(super) fn present(&mut self, frame: SurfaceFrame) {
        self.surface.present(&self.gpu, frame);
        self.frames = self.frames.saturating_add(1);
    }

    /// Whether the device is lost after it worked for long enough that another one may as well.
    pub(super) fn is_worth_replacing(&self) -> bool {
        self.gpu.is_worth_replacing(self.frames)
    }
}

impl Drop for Screen {
    /// What was under way on a device that is gone holds images of the window until the device is put
    /// away, which the loader may still have in its hands for a moment.
    fn drop(&mut self) {
        let start = Instant::now();
        while self.gpu.is_lost() && Arc::strong_count(&self.gpu) > 1 && start.elapsed() < PATIENCE {
            sleep(Duration::from_millis(1));
        }
    }
}
