//! Every prefix of a package decodes to its complete layers and draws them, or fails to decode.

use aarc_tests::gpu::{self, Passes};
use aarc_tests::scene::{Motion, Place, Recipe, camera, packaged};
use client::gpu::{ChannelDepth, Gpu, RenderSettings};
use codec::Limits;
use libtest_mimic::Trial;
use refine::image::Image;

/// The tests of this file.
pub(crate) fn trials() -> Vec<Trial> {
    vec![gpu::trial("prefixes of a package", Passes::Shared, prefixes)]
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
        if image.pixels.iter().all(|pixel| pixel[3] == 0.0) {
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
