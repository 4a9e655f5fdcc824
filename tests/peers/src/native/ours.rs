//! This project's player, by the calls that its headless mode makes.

use std::path::Path;

use client::gpu::{
    ChannelDepth, Cutoff, FrameLayout, Gpu, GpuClip, Offscreen, RenderSettings, Renderer, choose_f16,
};
use client::content::OpenTake;
use client::view::View;

use super::renderer::PeerRenderer;
use crate::workload::{WorkFrame, Workload};

struct Ours {
    gpu: Gpu,
    renderer: Renderer,
    image: Offscreen,
    settings: RenderSettings,
}

/// Opens the package at `path`, for 8 bits per channel, as windows have.
pub(super) fn open(path: &Path, work: &Workload, cutoff: Cutoff) -> anyhow::Result<Box<dyn PeerRenderer>> {
    let opened = OpenTake::open(path, &codec::Limits::default())?;
    let clip = opened.segment(0, opened.layers()[0])?;
    let mut gpu = Gpu::new_headless()?;
    choose_f16(&mut gpu, ChannelDepth::Eight)?;
    let view = View::from_camera(&work.frames[0].camera);
    let image = Offscreen::new(&gpu, view.size, 1, ChannelDepth::Eight)?;
    let on_gpu = GpuClip::upload(&gpu, &clip)?;
    let renderer = Renderer::new(&gpu, on_gpu, FrameLayout::plain(ChannelDepth::Eight.format(), 1))?;
    let settings = RenderSettings { cutoff, ..RenderSettings::default() };
    Ok(Box::new(Ours { gpu, renderer, image, settings }))
}

impl PeerRenderer for Ours {
    fn device(&self) -> String {
        format!("{}, {}", self.gpu.adapter_name, self.gpu.driver)
    }

    fn draw(&mut self, frame: &WorkFrame) -> anyhow::Result<()> {
        let view = View::from_camera(&frame.camera);
        self.image.render(&self.gpu, &mut self.renderer, frame.t, &[view], &self.settings)?;
        Ok(())
    }

    fn read(&mut self) -> anyhow::Result<Vec<u8>> {
        Ok(self.image.read(&self.gpu)?[0].to_rgb8())
    }
}
