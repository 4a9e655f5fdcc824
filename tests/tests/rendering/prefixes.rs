//! Every prefix of a package decodes to its complete layers and draws them, or fails to decode; further layers are drawn as
//! if they had come with the first.

use std::num::NonZero;

use aarc_tests::gpu::{self, Drawing, Passes};
use aarc_tests::image::{Tolerance, check, difference};
use aarc_tests::scene::{Motion, Place, Recipe, camera, packaged};
use client::gpu::{
    ChannelDepth, FrameLayout, Gpu, GpuClip, PackedLayers, PackedSegment, RenderSettings, Renderer, Span,
    TakeLayout,
};
use codec::{Field, LayerEnd, Limits};
use libtest_mimic::Trial;
use program::Fault;
use refine::image::Image;
use refine::reference::{Order, RenderScene, render};

/// The tests of this file.
pub(crate) fn trials() -> Vec<Trial> {
    vec![
        gpu::trial("prefixes of a package", Passes::Shared, prefixes),
        gpu::trial("layers that arrive one by one", Passes::Shared, one_by_one),
        gpu::trial("a clip that announces more than fits is refused at once", Passes::Shared, too_large),
    ]
}

/// As in the other comparisons with the reference.
const TOLERANCE: Tolerance = Tolerance { max_diff: 2.0, diff_pixels: 100, psnr: 54.0 };

fn text(fault: Fault) -> String {
    fault.to_string()
}

/// Each arrival uploads its own rows into the memory that there is, and draws as the reference draws all of them. What was
/// drawn before stays as it was.
fn one_by_one(gpu: &Gpu) -> Result<(), String> {
    let mixed =
        Recipe { count: 600, sh_degree: 2, motion: Motion::Mixed, motion_order: 3, turning: true, seed: 5 };
    for motion in [Motion::Mixed, Motion::Static, Motion::Dynamic] {
        let plate =
            Recipe { count: 50, sh_degree: 1, motion: Motion::Static, turning: false, ..mixed }.field();
        let bytes = packaged(&Recipe { motion, ..mixed }.field(), Some(&plate), &[60, 61, 250]);
        let limits = Limits::default();
        let error = |error: codec::Error| error.to_string();
        let head = codec::contents(&bytes, &limits).map_err(error)?;
        let ends = head.layer_bytes();
        let mut clip = codec::decode(&bytes[..ends[0]], &limits).map_err(error)?;
        let layout = TakeLayout::for_clip(&clip);
        let frame = FrameLayout::plain(ChannelDepth::Sixteen.format(), 1);
        let mut owner = Renderer::new_take(gpu, layout, frame).map_err(text)?;
        let slots = owner.slots().ok_or("it has its own segments")?;
        let packed = PackedSegment::new(&clip, Span::WHOLE, &layout).map_err(text)?;
        let segment = slots.insert(packed).ok_or("no room")?;
        let first_bytes = slots.upload(gpu, usize::MAX);
        let gpu_bytes = owner.clip().bytes();
        let mut uploaded = first_bytes;
        let mut drawn: Vec<(Drawing<'_>, Image)> = Vec::new();
        for layers in 1..=ends.len() {
            if layers > 1 {
                let (one, prefix) = (NonZero::<usize>::MIN, &bytes[..ends[layers - 1]]);
                let further = head.decode_layers(prefix, layers - 1, &limits, one).map_err(error)?;
                let slots = owner.slots().ok_or("it has its own segments")?;
                let packed = PackedLayers::new(&further, Span::WHOLE, &layout).map_err(text)?;
                slots.append(segment, packed);
                uploaded += slots.upload(gpu, usize::MAX);
                clip.append(further);
            }
            let on_gpu = owner.clip().clone();
            if on_gpu.bytes() != gpu_bytes {
                return Err(format!("{} of {gpu_bytes} bytes", on_gpu.bytes()));
            }
            let view = camera(Place::Whole, 160, 120);
            let expected = render(&RenderScene::from(&clip), &view, 0.4, Order::Depth);
            let mut drawing = Drawing::new(gpu, on_gpu, &[view], ChannelDepth::Sixteen).map_err(text)?;
            let image = drawing.frame(0.4, &RenderSettings::default()).map_err(text)?.remove(0);
            check(&format!("{motion:?}, {layers} layers"), &image, &expected, TOLERANCE.on(gpu))?;
            drawn.push((drawing, image));
        }
        // Fewer layers are those that came first, and every state is drawn as before.
        let (first, last) = (drawn[0].1.clone(), drawn.len() - 1);
        let one_layer = RenderSettings { layers: Some(1), ..RenderSettings::default() };
        let again = drawn[last].0.frame(0.4, &one_layer).map_err(text)?.remove(0);
        if difference(&again, &first).max_diff > 0.0 {
            return Err(format!("{motion:?}: the first layer has changed"));
        }
        for (layers, (drawing, image)) in (1..).zip(&mut drawn) {
            let again = drawing.frame(0.4, &RenderSettings::default()).map_err(text)?.remove(0);
            if difference(&again, image).max_diff > 0.0 {
                return Err(format!("{motion:?}: {layers} layers have changed"));
            }
        }
        // Every row once: as many bytes as all at once.
        let whole = PackedSegment::new(&clip, Span::WHOLE, &layout).map_err(text)?.bytes();
        let at_once = GpuClip::upload(gpu, &clip).map_err(text)?;
        if uploaded != whole || first_bytes * 3 > uploaded || at_once.bytes() != gpu_bytes {
            return Err(format!("{motion:?}: {uploaded} bytes, {whole} at once"));
        }
    }
    Ok(())
}

/// Before the layers that do not fit are there.
fn too_large(gpu: &Gpu) -> Result<(), String> {
    let field: Field =
        Recipe { count: 50, sh_degree: 0, motion: Motion::Static, motion_order: 0, turning: false, seed: 1 }
            .field();
    let mut clip = aarc_tests::scene::decoded_with(&field, None, &[]);
    let rows = gpu.caps.max_buffer_bytes as usize / 32;
    clip.layers_announced.push(LayerEnd { static_count: rows + 1, dynamic_count: 0 });
    match GpuClip::upload(gpu, &clip) {
        Ok(_) => Err(format!("{} rows have room", rows + 1)),
        Err(fault) => {
            let sentence = fault.to_string();
            let expected = sentence.starts_with("the clip takes a buffer of ")
                && sentence.ends_with(" MiB: package it with a smaller --budget");
            if expected && fault.exit_code() == 5 { Ok(()) } else { Err(sentence) }
        }
    }
}

fn prefixes(gpu: &Gpu) -> Result<(), String> {
    let recipe =
        Recipe { count: 400, sh_degree: 1, motion: Motion::Mixed, motion_order: 2, turning: true, seed: 5 };
    let plate = Recipe { count: 50, sh_degree: 0, motion: Motion::Static, turning: false, ..recipe };
    let bytes = packaged(&recipe.field(), Some(&plate.field()), &[60, 150, 250]);
    let draw = |bytes: &[u8]| -> Result<Option<(usize, Image)>, String> {
        let Ok(clip) = codec::decode(bytes, &Limits::default()) else { return Ok(None) };
        let view = camera(Place::Whole, 64, 48);
        let images = gpu::draw(gpu, &clip, &[view], 0.5, &RenderSettings::default(), ChannelDepth::Eight);
        let image = images.map_err(|fault| fault.to_string())?.swap_remove(0);
        Ok(Some((clip.layers.len(), image)))
    };
    let (all_layers, full) = draw(&bytes)?.ok_or("the whole package does not decode")?;
    if all_layers != 4 {
        return Err(format!("{all_layers} layers"));
    }
    // Drawing every length takes too long; a prime step falls into every section.
    let mut layer_counts = Vec::new();
    for length in (0..bytes.len()).step_by(97).chain([bytes.len() - 1]) {
        let Some((layers, image)) = draw(&bytes[..length])? else { continue };
        if layers == all_layers && length == bytes.len() - 1 && image == full {
            return Err("the last byte of the file has no effect".into());
        }
        if image.pixels.iter().all(|pixel| pixel[..3] == [0.0; 3]) {
            return Err(format!("{length} of {} bytes, {layers} layers, show nothing", bytes.len()));
        }
        if layer_counts.last() != Some(&layers) {
            layer_counts.push(layers);
        }
    }
    if !layer_counts.is_sorted() || layer_counts.first() != Some(&1) || layer_counts.len() < 3 {
        return Err(format!("growing prefixes play with {layer_counts:?} layers"));
    }
    Ok(())
}
