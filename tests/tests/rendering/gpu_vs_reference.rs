//! The GPU draws what the reference renderer draws.
//!
//! A matrix over everything that selects a shader or places Gaussians in the image: SH degree, motion
//! order, static, dynamic and mixed fields, one eye and two (in one pass and in two), viewpoints. Both
//! renderers get the same decoded clip. The target has 16-bit floats, so that its rounding hides no
//! difference between the renderers.

use std::sync::{Arc, OnceLock};

use aarc_tests::gpu::{self, Drawing, Passes};
use aarc_tests::image::{Tolerance, check, difference};
use aarc_tests::scene::{Motion, Place, Recipe, camera, decoded, decoded_with};
use client::gpu::{ChannelDepth, Cutoff, Gpu, GpuClip, RenderSettings, SortOrder};
use codec::{Camera, Clip, Field, PixelFilter};
use libtest_mimic::Trial;
use refine::image::Image;
use refine::reference::{Order, RenderScene, render};

use crate::naive;

/// The tolerance of every test that does not state its own.
const TOLERANCE: Tolerance = Tolerance { max_diff: 2.0, diff_pixels: 100, psnr: 54.0 };

const SIZE: (u32, u32) = (160, 120);

const PLACES: [Place; 4] = [Place::Whole, Place::Near, Place::Far, Place::Edge];

/// The tests of this file.
pub(crate) fn trials() -> Vec<Trial> {
    let mut trials = Vec::new();
    for sh_degree in 0..=3 {
        trials.extend(eyes_trials(Recipe { sh_degree, motion: Motion::Static, ..RECIPE }));
        for motion in [Motion::Dynamic, Motion::Mixed] {
            for motion_order in 0..=3 {
                trials.extend(eyes_trials(Recipe { sh_degree, motion, motion_order, ..RECIPE }));
            }
        }
    }
    for motion_order in 0..=3 {
        trials.extend(eyes_trials(Recipe { motion_order, turning: true, ..RECIPE }));
    }
    trials.extend(eyes_of("fading near the eye", |stereo| Expected::of_places(stereo, fading)));
    trials.extend([
        gpu::trial("naive rasteriser", Passes::Shared, naive_rasterizer),
        gpu::trial("plate", Passes::Shared, plate),
        gpu::trial("mip filter", Passes::Shared, mip_filter),
        gpu::trial("plate of another filter", Passes::Shared, plate_of_another_filter),
        gpu::trial("layers", Passes::Shared, layers),
        gpu::trial("sorted by distance from the eye", Passes::Shared, radial),
        gpu::trial("cutoffs that clip nothing", Passes::Shared, cutoffs),
        gpu::trial("cutoffs that clip", Passes::Shared, cutoffs_that_clip),
        gpu::trial("before, at and after the ends of the clip", Passes::Shared, outside_the_clip),
        gpu::trial("off-centre principal point", Passes::Shared, off_centre),
        gpu::trial("8-bit target", Passes::Shared, eight_bits),
    ]);
    trials
}

const RECIPE: Recipe =
    Recipe { count: 600, sh_degree: 0, motion: Motion::Dynamic, motion_order: 3, turning: false, seed: 7 };

/// One eye, two in one pass, two in two passes.
fn eyes_trials(recipe: Recipe) -> [Trial; 3] {
    let Recipe { sh_degree, motion, motion_order, turning, .. } = recipe;
    let order = if motion == Motion::Static { String::new() } else { format!(" of order {motion_order}") };
    let turning = if turning { ", turning" } else { "" };
    let name = format!("SH {sh_degree}, {motion:?}{order}{turning}").to_lowercase();
    eyes_of(&name, move |stereo| Expected::new(&recipe, stereo))
}

/// One eye, two in one pass, two in two passes, of what `expected` makes for one eye or two.
fn eyes_of(name: &str, expected: impl Fn(bool) -> Expected + Clone + Send + Sync + 'static) -> [Trial; 3] {
    // Both ways to draw two eyes are compared with the same images.
    let (mono, stereo) = (OnceLock::new(), Arc::new(OnceLock::new()));
    let (shared, per_eye) = (stereo.clone(), stereo);
    let (of_one, of_two) = (expected.clone(), expected.clone());
    let names =
        ["one eye", "two eyes in one pass", "two eyes in two passes"].map(|eyes| format!("{name}, {eyes}"));
    let [a, b, c] = names.clone();
    [
        gpu::trial(&names[0], Passes::Shared, move |gpu| matrix(gpu, &a, mono.get_or_init(|| of_one(false)))),
        gpu::multiview_trial(&names[1], move |gpu| matrix(gpu, &b, shared.get_or_init(|| of_two(true)))),
        gpu::trial(&names[2], Passes::PerEye, move |gpu| {
            matrix(gpu, &c, per_eye.get_or_init(|| expected(true)))
        }),
    ]
}

/// The cameras of the eyes, and the reference's images from them.
type Eyes = Vec<(Camera, Image)>;

/// The reference's images of clips from all places, each at another time.
struct Expected {
    views: Vec<(Place, f64, Clip, Eyes)>,
}

impl Expected {
    fn new(recipe: &Recipe, stereo: bool) -> Expected {
        let clip = decoded(&recipe.field());
        Expected::of_places(stereo, |_| clip.clone())
    }

    /// The expected views of a clip for each place.
    fn of_places(stereo: bool, clip: impl Fn(Place) -> Clip) -> Expected {
        let views = PLACES.into_iter().zip([0.5, 0.15, 0.4, 0.85]).map(|(place, t)| {
            let camera = camera(place, SIZE.0, SIZE.1);
            let clip = clip(place);
            let scene = RenderScene::from(&clip);
            let cameras = if stereo { camera.stereo_pair(0.065).to_vec() } else { vec![camera] };
            let image = |camera: &Camera| render(&scene, camera, t, Order::Depth);
            let eyes = cameras.into_iter().map(|camera| (camera.clone(), image(&camera))).collect();
            (place, t, clip, eyes)
        });
        Expected { views: views.collect() }
    }
}

/// A clip that mostly fades where it is seen from `place`, as its plate does.
fn fading(place: Place) -> Clip {
    // The ball has a radius of 1. From inside, hardly more than what is behind the eye is drawn.
    let near = match place {
        Place::Whole => 3.4,
        Place::Near => 0.8,
        Place::Far => 45.0,
        Place::Edge => 3.0,
    };
    let field = Field { near, ..Recipe { sh_degree: 1, motion: Motion::Mixed, ..RECIPE }.field() };
    let plate = Recipe { count: 60, motion: Motion::Static, seed: 9, ..RECIPE }.field();
    let clip = decoded_with(&field, Some(&plate), &[]);
    let whole = Clip {
        static_field: Field { near: 0.0, ..clip.static_field.clone() },
        dynamic_field: Field { near: 0.0, ..clip.dynamic_field.clone() },
        plate: clip.plate.clone().map(|plate| Field { near: 0.0, ..plate }),
        ..clip.clone()
    };
    let camera = camera(place, SIZE.0, SIZE.1);
    let [faded, whole] =
        [&clip, &whole].map(|clip| render(&RenderScene::from(clip), &camera, 0.5, Order::Depth));
    assert!(faded.psnr(&whole) < 35.0, "{place:?}: hardly anything fades, {} dB", faded.psnr(&whole));
    clip
}

/// Compares the GPU's images with all expected ones.
fn matrix(gpu: &Gpu, name: &str, expected: &Expected) -> Result<(), String> {
    for (place, t, clip, eyes) in &expected.views {
        let uploaded = GpuClip::upload(gpu, clip).map_err(|fault| fault.to_string())?;
        let cameras: Vec<Camera> = eyes.iter().map(|(camera, _)| camera.clone()).collect();
        let mut drawing = Drawing::new(gpu, uploaded.clone(), &cameras, ChannelDepth::Sixteen)
            .map_err(|fault| fault.to_string())?;
        let images = drawing.frame(*t, &RenderSettings::default()).map_err(|fault| fault.to_string())?;
        if images.len() != cameras.len() {
            return Err(format!("{} images for {} cameras", images.len(), cameras.len()));
        }
        for (eye, (image, (_, expected))) in images.iter().zip(eyes).enumerate() {
            if expected.pixels.iter().all(|pixel| pixel[3] < 0.5) {
                return Err(format!(
                    "{name}, {place:?}: the reference image is almost empty, so this tests nothing"
                ));
            }
            // A plate doubles the number of blended layers.
            let diff_pixels = if clip.plate.is_some() { 400 } else { TOLERANCE.diff_pixels };
            let tolerance = Tolerance { diff_pixels, ..TOLERANCE };
            check(&format!("{name}, {place:?}, eye {eye}"), image, expected, tolerance.on(gpu))?;
        }
    }
    Ok(())
}

/// Draws one image and compares it with the reference's image of `scene`.
fn compare(
    gpu: &Gpu,
    name: &str,
    clip: &Clip,
    (camera, t): (&Camera, f64),
    settings: &RenderSettings,
    (scene, order): (&RenderScene, Order),
) -> Result<(), String> {
    // A plate doubles the number of blended layers.
    let tolerance = match clip.plate {
        Some(_) => Tolerance { diff_pixels: 400, ..TOLERANCE },
        None => TOLERANCE,
    };
    let images = gpu::draw(gpu, clip, std::slice::from_ref(camera), t, settings, ChannelDepth::Sixteen);
    let images = images.map_err(|fault| fault.to_string())?;
    let expected = render(scene, camera, t, order);
    check(name, &images[0], &expected, tolerance.on(gpu)).map(|_| ())
}

/// Both filters, turning Gaussians of all degrees, a plate: what the device draws is what the equations say.
fn naive_rasterizer(gpu: &Gpu) -> Result<(), String> {
    let recipe = Recipe { sh_degree: 3, motion: Motion::Mixed, turning: true, ..RECIPE };
    let background = Recipe { motion: Motion::Static, seed: 9, ..RECIPE }.field();
    let tolerance = Tolerance { diff_pixels: 400, ..TOLERANCE };
    for (filter, place) in PixelFilter::ALL.into_iter().zip([Place::Whole, Place::Edge]) {
        let clip = decoded_with(&Field { filter, ..glaring(recipe.field()) }, Some(&background), &[]);
        let view = camera(place, SIZE.0, SIZE.1);
        let cameras = std::slice::from_ref(&view);
        let images = gpu::draw(gpu, &clip, cameras, 0.4, &RenderSettings::default(), ChannelDepth::Sixteen);
        let images = images.map_err(|fault| fault.to_string())?;
        let fields = [&clip.merged(), clip.plate.as_ref().expect("the clip has a plate")];
        let pixels = naive::draw(&fields, &view, 0.4);
        let expected = Image { width: SIZE.0, height: SIZE.1, pixels };
        check(&format!("naive, {place:?}"), &images[0], &expected, tolerance.on(gpu))?;
    }
    Ok(())
}

fn plate(gpu: &Gpu) -> Result<(), String> {
    let recipe = Recipe { sh_degree: 2, ..RECIPE };
    let mut background = Recipe { motion: Motion::Static, sh_degree: 1, seed: 9, ..RECIPE }.field();
    // Larger than the clip and partly in front of it; it must be drawn behind it all the same.
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
        return Err("the plate is hardly visible, so this tests nothing".into());
    }
    Ok(())
}

/// Needles and balls from a hundredth of a pixel up, static and dynamic.
fn mip_filter(gpu: &Gpu) -> Result<(), String> {
    for motion in [Motion::Static, Motion::Mixed] {
        let mut field = Recipe { sh_degree: 1, motion, ..RECIPE }.field();
        field.filter = PixelFilter::Mip;
        for (row, scales) in field.log_scales.iter_mut().enumerate() {
            match row % 4 {
                0 => scales.iter_mut().for_each(|scale| *scale -= 3.0),
                1 => scales[1..].iter_mut().for_each(|scale| *scale -= 4.0),
                2 => scales[0] -= 8.0,
                _ => {}
            }
        }
        let clip = decoded(&field);
        let blurred = Field { filter: PixelFilter::Blur, ..clip.merged() };
        for place in PLACES {
            let camera = camera(place, SIZE.0, SIZE.1);
            let scene = RenderScene::from(&clip);
            compare(
                gpu,
                &format!("mip filter, {motion:?}, {place:?}"),
                &clip,
                (&camera, 0.5),
                &RenderSettings::default(),
                (&scene, Order::Depth),
            )?;
            let expected = render(&scene, &camera, 0.5, Order::Depth);
            if render(&RenderScene::from(&blurred), &camera, 0.5, Order::Depth).psnr(&expected) > 40.0 {
                return Err(format!("{place:?}: both filters give the same image, so this tests nothing"));
            }
        }
    }
    Ok(())
}

/// The plate has a filter of its own.
fn plate_of_another_filter(gpu: &Gpu) -> Result<(), String> {
    let field = Recipe { motion: Motion::Static, ..RECIPE }.field();
    let mut background = Recipe { motion: Motion::Static, seed: 9, ..RECIPE }.field();
    background.filter = PixelFilter::Mip;
    background.log_scales.iter_mut().flatten().for_each(|scale| *scale -= 1.0);
    let clip = decoded_with(&field, Some(&background), &[]);
    let view = (&camera(Place::Whole, SIZE.0, SIZE.1), 0.5);
    let scene = RenderScene::from(&clip);
    compare(gpu, "plate of another filter", &clip, view, &RenderSettings::default(), (&scene, Order::Depth))
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
    // A wide view from inside differs between the two orders.
    let near = camera(Place::Near, SIZE.0, SIZE.1);
    let [depth, radial] =
        [Order::Depth, Order::Radial].map(|order| render(&RenderScene::from(&clip), &near, 0.5, order));
    if depth.max_difference(&radial) < 3.0 / 255.0 {
        return Err("both orders give the same image, so this tests nothing".into());
    }
    Ok(())
}

/// `sqrt(8)` standard deviations suffice for opacities up to `e^4 / 255`, `sqrt(5)` for opacities up to
/// `e^2.5 / 255`.
fn cutoffs(gpu: &Gpu) -> Result<(), String> {
    for (cutoff, squared_radius) in [(Cutoff::Sqrt8, 8.0f32), (Cutoff::Sqrt5, 5.0)] {
        let mut field = Recipe { motion: Motion::Static, ..RECIPE }.field();
        let limit = 0.98 * (0.5f32 * squared_radius).exp() / 255.0;
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

/// A cutoff that the opacities exceed darkens the image; a tighter one darkens it more.
fn cutoffs_that_clip(gpu: &Gpu) -> Result<(), String> {
    let clip = decoded(&Recipe { motion: Motion::Static, ..RECIPE }.field());
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

/// Real cameras have an off-centre principal point and unequal focal lengths.
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

/// Colours far below 0 and above 1, as fitted harmonics have them.
fn glaring(mut field: Field) -> Field {
    field.sh.iter_mut().flatten().for_each(|coefficient| *coefficient *= 3.0);
    field
}

/// Every blend rounds to 1/255, which loses contributions below half of that. The tolerance is looser,
/// and the differences are printed.
fn eight_bits(gpu: &Gpu) -> Result<(), String> {
    let tolerance = Tolerance { max_diff: 16.0, diff_pixels: usize::MAX, psnr: 36.0 };
    let clips = [RECIPE.field(), glaring(RECIPE.field())].map(|field| decoded(&field));
    for (clip, place) in clips.iter().flat_map(|clip| PLACES.map(|place| (clip, place))) {
        let view = camera(place, SIZE.0, SIZE.1);
        let images = gpu::draw(
            gpu,
            clip,
            std::slice::from_ref(&view),
            0.5,
            &RenderSettings::default(),
            ChannelDepth::Eight,
        );
        let images = images.map_err(|fault| fault.to_string())?;
        let expected = render(&RenderScene::from(clip), &view, 0.5, Order::Depth);
        println!("8-bit target, {place:?}: {}", difference(&images[0], &expected));
        check(&format!("8-bit, {place:?}"), &images[0], &expected, tolerance)?;
    }
    Ok(())
}
