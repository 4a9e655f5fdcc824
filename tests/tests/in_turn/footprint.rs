//! The memory that clips take is what the headset's limits reckon with.

use aarc_tests::gpu::{self, Passes};
use aarc_tests::scene::{Motion, Recipe, packaged};
use client::gpu::{ChannelDepth, FrameLayout, Gpu, GpuClip, RESIDENT_BYTES, Renderer, UPLOAD_BYTES};
use client::xr::clip_limits;
use codec::{Clip, Limits};
use libtest_mimic::Trial;

use crate::HEAP;

/// A clip with every optional column.
const RECIPE: Recipe =
    Recipe { count: 20_000, sh_degree: 3, motion: Motion::Dynamic, motion_order: 3, turning: true, seed: 8 };

/// The tests of this file.
pub(crate) fn trials() -> Vec<Trial> {
    vec![
        gpu::trial("memory of a Gaussian", Passes::Shared, |_| of_a_gaussian(&opened()?)),
        gpu::trial("a clip within the limits stays within the budget", Passes::Shared, |_| {
            within_budget(&opened()?)
        }),
    ]
}

/// A device of the test's own: memory of other clips would be counted.
fn opened() -> Result<Gpu, String> {
    Gpu::new_headless().map_err(|fault| fault.to_string())
}

/// A clip that can be drawn, as a headset makes it ready.
fn prepare(gpu: &Gpu, clip: &Clip) -> Result<Renderer, String> {
    let fault = |fault: program::Fault| fault.to_string();
    let on_gpu = GpuClip::upload(gpu, clip).map_err(fault)?;
    let layout = FrameLayout { format: ChannelDepth::Eight.format(), eyes: 2, foveated: true };
    Renderer::new(gpu, on_gpu, layout).map_err(fault)
}

/// Memory of the program and the device in bytes: now, and the most since the heap's peak was reset.
fn memory(gpu: &Gpu) -> Result<[u64; 2], String> {
    let device = gpu.allocated_bytes().ok_or("the device does not count its memory")?;
    Ok([HEAP.current_usage() as u64 + device, HEAP.peak_usage() as u64 + device])
}

/// Compares two sizes of a clip: what does not depend on it, such as pipelines, cancels out.
fn of_a_gaussian(gpu: &Gpu) -> Result<(), String> {
    let mut taken = Vec::new();
    for count in [RECIPE.count, 2 * RECIPE.count] {
        let package = packaged(&Recipe { count, ..RECIPE }.field(), None, &[]);
        let clip = codec::decode(&package, &Limits::default()).map_err(|error| error.to_string())?;
        HEAP.reset_peak_usage();
        let [before, _] = memory(gpu)?;
        let renderer = prepare(gpu, &clip)?;
        let [_, peak] = memory(gpu)?;
        // The copy on the way to the GPU goes with the next submission.
        gpu.submit(gpu.encoder());
        gpu.wait().map_err(|fault| fault.to_string())?;
        let [after, _] = memory(gpu)?;
        taken.push([peak - before, after - before].map(|bytes| bytes as f64));
        drop(renderer);
    }
    let count = RECIPE.count as f64;
    let [peak, resident] = [0, 1].map(|i: usize| (taken[1][i] - taken[0][i]) / count);
    println!("a Gaussian takes {resident:.0} bytes, and {peak:.0} while it is uploaded");
    for (what, bytes, most) in
        [("resident", resident, RESIDENT_BYTES), ("uploading", peak, RESIDENT_BYTES + UPLOAD_BYTES)]
    {
        // The bound is no guess: it is reached within a quarter.
        if !(0.75 * most as f64..=1.001 * most as f64).contains(&bytes) {
            return Err(format!("{what}: {bytes:.0} bytes, {most} are reckoned with"));
        }
    }
    Ok(())
}

/// Loads a clip on a machine with just enough memory for it, while two such clips are ready.
fn within_budget(gpu: &Gpu) -> Result<(), String> {
    let package = packaged(&RECIPE.field(), None, &[]);
    let decode = |bytes: &[u8], limits: &Limits| codec::decode(bytes, limits);
    let (mut too_small, mut total) = (0, 1 << 40);
    while total - too_small > 1 << 16 {
        let between = (too_small + total) / 2;
        let limits = clip_limits(between);
        let fits = package.len() <= limits.max_bytes && decode(&package, &limits).is_ok();
        *(if fits { &mut total } else { &mut too_small }) = between;
    }
    let limits = clip_limits(total);
    HEAP.reset_peak_usage();
    let [before, _] = memory(gpu)?;
    let mut ready = Vec::new();
    for _ in 0..3 {
        // The package as it arrives, in pieces, and the copy that is decoded.
        let mut buffer = Vec::new();
        package.chunks(1000).for_each(|piece| buffer.extend_from_slice(piece));
        let copy = buffer.clone();
        let clip = decode(&copy, &limits).map_err(|error| error.to_string())?;
        drop(copy);
        ready.push(prepare(gpu, &clip)?);
    }
    let [_, peak] = memory(gpu)?;
    let (taken, budget) = (peak - before, total / 4);
    println!("a machine of {total} bytes plays it: {taken} of {budget} bytes are taken");
    // A budget far above what is taken would refuse clips that play.
    if taken > budget || taken < budget / 8 {
        return Err(format!("{taken} bytes are taken, the budget is {budget}"));
    }
    Ok(())
}
