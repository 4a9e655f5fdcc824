//! The GPU of this machine, and pictures drawn by it.

use std::sync::{Arc, OnceLock};

use client::gpu::{
    ChannelDepth, FrameLayout, Gpu, GpuClip, Level, Offscreen, Pixels, RenderSettings, Renderer, choose_f16,
};
use client::view::View;
use codec::{Camera, Clip};
use glam::UVec2;
use program::Fault;
use refine::image::Image;

/// How the eyes of a frame are drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Passes {
    /// All in one pass where the device can, as players do.
    Shared,
    /// One pass for each eye, as devices without multiview must.
    PerEye,
}

/// What the fragment stage calculates in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fragments {
    /// As players do: in f16 where [`choose_f16`] finds that it suffices.
    AsPlayers,
    /// In f32, for what is held to the bounds of f32.
    Single,
}

/// The device of this machine, opened once for each way to draw; with [`Passes::PerEye`] made to draw without
/// multiview.
///
/// # Errors
/// Why there is none.
pub fn device(passes: Passes, fragments: Fragments) -> Result<&'static Gpu, Fault> {
    static DEVICES: [[OnceLock<Result<Gpu, Fault>>; 2]; 2] = [const { [const { OnceLock::new() }; 2] }; 2];
    let device = DEVICES[passes as usize][fragments as usize].get_or_init(|| {
        let mut gpu = Gpu::new_headless()?;
        gpu.caps.multiview &= passes == Passes::Shared;
        if fragments == Fragments::AsPlayers {
            choose_f16(&mut gpu, ChannelDepth::Sixteen)?;
        }
        Ok(gpu)
    });
    device.as_ref().map_err(Clone::clone)
}

/// Draws one frame of a clip, at clip time `t`, for one camera or for two that look the same way.
///
/// # Errors
/// What the renderer reports.
pub fn draw(
    gpu: &Gpu,
    clip: &Clip,
    cameras: &[Camera],
    t: f64,
    settings: &RenderSettings,
    depth: ChannelDepth,
) -> Result<Vec<Image>, Fault> {
    let clip = GpuClip::upload(gpu, clip)?;
    Drawing::new(gpu, clip, cameras, depth)?.frame(t, settings)
}

/// What drawing several frames of a clip or a take for the same cameras takes.
pub struct Drawing<'a> {
    gpu: &'a Gpu,
    renderer: Renderer,
    target: Offscreen,
    views: Vec<View>,
}

impl<'a> Drawing<'a> {
    /// Sets drawing up.
    ///
    /// # Errors
    /// What the renderer reports.
    pub fn new(
        gpu: &'a Gpu,
        clip: Arc<GpuClip>,
        cameras: &[Camera],
        depth: ChannelDepth,
    ) -> Result<Drawing<'a>, Fault> {
        Drawing::by(gpu, cameras, depth, |layout| Renderer::new(gpu, clip, layout))
    }

    /// Sets drawing up by the renderer that `renderer` makes for the frames.
    ///
    /// # Errors
    /// What the renderer reports.
    pub fn by(
        gpu: &'a Gpu,
        cameras: &[Camera],
        depth: ChannelDepth,
        renderer: impl FnOnce(FrameLayout) -> Result<Renderer, Fault>,
    ) -> Result<Drawing<'a>, Fault> {
        let size = UVec2::new(cameras[0].width, cameras[0].height);
        Ok(Drawing {
            gpu,
            renderer: renderer(FrameLayout { format: depth.format(), eyes: cameras.len(), foveated: true })?,
            target: Offscreen::new(gpu, size, cameras.len() as u32, depth)?
                .foveated(gpu, Level::INSET_MAX)?,
            views: cameras.iter().map(View::from_camera).collect(),
        })
    }

    /// The renderer.
    pub fn renderer(&mut self) -> &mut Renderer {
        &mut self.renderer
    }

    /// Turns to other cameras, as many and with images of the same size.
    pub fn look(&mut self, cameras: &[Camera]) {
        self.views = cameras.iter().map(View::from_camera).collect();
    }

    /// Draws a frame and reads it back, an image for each camera.
    ///
    /// # Errors
    /// What the renderer reports.
    pub fn frame(&mut self, t: f64, settings: &RenderSettings) -> Result<Vec<Image>, Fault> {
        self.target.render(self.gpu, &mut self.renderer, t, &self.views, settings)?;
        Ok(self.target.read(self.gpu)?.iter().map(image).collect())
    }
}

fn image(pixels: &Pixels) -> Image {
    Image {
        width: pixels.size.x,
        height: pixels.size.y,
        pixels: pixels.rgba.iter().map(|pixel| pixel.map(f64::from)).collect(),
    }
}
