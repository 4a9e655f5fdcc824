//! Foveated frames: the inset shows what a frame without it shows, the rest what the wide view shows, and between
//! them one becomes the other.

use aarc_tests::gpu::{self, Passes, draw};
use aarc_tests::image::{Tolerance, check, difference};
use aarc_tests::scene::{Motion, Place, Recipe, camera, decoded};
use client::gpu::{ChannelDepth, FrameLayout, Gpu, GpuClip, Offscreen, RenderSettings, Renderer};
use client::view::View;
use codec::{Camera, Clip, Field, PixelFilter};
use glam::UVec2;
use libtest_mimic::Trial;
use program::Fault;
use refine::image::Image;
use refine::reference::{Order, RenderScene, render};

const SIZE: (u32, u32) = (160, 120);

/// The inset as a fraction of the image's sides, and its size in pixels, a multiple of the 8 pixels of a block.
const SIDE: f32 = 0.4;
const PART: (u32, u32) = (64, 48);

/// Width of the edge in which the inset fades, in pixels.
const FEATHER: f64 = 0.05 * 48.0;

const TOLERANCE: Tolerance = Tolerance { max_diff: 2.0, diff_pixels: 100, psnr: 54.0 };

/// The tests of this file.
pub(crate) fn trials() -> Vec<Trial> {
    vec![
        gpu::trial("inset, wide view and edge, one eye", Passes::Shared, |gpu| composed(gpu, false)),
        gpu::multiview_trial("inset, wide view and edge, two eyes in one pass", |gpu| composed(gpu, true)),
        gpu::trial("inset, wide view and edge, two eyes in two passes", Passes::PerEye, |gpu| {
            composed(gpu, true)
        }),
        gpu::trial("the inset of a blurred field", Passes::Shared, blurred),
        gpu::trial("light of small Gaussians around the inset", Passes::Shared, light),
        gpu::trial("fragments of a foveated frame", Passes::Shared, fragments),
    ]
}

fn foveated() -> RenderSettings {
    RenderSettings { inset: Some(SIDE), ..RenderSettings::default() }
}

fn clip(filter: PixelFilter) -> Clip {
    let recipe =
        Recipe { count: 600, sh_degree: 1, motion: Motion::Mixed, motion_order: 2, turning: false, seed: 7 };
    decoded(&Field { filter, ..recipe.field() })
}

/// A camera with its axis out of the middle, like the eye of a headset.
fn eye() -> Camera {
    let mut camera = camera(Place::Near, SIZE.0, SIZE.1);
    (camera.k[0][2], camera.k[1][2]) = (96.0, 50.0);
    camera
}

/// The camera of the wide view, and the upper left pixel of the inset.
fn parts(eye: &Camera) -> (Camera, (u32, u32)) {
    let mut wide = eye.clone();
    (wide.width, wide.height) = PART;
    wide.k[..2].iter_mut().flatten().for_each(|x| *x *= f64::from(PART.0) / f64::from(SIZE.0));
    (wide, (eye.k[0][2] as u32 - PART.0 / 2, eye.k[1][2] as u32 - PART.1 / 2))
}

/// The pixel of `image` at `(x, y)`, interpolated linearly between pixel centres.
fn sampled(image: &Image, x: f64, y: f64) -> [f64; 4] {
    let at = |x: f64, size: u32| {
        let x = (x - 0.5).clamp(0.0, f64::from(size) - 1.0);
        let low = (x as u32).min(size - 2);
        (low, x - f64::from(low))
    };
    let ((x, fx), (y, fy)) = (at(x, image.width), at(y, image.height));
    let mix = |a: [f64; 4], b: [f64; 4], f: f64| std::array::from_fn(|i| a[i] + f * (b[i] - a[i]));
    let [upper, lower] = [y, y + 1].map(|y| mix(image.pixel(x, y), image.pixel(x + 1, y), fx));
    mix(upper, lower, fy)
}

/// The stage `foveate` in f64: the pixels of the inset are the pixels of the image at full resolution.
fn compose(wide: &Image, full: &Image, corner: (u32, u32)) -> Image {
    let mut composed = Image::new(SIZE.0, SIZE.1);
    for (i, pixel) in composed.pixels.iter_mut().enumerate() {
        let (x, y) = (i as u32 % SIZE.0, i as u32 / SIZE.0);
        let [full_x, full_y] = [x, y].map(|x| f64::from(x) + 0.5);
        let coarse = sampled(
            wide,
            full_x * f64::from(PART.0) / f64::from(SIZE.0),
            full_y * f64::from(PART.1) / f64::from(SIZE.1),
        );
        let (left, up) = (full_x - f64::from(corner.0), full_y - f64::from(corner.1));
        let edge = left.min(up).min(f64::from(PART.0) - left).min(f64::from(PART.1) - up);
        let f = (edge / FEATHER).clamp(0.0, 1.0);
        let weight = f * f * (3.0 - 2.0 * f);
        let sharp = full.pixel(x, y);
        *pixel = std::array::from_fn(|i| coarse[i] + weight * (sharp[i] - coarse[i]));
    }
    composed
}

/// Alpha as grey levels: what [`check`] compares is colour.
fn alpha(image: &Image) -> Image {
    let pixels = image.pixels.iter().map(|pixel| [pixel[3]; 4]).collect();
    Image { pixels, ..*image }
}

/// Compares a frame with the composition of the reference's images.
fn composed(gpu: &Gpu, stereo: bool) -> Result<(), String> {
    let clip = clip(PixelFilter::Mip);
    let scene = RenderScene::from(&clip);
    let eyes = if stereo { eye().stereo_pair(0.065).to_vec() } else { vec![eye()] };
    let images = draw(gpu, &clip, &eyes, 0.5, &foveated(), ChannelDepth::Sixteen).map_err(text)?;
    for (i, (image, eye)) in images.iter().zip(&eyes).enumerate() {
        let (wide, corner) = parts(eye);
        let [wide, full] = [&wide, eye].map(|camera| render(&scene, camera, 0.5, Order::Depth));
        let expected = compose(&wide, &full, corner);
        let name = format!("foveated, {} eyes, {:?}, eye {i}", eyes.len(), gpu.caps.multiview);
        check(&name, image, &expected, TOLERANCE.on(gpu))?;
        check(&format!("{name}, alpha"), &alpha(image), &alpha(&expected), TOLERANCE.on(gpu))?;
        if difference(&full, &expected).psnr > 40.0 {
            return Err(format!("{name}: the wide view is as sharp as the inset, so this tests nothing"));
        }
    }
    Ok(())
}

/// The middle of the inset equals the middle of a frame at full resolution, to a few roundings of 16 bits, each 5e-4
/// near 1.
fn blurred(gpu: &Gpu) -> Result<(), String> {
    let (clip, eye) = (clip(PixelFilter::Blur), eye());
    let frame = |settings: &RenderSettings| {
        draw(gpu, &clip, std::slice::from_ref(&eye), 0.5, settings, ChannelDepth::Sixteen).map_err(text)
    };
    let (full, foveated) = (frame(&RenderSettings::default())?.remove(0), frame(&foveated())?.remove(0));
    let (_, corner) = parts(&eye);
    let margin = FEATHER.ceil() as u32;
    let worst = (margin..PART.1 - margin).flat_map(|y| (margin..PART.0 - margin).map(move |x| (x, y)));
    let worst = worst
        .map(|(x, y)| [&full, &foveated].map(|image| image.pixel(corner.0 + x, corner.1 + y)))
        .flat_map(|[a, b]| (0..4).map(move |i| (a[i] - b[i]).abs()))
        .fold(0.0, f64::max);
    if worst > 2e-3 {
        return Err(format!("the inset differs by {worst} from the frame at full resolution"));
    }
    Ok(())
}

/// Gaussians smaller than the pixels of the wide view have the light there that they have at full resolution.
fn light(gpu: &Gpu) -> Result<(), String> {
    // The mip filter leaves little of what is much smaller than a pixel.
    for (filter, log_scale) in [(PixelFilter::Blur, -7.0), (PixelFilter::Mip, -4.5)] {
        let recipe = Recipe {
            count: 200,
            sh_degree: 0,
            motion: Motion::Static,
            motion_order: 0,
            turning: false,
            seed: 3,
        };
        let mut field = Field { filter, ..recipe.field() };
        field.log_scales.iter_mut().flatten().for_each(|scale| *scale = log_scale);
        field.opacities.iter_mut().for_each(|opacity| *opacity = 0.9);
        let (clip, camera) = (decoded(&field), camera(Place::Whole, SIZE.0, SIZE.1));
        let light = |settings: &RenderSettings| {
            let images =
                draw(gpu, &clip, std::slice::from_ref(&camera), 0.0, settings, ChannelDepth::Sixteen);
            Ok::<f64, String>(images.map_err(text)?[0].pixels.iter().map(|pixel| pixel[3]).sum())
        };
        let (full, foveated) = (light(&RenderSettings::default())?, light(&foveated())?);
        if full < 20.0 || (foveated / full - 1.0).abs() > 0.15 {
            return Err(format!("{filter:?}: alpha sums to {foveated} instead of {full}"));
        }
    }
    Ok(())
}

/// A foveated frame sorts once, and has at most half of the fragments.
fn fragments(gpu: &Gpu) -> Result<(), String> {
    let (clip, eye) = (clip(PixelFilter::Mip), eye());
    let uploaded = GpuClip::upload(gpu, &clip).map_err(text)?;
    let depth = ChannelDepth::Eight;
    let layout = FrameLayout { format: depth.format(), eyes: 1, foveated: true };
    let mut renderer = Renderer::new(gpu, uploaded, layout).map_err(text)?;
    let mut count = |camera: &Camera, settings: &RenderSettings| {
        let size = UVec2::new(camera.width, camera.height);
        let target =
            Offscreen::new(gpu, size, 1, depth).and_then(|image| image.foveated(gpu, SIDE)).map_err(text)?;
        let views = [View::from_camera(camera)];
        let counts = target.render(gpu, &mut renderer, 0.5, &views, settings).map_err(text)?;
        let coverage = renderer.count(gpu).map_err(text)?;
        Ok::<_, String>((counts.sorted, coverage))
    };
    let (sorted, coverage) = count(&eye, &foveated())?;
    let (in_wide, wide) = count(&parts(&eye).0, &RenderSettings::default())?;
    if sorted != in_wide || coverage.fragments <= wide.fragments || coverage.drawn < wide.drawn {
        return Err(format!("{sorted} sorted, {coverage:?}; in the wide view alone {in_wide}, {wide:?}"));
    }
    let (_, full) = count(&eye, &RenderSettings::default())?;
    if 2 * coverage.fragments > full.fragments {
        return Err(format!("{} fragments instead of {}", coverage.fragments, full.fragments));
    }
    Ok(())
}

fn text(fault: Fault) -> String {
    fault.to_string()
}
