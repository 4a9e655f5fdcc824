//! [`choose_f16`]: decides by a measurement whether a device calculates the fragment stage in f16.
//!
//! Drivers round f16 differently, and may err. So a new device draws a small scene in f16 and in f32, and uses f16 only
//! if the pictures are close. Its many hazy layers and its opaque edges show what rounding adds up to.

use std::sync::Arc;

use codec::{Camera, Clip, ClipInfo, Field};
use glam::UVec2;
use program::Fault;

use super::device::Gpu;
use super::readback::Pixels;
use super::renderer::{FrameLayout, Renderer};
use super::settings::RenderSettings;
use super::stages::clip::GpuClip;
use super::target::{ChannelDepth, Offscreen};
use crate::view::View;

/// Least PSNR of the picture in f16 against the picture in f32, in dB.
const PSNR_MIN: f64 = 50.0;

/// Width and height of the pictures in pixels.
const SIDE: u32 = 64;

/// Number of Gaussians: a pixel blends 33 on average and 62 at most, as many as one of a fitted room.
const GAUSSIANS: u32 = 160;

/// Sets [`Caps::f16`](super::Caps::f16) of a new device for clips drawn into targets of `depth`. It is on if the device
/// has f16, is a GPU, and draws the small scene in f16 with at least 50 dB against f32. A processor calculates in f32
/// and converts after each operation, so there f16 takes longer.
///
/// # Errors
/// [`Fault::Device`] if there is not enough memory, or the device was lost.
pub fn choose_f16(gpu: &mut Gpu, depth: ChannelDepth) -> Result<(), Fault> {
    if gpu.has_f16() && !gpu.is_software() {
        let psnr = f16_psnr(gpu, depth)?;
        log::info!("fragments in f16: {psnr:.1} dB against f32");
        gpu.caps.f16 = suffices(psnr);
        gpu.drop_pipelines();
    }
    Ok(())
}

/// Whether pictures with this PSNR are close enough: not with NaN, which a driver may draw.
fn suffices(psnr: f64) -> bool {
    psnr >= PSNR_MIN
}

/// PSNR in dB of the small scene drawn in f16 against the same in f32, in targets of `depth`. Leaves f16 off.
///
/// # Errors
/// As [`choose_f16`].
///
/// # Panics
/// If the device does not have f16.
pub fn f16_psnr(gpu: &mut Gpu, depth: ChannelDepth) -> Result<f64, Fault> {
    assert!(gpu.has_f16(), "the device has f16");
    let scene = scene();
    let (bounds, info) = (scene.bounds(), ClipInfo::default());
    let clip = GpuClip::upload(gpu, &Clip::of_one_layer(info, bounds, scene, Field::default(), None))?;
    let mut picture = |f16| {
        gpu.caps.f16 = f16;
        draw(gpu, clip.clone(), depth)
    };
    let [half, single] = [picture(true), picture(false)];
    Ok(psnr(&half?, &single?))
}

/// Gaussians in a box of two units around the origin, one in four of them opaque. Multiples of irrational numbers
/// spread places, sizes and colours evenly.
fn scene() -> Field {
    let fraction = |row: u32, factor: f64| (f64::from(row) * factor).fract() as f32;
    let rows = 0..GAUSSIANS;
    let triple = |row, factors: [f64; 3]| factors.map(|factor| fraction(row, factor));
    let centers = rows.clone().map(|row| triple(row, [0.8192, 0.6711, 0.5497]).map(|x| 2.0 * x - 1.0));
    let log_scales = rows.clone().map(|row| triple(row, [0.7549, 0.5698, 0.3247]).map(|x| x - 2.0));
    let opacity = |row| if row % 4 == 0 { 1.0 } else { 0.02 + 0.4 * fraction(row, 0.6180) };
    let color = |row| triple(row, [0.4142, 0.7321, 0.2361]).map(|x| 3.5 * (x - 0.5));
    Field {
        centers: centers.collect(),
        rotations: rows.clone().map(|_| [1.0, 0.0, 0.0, 0.0]).collect(),
        log_scales: log_scales.collect(),
        opacities: rows.clone().map(opacity).collect(),
        sh: rows.map(color).collect(),
        ..Field::default()
    }
}

fn draw(gpu: &Gpu, clip: Arc<GpuClip>, depth: ChannelDepth) -> Result<Pixels, Fault> {
    let camera = Camera::look_at([0.0, 0.0, 4.0], [0.0; 3], [0.0, 1.0, 0.0], 0.6, SIDE, SIDE);
    let mut renderer = Renderer::new(gpu, clip, FrameLayout::plain(depth.format(), 1))?;
    let target = Offscreen::new(gpu, UVec2::splat(SIDE), 1, depth)?;
    target.render(gpu, &mut renderer, 0.0, &[View::from_camera(&camera)], &RenderSettings::default())?;
    Ok(target.read(gpu)?.remove(0))
}

/// PSNR in dB over all channels, alpha included; `+inf` for equal pictures.
fn psnr(a: &Pixels, b: &Pixels) -> f64 {
    let pairs = a.rgba.iter().flatten().zip(b.rgba.iter().flatten());
    let squares: f64 = pairs.map(|(a, b)| f64::from(a - b).powi(2)).sum();
    -10.0 * (squares / (4 * a.rgba.len()) as f64).log10()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn psnr_of_flat_pictures() {
        let flat = |value: f32| Pixels { size: UVec2::ONE, rgba: vec![[value; 4]] };
        assert!((psnr(&flat(0.5), &flat(0.51)) - 40.0).abs() < 1e-4);
        assert_eq!(psnr(&flat(0.5), &flat(0.5)), f64::INFINITY);
        assert!(psnr(&flat(f32::NAN), &flat(0.5)).is_nan());
    }

    #[test]
    fn only_close_pictures_suffice() {
        assert_eq!([49.9, 50.0, f64::INFINITY, f64::NAN].map(suffices), [false, true, true, false]);
    }

    #[test]
    fn the_scene_is_a_valid_field() {
        assert_eq!(scene().check(), Ok(()));
    }
}
