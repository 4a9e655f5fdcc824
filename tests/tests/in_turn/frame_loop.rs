//! Drawing frames allocates nothing that stays, builds no graphics object and waits for nothing: a clip's
//! memory and pipelines are final after its upload.
//!
//! Rounds of the same frames are drawn without a wait in between, as a window draws them, and everything is
//! counted between rounds: the heap to the byte, and the objects by the graphics API's own report.

use aarc_tests::gpu::{self, Passes};
use aarc_tests::scene::{Motion, Place, Recipe, camera, decoded_with};
use aarc_tests::takes::SplitTake;
use client::gpu::{
    ChannelDepth, Cutoff, Foveation, FrameLayout, Gpu, GpuClip, Offscreen, PackedSegment, RenderSettings,
    Renderer, SortOrder,
};
use client::view::View;
use glam::UVec2;
use libtest_mimic::Trial;

use crate::HEAP;

/// Frames of a round, in which everything that may differ between frames takes each of its values.
const FRAMES: u32 = 12;

/// Rounds in which pools of the graphics API find their size, and rounds that are compared.
const WARM_UP: usize = 20;
const ROUNDS: usize = 42;

/// The tests of this file.
pub(crate) fn trials() -> Vec<Trial> {
    // Their own devices: objects of other tests would be counted.
    let opened = || Gpu::new_headless().map_err(|fault| fault.to_string());
    vec![
        gpu::trial("one eye, then two", Passes::Shared, move |_| {
            let gpu = opened()?;
            clip(&gpu, 1).and_then(|()| clip(&gpu, 2))
        }),
        gpu::trial("segments come and go, one eye, then two", Passes::Shared, move |_| {
            let gpu = opened()?;
            take(&gpu, 1).and_then(|()| take(&gpu, 2))
        }),
        gpu::trial("the GPU time of a frame is told once", Passes::Shared, told_once),
    ]
}

fn clip(gpu: &Gpu, eyes: usize) -> Result<(), String> {
    let recipe =
        Recipe { count: 800, sh_degree: 2, motion: Motion::Mixed, motion_order: 3, turning: true, seed: 4 };
    let plate = Recipe { motion: Motion::Static, turning: false, count: 100, ..recipe };
    let clip = decoded_with(&recipe.field(), Some(&plate.field()), &[200, 500]);
    let fault = |fault: program::Fault| fault.to_string();
    let uploaded = GpuClip::upload(gpu, &clip).map_err(fault)?;
    let renderer = Renderer::new(gpu, uploaded, frames(eyes)).map_err(fault)?;
    steady(gpu, eyes, renderer, |_, frame| f64::from(frame) / f64::from(FRAMES))
}

fn told_once(gpu: &Gpu) -> Result<(), String> {
    let fault = |fault: program::Fault| fault.to_string();
    let recipe =
        Recipe { count: 800, sh_degree: 2, motion: Motion::Static, motion_order: 0, turning: false, seed: 4 };
    let uploaded = GpuClip::upload(gpu, &decoded_with(&recipe.field(), None, &[])).map_err(fault)?;
    let mut renderer = Renderer::new(gpu, uploaded, frames(1)).map_err(fault)?;
    let target = Offscreen::new(gpu, UVec2::new(96, 64), 1, ChannelDepth::Eight).map_err(fault)?;
    let views = [View::from_camera(&camera(Place::Whole, 96, 64))];
    for _ in 0..3 {
        target.render(gpu, &mut renderer, 0.0, &views, &RenderSettings::default()).map_err(fault)?;
        let told = [renderer.new_gpu_ms(), renderer.new_gpu_ms()];
        if told[0].is_some() != gpu.caps.timestamps || told[1].is_some() || renderer.gpu_ms() != told[0] {
            return Err(format!("{told:?}, and the latest is {:?}", renderer.gpu_ms()));
        }
    }
    Ok(())
}

/// Frames of `eyes` eyes.
fn frames(eyes: usize) -> FrameLayout {
    FrameLayout { format: ChannelDepth::Eight.format(), eyes, foveated: true }
}

/// Before each frame one of two segments gives its place to another one, which the frame then draws.
fn take(gpu: &Gpu, eyes: usize) -> Result<(), String> {
    let recipe =
        Recipe { count: 800, sh_degree: 2, motion: Motion::Mixed, motion_order: 3, turning: true, seed: 4 };
    let take = SplitTake::new(&recipe, 24.0, 1.5);
    let fault = |fault: program::Fault| fault.to_string();
    let layout = take.layout(take.resident_max() * 2);
    let renderer = Renderer::new_take(gpu, layout, frames(eyes)).map_err(fault)?;
    // In a player, a loader's thread packs.
    let packed = |segment: usize| {
        let (span, clip) = &take.segments[segment % take.segments.len()];
        PackedSegment::new(clip, *span, &layout).map_err(fault).map(|packed| (packed, *span))
    };
    let mut resident = Vec::with_capacity(2);
    let mut changes = 0;
    steady(gpu, eyes, renderer, |renderer, frame| {
        let slots = renderer.slots().expect("it draws a take");
        if resident.len() == 2 {
            slots.remove(resident.remove(0));
        }
        let (packed, span) = packed(frame as usize).expect("it is a segment of the take");
        resident.push(slots.insert(packed).expect("room for two"));
        assert!(slots.upload(gpu, 1 << 20) > 0);
        changes += 1;
        (span.start_s + 0.4 * span.duration_s) / take.duration_s
    })?;
    assert_eq!(changes, (WARM_UP + ROUNDS) as u32 * FRAMES);
    Ok(())
}

/// Draws rounds of frames of `renderer`; `instant` prepares each and returns its time.
fn steady(
    gpu: &Gpu,
    eyes: usize,
    mut renderer: Renderer,
    mut instant: impl FnMut(&mut Renderer, u32) -> f64,
) -> Result<(), String> {
    let fault = |fault: program::Fault| fault.to_string();
    let (format, size) = (ChannelDepth::Eight.format(), UVec2::new(96, 64));
    let foveation = Foveation::new(gpu, format, eyes, size, 0.5).map_err(fault)?;
    let target = Offscreen::new(gpu, size, eyes as u32, ChannelDepth::Eight).map_err(fault)?;
    let targets = target.targets(renderer.eyes_per_pass());
    let settled = (gpu.objects(), renderer.clip().bytes());

    let mut heap = Vec::with_capacity(WARM_UP + ROUNDS);
    for round in 0..WARM_UP + ROUNDS {
        let waits = gpu.waits();
        for frame in 0..FRAMES {
            let (views, settings) = inputs(eyes, frame);
            let mut encoder = gpu.encoder();
            let t = instant(&mut renderer, frame);
            renderer.prepare(gpu, t, &views, &settings);
            renderer.record(gpu, &mut encoder, &targets, Some(&foveation), None);
            gpu.submit(encoder);
        }
        if gpu.waits() != waits {
            return Err("a frame waits for the GPU".into());
        }
        // The graphics API holds what the GPU uses until then.
        gpu.wait().map_err(fault)?;
        heap.push(HEAP.current_usage());
        let held = (gpu.objects(), renderer.clip().bytes());
        if held != settled {
            return Err(format!(
                "after {round} rounds of {FRAMES} frames {held:?} are held, {settled:?} before"
            ));
        }
    }
    // The least of many rounds is what is held for good: a pool may be fuller for a round. And a pool may grow once; what
    // is lost in every round grows from each third to the next.
    let least = |rounds: &[usize]| rounds.iter().copied().min().unwrap_or(0);
    let thirds: Vec<usize> = heap[WARM_UP..].chunks(ROUNDS / 3).map(least).collect();
    if thirds.is_sorted_by(|before, after| before < after) {
        return Err(format!("the heap grows from third to third: {thirds:?}, {heap:?}"));
    }
    Ok(())
}

/// Views and settings of frame `frame` of a round.
fn inputs(eyes: usize, frame: u32) -> (Vec<View>, RenderSettings) {
    let camera = camera([Place::Whole, Place::Near, Place::Far, Place::Edge][frame as usize % 4], 96, 64);
    let cameras = if eyes == 2 { camera.stereo_pair(0.065).to_vec() } else { vec![camera] };
    let settings = RenderSettings {
        sort: [SortOrder::Depth, SortOrder::Radial][frame as usize % 2],
        cutoff: [Cutoff::Exact, Cutoff::Sqrt8, Cutoff::Sqrt5][frame as usize % 3],
        layers: [None, Some(1), Some(2)][frame as usize % 3],
        inset: [None, Some(0.5), Some(0.3)][frame as usize % 3],
    };
    (cameras.iter().map(View::from_camera).collect(), settings)
}
