//! The trajectory, the temporal opacity, the rotation and the fade near the eye exist once in Rust and once in WGSL.
//! These tests compare the GPU's images with [`codec::Field`]'s equations and [`near_fade`], without the reference
//! renderer.
//!
//! One Gaussian is drawn at many instants. Alpha's centroid gives its position, alpha at its center
//! its opacity, and alpha's second moments its rotation.

use aarc_tests::gpu::{self, Drawing, Passes};
use aarc_tests::scene::decoded;
use client::gpu::{ChannelDepth, Cutoff, Gpu, GpuClip, RenderSettings};
use codec::{Camera, Clip, Field, Temporal, near_fade};
use libtest_mimic::Trial;
use refine::image::Image;

const SIZE: u32 = 256;

/// Pixels per unit at the distance of the Gaussian.
const SCALE: f64 = 60.0;

const DISTANCE: f64 = 50.0;

/// The tests of this file.
pub(crate) fn trials() -> Vec<Trial> {
    let mut trials = Vec::new();
    for order in 0..=3u8 {
        trials.push(gpu::trial(format!("trajectory of order {order}"), Passes::Shared, move |gpu| {
            trajectory(gpu, order)
        }));
    }
    trials.push(gpu::trial("temporal opacity", Passes::Shared, temporal_opacity));
    trials.push(gpu::trial("rotation", Passes::Shared, rotation));
    trials.push(gpu::trial("fade near the eye", Passes::Shared, fade));
    trials.push(gpu::trial("support radius", Passes::Shared, support_radius));
    trials.push(gpu::trial("largest alpha", Passes::Shared, largest_alpha));
    trials
}

/// Instants from the start to the end of the clip.
fn times() -> impl Iterator<Item = f64> {
    (0..=16).map(|i| f64::from(i) / 16.0)
}

/// A camera on the z axis, so far away that perspective does not distort the plane z = 0.
fn camera() -> Camera {
    let center = 0.5 * f64::from(SIZE);
    Camera {
        width: SIZE,
        height: SIZE,
        k: [[SCALE * DISTANCE, 0.0, center], [0.0, SCALE * DISTANCE, center], [0.0, 0.0, 1.0]],
        camera_from_world: [
            [1.0, 0.0, 0.0, 0.0],
            [0.0, 1.0, 0.0, 0.0],
            [0.0, 0.0, 1.0, DISTANCE],
            [0.0, 0.0, 0.0, 1.0],
        ],
    }
}

/// One Gaussian in the plane z = 0; `deviations` are its standard deviations in world units.
fn gaussian(deviations: [f32; 3], temporal: Temporal) -> Field {
    Field {
        centers: vec![[0.2, -0.1, 0.0]],
        rotations: vec![[1.0, 0.0, 0.0, 0.0]],
        log_scales: vec![deviations.map(f32::ln)],
        opacities: vec![0.8],
        sh_degree: 0,
        sh: vec![[1.0; 3]],
        temporal: Some(temporal),
        ..Field::default()
    }
}

/// The field packaged and decoded. Both sides use these numbers, because packages round.
fn one(field: &Field) -> Result<Clip, String> {
    let clip = decoded(field);
    if (clip.static_field.len(), clip.dynamic_field.len()) == (0, 1) {
        Ok(clip)
    } else {
        Err("it is not one dynamic Gaussian".into())
    }
}

/// Calls `check` with the image at each instant.
fn at_all_times(
    gpu: &Gpu,
    clip: &Clip,
    mut check: impl FnMut(f64, &Image) -> Result<(), String>,
) -> Result<(), String> {
    let uploaded = GpuClip::upload(gpu, clip).map_err(|fault| fault.to_string())?;
    let mut drawing =
        Drawing::new(gpu, uploaded, &[camera()], ChannelDepth::Sixteen).map_err(|fault| fault.to_string())?;
    for t in times() {
        let images = drawing.frame(t, &RenderSettings::default()).map_err(|fault| fault.to_string())?;
        check(t, &images[0]).map_err(|what| format!("at {t}: {what}"))?;
    }
    Ok(())
}

/// Centroid of alpha, in pixels.
fn centroid(image: &Image) -> [f64; 2] {
    let [sum, x, y] = moments(image, |x, y| [1.0, x, y]);
    [x / sum, y / sum]
}

/// Sums of alpha times functions of the pixel centre.
fn moments<const N: usize>(image: &Image, functions: impl Fn(f64, f64) -> [f64; N]) -> [f64; N] {
    let mut sums = [0.0; N];
    for (i, pixel) in image.pixels.iter().enumerate() {
        let (column, row) = (i as u32 % image.width, i as u32 / image.width);
        let values = functions(f64::from(column) + 0.5, f64::from(row) + 0.5);
        for (sum, value) in sums.iter_mut().zip(values) {
            *sum += pixel[3] * value;
        }
    }
    sums
}

fn close(what: &str, actual: f64, expected: f64, tolerance: f64) -> Result<(), String> {
    if (actual - expected).abs() <= tolerance {
        return Ok(());
    }
    Err(format!("{what} is {actual} on the GPU and {expected} by the equation, more than {tolerance} apart"))
}

/// The centroid follows the equation within 0.03 pixels, on paths of up to 100 pixels.
fn trajectory(gpu: &Gpu, order: u8) -> Result<(), String> {
    // Powers of different magnitude: the GPU's records have a unit for each.
    let motion = [[0.4, -0.3, 0.0], [1.9, 0.8, 0.0], [-2.9, 3.1, 0.0]];
    let temporal = Temporal {
        tau: vec![0.3],
        s: vec![0.9],
        motion_order: order,
        motion: motion[..order.into()].to_vec(),
        rotation_rates: None,
    };
    let clip = one(&gaussian([0.12; 3], temporal))?;
    let mut path = Vec::new();
    at_all_times(gpu, &clip, |t, image| {
        let [x, y, _] = clip.dynamic_field.position_at(0, t);
        let center = 0.5 * f64::from(SIZE);
        let found = centroid(image);
        path.push(found);
        close("x in pixels", found[0], center + SCALE * x, 0.03)?;
        close("y in pixels", found[1], center + SCALE * y, 0.03)
    })?;
    let length: f64 =
        path.windows(2).map(|pair| (pair[1][0] - pair[0][0]).hypot(pair[1][1] - pair[0][1])).sum();
    if (order == 0) == (length < 0.1) { Ok(()) } else { Err(format!("it moves by {length} pixels")) }
}

/// Opacity agrees within half of an 8-bit step, while the temporal window opens and closes.
fn temporal_opacity(gpu: &Gpu) -> Result<(), String> {
    for (tau, s) in [(0.5, 0.12), (0.1, 0.3), (1.2, 0.4), (0.7, 0.03)] {
        let temporal = Temporal { tau: vec![tau], s: vec![s], ..Temporal::default() };
        let clip = one(&gaussian([0.3; 3], temporal))?;
        let mut visible = 0;
        at_all_times(gpu, &clip, |t, image| {
            let expected = clip.dynamic_field.opacity_at(0, t);
            // The falloff at the pixel centre nearest to the Gaussian's.
            let [x, y, _] = clip.dynamic_field.position_at(0, t).map(|x| 0.5 * f64::from(SIZE) + SCALE * x);
            let deviation = SCALE * f64::from(clip.dynamic_field.log_scales[0][0].exp());
            let square = (x.floor() + 0.5 - x).powi(2) + (y.floor() + 0.5 - y).powi(2);
            let falloff = (-0.5 * square / (deviation * deviation + 0.3)).exp();
            let alpha = image.pixel(x as u32, y as u32)[3] / falloff;
            if expected < 1.01 / 255.0 {
                // Rounding decides whether an opacity at the alpha cut is drawn.
                return close("opacity", alpha, 0.0, 1.02 / 255.0);
            }
            visible += 1;
            close("opacity", alpha, expected, 0.5 / 255.0)
        })
        .map_err(|what| format!("tau {tau}, s {s}: {what}"))?;
        if visible == 0 {
            return Err(format!("tau {tau}, s {s}: it is never visible"));
        }
    }
    Ok(())
}

/// Draws a clip in the middle of its time.
fn draw(gpu: &Gpu, clip: &Clip, settings: &RenderSettings) -> Result<Image, String> {
    let images = gpu::draw(gpu, clip, &[camera()], 0.5, settings, ChannelDepth::Sixteen);
    images.map(|mut images| images.remove(0)).map_err(|fault| fault.to_string())
}

/// A cutoff leaves out what lies beyond its radius in each direction: also in the corners of the quad around it.
fn support_radius(gpu: &Gpu) -> Result<(), String> {
    let temporal = Temporal { tau: vec![0.5], s: vec![0.4], ..Temporal::default() };
    let clip = one(&gaussian([0.3; 3], temporal))?;
    let field = &clip.dynamic_field;
    let [x, y, _] = field.position_at(0, 0.5).map(|x| 0.5 * f64::from(SIZE) + SCALE * x);
    let variance = (SCALE * f64::from(field.log_scales[0][0].exp())).powi(2) + 0.3;
    for (cutoff, square_max) in [(Cutoff::Sqrt8, 8.0), (Cutoff::Sqrt5, 5.0)] {
        let image = draw(gpu, &clip, &RenderSettings { cutoff, ..RenderSettings::default() })?;
        for (i, pixel) in (0u32..).zip(&image.pixels) {
            let [column, row] = [i % SIZE, i / SIZE].map(|place| f64::from(place) + 0.5);
            let square = ((column - x).powi(2) + (row - y).powi(2)) / variance;
            let expected = field.opacity_at(0, 0.5) * (-0.5 * square).exp();
            let expected = if square <= square_max && expected >= 1.0 / 255.0 { expected } else { 0.0 };
            // Rounding decides at the edge.
            if (square - square_max).abs() > 0.1 {
                close(&format!("alpha at {square:.2} of {square_max}"), pixel[3], expected, 0.5 / 255.0)?;
            }
        }
    }
    Ok(())
}

/// An opaque Gaussian leaves a thousandth of what is behind it.
fn largest_alpha(gpu: &Gpu) -> Result<(), String> {
    let temporal = Temporal { tau: vec![0.5], s: vec![0.4], ..Temporal::default() };
    let clip = one(&Field { opacities: vec![1.0], ..gaussian([3.0; 3], temporal) })?;
    if clip.dynamic_field.opacity_at(0, 0.5) < 0.9999 {
        return Err("the package lost the opacity".into());
    }
    let image = draw(gpu, &clip, &RenderSettings::default())?;
    let largest = image.pixels.iter().map(|pixel| pixel[3]).fold(0.0, f64::max);
    // 16-bit floats below 1 are 0.0005 apart, and some drivers cut what they cannot hold.
    close("the largest alpha", largest, 0.999, 0.0006)
}

/// The angle of a needle that turns in the image plane agrees within 0.25 degrees.
fn rotation(gpu: &Gpu) -> Result<(), String> {
    let temporal = Temporal {
        tau: vec![0.5],
        s: vec![0.9],
        motion_order: 0,
        motion: Vec::new(),
        rotation_rates: Some(vec![[0.2, 0.0, 0.0, 0.9]]),
    };
    let clip = one(&gaussian([0.4, 0.08, 0.08], temporal))?;
    if clip.dynamic_field.temporal.as_ref().is_none_or(|temporal| temporal.rotation_rates.is_none()) {
        return Err("the package lost the rotation".into());
    }
    let mut angles = Vec::new();
    at_all_times(gpu, &clip, |t, image| {
        let [cx, cy] = centroid(image);
        let [xx, xy, yy] = moments(image, |x, y| {
            let (x, y) = (x - cx, y - cy);
            [x * x, x * y, y * y]
        });
        let found = 0.5 * (2.0 * xy).atan2(xx - yy);
        let [w, _, _, z] = clip.dynamic_field.rotation_at(0, t);
        let expected = 2.0 * z.atan2(w);
        // A needle looks the same after half a turn.
        let apart = (found - expected).rem_euclid(std::f64::consts::PI);
        angles.push(found);
        close("angle", apart.min(std::f64::consts::PI - apart).to_degrees(), 0.0, 0.25)
    })?;
    if (angles[0] - angles[16]).abs() > 0.5 {
        Ok(())
    } else {
        Err("it hardly turns, so it tests nothing".into())
    }
}

/// Opacity agrees within half of an 8-bit step, from before the start of the fade to where the Gaussian is whole.
fn fade(gpu: &Gpu) -> Result<(), String> {
    let temporal = Temporal { tau: vec![0.5], s: vec![0.4], ..Temporal::default() };
    let still = gaussian([0.3; 3], temporal);
    let mut faded = 0;
    for depth in [0.3, 0.499, 0.501, 0.51, 0.55, 0.6, 0.75, 0.9, 0.98, 1.0, 1.02, 3.0, f64::INFINITY] {
        let near = if depth.is_infinite() { 0.0 } else { DISTANCE / depth };
        let clip = one(&Field { near: near as f32, ..still.clone() })?;
        let fade = near_fade(DISTANCE, f64::from(clip.near()));
        let [x, y, _] = clip.dynamic_field.position_at(0, 0.5).map(|x| 0.5 * f64::from(SIZE) + SCALE * x);
        let deviation = SCALE * f64::from(clip.dynamic_field.log_scales[0][0].exp());
        let square = (x.floor() + 0.5 - x).powi(2) + (y.floor() + 0.5 - y).powi(2);
        let falloff = (-0.5 * square / (deviation * deviation + 0.3)).exp();
        let expected = fade * clip.dynamic_field.opacity_at(0, 0.5);
        let image = draw(gpu, &clip, &RenderSettings::default())?;
        let alpha = image.pixel(x as u32, y as u32)[3] / falloff;
        let expected = if expected < 1.0 / 255.0 { 0.0 } else { expected };
        close(&format!("opacity at {depth} of the near distance"), alpha, expected, 0.5 / 255.0)?;
        faded += usize::from(expected > 0.0 && fade < 1.0);
    }
    if faded == 6 { Ok(()) } else { Err(format!("{faded} depths are in the fade")) }
}
