//! Fragments in f16: their pictures are within 50 dB of the pictures in f32, in targets of 8 and of 16 bits, and the
//! player uses them only after it has measured that.

use aarc_tests::data;
use aarc_tests::gpu::{draw, f16_trial};
use aarc_tests::image::difference;
use aarc_tests::scene::{Motion, Place, Recipe, camera, decoded, decoded_with};
use client::gpu::{ChannelDepth, Gpu, RenderSettings, choose_f16, f16_psnr};
use codec::{Camera, Clip, Field, Limits, PixelFilter};
use libtest_mimic::Trial;
use measure::device::{Fragments, Passes, device};
use program::Fault;

use super::real_data::{SPINACH, spinach_clip};

const SIZE: (u32, u32) = (160, 120);

/// Least PSNR against f32, in dB.
const PSNR_MIN: f64 = 50.0;

const DEPTHS: [ChannelDepth; 2] = [ChannelDepth::Eight, ChannelDepth::Sixteen];

/// The tests of this file.
pub(crate) fn trials() -> Vec<Trial> {
    let mut trials: Vec<_> = DEPTHS
        .map(|depth| {
            f16_trial(format!("pictures in f16, {depth:?} bits"), move || compare(&scenes()?, depth))
        })
        .into();
    trials.extend([
        f16_trial("a device chooses f16 by its picture", chosen),
        data::f16_trial("spinach in f16", SPINACH, |path| {
            let (clip, camera) = spinach_clip(&path)?;
            let scenes = [("spinach".to_owned(), clip, camera)];
            DEPTHS.into_iter().try_for_each(|depth| compare(&scenes, depth))
        }),
    ]);
    trials
}

const RECIPE: Recipe =
    Recipe { count: 600, sh_degree: 1, motion: Motion::Mixed, motion_order: 2, turning: false, seed: 7 };

/// A name, a clip and the camera that sees it.
type Scene = (String, Clip, Camera);

/// Of generated fields some opaque, some hazy, some of large Gaussians, and the demo.
fn scenes() -> Result<Vec<Scene>, String> {
    let plate = Recipe { motion: Motion::Static, seed: 9, ..RECIPE }.field();
    let mut hazy = Recipe { count: 5000, seed: 11, ..RECIPE }.field();
    hazy.opacities.iter_mut().for_each(|opacity| *opacity *= 0.1);
    let mut large = Recipe { seed: 5, ..RECIPE }.field();
    large.log_scales.iter_mut().flatten().for_each(|scale| *scale += 1.5);
    let mip = Field { filter: PixelFilter::Mip, ..RECIPE.field() };
    let clips = [
        ("blur", decoded(&RECIPE.field())),
        ("mip filter", decoded(&mip)),
        ("plate", decoded_with(&RECIPE.field(), Some(&plate), &[])),
        ("hazy", decoded(&hazy)),
        ("large", decoded(&large)),
    ];
    let mut scenes = Vec::new();
    for (name, clip) in clips {
        for place in [Place::Whole, Place::Near, Place::Far, Place::Edge] {
            scenes.push((format!("{name}, {place:?}"), clip.clone(), camera(place, SIZE.0, SIZE.1)));
        }
    }
    let demo = include_bytes!("../../../assets/demo.aarc");
    let demo = codec::decode(demo, &Limits::default()).map_err(|error| error.to_string())?;
    let viewpoint = demo.viewpoints().remove(0).camera(demo.info.up, 256, 256);
    scenes.push(("demo".into(), demo, viewpoint));
    Ok(scenes)
}

/// Compares pictures in f16 with pictures in f32.
fn compare(scenes: &[Scene], depth: ChannelDepth) -> Result<(), String> {
    let device = |f16| {
        let mut gpu = Gpu::new_headless().map_err(text)?;
        gpu.caps.f16 = f16;
        Ok::<_, String>(gpu)
    };
    let [half, single] = [device(true)?, device(false)?];
    for (name, clip, camera) in scenes {
        let picture = |gpu: &Gpu| {
            let cameras = std::slice::from_ref(camera);
            draw(gpu, clip, cameras, 0.5, &RenderSettings::default(), depth).map_err(text)
        };
        let found = difference(&picture(&half)?[0], &picture(&single)?[0]);
        println!("f16, {name}, {depth:?} bits: {found}");
        if found.psnr < PSNR_MIN {
            return Err(format!("{name}: {found}"));
        }
        if found.psnr.is_infinite() {
            return Err(format!("{name}: both pictures are the same, so this tests nothing"));
        }
    }
    Ok(())
}

/// Software drivers never use f16. Others use it if the scene that they draw for it is close enough.
fn chosen() -> Result<(), String> {
    let mut gpu = Gpu::new_headless().map_err(text)?;
    if gpu.caps.f16 {
        return Err("a new device uses f16 before it is measured".into());
    }
    for depth in DEPTHS {
        let psnr = f16_psnr(&mut gpu, depth).map_err(text)?;
        println!("f16, the scene to choose by, {depth:?} bits: {psnr:.2} dB");
        if !(PSNR_MIN..100.0).contains(&psnr) || gpu.caps.f16 {
            return Err(format!("{depth:?} bits: {psnr} dB, in f16: {}", gpu.caps.f16));
        }
    }
    choose_f16(&mut gpu, ChannelDepth::Eight).map_err(text)?;
    let is_software = ["llvmpipe", "SwiftShader"].iter().any(|name| gpu.adapter_name.contains(name));
    if gpu.caps.f16 == is_software {
        return Err(format!("{}: in f16: {}", gpu.adapter_name, gpu.caps.f16));
    }
    let reported = device(Passes::Shared, Fragments::AsPlayers).map_err(text)?;
    if reported.caps.f16 == is_software {
        return Err(format!("{}: reports draw in f16: {}", gpu.adapter_name, reported.caps.f16));
    }
    Ok(())
}

fn text(fault: Fault) -> String {
    fault.to_string()
}
