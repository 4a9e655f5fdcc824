//! The coder `rans`: precision, damaged payloads, and sizes by attribute.

mod common;

use codec::{
    Coder, EncodeOptions, Field, Limits, Precision, Sensitivity, Source, contents, decode, encode, measure,
};
use common::{
    Parts, Rng, Shape, field, info, options, package,
    precision::{Worst, uniform},
    static_field, valid_clip,
};

/// Length of the head of a chunk.
const HEAD_BYTES: usize = 26;

/// 24 dB are four bits more per number.
#[test]
fn errors_shrink_with_the_precision() {
    let source = field(Shape::full(250), 3);
    let worst = |psnr| {
        let clip = valid_clip(&package(&source, None, &uniform(Coder::Rans, &source, psnr, &[])));
        Worst::measure(&[&clip.static_field, &clip.dynamic_field], &source)
    };
    let (coarse, fine) = (worst(35.0), worst(59.0));
    for (coarse, fine) in [
        (coarse.position, fine.position),
        (coarse.color, fine.color),
        (coarse.opacity, fine.opacity),
        (coarse.covariance, fine.covariance),
    ] {
        assert!(fine > 0.0 && fine < coarse / 6.0, "{coarse} and {fine}");
    }
}

#[test]
fn sensitive_gaussians_are_coded_more_finely() {
    let source = static_field(250, 0, 4);
    let sensitivities = |i: usize| {
        let x = if i < 125 { 1e-3 } else { 1e-5 };
        Sensitivity { color: x, geometry: 0.3 * x }
    };
    let mut options = options(Coder::Rans, &[]);
    options.precision.psnr = 90.0;
    options.precision.sensitivities = (0..250).map(sensitivities).collect();
    options.precision.footprint = Some(1e-3);
    let clip = valid_clip(&package(&source, None, &options));
    let mut error = [0.0f32; 2];
    for i in 0..250 {
        // The source row has the nearest centre.
        let distance = |row: &usize| {
            let (a, b) = (clip.static_field.centers[i], source.centers[*row]);
            (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f32>()
        };
        let row = (0..250).min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap();
        let off = (0..3).map(|k| (clip.static_field.sh[i][k] - source.sh[row][k]).abs()).fold(0.0, f32::max);
        error[usize::from(row >= 125)] += off;
    }
    assert!(error[1] > 20.0 * error[0], "{error:?}");

    // The plate has its own.
    let (field, plate) = (static_field(1, 0, 4), static_field(250, 0, 5));
    let bytes = |color: f32| {
        options.precision.sensitivities.clear();
        options.precision.plate_sensitivities = vec![Sensitivity { color, geometry: color }; 250];
        package(&field, Some(&plate), &options).len()
    };
    let [coarse, fine] = [1e-5, 1e-3].map(bytes);
    assert!(fine > coarse + 1000, "{coarse} {fine}");
}

/// Geometry steps end 46 half octaves above the finest colour step of a chunk, colour steps 31.
#[test]
fn insensitive_gaussians_are_coded_with_the_coarsest_step() {
    let source = static_field(250, 0, 4);
    let package_at = |octaves: f32| {
        let mut options = options(Coder::Rans, &[]);
        let weight = |i: usize| if i == 0 { 1.0 } else { (-octaves).exp2() };
        let sensitivity = |x: f32| Sensitivity { color: x, geometry: x };
        options.precision.sensitivities = (0..250).map(weight).map(sensitivity).collect();
        package(&source, None, &options)
    };
    let coarsest = package_at(24.0);
    assert!(package_at(22.0) != coarsest);
    assert!([25.0, 30.0, 36.0].into_iter().all(|octaves| package_at(octaves) == coarsest));
}

#[test]
fn footprints_bound_the_detail() {
    let source = static_field(2000, 0, 5);
    let bytes = |footprint| {
        let mut options = options(Coder::Rans, &[]);
        options.precision.footprint = Some(footprint);
        package(&source, None, &options).len()
    };
    assert!(bytes(0.1) < bytes(0.01) && bytes(0.01) < bytes(0.001));
}

#[test]
fn precision_must_fit_the_field() {
    let source = static_field(3, 0, 6);
    let refused = |precision: Precision| {
        let options = EncodeOptions { coder: Coder::Rans, precision, ..EncodeOptions::default() };
        encode(&Source { info: &info(), field: &source, plate: None }, &options).unwrap_err().to_string()
    };
    let with = |count: usize, color: f32| Precision {
        sensitivities: vec![Sensitivity { color, geometry: 1.0 }; count],
        ..Precision::default()
    };
    assert_eq!(refused(with(2, 1.0)), "the precision cannot be used: 2 sensitivities for 3 Gaussians");
    let of_plate = Precision { plate_sensitivities: with(2, 1.0).sensitivities, ..with(3, 1.0) };
    assert_eq!(
        refused(of_plate),
        "the precision cannot be used: 2 sensitivities for 0 Gaussians of the plate"
    );
    assert_eq!(refused(with(3, 0.0)), "the precision cannot be used: 0 is not a positive number");
    assert!(refused(with(3, f32::NAN)).contains("NaN is not"));
    assert!(refused(Precision { footprint: Some(-1.0), ..with(3, 1.0) }).contains("-1 is not"));
    assert!(refused(Precision { psnr: f64::NAN, ..with(3, 1.0) }).contains("PSNR is NaN"));
}

/// The centre of an infinite window is not coded; motion and rotation about it must not change.
#[test]
fn motion_about_a_distant_window_centre_is_preserved() {
    let mut source = field(Shape { some_static: false, ..Shape::full(250) }, 21);
    let temporal = source.temporal.as_mut().unwrap();
    for i in 0..250 {
        temporal.tau[i] = -0.4 + 0.007 * i as f32;
        temporal.s[i] = if i % 2 == 0 { f32::INFINITY } else { 5.0 };
    }
    let clip = valid_clip(&package(&source, None, &uniform(Coder::Rans, &source, 80.0, &[])));
    Worst::measure(&[&clip.dynamic_field], &source).check(1e-3);
}

/// Nor must motion about a centre that is too far away for another window.
#[test]
fn motion_about_a_window_centre_out_of_sight_is_preserved() {
    let shape = Shape { some_static: false, motion_order: 1, rotation_rates: false, ..Shape::full(250) };
    let mut source = field(shape, 22);
    let temporal = source.temporal.as_mut().unwrap();
    temporal.s.fill(f32::INFINITY);
    for i in 0..250 {
        temporal.tau[i] = if i % 2 == 0 { 2e5 } else { -3e5 };
        temporal.motion[i] = [2e-3, 0.0, -1e-3];
        for (x, v) in source.centers[i].iter_mut().zip(temporal.motion[i]) {
            *x += v * temporal.tau[i];
        }
    }
    let clip = valid_clip(&package(&source, None, &uniform(Coder::Rans, &source, 80.0, &[])));
    let fields = [&clip.static_field, &clip.dynamic_field];
    Worst::measure(&fields, &source).check(1e-3);
}

/// Windows centred outside the clip are coded as exactly, and in as many bytes, as windows centred inside.
#[test]
fn windows_centred_outside_the_clip_are_coded_as_well_as_others() {
    let coded = |width: f32, distance: f32| {
        let mut source = field(Shape { some_static: false, ..Shape::full(250) }, 23);
        let temporal = source.temporal.as_mut().unwrap();
        for i in 0..250 {
            source.opacities[i] = 0.5 + 0.002 * i as f32;
            let s = width * (1.0 + 0.002 * i as f32);
            temporal.s[i] = s;
            temporal.tau[i] = if i % 2 == 0 { -distance * s } else { 1.0 + distance * s };
        }
        let package = package(&source, None, &uniform(Coder::Rans, &source, 60.0, &[]));
        let clip = valid_clip(&package);
        let decoded = &clip.dynamic_field;
        let mut worst = Worst::default();
        for i in 0..decoded.len() {
            // The source row has the nearest colour.
            let distance = |row: &usize| {
                let (a, b) = (decoded.sh_of(i)[0], source.sh_of(*row)[0]);
                (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f32>()
            };
            let row = (0..250).min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap();
            worst.compare(decoded, i, &source, row);
        }
        (worst.opacity, package.len())
    };
    let (inside, bytes) = coded(0.2, -1.0);
    for (width, distance) in [(0.2, 1.0), (0.2, 2.0), (1.0, 2.0), (5.0, 2.0), (40.0, 1.5)] {
        let (outside, outside_bytes) = coded(width, distance);
        assert!(outside < inside, "{width} {distance}: {outside} for {inside}");
        assert!(outside_bytes < bytes + bytes / 50, "{width} {distance}: {outside_bytes} bytes for {bytes}");
    }
}

/// A package with every kind of chunk.
fn full_package(rows: usize) -> Vec<u8> {
    package(&field(Shape::full(rows), 1), Some(&static_field(8, 1, 2)), &options(Coder::Rans, &[rows / 2]))
}

#[test]
fn payloads_too_short_or_too_long_are_refused() {
    let parts = Parts::new(&full_package(60));
    let at = parts.find(1, 1);
    let payload = parts.sections[at].clone();
    for length in 0..payload.len() {
        let error = decode(&parts.with_payload(at, payload[..length].to_vec()), &Limits::default());
        let message = error.unwrap_err().to_string();
        assert!(message.contains("at byte "), "{message}");
        // After the head of a chunk, the bytes end where the payload does.
        if length >= HEAD_BYTES && message.contains("too short") {
            assert!(message.ends_with(&format!("at byte {}", parts.offset(at) + length)), "{message}");
        }
    }
    let mut long = payload.clone();
    long.extend([0; 3]);
    // Bypass bits come from the end, so that other bytes there change the numbers.
    assert!(decode(&parts.with_payload(at, long), &Limits::default()).is_err());
}

#[test]
fn numbers_out_of_range_before_the_symbols_are_refused() {
    let parts = Parts::new(&full_package(60));
    let at = parts.find(1, 1);
    // Step, footprint, origin, size of the cells; then bits of the grid.
    let expected = ["step", "footprint", "origin", "origin", "origin", "size"];
    for (i, name) in expected.into_iter().enumerate() {
        for bad in [f32::NAN, f32::INFINITY, -1.0] {
            if name == "origin" && bad == -1.0 {
                continue;
            }
            let mut payload = parts.sections[at].clone();
            payload[4 * i..4 * i + 4].copy_from_slice(&bad.to_le_bytes());
            let error = decode(&parts.with_payload(at, payload), &Limits::default()).unwrap_err();
            assert!(error.to_string().contains(&format!("bad {name}")), "{error}");
        }
    }
    let mut payload = parts.sections[at].clone();
    payload[24] = 17;
    let error = decode(&parts.with_payload(at, payload), &Limits::default()).unwrap_err();
    assert!(error.to_string().contains("bad bits of the grid: 17"), "{error}");
}

/// Random symbols for thousands of rows are refused in bounded time.
#[test]
fn random_symbols_are_refused() {
    let bytes = package(&field(Shape::full(4096), 1), None, &options(Coder::Rans, &[]));
    let parts = Parts::new(&bytes);
    let at = parts.find(1, 1);
    let mut rng = Rng(9);
    for fill in 0..40 {
        let length = rng.below(100_000);
        let mut payload = parts.sections[at][..HEAD_BYTES].to_vec();
        payload.extend((0..length).map(|_| if fill % 4 == 0 { 0 } else { rng.bits() as u8 }));
        assert!(decode(&parts.with_payload(at, payload), &Limits::default()).is_err());
    }
}

#[test]
fn attribute_sizes_add_up_to_the_chunks() {
    let source = field(Shape::full(6000), 1);
    let bytes = package(&source, Some(&static_field(50, 1, 2)), &options(Coder::Rans, &[1000]));
    let attributes = measure(&bytes, &Limits::default()).unwrap();
    assert_eq!(attributes.len(), 10, "{attributes:?}");
    let sections = contents(&bytes, &Limits::default()).unwrap().sections;
    let stored = sections.iter().map(|section| section.length as f64 - HEAD_BYTES as f64).sum::<f64>();
    let coded = attributes.iter().map(|attribute| attribute.coded).sum::<f64>();
    assert!((coded - stored).abs() < 0.001 * stored + 20.0 * sections.len() as f64, "{coded} of {stored}");
    // Uniform positions, 1000 and 5000 per layer: only their order can be saved.
    let position = attributes[0];
    let free = (5000.0 * (5000f64.log2() - 1.44) + 1000.0 * (1000f64.log2() - 1.44)) / 8.0;
    assert_eq!(position.attribute, "position");
    assert!((position.order_0 - position.coded) / free > 0.7, "{position:?}, {free}");
    let damaged = [&bytes[..bytes.len() - 1], &[bytes[bytes.len() - 1] ^ 1]].concat();
    assert_eq!(
        measure(&damaged, &Limits::default()).unwrap_err(),
        decode(&damaged, &Limits::default()).unwrap_err()
    );
}

/// Two kinds of Gaussians, mixed at random: neighbours say nothing of a Gaussian.
fn mixed(rows: usize) -> Field {
    let mut field = static_field(rows, 0, 11);
    let mut rng = Rng(11);
    for i in 0..rows {
        field.centers[i] = [i as f32, 0.0, 0.0];
        let sign = if rng.below(2) == 0 { 1.0 } else { -1.0 };
        field.sh[i] = [sign, 0.5 * sign, -sign];
        field.log_scales[i] = [-1.0 + sign, -1.5 + sign, -2.0 + 0.5 * sign];
    }
    field
}

#[test]
fn chunks_have_no_neighbours_where_these_mislead() {
    let misled = mixed(8_192);
    let bytes = package(&misled, None, &options(Coder::Rans, &[]));
    let head = contents(&bytes, &Limits::default()).unwrap();
    assert_eq!(head.sections.len(), 2);
    let flags: Vec<u8> = head.sections.iter().map(|section| bytes[section.offset + 25]).collect();
    assert_eq!(flags, [1, 1]);
    let clip = valid_clip(&bytes);
    let bright = |field: &Field| field.sh.iter().filter(|sh| sh[0] > 0.0 && sh[2] < 0.0).count();
    assert_eq!((clip.len(), bright(&clip.static_field)), (8_192, bright(&misled)));

    // Any other flag is refused.
    let mut parts = Parts::new(&bytes);
    parts.sections[0][25] = 2;
    let error = decode(&parts.join(), &Limits::default()).unwrap_err().to_string();
    assert!(error.contains("flags of a chunk: 2"), "{error}");

    // Where neighbours help, they remain.
    let mut smooth = mixed(3_000);
    for (i, (sh, scales)) in smooth.sh.iter_mut().zip(&mut smooth.log_scales).enumerate() {
        let wave = (i as f32 * 0.003).sin();
        (*sh, *scales) = ([wave; 3], [-1.0 + wave, -1.5 + wave, -2.0 + wave]);
    }
    let bytes = package(&smooth, None, &options(Coder::Rans, &[]));
    let head = contents(&bytes, &Limits::default()).unwrap();
    assert_eq!(bytes[head.sections[0].offset + 25], 0);
}
