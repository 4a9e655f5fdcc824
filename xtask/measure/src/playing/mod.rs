//! Measures cost and error of playing a clip: sweeps every parameter of the renderer, and switches on every
//! optional feature that the clip lacks.
//!
//! Each way to draw is a `Variant`, and all variants do the same work: the same clip, views, times and
//! size. Errors compare pictures with the f64 reference of the whole field. Times are taken in rounds
//! that draw every variant once, so that other load on the machine slows all variants alike.

mod bench;
mod errors;
mod features;
mod held;
mod measured;
mod pad;
mod reduce;
mod result;
mod sweeps;
mod views;

use std::io::Cursor;
use std::{iter, ptr};

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use client::gpu::{ChannelDepth, Gpu, Offscreen};
use codec::Clip;
use glam::UVec2;
use image::{ImageFormat, RgbImage};
use refine::image::Image;
use refine::reference::PosedView;
use refine::reference::{self, Order, render};

use crate::parameter::{FlowStage, Parameter};
use bench::{Bench, ROUNDS, Variant};
use errors::Expected;
use features::{FeatureToggle, features};
use measured::{FrameTiming, MeasuredVariant};
pub use result::{ClipFeature, NamedPicture, Playing, PlayingSetup, ResourceUse};
use sweeps::{Sweep, sweeps};
use views::{ViewSet, view_set};

/// Measures `clip` in pictures of `size` pixels against `whole`, the field that it was made of.
/// Packages with layers get `layers`. Calls `on_step` with the name of each step and the number of
/// steps.
///
/// # Errors
/// Errors of the renderer, which include a `size` that is too large for it.
// Long: the steps of one measurement, in order.
pub fn measure(
    gpu: &'static Gpu,
    clip: &Clip,
    whole: &reference::RenderScene,
    size: UVec2,
    layers: &[usize],
    on_step: &mut dyn FnMut(&str, u64),
) -> anyhow::Result<Playing> {
    // Fails where the device cannot draw this size, before the reference takes minutes.
    Offscreen::new(gpu, size, 2, ChannelDepth::Sixteen)?;
    let views = view_set(clip, size);
    let sweeps = sweeps(clip, size);
    let toggles = features(clip, gpu, layers);
    let swept = sweeps.iter().flat_map(|sweep| &sweep.values).filter_map(|value| value.variant.as_ref());
    let player = Variant { name: "player".into(), ..Variant::default() };
    let variants: Vec<&Variant> =
        iter::once(&player).chain(swept).chain(toggles.iter().flat_map(FeatureToggle::variants)).collect();

    let pictures = views.pictures.len() + views.turn.len();
    let packaged = toggles.iter().filter(|toggle| toggle.packages()).count();
    let steps = (pictures + held::pictures(&views) + variants.len() * (1 + ROUNDS) + packaged) as u64;
    let mut on_step = |name: &str| on_step(name, steps);

    let expected = expected(whole, &views, &mut on_step);
    let mut measured =
        draw(Bench::new(gpu, clip, size, &views), &variants, &sweeps, &expected, &mut on_step)?;
    let base = measured.next().expect("the player as it is");
    let mut playing = Playing {
        setup: PlayingSetup {
            adapter: gpu.adapter_name.clone(),
            driver: gpu.driver.clone(),
            f16: gpu.caps.f16,
            gpu_timed: base.timings.iter().all(|timing| timing.gpu_timed),
            size: size.to_array(),
            gaussians: clip.len(),
            pictures: views.pictures.len(),
            turn_frames: views.turn.len(),
            rounds: ROUNDS,
            steps,
        },
        parameters: Vec::new(),
        features: Vec::new(),
        pictures: vec![
            picture("f64 reference", &expected.pictures[0])?,
            picture("player", &base.inspection.images[0])?,
        ],
    };
    let mut on_picture = || on_step("frames to a sort");
    let duration_s = f64::from(clip.info.duration_s);
    let (held, longest) = held::parameter(whole, &views, duration_s, &expected, &base, &mut on_picture)?;
    let frames = held.points.last().map_or("", |point| &point.value);
    playing.pictures.push(picture(&format!("{}: {frames}", held.name), &longest)?);
    playing.parameters.push(held);
    for sweep in sweeps {
        let results: Vec<Option<MeasuredVariant>> =
            sweep.values.iter().map(|value| value.variant.as_ref().and_then(|_| measured.next())).collect();
        let coarsest =
            results.last().and_then(Option::as_ref).and_then(|last| last.inspection.images.first());
        if let (Some(image), Some(value)) = (coarsest, sweep.values.last()) {
            playing.pictures.push(picture(&format!("{}: {}", sweep.name, value.label), image)?);
        }
        playing.parameters.push(parameter(sweep, &results, &base));
    }
    for toggle in toggles {
        let count = toggle.variants().count();
        let results: Vec<MeasuredVariant> = measured.by_ref().take(count).collect();
        if toggle.packages() {
            on_step("package");
        }
        playing.features.push(toggle.into_feature(clip, &base, &results)?);
    }
    Ok(playing)
}

/// The reference's pictures of the whole field.
fn expected(whole: &reference::RenderScene, views: &ViewSet, on_step: &mut dyn FnMut(&str)) -> Expected {
    let mut render_all = |views: &[PosedView], order| {
        let mut render_one = |view: &PosedView| {
            on_step("reference");
            render(whole, &view.camera, view.t, order)
        };
        views.iter().map(&mut render_one).collect()
    };
    Expected {
        pictures: render_all(&views.pictures, Order::Depth),
        // Radial order does not change when the head turns, so nothing pops.
        turn: render_all(&views.turn, Order::Radial),
        cameras: views.turn.iter().map(|view| view.camera.clone()).collect(),
    }
}

/// Draws all variants: once to inspect, then in rounds to time. It holds only the images of the first variant, and the
/// first image of each sweep's end, which the page shows.
fn draw(
    mut bench: Bench,
    variants: &[&Variant],
    sweeps: &[Sweep],
    expected: &Expected,
    on_step: &mut dyn FnMut(&str),
) -> anyhow::Result<impl Iterator<Item = MeasuredVariant> + use<>> {
    let ends: Vec<&Variant> =
        sweeps.iter().filter_map(|sweep| sweep.values.last()?.variant.as_ref()).collect();
    let mut inspections = Vec::new();
    for variant in variants {
        on_step(&variant.name);
        let mut inspection = bench.inspect(variant, expected)?;
        if !inspections.is_empty() {
            let is_shown = ends.iter().any(|end| ptr::eq(*end, *variant));
            inspection.images.truncate(usize::from(is_shown));
            inspection.turn.clear();
        }
        inspections.push(inspection);
    }
    let mut timings: Vec<Vec<FrameTiming>> = vec![Vec::new(); variants.len()];
    for _ in 0..ROUNDS {
        for (i, variant) in variants.iter().enumerate() {
            on_step(&variant.name);
            timings[i].push(bench.time(i)?);
        }
    }
    let measured = inspections.into_iter().zip(timings);
    Ok(measured.map(|(inspection, timings)| MeasuredVariant { inspection, timings }))
}

fn parameter(sweep: Sweep, results: &[Option<MeasuredVariant>], base: &MeasuredVariant) -> Parameter {
    let values = sweep.values.iter().zip(results);
    let values =
        values.map(|(value, result)| result.as_ref().unwrap_or(base).to_value(&value.label, value.default));
    Parameter {
        stage: FlowStage::Playing,
        name: sweep.name.into(),
        about: sweep.about.into(),
        why_default: sweep.why_default.into(),
        cost: "ms a frame".into(),
        points: values.collect(),
    }
    .mark_front()
}

/// An image over black, as a page shows it.
fn picture(name: &str, image: &Image) -> anyhow::Result<NamedPicture> {
    let pixels = RgbImage::from_raw(image.width, image.height, image.to_rgb8());
    let mut png = Cursor::new(Vec::new());
    pixels.expect("three bytes a pixel").write_to(&mut png, ImageFormat::Png)?;
    Ok(NamedPicture { name: name.into(), png: STANDARD.encode(png.into_inner()) })
}
