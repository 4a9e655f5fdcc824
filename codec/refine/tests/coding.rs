//! The coder `rans` keeps what the mip filter shows of detail below a pixel, and a package meets its quality.

use codec::{
    Camera, ClipInfo, Coder, EncodeOptions, Field, Limits, PixelFilter, Precision, SH_C0, Source,
    Surroundings, decode, encode,
};
use refine::code::{Coded, PackageTarget, code};
use refine::prune::{Pictures, posed_views};
use refine::reference::{Order, RenderScene, render, sensitivities};

/// Size of the pictures that the field is coded for.
const SIZE: (u32, u32) = (96, 72);

/// Needles in a ball of radius 1, from a fiftieth of a `pixel` to half a pixel wide.
fn needles(pixel: f64) -> Field {
    let mut random = fastrand::Rng::with_seed(3);
    let mut signed = || random.f32() * 2.0 - 1.0;
    let mut field = Field { filter: PixelFilter::Mip, ..Field::default() };
    for row in 0..600 {
        let center = [signed(), signed(), signed()];
        let q = [signed(), signed(), signed(), signed()];
        let norm = q.iter().map(|x| x * x).sum::<f32>().sqrt();
        let width = (pixel * 0.02 * 25f64.powf(f64::from(row % 20) / 19.0)).ln() as f32;
        field.centers.push(center);
        field.rotations.push(q.map(|x| x / norm));
        field.log_scales.push([-2.5 + 0.5 * signed(), width, width]);
        field.opacities.push(0.6 + 0.4 * signed().abs());
        field.sh.push([signed(), signed(), signed()].map(|c| (0.4 * f64::from(c) / SH_C0) as f32));
    }
    field
}

/// The camera with an image of 8 times the size.
fn enlarged(camera: &Camera) -> Camera {
    let mut large = camera.clone();
    (large.width, large.height) = (8 * camera.width, 8 * camera.height);
    large.k[..2].iter_mut().flatten().for_each(|x| *x *= 8.0);
    large
}

/// The field, coded with the precision of one with `filter`, and the bytes that takes.
fn coded(field: &Field, filter: PixelFilter, precision: &Precision) -> (Field, usize) {
    let info = ClipInfo::default();
    let field = Field { filter, ..field.clone() };
    let options =
        EncodeOptions { coder: Coder::Rans, precision: precision.clone(), ..EncodeOptions::default() };
    let bytes = encode(&Source { info: &info, field: &field, plate: None }, &options).unwrap();
    let decoded = decode(&bytes, &Limits::default()).unwrap().merged();
    (Field { filter: PixelFilter::Mip, ..decoded }, bytes.len())
}

/// The steps for the mip filter show more of the needles in fewer bytes than those for blur, at the size that they are
/// coded for and at 8 times that: steps for blur forget how much thinner than a pixel a needle is.
#[test]
fn compensated_needles_are_right_at_8_times_the_resolution() {
    let field = needles(0.05);
    let cameras = Surroundings::new(&field, None, [0.0, 1.0, 0.0]).stand_points(0.0, SIZE).content;
    let pixel = 3.0 / cameras[0].k[0][0];
    assert!((0.02..0.1).contains(&pixel), "{pixel}");
    let seen = sensitivities(&field, None, &posed_views(&cameras, &[0.0]), || ()).unwrap();
    let measured = |filter, psnr| {
        let precision = Precision {
            psnr,
            footprint: Some(seen.footprint),
            sensitivities: seen.field.clone(),
            ..Precision::default()
        };
        let (decoded, bytes) = coded(&field, filter, &precision);
        let psnr = |camera: &Camera| {
            let draw = |field: &Field| render(&RenderScene::from(field), camera, 0.0, Order::Depth);
            draw(&decoded).psnr(&draw(&field))
        };
        (psnr(&cameras[0]), psnr(&enlarged(&cameras[0])), bytes)
    };
    let mip = measured(PixelFilter::Mip, 45.0);
    let blur = measured(PixelFilter::Blur, 55.0);
    assert!(mip.0 > 45.0 && mip.1 > 37.5, "{mip:?}");
    assert!(mip.0 > blur.0 + 4.0 && mip.1 > blur.1 + 3.0 && mip.2 < blur.2, "{mip:?}, for blur {blur:?}");
}

/// Gaussians of one shape have the same errors, so that the PSNR jumps from precision to precision.
#[test]
fn regular_fields_meet_their_quality() {
    let shape = needles(1.0);
    let rows: Vec<usize> = (0..1800).map(|i| i % shape.len()).collect();
    let mut field = Field { filter: PixelFilter::Blur, ..shape.select(&rows) };
    for (i, center) in field.centers.iter_mut().enumerate() {
        *center = [i % 12, i / 12 % 12, i / 144].map(|x| 0.15 * x as f32 - 0.9);
    }
    field.log_scales.fill([-2.7; 3]);
    field.opacities.fill(0.83);
    field.rotations.fill([1.0, 0.0, 0.0, 0.0]);
    let info = ClipInfo::default();
    let source = Source { info: &info, field: &field, plate: None };
    let cameras = Surroundings::new(&field, None, [0.0, 1.0, 0.0]).stand_points(0.0, SIZE).content;
    let views = posed_views(&cameras, &[0.0]);
    let judge = Pictures::take(&RenderScene::from(&field), views.clone(), || ());
    for psnr_db in [40.0, 43.0, 46.0, 49.0, 52.0] {
        let target = PackageTarget { layers: &[], psnr_db, by_device: false };
        let Coded { fidelity, miss, .. } = code(&source, target, &views, &judge, None, |_| ()).unwrap();
        println!("{psnr_db}: {}", fidelity.psnr_db);
        assert_eq!(miss, None, "{psnr_db} dB: {fidelity:?}");
    }
}
