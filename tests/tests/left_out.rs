//! What a clip does not use is absent from its GPU memory and its pipelines: what it takes is
//! exactly what its columns need.

use std::mem::size_of;
use std::process::ExitCode;
use std::sync::Arc;

use aarc_tests::gpu::{self, Passes};
use aarc_tests::scene::{Motion, Recipe, decoded_with};
use client::gpu::{Depth, Gpu, GpuClip, Renderer};
use codec::Clip;
use shaders::layout::{Gaussian, Ranges};
use shaders::sh_words;

fn main() -> ExitCode {
    gpu::run(vec![gpu::trial("GPU memory and pipelines", Passes::Shared, memory_and_pipelines)])
}

const COUNT: usize = 100;

const WORD: usize = size_of::<u32>();

fn memory_and_pipelines(gpu: &Gpu) -> Result<(), String> {
    let bare = Recipe {
        count: COUNT,
        sh_degree: 0,
        motion: Motion::Still,
        motion_order: 0,
        turning: false,
        seed: 2,
    };
    let least = size_of::<Ranges>() + COUNT * size_of::<Gaussian>();
    expect(gpu, "nothing optional", &decoded_with(&bare.field(), None, &[]), least, 1)?;
    for sh_degree in 1..=3 {
        let clip = decoded_with(&Recipe { sh_degree, ..bare }.field(), None, &[]);
        let bytes = least + COUNT * WORD * sh_words(sh_degree);
        expect(gpu, &format!("SH {sh_degree}"), &clip, bytes, 1)?;
    }
    for (motion_order, turning) in [(0, false), (1, false), (2, false), (3, false), (3, true)] {
        let recipe = Recipe { motion: Motion::Mixed, motion_order, turning, ..bare };
        let clip = decoded_with(&recipe.field(), None, &[]);
        if clip.moving.len() != COUNT / 2 {
            return Err(format!("{} of {COUNT} Gaussians move", clip.moving.len()));
        }
        let words = shaders::Motion { order: motion_order, rotates: turning }.words();
        let bytes = least + clip.moving.len() * WORD * words;
        expect(gpu, &format!("motion of order {motion_order}, turning: {turning}"), &clip, bytes, 1)?;
    }
    let plate = Recipe { sh_degree: 1, ..bare }.field();
    let bytes = 2 * least + COUNT * WORD * sh_words(1);
    expect(gpu, "plate", &decoded_with(&bare.field(), Some(&plate), &[]), bytes, 2)
}

fn expect(gpu: &Gpu, what: &str, clip: &Clip, bytes: usize, pipelines: usize) -> Result<(), String> {
    let fault = |fault: client::fault::Fault| fault.to_string();
    let uploaded = Arc::new(GpuClip::upload(gpu, clip).map_err(fault)?);
    let renderer = Renderer::new(gpu, uploaded.clone(), Depth::Eight.format(), 1).map_err(fault)?;
    if (uploaded.bytes(), renderer.pipelines()) == (bytes as u64, pipelines) {
        return Ok(());
    }
    let (has_bytes, has_pipelines) = (uploaded.bytes(), renderer.pipelines());
    Err(format!("{what}: {has_bytes} bytes for {bytes}, {has_pipelines} pipelines for {pipelines}"))
}
