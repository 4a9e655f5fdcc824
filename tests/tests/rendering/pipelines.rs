//! Compiled pipelines are kept: across the clips of a device, and across runs.

use std::sync::{Arc, Mutex, PoisonError};

use aarc_tests::gpu::{self, Passes};
use aarc_tests::scene::{Motion, Recipe, decoded_with};
use client::gpu::{
    ChannelDepth, FrameLayout, Gpu, GpuClip, Offscreen, PipelineStore, RenderSettings, Renderer,
};
use client::pipeline_folder::PipelineFolder;
use client::view::View;
use codec::Camera;
use glam::UVec2;
use libtest_mimic::Trial;
use program::Fault;

/// The tests of this file.
pub(crate) fn trials() -> Vec<Trial> {
    // Devices of their own: pipelines of other tests would be counted.
    vec![
        gpu::trial("a clip like the last one compiles nothing", Passes::Shared, |_| like_the_last()),
        gpu::trial("what was compiled is saved after the first frame", Passes::Shared, |_| saved()),
        gpu::trial("damaged pipelines of an earlier run do no harm", Passes::Shared, |_| damaged()),
    ]
}

const BARE: Recipe =
    Recipe { count: 50, sh_degree: 0, motion: Motion::Static, motion_order: 0, turning: false, seed: 3 };

fn text(fault: Fault) -> String {
    fault.to_string()
}

/// A renderer of a clip for one eye.
fn renderer(gpu: &Gpu, recipe: Recipe) -> Result<Renderer, String> {
    let clip = decoded_with(&recipe.field(), None, &[]);
    let uploaded = GpuClip::upload(gpu, &clip).map_err(text)?;
    Renderer::new(gpu, uploaded, FrameLayout::plain(ChannelDepth::Eight.format(), 1)).map_err(text)
}

/// Draws `frames` frames and returns the picture.
fn draw(gpu: &Gpu, renderer: &mut Renderer, frames: usize) -> Result<Vec<u8>, String> {
    let target = Offscreen::new(gpu, UVec2::new(48, 32), 1, ChannelDepth::Eight).map_err(text)?;
    let camera = Camera::look_at([0.0, 0.0, 4.0], [0.0; 3], [0.0, 1.0, 0.0], 1.0, 48, 32);
    for _ in 0..frames {
        let views = [View::from_camera(&camera)];
        target.render(gpu, renderer, 0.0, &views, &RenderSettings::default()).map_err(text)?;
    }
    Ok(target.read(gpu).map_err(text)?.remove(0).to_rgb8())
}

fn like_the_last() -> Result<(), String> {
    let gpu = Gpu::new_headless().map_err(text)?;
    let mut counts = Vec::new();
    let mut picture = Vec::new();
    for recipe in [BARE, Recipe { seed: 4, ..BARE }, Recipe { sh_degree: 1, ..BARE }, BARE] {
        // The clip before is gone, as where a player changes clips.
        let mut renderer = renderer(&gpu, recipe)?;
        counts.push(gpu.pipelines_compiled());
        picture.push(draw(&gpu, &mut renderer, 1)?);
    }
    if counts != [1, 1, 2, 2] {
        return Err(format!("{counts:?} pipelines were compiled"));
    }
    if picture[0] != picture[3] || picture[0] == picture[1] {
        return Err("a kept pipeline draws another picture".into());
    }
    Ok(())
}

/// A store in memory that records every save.
#[derive(Default)]
struct Recorded {
    bytes: Option<Vec<u8>>,
    saved: Mutex<Vec<(String, usize)>>,
}

impl PipelineStore for Recorded {
    fn load(&self, _: &str) -> Option<Vec<u8>> {
        self.bytes.clone()
    }

    fn save(&self, name: &str, bytes: &[u8]) {
        self.saved.lock().unwrap_or_else(PoisonError::into_inner).push((name.into(), bytes.len()));
    }
}

impl Recorded {
    fn saves(&self) -> Vec<(String, usize)> {
        self.saved.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

fn saved() -> Result<(), String> {
    let store = Arc::new(Recorded::default());
    let mut gpu = Gpu::new_headless().map_err(text)?;
    gpu.keep_pipelines(store.clone());
    let mut clip = renderer(&gpu, BARE)?;
    draw(&gpu, &mut clip, 1)?;
    if !store.saves().is_empty() {
        return Err("saved before the first frame was drawn".into());
    }
    draw(&gpu, &mut clip, 5)?;
    // The device waits for the thread that saves.
    drop((clip, gpu));
    match &store.saves()[..] {
        [(name, bytes)] if name.starts_with("wgpu_pipeline_cache_vulkan_") && *bytes > 0 => Ok(()),
        saves => Err(format!("{saves:?}")),
    }
}

fn damaged() -> Result<(), String> {
    let folder = tempfile::tempdir().map_err(|error| error.to_string())?;
    let store = Arc::new(PipelineFolder::new(folder.path().into()));
    let run = |store: Arc<dyn PipelineStore>| {
        let mut gpu = Gpu::new_headless().map_err(text)?;
        gpu.keep_pipelines(store);
        draw(&gpu, &mut renderer(&gpu, BARE)?, 3)
    };
    let picture = run(store.clone())?;
    let entry = folder.path().read_dir().map_err(|error| error.to_string())?.next();
    let name = entry.ok_or("nothing was saved")?.map_err(|error| error.to_string())?.file_name();
    let whole = store.load(&name.to_string_lossy()).ok_or("what was saved is not found")?;
    let header_of_another_device = {
        let mut bytes = whole.clone();
        bytes[20..28].fill(0xab);
        bytes
    };
    for bytes in
        [whole.clone(), whole[..whole.len() / 2].to_vec(), vec![], vec![7; 4096], header_of_another_device]
    {
        let number = bytes.len();
        let store = Arc::new(Recorded { bytes: Some(bytes), ..Recorded::default() });
        if run(store.clone())? != picture || store.saves().len() != 1 {
            return Err(format!("{number} bytes"));
        }
    }
    Ok(())
}
