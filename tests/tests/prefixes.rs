//! A package that was cut off plays as a smaller layer, or fails with one clear error: whatever
//! part of the file is there, and all the way to the picture.

use std::process::ExitCode;

use aarc_tests::gpu::{self, Passes};
use aarc_tests::scene::{Motion, Place, Recipe, camera, packaged};
use client::gpu::{ChannelDepth, Gpu, RenderSettings};
use codec::Limits;
use refine::image::Image;

fn main() -> ExitCode {
    gpu::run(vec![gpu::trial("prefixes of a package", Passes::Shared, prefixes)])
}

fn prefixes(gpu: &Gpu) -> Result<(), String> {
    let recipe =
        Recipe { count: 400, sh_degree: 1, motion: Motion::Mixed, motion_order: 2, turning: true, seed: 5 };
    let plate = Recipe { count: 50, sh_degree: 0, motion: Motion::Still, turning: false, ..recipe };
    let bytes = packaged(&recipe.field(), Some(&plate.field()), &[60, 150, 250]);
    let draw = |bytes: &[u8]| -> Result<Option<(usize, Image)>, String> {
        let Ok(clip) = codec::decode(bytes, &Limits::default()) else { return Ok(None) };
        let view = camera(Place::Whole, 64, 48);
        let images = gpu::draw(gpu, &clip, &[view], 0.5, &RenderSettings::default(), ChannelDepth::Eight);
        let image = images.map_err(|fault| fault.to_string())?.swap_remove(0);
        Ok(Some((clip.layers.len(), image)))
    };
    let (all_layers, whole) = draw(&bytes)?.ok_or("the whole package does not decode")?;
    if all_layers != 4 {
        return Err(format!("{all_layers} layers"));
    }
    // Every length would take long to draw; a prime step meets each part of the file.
    let mut layers_seen = Vec::new();
    for length in (0..bytes.len()).step_by(97).chain([bytes.len() - 1]) {
        let Some((layers, image)) = draw(&bytes[..length])? else { continue };
        if layers == all_layers && length == bytes.len() - 1 && image == whole {
            return Err("the last byte of the file is of no effect".into());
        }
        if image.pixels.iter().all(|pixel| pixel[3] == 0.0) {
            return Err(format!("{length} of {} bytes, {layers} layers, show nothing", bytes.len()));
        }
        if layers_seen.last() != Some(&layers) {
            layers_seen.push(layers);
        }
    }
    if !layers_seen.is_sorted() || layers_seen.first() != Some(&1) || layers_seen.len() < 3 {
        return Err(format!("growing prefixes play with {layers_seen:?} layers"));
    }
    Ok(())
}
