//! Frames over the room: composed by OpenXR's formula, a pixel has the light of its colour in the part that its alpha
//! covers. No compositor runs here: the formula is applied to the images that a runtime would get.

use aarc_tests::gpu::{self, Passes, draw};
use aarc_tests::image::{Tolerance, check, difference};
use aarc_tests::scene::{Motion, Place, Recipe, camera, decoded};
use client::gpu::{ChannelDepth, FrameLayout, Gpu, GpuClip, Offscreen, RenderSettings, Renderer};
use client::view::View;
use codec::{Camera, Clip};
use glam::UVec2;
use libtest_mimic::Trial;
use program::Fault;
use refine::image::Image;

const SIZE: (u32, u32) = (160, 120);

/// The inset of a foveated frame.
const SIDE: f32 = 0.4;

/// Light of the room: a bright wall, which shows dark edges.
const ROOM: [f64; 3] = [0.7, 0.6, 0.5];

/// What 16 bits round in the image and before the conversion.
const SIXTEEN: Tolerance = Tolerance { max_diff: 1.0, diff_pixels: 0, psnr: 60.0 };

/// 8-bit blending rounds every layer, so most pixels differ a little.
const EIGHT: Tolerance = Tolerance { max_diff: 8.0, diff_pixels: (SIZE.0 * SIZE.1) as usize, psnr: 45.0 };

/// The tests of this file.
pub(crate) fn trials() -> Vec<Trial> {
    vec![
        gpu::trial("frames over the room, one eye", Passes::Shared, |gpu| over_the_room(gpu, false)),
        gpu::multiview_trial("frames over the room, two eyes in one pass", |gpu| over_the_room(gpu, true)),
        gpu::trial("frames over the room, two eyes in two passes", Passes::PerEye, |gpu| {
            over_the_room(gpu, true)
        }),
        gpu::trial("faint and dark colours in linear light", Passes::Shared, faint_and_dark),
    ]
}

/// Light of an sRGB value.
fn decode(value: f64) -> f64 {
    if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
}

fn encode(light: f64) -> f64 {
    if light <= 0.003_130_8 { 12.92 * light } else { 1.055 * light.powf(1.0 / 2.4) - 0.055 }
}

/// Display-referred picture of a layer over the room, whose pixel's light `layer` computes from the stored pixel. The
/// formula describes a layer with BLEND_TEXTURE_SOURCE_ALPHA: its light, and the room's times 1 - alpha.
fn over(image: &Image, layer: impl Fn([f64; 4], usize) -> f64) -> Image {
    let compose = |pixel: &[f64; 4]| {
        let [r, g, b] = [0, 1, 2].map(|c| encode(layer(*pixel, c) + (1.0 - pixel[3]) * ROOM[c]));
        [r, g, b, 1.0]
    };
    Image { pixels: image.pixels.iter().map(compose).collect(), ..*image }
}

/// The light of a pixel whose colour is premultiplied as displayed.
fn light(pixel: [f64; 4], channel: usize) -> f64 {
    if pixel[3] == 0.0 {
        return 0.0;
    }
    pixel[3] * decode((pixel[channel] / pixel[3]).clamp(0.0, 1.0))
}

/// The light that a compositor reads from an sRGB image.
fn stored(pixel: [f64; 4], channel: usize) -> f64 {
    decode(pixel[channel])
}

/// The images that a runtime gets while the room is visible.
fn submitted(
    gpu: &Gpu,
    clip: &Clip,
    eyes: &[Camera],
    settings: &RenderSettings,
    depth: ChannelDepth,
) -> Result<Vec<Image>, Fault> {
    let (size, count) = (UVec2::from(SIZE), eyes.len());
    let layout = FrameLayout { format: depth.format(), eyes: count, foveated: true };
    let mut renderer = Renderer::new(gpu, GpuClip::upload(gpu, clip)?, layout)?;
    let target = Offscreen::new(gpu, size, count as u32, depth)?.foveated(gpu, SIDE)?.in_linear_light(gpu)?;
    let views: Vec<View> = eyes.iter().map(View::from_camera).collect();
    target.render(gpu, &mut renderer, 0.5, &views, settings)?;
    let image = |pixels: &client::gpu::Pixels| Image {
        width: pixels.size.x,
        height: pixels.size.y,
        pixels: pixels.rgba.iter().map(|pixel| pixel.map(f64::from)).collect(),
    };
    Ok(target.read(gpu)?.iter().map(image).collect())
}

/// What a bright room hides: colours whose alpha is near 0, and colours on both sides of the bend in the sRGB curve.
fn faint_and_dark(gpu: &Gpu) -> Result<(), String> {
    /// The first spherical harmonic, and the colour where its coefficient is 0.
    const Y0: f32 = 0.282_094_8;
    const GREY: f32 = 0.5;
    let text = |fault: Fault| fault.to_string();
    let eye = [camera(Place::Whole, SIZE.0, SIZE.1)];
    let settings = RenderSettings::default();
    for (name, brightness) in [("faint", 1.0), ("dark", 0.2)] {
        let recipe = Recipe {
            count: 600,
            sh_degree: 0,
            motion: Motion::Static,
            motion_order: 0,
            turning: false,
            seed: 7,
        };
        let mut field = recipe.field();
        let dimmed = |sh: f32| (brightness * (GREY + Y0 * sh) - GREY) / Y0;
        field.sh.iter_mut().flatten().for_each(|sh| *sh = dimmed(*sh));
        let clip = decoded(&field);
        let drawn = draw(gpu, &clip, &eye, 0.5, &settings, ChannelDepth::Sixteen).map_err(text)?;
        let images = submitted(gpu, &clip, &eye, &settings, ChannelDepth::Sixteen).map_err(text)?;
        let layer = |pixel: &[f64; 4]| {
            let [r, g, b] = [0, 1, 2].map(|channel| encode(light(*pixel, channel)));
            [r, g, b, pixel[3]]
        };
        let expected = Image { pixels: drawn[0].pixels.iter().map(layer).collect(), ..drawn[0] };
        check(&format!("{name} colours in linear light"), &images[0], &expected, SIXTEEN.on(gpu))?;
        let is_there = |pixel: &&[f64; 4]| match name {
            "faint" => pixel[3] > 0.0 && pixel[3] < 0.03 && pixel[0] > 0.3 * pixel[3],
            _ => pixel[3] > 0.5 && pixel[0] > 0.05 * pixel[3] && pixel[0] < 0.1 * pixel[3],
        };
        let count = drawn[0].pixels.iter().filter(is_there).count();
        if count < 20 {
            return Err(format!("{count} {name} pixels test nothing"));
        }
    }
    Ok(())
}

fn over_the_room(gpu: &Gpu, stereo: bool) -> Result<(), String> {
    let text = |fault: Fault| fault.to_string();
    let recipe =
        Recipe { count: 600, sh_degree: 1, motion: Motion::Mixed, motion_order: 2, turning: false, seed: 7 };
    let clip = decoded(&recipe.field());
    let eye = camera(Place::Near, SIZE.0, SIZE.1);
    let eyes = if stereo { eye.stereo_pair(0.065).to_vec() } else { vec![eye] };
    for inset in [None, Some(SIDE)] {
        let settings = RenderSettings { inset, ..RenderSettings::default() };
        // Other tests hold these images against the reference.
        let drawn = draw(gpu, &clip, &eyes, 0.5, &settings, ChannelDepth::Sixteen).map_err(text)?;
        for (depth, tolerance) in [(ChannelDepth::Sixteen, SIXTEEN), (ChannelDepth::Eight, EIGHT)] {
            let images = submitted(gpu, &clip, &eyes, &settings, depth).map_err(text)?;
            for (i, (image, drawn)) in images.iter().zip(&drawn).enumerate() {
                let name = format!("over the room, {} eyes, inset {inset:?}, {depth:?}, eye {i}", eyes.len());
                let expected = over(drawn, light);
                check(&name, &over(image, stored), &expected, tolerance.on(gpu))?;
                if difference(&over(drawn, stored), &expected).psnr > 30.0 {
                    return Err(format!("{name}: without the conversion it is as good"));
                }
            }
        }
    }
    Ok(())
}
