//! The GPU draws what the reference renderer draws.
//!
//! A matrix over what decides which shader runs and where Gaussians fall in the picture: degree of
//! the spherical harmonics, order of motion, still, moving and mixed fields, one eye and two (in
//! one pass and in two), places to look from. Both renderers get the same decoded clip; the target
//! has 16-bit floats, so that what differs is the renderer and not the rounding of its target.

use std::process::ExitCode;
use std::sync::Arc;

use aarc_tests::gpu::{self, Drawing, Passes};
use aarc_tests::image::{Tolerance, check, difference};
use aarc_tests::scene::{Motion, Place, Recipe, camera, decoded, decoded_with, stereo_pair};
use client::gpu::{ChannelDepth, Cutoff, Gpu, GpuClip, RenderSettings, SortOrder};
use codec::{Camera, Clip};
use libtest_mimic::Trial;
use refine::reference::{Order, RenderScene, render};

/// Allowed everywhere unless a test says otherwise.
const TOLERANCE: Tolerance = Tolerance { max_diff: 2.0, diff_pixels: 100, psnr: 54.0 };

const SIZE: (u32, u32) = (160, 120);

const PLACES: [Place; 4] = [Place::Whole, Place::Near, Place::Far, Place::Edge];

fn main() -> ExitCode {
    let mut trials = Vec::new();
    for sh_degree in 0..=3 {
        trials.extend(eyes_trials(Recipe { sh_degree, motion: Motion::Still, ..RECIPE }));
        for motion in [Motion::Moving, Motion::Mixed] {
            for motion_order in 0..=3 {
                trials.extend(eyes_trials(Recipe { sh_degree, motion, motion_order, ..RECIPE }));
            }
        }
    }
    for motion_order in 0..=3 {
        trials.extend(eyes_trials(Recipe { motion_order, turning: true, ..RECIPE }));
    }
    trials.extend([
        gpu::trial("plate", Passes::Shared, plate),
        gpu::trial("layers", Passes::Shared, layers),
        gpu::trial("sorted by distance from the eye", Passes::Shared, radial),
        gpu::trial("cutoffs that cut nothing", Passes::Shared, cutoffs),
        gpu::trial("cutoffs that cut", Passes::Shared, cutoffs_cut),
        gpu::trial("before, at and after the ends of the clip", Passes::Shared, outside_the_clip),
        gpu::trial("off-centre principal point", Passes::Shared, off_centre),
        gpu::trial("8-bit target", Passes::Shared, eight_bits),
    ]);
    gpu::run(trials)
}

const RECIPE: Recipe =
    Recipe { count: 600, sh_degree: 0, motion: Motion::Moving, motion_order: 3, turning: false, seed: 7 };

/// One eye, two in one pass, two in two passes.
fn eyes_trials(recipe: Recipe) -> [Trial; 3] {
    let Recipe { sh_degree, motion, motion_order, turning, .. } = recipe;
    let order = if motion == Motion::Still { String::new() } else { format!(" of order {motion_order}") };
    let turning = if turning { ", turning" } else { "" };
    let name = format!("SH {sh_degree}, {motion:?}{order}{turning}").to_lowercase();
    let (mono, stereo) = (format!("{name}, one eye"), format!("{name}, two eyes"));
    let (shared, per_eye) = (format!("{stereo} in one pass"), format!("{stereo} in two passes"));
    [
        gpu::trial(&mono, Passes::Shared, {
            let mono = mono.clone();
            move |gpu| matrix(gpu, &mono, &decoded(&recipe.field()), false)
        }),
        gpu::multiview_trial(&shared, {
            let shared = shared.clone();
            move |gpu| matrix(gpu, &shared, &decoded(&recipe.field()), true)
        }),
        gpu::trial(&per_eye, Passes::PerEye, {
            let per_eye = per_eye.clone();
            move |gpu| matrix(gpu, &per_eye, &decoded(&recipe.field()), true)
        }),
    ]
}

/// Compares the pictures from all places, each at another time.
fn matrix(gpu: &Gpu, name: &str, clip: &Clip, stereo: bool) -> Result<(), String> {
    let uploaded = Arc::new(GpuClip::upload(gpu, clip).map_err(|fault| fault.to_string())?);
    for (place, t) in PLACES.into_iter().zip([0.5, 0.15, 0.4, 0.85]) {
        let camera = camera(place, SIZE.0, SIZE.1);
        let cameras = if stereo { stereo_pair(&camera, 0.065).to_vec() } else { vec![camera] };
        let mut drawing = Drawing::new(gpu, uploaded.clone(), &cameras, ChannelDepth::Sixteen)
            .map_err(|fault| fault.to_string())?;
        let images = drawing.frame(t, &RenderSettings::default()).map_err(|fault| fault.to_string())?;
        if images.len() != cameras.len() {
            return Err(format!("{} images for {} cameras", images.len(), cameras.len()));
        }
        for (eye, (image, camera)) in images.iter().zip(&cameras).enumerate() {
            let expected = render(&RenderScene::from(clip), camera, t, Order::Depth);
            if expected.pixels.iter().all(|pixel| pixel[3] < 0.5) {
                return Err(format!(
                    "{name}, {place:?}: the reference shows next to nothing, so it tests nothing"
                ));
            }
            check(&format!("{name}, {place:?}, eye {eye}"), image, &expected, TOLERANCE)?;
        }
    }
    Ok(())
}

/// Draws one picture, and compares it with the reference's of `scene`.
fn compare(
    gpu: &Gpu,
    name: &str,
    clip: &Clip,
    (camera, t): (&Camera, f64),
    settings: &RenderSettings,
    (scene, order): (&RenderScene, Order),
) -> Result<(), String> {
    // A plate doubles the layers that add up.
    let tolerance = match clip.plate {
        Some(_) => Tolerance { diff_pixels: 400, ..TOLERANCE },
        None => TOLERANCE,
    };
    let images = gpu::draw(gpu, clip, std::slice::from_ref(camera), t, settings, ChannelDepth::Sixteen);
    let images = images.map_err(|fault| fault.to_string())?;
    let expected = render(scene, camera, t, order);
    check(name, &images[0], &expected, tolerance).map(|_| ())
}

fn plate(gpu: &Gpu) -> Result<(), String> {
    let recipe = Recipe { sh_degree: 2, ..RECIPE };
    let mut background = Recipe { motion: Motion::Still, sh_degree: 1, seed: 9, ..RECIPE }.field();
    // Larger than the clip and reaching in front of it, where it must be drawn behind all the same.
    background.log_scales.iter_mut().flatten().for_each(|scale| *scale += 0.8);
    let clip = decoded_with(&recipe.field(), Some(&background), &[]);
    let without = Clip { plate: None, ..clip.clone() };
    for place in PLACES {
        let view = (&camera(place, SIZE.0, SIZE.1), 0.5);
        compare(
            gpu,
            &format!("plate, {place:?}"),
            &clip,
            view,
            &RenderSettings::default(),
            (&RenderScene::from(&clip), Order::Depth),
        )?;
    }
    let view = camera(Place::Whole, SIZE.0, SIZE.1);
    let [with, without] =
        [&clip, &without].map(|clip| render(&RenderScene::from(clip), &view, 0.5, Order::Depth));
    if with.psnr(&without) > 30.0 {
        return Err("the plate hardly shows, so it tests nothing".into());
    }
    Ok(())
}

fn layers(gpu: &Gpu) -> Result<(), String> {
    let recipe = Recipe { motion: Motion::Mixed, ..RECIPE };
    let clip = decoded_with(&recipe.field(), None, &[100, 250, 400]);
    if clip.layers.len() != 4 {
        return Err(format!("{} layers", clip.layers.len()));
    }
    let view = (&camera(Place::Whole, SIZE.0, SIZE.1), 0.5);
    for layers in 1..=4 {
        let settings = RenderSettings { layers: Some(layers), ..RenderSettings::default() };
        let scene = RenderScene::from_layers(&clip, layers);
        compare(gpu, &format!("layers, {layers}"), &clip, view, &settings, (&scene, Order::Depth))?;
    }
    Ok(())
}

fn radial(gpu: &Gpu) -> Result<(), String> {
    let clip = decoded(&RECIPE.field());
    let settings = RenderSettings { sort: SortOrder::Radial, ..RenderSettings::default() };
    for place in PLACES {
        let view = (&camera(place, SIZE.0, SIZE.1), 0.5);
        compare(
            gpu,
            &format!("radial, {place:?}"),
            &clip,
            view,
            &settings,
            (&RenderScene::from(&clip), Order::Radial),
        )?;
    }
    // From inside, with a wide angle, the two orders are not the same picture.
    let near = camera(Place::Near, SIZE.0, SIZE.1);
    let [depth, radial] =
        [Order::Depth, Order::Radial].map(|order| render(&RenderScene::from(&clip), &near, 0.5, order));
    if depth.max_difference(&radial) < 3.0 / 255.0 {
        return Err("both orders give the same picture, so it tests nothing".into());
    }
    Ok(())
}

/// `sqrt(8)` standard deviations are enough for opacities up to `e^4 / 255`, `sqrt(5)` for those up
/// to `e^2.5 / 255`.
fn cutoffs(gpu: &Gpu) -> Result<(), String> {
    for (cutoff, reach) in [(Cutoff::Sqrt8, 8.0f32), (Cutoff::Sqrt5, 5.0)] {
        let mut field = Recipe { motion: Motion::Still, ..RECIPE }.field();
        let limit = 0.98 * (0.5 * reach).exp() / 255.0;
        field.opacities.iter_mut().for_each(|opacity| *opacity *= limit);
        let clip = decoded(&field);
        let view = (&camera(Place::Whole, SIZE.0, SIZE.1), 0.5);
        let settings = RenderSettings { cutoff, ..RenderSettings::default() };
        compare(
            gpu,
            &format!("cutoff, {cutoff:?}"),
            &clip,
            view,
            &settings,
            (&RenderScene::from(&clip), Order::Depth),
        )?;
    }
    Ok(())
}

/// A cutoff below what the opacities need darkens the picture, the tighter the more.
fn cutoffs_cut(gpu: &Gpu) -> Result<(), String> {
    let clip = decoded(&Recipe { motion: Motion::Still, ..RECIPE }.field());
    let view = camera(Place::Whole, SIZE.0, SIZE.1);
    let light = |cutoff| {
        let settings = RenderSettings { cutoff, ..RenderSettings::default() };
        let images =
            gpu::draw(gpu, &clip, std::slice::from_ref(&view), 0.5, &settings, ChannelDepth::Sixteen);
        let images = images.map_err(|fault| fault.to_string())?;
        Ok::<f64, String>(images[0].pixels.iter().map(|pixel| pixel[3]).sum())
    };
    let [exact, sqrt8, sqrt5] = [light(Cutoff::Exact)?, light(Cutoff::Sqrt8)?, light(Cutoff::Sqrt5)?];
    if exact > sqrt8 && sqrt8 > sqrt5 && sqrt5 > 0.8 * exact {
        return Ok(());
    }
    Err(format!("total alpha: exact {exact}, sqrt(8) {sqrt8}, sqrt(5) {sqrt5}"))
}

fn outside_the_clip(gpu: &Gpu) -> Result<(), String> {
    let clip = decoded(&RECIPE.field());
    let view = camera(Place::Whole, SIZE.0, SIZE.1);
    for t in [0.0, 1.0] {
        let name = format!("ends of the clip, {t}");
        compare(
            gpu,
            &name,
            &clip,
            (&view, t),
            &RenderSettings::default(),
            (&RenderScene::from(&clip), Order::Depth),
        )?;
    }
    Ok(())
}

/// Real cameras have the principal point elsewhere than in the middle, and unequal focal lengths.
fn off_centre(gpu: &Gpu) -> Result<(), String> {
    let clip = decoded(&Recipe { sh_degree: 1, ..RECIPE }.field());
    let mut camera = camera(Place::Whole, SIZE.0, SIZE.1);
    camera.k = [[170.0, 0.0, 43.0], [0.0, 120.0, 81.5], [0.0, 0.0, 1.0]];
    compare(
        gpu,
        "off-centre",
        &clip,
        (&camera, 0.5),
        &RenderSettings::default(),
        (&RenderScene::from(&clip), Order::Depth),
    )
}

/// Every blend rounds to 1/255, and what is fainter than half of that is lost: this has its own,
/// looser tolerance, and the numbers are printed.
fn eight_bits(gpu: &Gpu) -> Result<(), String> {
    let tolerance = Tolerance { max_diff: 16.0, diff_pixels: usize::MAX, psnr: 36.0 };
    let clip = decoded(&RECIPE.field());
    for place in PLACES {
        let view = camera(place, SIZE.0, SIZE.1);
        let images = gpu::draw(
            gpu,
            &clip,
            std::slice::from_ref(&view),
            0.5,
            &RenderSettings::default(),
            ChannelDepth::Eight,
        );
        let images = images.map_err(|fault| fault.to_string())?;
        let expected = render(&RenderScene::from(&clip), &view, 0.5, Order::Depth);
        println!("8-bit target, {place:?}: {}", difference(&images[0], &expected));
        check(&format!("8-bit, {place:?}"), &images[0], &expected, tolerance)?;
    }
    Ok(())
}
