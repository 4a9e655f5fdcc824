//! The coder `context`: what goes in comes back within the precision asked for, and no bytes break
//! it. That decoding gives bit for bit what the encoder reckoned with is asserted by the encoder
//! itself wherever debug assertions are on, as they are here.

mod common;

use codec::{
    Clip, Coder, EncodeOptions, Error, Field, Limits, Precision, Sensitivity, Source, contents, decode,
    encode, measure,
};
use common::{Parts, Rng, Shape, field, info, put_u32, static_field, u32_at};

fn options(psnr: f64, layers: &[usize]) -> EncodeOptions {
    let precision = Precision { psnr, ..Precision::default() };
    EncodeOptions { coder: Coder::Context, layers: layers.to_vec(), precision }
}

/// Options with which every number of a field of at most 255 rows comes back to within 1e-3.
fn fine(field: &Field, layers: &[usize]) -> EncodeOptions {
    let mut options = options(80.0, layers);
    options.precision.sensitivities = vec![Sensitivity { color: 1.0, geometry: 1.0 }; field.len()];
    options
}

fn package(field: &Field, plate: Option<&Field>, options: &EncodeOptions) -> Vec<u8> {
    encode(&Source { info: &info(), field, plate }, options).unwrap()
}

fn clip_of(bytes: &[u8]) -> Clip {
    let clip = decode(bytes, &Limits::default()).unwrap();
    for decoded in [&clip.static_field, &clip.dynamic_field].into_iter().chain(&clip.plate) {
        decoded.check().unwrap();
    }
    clip
}

fn clip(field: &Field, plate: Option<&Field>, options: &EncodeOptions) -> Clip {
    clip_of(&package(field, plate, options))
}

/// The row of the source, at most 255 long, that a finely coded row came from.
fn source_row(decoded: &Field, i: usize) -> usize {
    (decoded.opacities[i] * 255.0).round() as usize - 1
}

/// Covariance of a Gaussian of `field`.
fn covariance(field: &Field, i: usize) -> [[f64; 3]; 3] {
    let [w, x, y, z] = field.rotations[i].map(f64::from);
    let r = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ];
    let v = field.log_scales[i].map(|s| f64::from(s).exp().powi(2));
    std::array::from_fn(|a| std::array::from_fn(|b| (0..3).map(|k| r[a][k] * v[k] * r[b][k]).sum()))
}

/// Largest distances of decoded Gaussians to their sources at all times: of positions, colours,
/// opacities, and of covariances relative to the square of the largest scale.
#[derive(Debug, Default)]
struct Worst {
    position: f64,
    color: f64,
    opacity: f64,
    covariance: f64,
}

impl Worst {
    fn compare(&mut self, decoded: &Field, source: &Field) {
        for i in 0..decoded.len() {
            let row = source_row(decoded, i);
            for step in 0..=20 {
                let t = f64::from(step) / 20.0;
                let opacity = source.opacity_at(row, t);
                self.opacity = self.opacity.max((decoded.opacity_at(i, t) - opacity).abs());
                if opacity < 1.0 / 255.0 {
                    continue;
                }
                let (a, b) = (decoded.position_at(i, t), source.position_at(row, t));
                let distance = (0..3).map(|k| (a[k] - b[k]).abs()).fold(0.0, f64::max);
                self.position = self.position.max(distance);
                // Axes may be renamed, so what turns is compared by the covariance it gives.
                let turned = |field: &Field, i: usize| {
                    let q = field.rotation_at(i, t).map(|x| x as f32);
                    let one = field.select(&[i]);
                    covariance(&Field { rotations: vec![q], ..one }, 0)
                };
                let (a, b) = (turned(decoded, i), turned(source, row));
                let scale = source.log_scales[row].iter().map(|s| f64::from(*s).exp()).fold(0.0, f64::max);
                for (a, b) in a.as_flattened().iter().zip(b.as_flattened()) {
                    self.covariance = self.covariance.max((a - b).abs() / (scale * scale));
                }
            }
            for (a, b) in decoded.sh_of(i).as_flattened().iter().zip(source.sh_of(row).as_flattened()) {
                self.color = self.color.max(f64::from((a - b).abs()));
            }
        }
    }

    #[track_caller]
    fn check(&self, bound: f64) {
        assert!(self.position <= 0.5 * bound, "{self:?}");
        assert!(self.color <= bound, "{self:?}");
        assert!(self.opacity <= bound, "{self:?}");
        assert!(self.covariance <= 2.0 * bound, "{self:?}");
    }
}

#[test]
fn every_combination_of_columns_round_trips() {
    for sh_degree in 0..=3 {
        for motion_order in 0..=3 {
            for (rotation_rates, some_still) in [(false, false), (false, true), (true, false), (true, true)] {
                let shape = Shape { rows: 250, sh_degree, motion_order, rotation_rates, some_still };
                let source = field(shape, 1);
                let clip = clip(&source, None, &fine(&source, &[]));
                assert_eq!(clip.len(), 250, "{shape:?}");
                assert_eq!(clip.static_field.len(), if some_still { 62 } else { 0 }, "{shape:?}");
                assert_eq!(clip.sh_degree(), sh_degree, "{shape:?}");
                assert_eq!(clip.dynamic_field.motion_order(), motion_order, "{shape:?}");
                let temporal = clip.dynamic_field.temporal.as_ref().unwrap();
                assert_eq!(temporal.rotation_rates.is_some(), rotation_rates, "{shape:?}");
                let mut worst = Worst::default();
                worst.compare(&clip.static_field, &source);
                worst.compare(&clip.dynamic_field, &source);
                worst.check(1e-3);
                let rows = |field: &Field| (0..field.len()).map(|i| source_row(field, i)).collect::<Vec<_>>();
                let mut rows = [rows(&clip.static_field), rows(&clip.dynamic_field)].concat();
                rows.sort_unstable();
                assert!(rows.into_iter().eq(0..250), "{shape:?}: every row once");
            }
        }
    }
}

/// Four bits more for every number must take away nearly all of the error.
#[test]
fn errors_shrink_with_the_precision() {
    let source = field(Shape::full(250), 3);
    let worst = |psnr| {
        let mut options = fine(&source, &[]);
        options.precision.psnr = psnr;
        let clip = clip(&source, None, &options);
        let mut worst = Worst::default();
        worst.compare(&clip.static_field, &source);
        worst.compare(&clip.dynamic_field, &source);
        worst
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
    let mut options = options(90.0, &[]);
    options.precision.sensitivities = (0..250).map(sensitivities).collect();
    options.precision.footprint = Some(1e-3);
    let clip = clip(&source, None, &options);
    let mut error = [0.0f32; 2];
    for i in 0..250 {
        // The nearest centre tells the row.
        let distance = |row: &usize| {
            let (a, b) = (clip.static_field.centers[i], source.centers[*row]);
            (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f32>()
        };
        let row = (0..250).min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap();
        let off = (0..3).map(|k| (clip.static_field.sh[i][k] - source.sh[row][k]).abs()).fold(0.0, f32::max);
        error[usize::from(row >= 125)] += off;
    }
    assert!(error[1] > 20.0 * error[0], "{error:?}");
}

#[test]
fn footprints_bound_the_detail() {
    let source = static_field(2000, 0, 5);
    let bytes = |footprint| {
        let mut options = options(50.7, &[]);
        options.precision.footprint = Some(footprint);
        package(&source, None, &options).len()
    };
    assert!(bytes(0.1) < bytes(0.01) && bytes(0.01) < bytes(0.001));
}

#[test]
fn precision_must_fit_the_field() {
    let source = static_field(3, 0, 6);
    let refused = |precision: Precision| {
        let options = EncodeOptions { coder: Coder::Context, precision, ..EncodeOptions::default() };
        encode(&Source { info: &info(), field: &source, plate: None }, &options).unwrap_err().to_string()
    };
    let with = |count: usize, color: f32| Precision {
        sensitivities: vec![Sensitivity { color, geometry: 1.0 }; count],
        ..Precision::default()
    };
    assert_eq!(refused(with(2, 1.0)), "the precision cannot be used: 2 sensitivities for 3 Gaussians");
    assert_eq!(refused(with(3, 0.0)), "the precision cannot be used: 0 is not a positive number");
    assert!(refused(with(3, f32::NAN)).contains("NaN is not"));
    assert!(refused(Precision { footprint: Some(-1.0), ..with(3, 1.0) }).contains("-1 is not"));
    assert!(refused(Precision { psnr: f64::NAN, ..with(3, 1.0) }).contains("PSNR is NaN"));
}

#[test]
fn layers_hold_the_most_important_rows_first() {
    let source = field(Shape::full(200), 5);
    let clip = clip(&source, None, &fine(&source, &[10, 60, 100]));
    assert_eq!(clip.layers.len(), 4);
    let mut start = codec::LayerEnd::default();
    for (end, last_row) in clip.layers.iter().zip([10, 60, 100, 200]) {
        let rows = (start.static_count..end.static_count).map(|i| source_row(&clip.static_field, i));
        let mut rows: Vec<_> = rows
            .chain((start.dynamic_count..end.dynamic_count).map(|i| source_row(&clip.dynamic_field, i)))
            .collect();
        rows.sort_unstable();
        assert!(rows.into_iter().eq(start.total()..last_row));
        start = *end;
    }
}

#[test]
fn the_time_index_finds_what_is_alive() {
    let source = field(Shape { some_still: false, ..Shape::full(9000) }, 7);
    let clip = clip(&source, None, &options(50.7, &[5000]));
    let mut candidates = 0;
    for step in 0..=40 {
        let t = f64::from(step) / 40.0;
        let ranges: Vec<_> = clip.time_index.candidates(t, 2).collect();
        candidates += ranges.iter().map(|range| range.len()).sum::<usize>();
        for row in 0..clip.dynamic_field.len() {
            let alive = clip.dynamic_field.opacity_at(row, t) >= 1.0 / 255.0;
            assert!(!alive || ranges.iter().any(|range| range.contains(&row)), "row {row} at {t}");
        }
    }
    assert!(candidates < 41 * 9000 * 9 / 10, "{candidates} candidates");
}

#[test]
fn a_plate_comes_back() {
    let source = field(Shape::full(50), 3);
    for sh_degree in 0..=3 {
        let plate = static_field(250, sh_degree, 4);
        let with_plate = clip(&source, Some(&plate), &options(150.0, &[10]));
        let mut worst = Worst::default();
        worst.compare(with_plate.plate.as_ref().unwrap(), &plate);
        // Detail below the footprint is not kept.
        worst.check(0.05);
        let without = clip(&source, None, &options(150.0, &[10]));
        assert_eq!(Clip { plate: None, ..with_plate }, without, "a plate changes nothing else");
    }
    assert_eq!(clip(&source, Some(&Field::default()), &options(50.7, &[])).plate, None);
}

#[test]
fn fields_at_the_edge_of_sense_come_back_valid() {
    let still = Shape { rows: 1, sh_degree: 0, motion_order: 0, rotation_rates: false, some_still: false };
    let mut point = field(Shape { motion_order: 0, ..Shape::full(255) }, 11);
    point.centers.fill([1.5, -2.25, 1e-3]);
    point.log_scales.fill([-3.0; 3]);
    let mut dead = field(Shape { some_still: false, ..Shape::full(100) }, 12);
    dead.opacities.fill(0.0);
    let mut flash = field(Shape::full(300), 13);
    flash.temporal.as_mut().unwrap().tau.fill(0.25);
    flash.temporal.as_mut().unwrap().s.fill(1e-7);
    let mut flat = static_field(5000, 2, 14);
    flat.centers.iter_mut().for_each(|c| c[2] = 7.0);
    flat.rotations.fill([1.0, 0.0, 0.0, 0.0]);
    for source in [field(Shape::full(1), 1), field(still, 2), static_field(1, 3, 3), point, dead, flash, flat]
    {
        for psnr in [0.0, 50.7, 160.0] {
            let clip = clip(&source, None, &options(psnr, &[]));
            assert_eq!(clip.len(), source.len());
        }
    }
}

/// An infinite window has no centre to keep: what moves and turns about it must go on as before.
#[test]
fn what_turns_about_a_far_centre_keeps_turning() {
    let mut source = field(Shape { some_still: false, ..Shape::full(250) }, 21);
    let temporal = source.temporal.as_mut().unwrap();
    for i in 0..250 {
        temporal.tau[i] = -0.4 + 0.007 * i as f32;
        temporal.s[i] = if i % 2 == 0 { f32::INFINITY } else { 5.0 };
    }
    let clip = clip(&source, None, &fine(&source, &[]));
    let mut worst = Worst::default();
    worst.compare(&clip.dynamic_field, &source);
    worst.check(1e-3);
}

#[test]
fn gaussians_that_are_never_alive_stay_so() {
    let mut source = field(Shape { some_still: false, ..Shape::full(100) }, 12);
    let temporal = source.temporal.as_mut().unwrap();
    for i in 0..50 {
        temporal.tau[i] = if i % 2 == 0 { -3.0 } else { 60_000.0 };
        temporal.s[i] = 0.1;
    }
    source.opacities[60] = 0.0;
    source.opacities[61] = 0.0038;
    let clip = clip(&source, None, &options(50.7, &[]));
    let dead = (0..100).filter(|&i| clip.dynamic_field.alive_interval(i).is_none()).count();
    assert!(dead >= 52, "{dead}");
}

#[test]
fn extreme_numbers_stay_finite() {
    let mut source = field(Shape::full(40), 13);
    let temporal = source.temporal.as_mut().unwrap();
    source.centers[0] = [1e9, -1e9, 1e9];
    source.log_scales[1] = [-1e9, 1e9, 0.0];
    source.sh[2] = [1e9; 3];
    source.sh[40] = [-1e9; 3];
    temporal.motion[3] = [1e9; 3];
    temporal.tau[4] = 1e9;
    temporal.tau[5] = -1e9;
    temporal.s[6] = f32::MAX;
    temporal.s[7] = f32::MIN_POSITIVE;
    temporal.rotation_rates.as_mut().unwrap()[8] = [1e9; 4];
    for psnr in [0.0, 50.7, 160.0] {
        clip(&source, None, &options(psnr, &[]));
    }
}

#[test]
fn same_field_same_bytes() {
    let source = field(Shape::full(5000), 15);
    let plate = static_field(300, 2, 16);
    let options = options(50.7, &[1000]);
    assert_eq!(package(&source, Some(&plate), &options), package(&source.clone(), Some(&plate), &options));
}

/// A package with every kind of chunk.
fn full_package(rows: usize) -> Vec<u8> {
    package(&field(Shape::full(rows), 1), Some(&static_field(8, 1, 2)), &options(50.7, &[rows / 2]))
}

#[test]
fn the_head_names_the_coder_and_no_time_index() {
    let contents = contents(&full_package(40), &Limits::default()).unwrap();
    assert_eq!(contents.coder.name(), "context");
    assert!(contents.sections.iter().all(|s| s.kind == codec::SectionKind::Gaussians));
    assert!(contents.sections.iter().all(|s| s.raw_length == s.length));
}

#[test]
fn every_prefix_fails_or_plays_its_complete_layers() {
    let bytes = full_package(40);
    let whole = clip_of(&bytes);
    let head = contents(&bytes, &Limits::default()).unwrap();
    let first_layer = head.sections.iter().rfind(|s| s.layer == 0).unwrap().end();
    for length in 0..bytes.len() {
        let result = decode(&bytes[..length], &Limits::default());
        if length < first_layer {
            assert!(result.unwrap_err().to_string().contains("at byte "));
            continue;
        }
        let clip = result.unwrap();
        assert_eq!((clip.layers.len(), clip.layers_announced), (1, 2));
        let rows: Vec<usize> = (0..clip.layers[0].dynamic_count).collect();
        assert_eq!(clip.dynamic_field, whole.dynamic_field.select(&rows));
        let rows: Vec<usize> = (0..clip.layers[0].static_count).collect();
        assert_eq!(clip.static_field, whole.static_field.select(&rows));
    }
}

#[test]
fn a_flip_of_any_byte_is_noticed() {
    let bytes = full_package(20);
    for at in 0..bytes.len() {
        for mask in [0x01, 0x80, 0xff] {
            let mut flipped = bytes.clone();
            flipped[at] ^= mask;
            assert!(decode(&flipped, &Limits::default()).is_err(), "byte {at} ^ {mask:02x} went unnoticed");
        }
    }
}

/// Replaces a payload and makes everything around it true again.
fn with_payload(parts: &Parts, section: usize, payload: Vec<u8>) -> Vec<u8> {
    let mut parts = parts.clone();
    put_u32(&mut parts.table[section], 16, payload.len());
    parts.sections[section] = payload;
    parts.join()
}

#[test]
fn payloads_too_short_or_too_long_are_refused() {
    let parts = Parts::of(&full_package(60));
    let at = parts.find(1, 1);
    let payload = parts.sections[at].clone();
    for length in 0..payload.len() {
        let error = decode(&with_payload(&parts, at, payload[..length].to_vec()), &Limits::default());
        let message = error.unwrap_err().to_string();
        assert!(message.contains("at byte "), "{message}");
    }
    let mut long = payload.clone();
    long.extend([0; 3]);
    let error = decode(&with_payload(&parts, at, long), &Limits::default()).unwrap_err().to_string();
    assert!(error.contains("3 extra bytes after chunk of Gaussians"), "{error}");
}

#[test]
fn numbers_out_of_range_before_the_symbols_are_refused() {
    let parts = Parts::of(&full_package(60));
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
            let error = decode(&with_payload(&parts, at, payload), &Limits::default()).unwrap_err();
            assert!(error.to_string().contains(&format!("bad {name}")), "{error}");
        }
    }
    let mut payload = parts.sections[at].clone();
    payload[24] = 17;
    let error = decode(&with_payload(&parts, at, payload), &Limits::default()).unwrap_err();
    assert!(error.to_string().contains("bad bits of the grid: 17"), "{error}");
}

/// Changes that pass every checksum reach the coder. What still decodes must be a valid clip.
#[test]
fn mutations_with_true_checksums_never_break_the_decoder() {
    let parts = Parts::of(&full_package(120));
    let mut rng = Rng(7);
    let (mut accepted, mut refused) = (0, 0);
    for _ in 0..20_000 {
        let section = rng.below(parts.table.len());
        let mut payload = parts.sections[section].clone();
        for _ in 0..1 + rng.below(3) {
            // Half of the time in the head of the chunk.
            let reach = if rng.below(2) == 0 { 25 } else { payload.len() };
            let at = rng.below(reach);
            payload[at] = match rng.below(3) {
                0 => rng.bits() as u8,
                1 => payload[at] ^ 1 << rng.below(8),
                _ => [0, 0xff, 0x7f, 0x80][rng.below(4)],
            };
        }
        match decode(&with_payload(&parts, section, payload), &Limits::default()) {
            Err(error) => {
                assert!(error.to_string().contains("at byte "), "{error}");
                refused += 1;
            }
            Ok(clip) => {
                accepted += 1;
                for field in [&clip.static_field, &clip.dynamic_field].into_iter().chain(&clip.plate) {
                    field.check().unwrap();
                }
            }
        }
    }
    assert!(accepted > 50 && refused > 500, "{accepted} accepted, {refused} refused");
}

/// Random symbols for thousands of rows: whatever they mean, they end in an error or a valid
/// clip, in bounded time.
#[test]
fn random_symbols_end() {
    let bytes = package(&field(Shape::full(4096), 1), None, &options(50.7, &[]));
    let parts = Parts::of(&bytes);
    let at = parts.find(1, 1);
    let mut rng = Rng(9);
    for fill in 0..40 {
        let length = rng.below(100_000);
        let mut payload = parts.sections[at][..25].to_vec();
        payload.extend((0..length).map(|_| if fill % 4 == 0 { 0 } else { rng.bits() as u8 }));
        assert!(decode(&with_payload(&parts, at, payload), &Limits::default()).is_err());
    }
}

#[test]
fn limits_hold() {
    let bytes = full_package(40);
    let limits = Limits { max_gaussians: 47, ..Limits::default() };
    assert!(matches!(decode(&bytes, &limits), Err(Error::Limits { quantity: "Gaussians", .. })));
    assert!(decode(&bytes, &Limits { max_gaussians: 48, ..limits }).is_ok());
    let error = decode(&bytes, &Limits { max_bytes: 1 << 20, ..Limits::default() }).unwrap_err();
    assert!(matches!(error, Error::Limits { quantity: "bytes of memory", .. }), "{error}");
    // Counts that ask for everything, in a small file.
    let mut parts = Parts::of(&bytes);
    let rows = u32_at(&parts.head, 76);
    put_u32(&mut parts.head, 76, rows + 4_000_000);
    assert!(decode(&parts.join(), &Limits::default()).is_err());
}

#[test]
fn what_attributes_take_is_the_size_of_the_chunks() {
    let source = field(Shape::full(6000), 1);
    let bytes = package(&source, Some(&static_field(50, 1, 2)), &options(50.7, &[1000]));
    let attributes = measure(&bytes, &Limits::default()).unwrap();
    assert_eq!(attributes.len(), 10, "{attributes:?}");
    let sections = contents(&bytes, &Limits::default()).unwrap().sections;
    // 25 bytes before the symbols.
    let stored = sections.iter().map(|section| section.length as f64 - 25.0).sum::<f64>();
    let coded = attributes.iter().map(|attribute| attribute.coded).sum::<f64>();
    assert!((coded - stored).abs() < 0.001 * stored + 4.0 * sections.len() as f64, "{coded} of {stored}");
    // Uniform numbers, 1000 or 5000 to a layer, in cubes 6 wide: nothing to gain but the order.
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
