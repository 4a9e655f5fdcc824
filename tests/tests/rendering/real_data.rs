//! Both renderers on data of others: forward renders of gsplat, the rasteriser that fits most fields, and a real
//! fitted field, packaged and played.

use std::fs;
use std::path::{Path, PathBuf};

use aarc_tests::data;
use aarc_tests::gpu::{self, Drawing};
use aarc_tests::image::{Tolerance, check, pixels_beyond};
use client::gpu::{ChannelDepth, Gpu, GpuClip, RenderSettings};
use codec::{Camera, Clip, Field, LayerEnd, Limits, TimeIndex};
use libtest_mimic::Trial;
use refine::image::Image;
use refine::prune::Ranking;
use refine::reference::{Order, RenderScene, render};
use safetensors::SafeTensors;
use studio::package::{self, package};

/// The field of spinach.
pub(crate) const SPINACH: &str = "spacetime-spinach/spinach_4.splatv";

/// The tests of this file.
pub(crate) fn trials() -> Vec<Trial> {
    const TINY: &str = "raster-reference/brush/tiny_case.safetensors";
    const BASIC: &str = "raster-reference/brush/basic_case.safetensors";
    vec![
        data::cpu_trial("gsplat by the reference, tiny case", TINY, gsplat_by_reference),
        data::cpu_trial("gsplat by the reference, basic case", BASIC, gsplat_by_reference),
        data::trial("gsplat, tiny case", TINY, gsplat_by_gpu),
        data::trial("gsplat, basic case", BASIC, gsplat_by_gpu),
        data::trial("spinach, 40,000 Gaussians", SPINACH, spinach),
    ]
}

/// By how much the colours of gsplat's fields, and so of its images, are divided: some are brighter than 1, which gsplat
/// draws, and which are clamped here.
const BRIGHTEST: f32 = 4.0;

/// A field of gsplat's tests, and its image by gsplat, in dimmed colours.
struct GsplatCase {
    name: String,
    field: Field,
    camera: Camera,
    expected: Image,
}

impl GsplatCase {
    fn read(path: &Path) -> Result<GsplatCase, String> {
        let bytes = fs::read(path).map_err(|error| error.to_string())?;
        let file = SafeTensors::deserialize(&bytes).map_err(|error| error.to_string())?;
        let (shape, expected) = floats(&file, "out_img");
        let (width, height) = (shape[1] as u32, shape[0] as u32);
        let dimmed = |[r, g, b, a]: [f32; 4]| [r / BRIGHTEST, g / BRIGHTEST, b / BRIGHTEST, a].map(f64::from);
        let pixels = expected.as_chunks::<4>().0.iter().map(|pixel| dimmed(*pixel)).collect();
        let (sh_degree, mut sh) = (floats(&file, "coeffs").0[1].isqrt() as u8 - 1, rows(&file, "coeffs"));
        sh.iter_mut().flatten().for_each(|coefficient| *coefficient /= BRIGHTEST);
        // Colours are 0.5 and the harmonics: the first one also takes the dimmed part of the 0.5 away.
        let grey = (0.5 / BRIGHTEST - 0.5) * 2.0 * std::f32::consts::PI.sqrt();
        sh.iter_mut().step_by((usize::from(sh_degree) + 1).pow(2)).flatten().for_each(|first| *first += grey);
        let field = Field {
            centers: rows(&file, "means"),
            rotations: rows(&file, "quats").into_iter().map(normalized).collect(),
            log_scales: rows(&file, "scales"),
            opacities: floats(&file, "opacities").1.iter().map(|o| 1.0 / (1.0 + (-o).exp())).collect(),
            sh_degree,
            sh,
            ..Field::default()
        };
        field.check()?;
        let (w, h) = (f64::from(width), f64::from(height));
        let camera = Camera {
            width,
            height,
            k: [[0.5 * w, 0.0, 0.5 * w], [0.0, 0.5 * w, 0.5 * h], [0.0, 0.0, 1.0]],
            camera_from_world: [
                [1.0, 0.0, 0.0, -0.123],
                [0.0, 1.0, 0.0, -0.456],
                [0.0, 0.0, 1.0, 8.0],
                [0.0, 0.0, 0.0, 1.0],
            ],
        };
        let name = path.file_stem().expect("it is a file").to_string_lossy().into_owned();
        Ok(GsplatCase { name, field, camera, expected: Image { width, height, pixels } })
    }
}

/// Pins the conventions of the reference renderer: its images are gsplat's to 1e-5.
fn gsplat_by_reference(path: PathBuf) -> Result<(), String> {
    let GsplatCase { name, field, camera, expected } = GsplatCase::read(&path)?;
    let image = render(&RenderScene::from(&field), &camera, 0.0, Order::Depth);
    let pairs = image.pixels.iter().flatten().zip(expected.pixels.iter().flatten());
    let worst = f64::from(BRIGHTEST) * pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    println!("gsplat {name}: {} Gaussians, largest difference {worst:.2e}", field.len());
    if !expected.pixels.iter().flat_map(|pixel| &pixel[..3]).any(|c| *c > 0.1) {
        return Err(format!("{name} is black"));
    }
    if worst > 1e-5 { Err(format!("{name}: {worst}")) } else { Ok(()) }
}

/// The tolerance is for the GPU's records, which round scales and colours to 16 bits.
fn gsplat_by_gpu(gpu: &Gpu, path: PathBuf) -> Result<(), String> {
    let GsplatCase { name, field, camera, expected } = GsplatCase::read(&path)?;
    let images =
        gpu::draw(gpu, &unpackaged(field), &[camera], 0.0, &RenderSettings::default(), ChannelDepth::Sixteen);
    let images = images.map_err(|fault| fault.to_string())?;
    let tolerance = Tolerance { max_diff: 1.0, diff_pixels: 20, psnr: 55.0 };
    println!("gsplat {name}: {}", check(&format!("gsplat {name}"), &images[0], &expected, tolerance)?);
    Ok(())
}

/// A static clip of the field, without the rounding of a package.
fn unpackaged(field: Field) -> Clip {
    let end = LayerEnd { static_count: field.len(), dynamic_count: 0 };
    Clip {
        info: aarc_tests::scene::info(),
        bounds: field.bounds(),
        layers: vec![end],
        layers_announced: vec![end],
        static_field: field,
        dynamic_field: Field::default(),
        time_index: TimeIndex::default(),
        plate: None,
    }
}

fn floats(file: &SafeTensors, name: &str) -> (Vec<usize>, Vec<f32>) {
    let tensor = file.tensor(name).unwrap_or_else(|error| panic!("{name}: {error}"));
    let values = tensor.data().as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes));
    (tensor.shape().to_vec(), values.collect())
}

fn rows<const N: usize>(file: &SafeTensors, name: &str) -> Vec<[f32; N]> {
    floats(file, name).1.as_chunks().0.to_vec()
}

fn normalized(q: [f32; 4]) -> [f32; 4] {
    let length = q.iter().map(|c| f64::from(*c) * f64::from(*c)).sum::<f64>().sqrt();
    q.map(|c| (f64::from(c) / length) as f32)
}

/// The field of spinach as a clip of 40,000 Gaussians, and its cameras' viewpoint.
pub(crate) fn spinach_clip(path: &Path) -> Result<(Clip, Camera), String> {
    let scene = studio::scene::Scene::load(path).map_err(|error| format!("{error:#}"))?;
    let settings = package::PackageSettings {
        budget: Some(40_000),
        rank: Some(Ranking::Mass),
        no_floor: true,
        coding: package::Coding::Fixed,
        ..package::PackageSettings::default()
    };
    let package = package(&scene, &settings).map_err(|error| format!("{error:#}"))?;
    let clip = codec::decode(&package.bytes, &Limits::default()).map_err(|error| error.to_string())?;
    if clip.len() != 40_000 {
        return Err(format!("{} Gaussians in the package", clip.len()));
    }
    // From the data's notes: at the origin, looking along z, y down, focal length 0.75 widths.
    let (width, height) = (1024, 768);
    let focal = 0.75 * f64::from(width);
    let camera = Camera {
        width,
        height,
        k: [[focal, 0.0, 0.5 * f64::from(width)], [0.0, focal, 0.5 * f64::from(height)], [0.0, 0.0, 1.0]],
        camera_from_world: std::array::from_fn(|r| std::array::from_fn(|c| f64::from(u8::from(r == c)))),
    };
    Ok((clip, camera))
}

/// A real field at five times from its cameras' viewpoint: each image is the reference's, and differs
/// from the image before, since the cook's arm moves.
fn spinach(gpu: &Gpu, path: PathBuf) -> Result<(), String> {
    let (clip, camera) = spinach_clip(&path)?;
    let uploaded = GpuClip::upload(gpu, &clip).map_err(|fault| fault.to_string())?;
    let mut drawing = Drawing::new(gpu, uploaded, std::slice::from_ref(&camera), ChannelDepth::Sixteen)
        .map_err(|fault| fault.to_string())?;
    let mut before: Option<Image> = None;
    for t in [0.1, 0.3, 0.5, 0.7, 0.9] {
        let images = drawing.frame(t, &RenderSettings::default()).map_err(|fault| fault.to_string())?;
        let expected = render(&RenderScene::from(&clip), &camera, t, Order::Depth);
        // The reference stops before the Gaussian that would bring a pixel's transmittance to 1e-4.
        // Blending back to front cannot stop, so a few pixels differ by more than 3/255.
        let few = Tolerance { max_diff: 8.0, diff_pixels: 40, psnr: 50.0 }.on(gpu);
        let beyond = pixels_beyond(3.0, &images[0], &expected);
        if beyond > few.diff_pixels {
            return Err(format!("at {t}, {beyond} pixels are off by more than 3/255"));
        }
        let tolerance = Tolerance { diff_pixels: usize::MAX, ..few };
        println!("spinach at {t}: {}", check(&format!("spinach at {t}"), &images[0], &expected, tolerance)?);
        if before.is_some_and(|before| before.psnr(&expected) > 40.0) {
            return Err(format!("at {t} the image equals the one before"));
        }
        before = Some(expected);
    }
    Ok(())
}
