//! A clip's package, GPU memory and pipelines hold nothing that the clip does not use: their sizes are
//! exactly the sizes of its columns.

use std::mem::size_of;

use aarc_tests::gpu::{self, Passes};
use aarc_tests::scene::{Motion, Recipe, decoded_with, info};
use client::gpu::{ChannelDepth, FrameLayout, Gpu, GpuClip, PlateLayout, Renderer, TakeLayout};
use codec::{Clip, Coder, EncodeOptions, Field, LayerEnd, Limits, Source, Temporal, sh_coefficients};
use libtest_mimic::{Failed, Trial};
use shaders::layout::{Gaussian, Ranges};
use shaders::sh_words;

/// The tests of this file.
pub(crate) fn trials() -> Vec<Trial> {
    vec![
        gpu::trial("GPU memory and pipelines", Passes::Shared, |_| memory_and_pipelines()),
        gpu::trial("GPU memory and pipelines of takes", Passes::Shared, takes),
        Trial::test("columns that say nothing", columns_that_say_nothing),
    ]
}

const COUNT: usize = 100;

/// A field without any optional column.
const BARE: Recipe =
    Recipe { count: COUNT, sh_degree: 0, motion: Motion::Static, motion_order: 0, turning: false, seed: 2 };

const WORD: usize = size_of::<u32>();

fn memory_and_pipelines() -> Result<(), String> {
    let least = size_of::<Ranges>() + COUNT * size_of::<Gaussian>();
    expect("nothing optional", &decoded_with(&BARE.field(), None, &[]), least, 1)?;
    for sh_degree in 1..=3 {
        let clip = decoded_with(&Recipe { sh_degree, ..BARE }.field(), None, &[]);
        let bytes = least + COUNT * WORD * sh_words(sh_degree);
        expect(&format!("SH {sh_degree}"), &clip, bytes, 1)?;
    }
    for (motion_order, turning) in [(0, false), (1, false), (2, false), (3, false), (3, true)] {
        let recipe = Recipe { motion: Motion::Mixed, motion_order, turning, ..BARE };
        let clip = decoded_with(&recipe.field(), None, &[]);
        if clip.dynamic_field.len() != COUNT / 2 {
            return Err(format!("{} of {COUNT} Gaussians are dynamic", clip.dynamic_field.len()));
        }
        let words = shaders::Motion { order: motion_order, rotates: turning }.words();
        let bytes = least + clip.dynamic_field.len() * WORD * words;
        expect(&format!("motion of order {motion_order}, turning: {turning}"), &clip, bytes, 1)?;
    }
    let plate = Recipe { sh_degree: 1, ..BARE }.field();
    let bytes = 2 * least + COUNT * WORD * sh_words(1);
    expect("plate", &decoded_with(&BARE.field(), Some(&plate), &[]), bytes, 2)
}

/// A take has the columns of its layout, and a second pipeline for a plate alone.
fn takes(gpu: &Gpu) -> Result<(), String> {
    let features = |sh_degree, motion| shaders::Features { sh_degree, motion, mip: false, segmented: true };
    let layout = |sh_degree, order, rotates, plate| TakeLayout {
        features: features(sh_degree, Some(shaders::Motion { order, rotates })),
        near: 0.0,
        origin: glam::DVec3::ZERO,
        bounds: [[-1.0; 3], [1.0; 3]],
        room: LayerEnd { static_count: 0, dynamic_count: COUNT },
        duration_s: 60.0,
        plate,
    };
    let plate = PlateLayout { features: features(1, None), rows: 7 };
    for (layout, words_of_plate, pipelines) in [
        (layout(0, 0, false, None), 0, 1),
        (layout(2, 1, false, None), 0, 1),
        (layout(0, 3, true, Some(plate)), 8 + sh_words(1), 2),
    ] {
        let words =
            layout.features.motion.map_or(0, shaders::Motion::words) + sh_words(layout.features.sh_degree);
        let row = size_of::<Gaussian>() + WORD * words;
        let bytes = (COUNT * row + 7 * WORD * words_of_plate) as u64;
        let renderer = Renderer::new_take(gpu, layout, FrameLayout::plain(ChannelDepth::Eight.format(), 1))
            .map_err(|fault| fault.to_string())?;
        let found = (renderer.clip().bytes(), renderer.pipelines());
        if found != (bytes, pipelines) {
            return Err(format!("{layout:?}: {found:?} for {:?}", (bytes, pipelines)));
        }
    }
    Ok(())
}

/// Columns that hold only defaults are not packaged: the package is the same as without them.
fn columns_that_say_nothing() -> Result<(), Failed> {
    let bare = BARE.field();
    let coefficients = sh_coefficients(3);
    let wide = Field {
        sh_degree: 3,
        sh: bare
            .sh
            .iter()
            .flat_map(|&c| [&[c][..], &vec![[0.0; 3]; coefficients - 1][..]].concat())
            .collect(),
        temporal: Some(Temporal {
            tau: vec![0.5; COUNT],
            s: vec![f32::INFINITY; COUNT],
            motion_order: 3,
            motion: vec![[0.0; 3]; 3 * COUNT],
            rotation_rates: Some(vec![[0.0; 4]; COUNT]),
        }),
        ..bare.clone()
    };
    let package = |coder, field| {
        let options = EncodeOptions { coder, ..EncodeOptions::default() };
        codec::encode(&Source { info: &info(), field, plate: None }, &options)
    };
    for coder in Coder::ALL {
        let [exact, least] = [&wide, &bare].map(|field| package(coder, field));
        if exact? != least? {
            return Err(format!("another package by the coder {coder:?}").into());
        }
    }
    let clip = codec::decode(&package(Coder::Rans, &wide)?, &Limits::default())?;
    if (clip.static_field.len(), clip.static_field.sh_degree, clip.dynamic_field.len()) != (COUNT, 0, 0) {
        return Err(format!(
            "{} of SH degree {} are static",
            clip.static_field.len(),
            clip.static_field.sh_degree
        )
        .into());
    }
    Ok(())
}

fn expect(what: &str, clip: &Clip, bytes: usize, pipelines: usize) -> Result<(), String> {
    let fault = |fault: program::Fault| fault.to_string();
    // Its own device: it keeps pipelines, so that pipelines of other clips would be missing in the count.
    let gpu = &Gpu::new_headless().map_err(fault)?;
    let uploaded = GpuClip::upload(gpu, clip).map_err(fault)?;
    // By the graphics API's own report.
    let built =
        || gpu.objects().into_iter().find_map(|(kind, count)| (kind == "render pipelines").then_some(count));
    let before = built();
    let renderer = Renderer::new(gpu, uploaded.clone(), FrameLayout::plain(ChannelDepth::Eight.format(), 1))
        .map_err(fault)?;
    let has_pipelines = before.zip(built()).map(|(before, after)| after - before);
    let (has_bytes, says_pipelines) = (uploaded.bytes(), renderer.pipelines());
    if (has_bytes, has_pipelines, says_pipelines) == (bytes as u64, Some(pipelines), pipelines) {
        return Ok(());
    }
    Err(format!(
        "{what}: {has_bytes} bytes for {bytes}, {has_pipelines:?} pipelines, as {says_pipelines}, for {pipelines}"
    ))
}
