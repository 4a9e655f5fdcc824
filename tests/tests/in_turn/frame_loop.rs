//! Drawing frames makes no growing allocation. A clip's GPU memory and pipelines are final after its
//! upload.

use std::sync::Arc;

use aarc_tests::gpu::{self, Passes};
use aarc_tests::scene::{Motion, Place, Recipe, camera, decoded_with};
use client::gpu::{ChannelDepth, Cutoff, Gpu, GpuClip, Offscreen, RenderSettings, Renderer, SortOrder};
use client::view::View;
use glam::UVec2;
use libtest_mimic::Trial;

use crate::HEAP;

const WARM_UP: u32 = 60;

const FRAMES: u32 = 300;

/// The tests of this file.
pub(crate) fn trials() -> Vec<Trial> {
    vec![gpu::trial("one eye, then two", Passes::Shared, |gpu| steady(gpu, 1).and_then(|()| steady(gpu, 2)))]
}

fn steady(gpu: &Gpu, eyes: usize) -> Result<(), String> {
    let recipe =
        Recipe { count: 800, sh_degree: 2, motion: Motion::Mixed, motion_order: 3, turning: true, seed: 4 };
    let plate = Recipe { motion: Motion::Static, turning: false, count: 100, ..recipe };
    let clip = decoded_with(&recipe.field(), Some(&plate.field()), &[200, 500]);
    let fault = |fault: program::Fault| fault.to_string();
    let uploaded = Arc::new(GpuClip::upload(gpu, &clip).map_err(fault)?);
    let mut renderer =
        Renderer::new(gpu, uploaded.clone(), ChannelDepth::Eight.format(), eyes).map_err(fault)?;
    let target = Offscreen::new(gpu, UVec2::new(96, 64), eyes as u32, ChannelDepth::Eight).map_err(fault)?;
    let targets = target.targets(renderer.eyes_per_pass());
    let settled = (uploaded.bytes(), renderer.pipelines());

    let mut heap_at = Vec::with_capacity((WARM_UP + FRAMES) as usize);
    for frame in 0..WARM_UP + FRAMES {
        // Varies everything that may differ between frames.
        let t = f64::from(frame) * 0.37 % 1.0;
        let place = [Place::Whole, Place::Near, Place::Far, Place::Edge][frame as usize % 4];
        let camera = camera(place, 96, 64);
        let cameras = if eyes == 2 { camera.stereo_pair(0.065).to_vec() } else { vec![camera] };
        let views: Vec<View> = cameras.iter().map(View::from_camera).collect();
        let settings = RenderSettings {
            sort: [SortOrder::Depth, SortOrder::Radial][frame as usize % 2],
            cutoff: [Cutoff::Exact, Cutoff::Sqrt8, Cutoff::Sqrt5][frame as usize % 3],
            layers: [None, Some(1), Some(2)][frame as usize % 3],
            min_contribution_px: [0.0, 1.0][frame as usize % 2],
        };
        let mut encoder = gpu.encoder();
        renderer.draw(gpu, &mut encoder, t, &views, &settings, &targets);
        gpu.submit(encoder);
        gpu.wait().map_err(fault)?;
        drop((views, cameras));
        heap_at.push(HEAP.current_usage());
    }
    // The minimum of a quarter ignores frames that hold memory for a while. A leak raises it from each
    // quarter to the next; a buffer that grows once does not.
    let quarters = heap_at[WARM_UP as usize..].chunks(FRAMES as usize / 4);
    let least: Vec<usize> = quarters.filter_map(|quarter| quarter.iter().min().copied()).collect();
    if least.is_sorted_by(|a, b| a < b) {
        return Err(format!("the heap grows: at least {least:?} bytes in each quarter of {FRAMES} frames"));
    }
    if (uploaded.bytes(), renderer.pipelines()) != settled {
        return Err("drawing changed the clip's GPU memory or pipelines".into());
    }
    Ok(())
}
