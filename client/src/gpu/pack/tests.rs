//! Error bounds of every packed quantity: the unpacking here is the WGSL's.

use codec::{Temporal, sh_coefficients};

use super::moment::{INSTANTS, Z_STEPS};
use super::*;

/// Uniform numbers in [0, 1), the same on every run.
struct Random(u64);

impl Random {
    fn unit(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 40) as f32 / (1u64 << 24) as f32
    }

    fn between(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.unit()
    }
}

fn field(rows: usize, sh_degree: u8, motion: Option<Motion>) -> Field {
    let mut random = Random(7);
    let mut field = Field { sh_degree, ..Field::default() };
    let mut temporal = Temporal { motion_order: motion.map_or(0, |m| m.order), ..Temporal::default() };
    let mut rates = Vec::new();
    for _ in 0..rows {
        let mut vector = |limit: f32| [0; 3].map(|_| random.between(-limit, limit));
        field.centers.push(vector(50.0));
        field.log_scales.push(vector(6.0).map(|x| x - 4.0));
        field.sh.extend((0..sh_coefficients(sh_degree)).map(|k| vector(if k == 0 { 1.7 } else { 0.4 })));
        temporal.motion.extend((0..temporal.motion_order).map(|k| vector([0.5, 30.0, 4e6][usize::from(k)])));
        let q = [0; 4].map(|_| random.between(-1.0, 1.0));
        let norm = q.iter().map(|x| x * x).sum::<f32>().sqrt();
        field.rotations.push(q.map(|x| x / norm));
        field.opacities.push(random.unit());
        temporal.tau.push(random.between(-0.2, 1.2));
        temporal.s.push(random.between(0.005, 2.0));
        rates.push([0; 4].map(|_| random.between(-20.0, 20.0)));
    }
    temporal.rotation_rates = motion.filter(|m| m.rotates).map(|_| rates);
    field.temporal = motion.map(|_| temporal);
    field.check().expect("a valid field");
    field
}

fn signed(word: u32, shift: u32, bits: u32) -> f32 {
    ((word << (32 - shift - bits)) as i32 >> (32 - bits)) as f32
}

fn half(word: u32, upper: bool) -> f32 {
    f16::from_bits((word >> if upper { 16 } else { 0 }) as u16).to_f32()
}

fn unpack_rotation(g: &Gaussian) -> [f32; 4] {
    let small = [
        signed(g.rotation, 0, 15) / 16383.0,
        signed(g.rotation, 15, 15) / 16383.0,
        signed(g.rotation_scale, 0, 16) / 32767.0,
    ]
    .map(|x| x * std::f32::consts::FRAC_1_SQRT_2);
    let mut q = small.to_vec();
    let large = (1.0 - small.iter().map(|x| x * x).sum::<f32>()).max(0.0).sqrt();
    q.insert((g.rotation >> 30) as usize, large);
    q.try_into().expect("four components")
}

#[test]
fn static_attributes() {
    let field = field(2000, 0, None);
    let packed = pack(&field, &Field::default(), DVec3::ZERO);
    assert_eq!(packed.format.features, Features::default());
    assert_eq!((packed.motion.len(), packed.sh.len()), (0, 0), "nothing for what is not there");
    for (row, g) in packed.gaussians.iter().enumerate() {
        assert_eq!(g.center.map(f32::from_bits), field.centers[row], "centres are exact");

        let (q, exact) = (unpack_rotation(g), field.rotations[row]);
        let cosine: f32 = q.iter().zip(exact).map(|(a, b)| a * b).sum();
        let sign = cosine.signum();
        let angle = q.iter().zip(exact).map(|(a, b)| (sign * a - b).powi(2)).sum::<f32>().sqrt() * 2.0;
        assert!(angle < 1.5e-4, "row {row}: turned by {angle} rad");

        let steps = [g.rotation_scale >> 16, g.scales & 0xffff, g.scales >> 16];
        for (axis, step) in steps.into_iter().enumerate() {
            let log = LOG_SCALE_STEP * step as f32 - LOG_SCALE_MAX;
            let error = (log - field.log_scales[row][axis]).abs();
            assert!(error < 3.1e-4, "row {row}: scale off by {error}");
        }

        let opacity = (g.opacity_red & 0xffff) as f32 / 65535.0;
        assert!((opacity - field.opacities[row]).abs() < 0.6 / 65535.0);

        let color = [half(g.opacity_red, true), half(g.green_blue, false), half(g.green_blue, true)];
        for (channel, c) in color.into_iter().enumerate() {
            let exact = 0.5 + 0.2820948 * field.sh[row][channel];
            assert!((c - exact).abs() < 0.07 / 255.0, "row {row}: colour {c} for {exact}");
        }
    }
}

/// A record at an instant.
struct Evaluated {
    /// From the origin of the clip.
    position: DVec3,
    /// Part of the peak opacity.
    window: f64,
    rotation: [f64; 4],
    /// Time from the instant of the record, in widths of its window or in clips.
    u: f64,
}

/// Records and their format.
struct Records {
    packed: Packed,
    format: RecordFormat,
}

impl std::ops::Deref for Records {
    type Target = Packed;

    fn deref(&self) -> &Packed {
        &self.packed
    }
}

/// The box around all centres of both fields while they are alive.
fn bounds(fields: [&Field; 2]) -> [[f32; 3]; 2] {
    let boxes = fields.into_iter().filter(|field| !field.is_empty()).map(Field::bounds);
    boxes
        .reduce(|[a, b], [c, d]| {
            [0, 1].map(|end| {
                [0, 1, 2].map(|axis| match end {
                    0 => a[axis].min(c[axis]),
                    _ => b[axis].max(d[axis]),
                })
            })
        })
        .unwrap_or_default()
}

/// Both fields as one layer.
fn run<'a>(static_field: &'a Field, dynamic_field: &'a Field) -> LayerRun<'a> {
    let count = LayerEnd { static_count: static_field.len(), dynamic_count: dynamic_field.len() };
    LayerRun {
        fields: [static_field, dynamic_field],
        rows: [0..count.static_count, 0..count.dynamic_count],
        before: LayerEnd::default(),
        ends: vec![count],
        time_index: codec::TimeIndex::default(),
    }
}

/// Packs both fields for a clip of their own.
fn pack(static_field: &Field, dynamic_field: &Field, origin: DVec3) -> Records {
    let run = run(static_field, dynamic_field);
    let motion_units = motion_units(bounds(run.fields));
    let format = RecordFormat { features: features(run.fields, run.count()), origin, motion_units };
    Records { packed: super::pack(&run, &format), format }
}

/// Layers that arrive later have the records that they have in the whole clip.
#[test]
fn further_layers_are_packed_as_with_those_before() {
    let static_field = field(30, 1, None);
    let dynamic_field = field(40, 2, Some(Motion { order: 3, rotates: true }));
    let whole = pack(&static_field, &dynamic_field, DVec3::ONE);
    let of_rows = |rows: [std::ops::Range<usize>; 2]| {
        let before = LayerEnd { static_count: rows[0].start, dynamic_count: rows[1].start };
        super::pack(&LayerRun { rows, before, ..run(&static_field, &dynamic_field) }, &whole.format)
    };
    let parts = [of_rows([0..10, 0..25]), of_rows([10..10, 25..31]), of_rows([10..30, 31..40])];
    let (mut gaussians, mut motion, mut sh) =
        ([Vec::new(), Vec::new()], Vec::new(), [Vec::new(), Vec::new()]);
    for packed in &parts {
        let words = packed.static_count * sh_words(2);
        gaussians[0].extend_from_slice(&packed.gaussians[..packed.static_count]);
        gaussians[1].extend_from_slice(&packed.gaussians[packed.static_count..]);
        sh[0].extend_from_slice(&packed.sh[..words]);
        sh[1].extend_from_slice(&packed.sh[words..]);
        motion.extend_from_slice(&packed.motion);
    }
    assert_eq!(
        (gaussians.concat(), motion, sh.concat()),
        (whole.packed.gaussians, whole.packed.motion, whole.packed.sh)
    );
    assert_eq!(parts.map(|packed| packed.before.total()), [0, 35, 41]);
}

/// Gaussians that cross the bounds in a fraction of their windows have their motion in range, and others lose nothing.
/// The unit of length does not matter.
#[test]
fn motion_across_the_bounds_is_in_range() {
    for scale in [1e-6, 1.0, 1e3] {
        let units = motion_units([[-scale, 0.0, 0.0], [scale, 0.5 * scale, 0.1 * scale]]);
        let extent = 2.0 * scale;
        for (power, unit) in (1..).zip(units) {
            // Chebyshev's polynomials have the largest coefficients, at most twice the length over h^power.
            let largest = 2.0 * extent / CROSSING_WIDTHS.powi(power);
            assert!(largest / unit <= f16::MAX.to_f32(), "{largest} in {unit}");
            assert!(unit * 2f32.powi(-25) <= 2f32.powi(3 * power - 38) * extent, "{unit} at {scale}");
        }
    }
    assert_eq!(motion_units([[1.0; 3]; 2]), [1.0; 3], "nothing moves");
    let endless = motion_units([[f32::NEG_INFINITY; 3], [f32::INFINITY; 3]]);
    assert_eq!(endless, [512.0; 3]);
}

/// Moving row `row` at clip time `t`: what evaluate.wgsl computes, in f64.
fn evaluate(packed: &Records, row: usize, t: f64) -> Evaluated {
    let features = packed.format.features.motion.expect("it moves");
    let words = &packed.motion[row * features.words()..][..features.words()];
    let half_at = |k: usize| f64::from(half(words[1 + k / 2], k % 2 == 1));
    let d = t - f64::from(words[0] & 0xffff) / INSTANTS;
    let widths = half_at(0) * f64::from(shaders::WIDTH_UNIT);
    let z = f64::from((words[0] >> 16) as u16 as i16) / Z_STEPS + d * widths;
    let u = d * widths.max(1.0);

    let g = &packed.gaussians[row + packed.static_count];
    let mut position = DVec3::from_array(g.center.map(|bits| f64::from(f32::from_bits(bits))));
    for power in 0..usize::from(features.order) {
        let w = DVec3::from_array([0, 1, 2].map(|axis| half_at(1 + 3 * power + axis)));
        position += w * f64::from(packed.format.motion_units[power]) * u.powi(power as i32 + 1);
    }
    let mut rotation = unpack_rotation(g).map(f64::from);
    if features.rotates {
        let first = 1 + 3 * usize::from(features.order);
        rotation = std::array::from_fn(|k| rotation[k] + half_at(first + k) * f64::from(RATE_UNIT) * u);
    }
    Evaluated { position, window: (-0.5 * z * z).exp(), rotation, u }
}

/// Instants over the part of the clip in which a row is alive, both ends among them.
fn instants_alive(field: &Field, row: usize) -> impl Iterator<Item = f64> + use<> {
    let alive = field.alive_interval(row);
    alive
        .into_iter()
        .flat_map(|(start, end)| (0..=10).map(move |i| start + f64::from(i) * 0.1 * (end - start)))
}

/// The rounding of an f16.
const H: f64 = 1.0 / 2048.0;

/// The bounds that [`moment`] derives.
#[test]
fn records_are_off_by_no_more_than_their_rounding_at_any_instant() {
    let motion = Motion { order: 3, rotates: true };
    let field = field(2000, 0, Some(motion));
    let origin = DVec3::new(10.0, -20.0, 0.5);
    let packed = pack(&Field::default(), &field, origin);
    assert_eq!(packed.format.features.motion, Some(motion));
    let temporal = field.temporal.as_ref().expect("temporal columns");
    let mut compared = 0;
    for row in 0..field.len() {
        let moment = Moment::new(&field, temporal, row);
        let z0 = f64::from(moment.z) / Z_STEPS;
        for t in instants_alive(&field, row) {
            compared += 1;
            let found = evaluate(&packed, row, t);
            assert!(found.u.abs() < 3.4, "row {row} at {t}: {} widths", found.u);

            let off = (found.position - (DVec3::from_array(field.position_at(row, t)) - origin)).abs();
            for axis in 0..3 {
                // The centre and the coefficients are numbers in f32 before anything else.
                let mut bound = 2f64.powi(-24) * (moment.position[axis] - origin[axis]).abs();
                for (power, w) in (1..).zip(moment.motion) {
                    let least = f64::from(packed.format.motion_units[power as usize - 1]) * 2f64.powi(-25);
                    bound += (1.001 * H * f64::from(w[axis]).abs()).max(least) * found.u.abs().powi(power);
                }
                assert!(off[axis] <= bound + 1e-9, "row {row} at {t}: {} beyond {bound}", off[axis]);
            }

            let exact = field.opacity_at(row, t) / f64::from(field.opacities[row]);
            let bound = H * (1.35 + 0.61 * z0.abs());
            assert!((found.window - exact).abs() <= bound, "row {row} at {t}: {} for {exact}", found.window);

            let exact = field.rotation_at(row, t);
            let norm = moment::length(found.rotation);
            let sign = found.rotation.iter().zip(exact).map(|(a, b)| a * b).sum::<f64>().signum();
            let apart: [f64; 4] = std::array::from_fn(|k| sign * found.rotation[k] / norm - exact[k]);
            let turned = moment::length(moment.rates.map(f64::from)) * found.u.abs();
            let bound = (0.75e-4 + 1.001 * H * turned + 2f64.powi(-20) * found.u.abs()) / norm;
            assert!(moment::length(apart) <= bound, "row {row} at {t}: {apart:?} beyond {bound}");
        }
    }
    assert!(compared > 15_000, "{compared} instants");
}

#[test]
fn windows_from_a_millionth_to_a_million_of_the_clip() {
    for exponent in -12..=12 {
        let s = 10f32.powf(0.5 * exponent as f32);
        for tau in [0.0, 0.5, 0.777, 1.0, 1.0 + 2.0 * s, -3.0 * s] {
            let mut field = field(1, 0, Some(Motion { order: 3, rotates: false }));
            field.opacities[0] = 1.0;
            let temporal = field.temporal.as_mut().expect("temporal columns");
            (temporal.tau[0], temporal.s[0]) = (tau, s);
            // Half a unit of each power within one width of any instant.
            let v = |power: i32| [0.5 * s.powi(-power); 3];
            temporal.motion = vec![v(1), v(2), v(3)];
            let origin = DVec3::from_array(field.position_at(0, tau.clamp(0.0, 1.0).into()));
            let packed = pack(&Field::default(), &field, origin);
            let moment = Moment::new(&field, field.temporal.as_ref().expect("temporal columns"), 0);
            for t in instants_alive(&field, 0) {
                let found = evaluate(&packed, 0, t);
                let exact = field.opacity_at(0, t);
                let off = (found.window - exact).abs();
                assert!(off < 1.5 / 255.0, "s {s}, tau {tau}, t {t}: {} for {exact}", found.window);
                let off = found.position - (DVec3::from_array(field.position_at(0, t)) - origin);
                let way: f64 = (1..)
                    .zip(&moment.motion)
                    .map(|(power, w)| f64::from(w[0]).abs() * found.u.abs().powi(power))
                    .sum();
                let center = (DVec3::from_array(moment.position) - origin).length();
                let bound = 3f64.sqrt() * 1.01 * H * way + 2f64.powi(-24) * center + 1e-9;
                assert!(off.length() <= bound, "s {s}, tau {tau}, t {t}: off by {off}, beyond {bound}");
                // Windows narrower than the steps of the instant have their record beside them.
                assert!(found.u.abs() < if s < 1e-5 { 20.0 } else { 5.0 }, "{} widths", found.u);
            }
        }
    }
}

#[test]
fn what_flies_off_costs_the_others_nothing() {
    let mut field = field(2, 0, Some(Motion { order: 1, rotates: false }));
    let temporal = field.temporal.as_mut().expect("temporal columns");
    (temporal.tau, temporal.s) = (vec![0.5; 2], vec![1.0; 2]);
    temporal.motion = vec![[1e30, -1e30, 1e9], [0.1, -0.07, 0.05]];
    let packed = pack(&Field::default(), &field, DVec3::ZERO);
    for t in [0.0, 0.3, 1.0] {
        let off = evaluate(&packed, 1, t).position - DVec3::from_array(field.position_at(1, t));
        assert!(off.length() < 1e-4, "{off}");
        assert!(evaluate(&packed, 0, t).position.is_finite());
    }
}

#[test]
fn far_from_the_origin_nothing_is_lost() {
    let mut near = field(500, 0, Some(Motion { order: 2, rotates: false }));
    // What f32 holds at both places.
    near.centers.iter_mut().flatten().for_each(|x| *x = (*x * 8.0).round() / 8.0);
    let mut far = near.clone();
    far.centers.iter_mut().for_each(|center| center[0] += 1e6);
    far.centers[7] = [-3e30; 3];
    let origin = origin(&Field::default(), &far);
    assert!((origin - DVec3::X * 1e6).length() < 1e6, "a stray does not move it: {origin}");
    let packed = pack(&Field::default(), &far, origin);
    let temporal = far.temporal.as_ref().expect("temporal columns");
    for row in (0..500).filter(|&row| row != 7 && far.alive_interval(row).is_some()) {
        let exact = DVec3::from_array(Moment::new(&far, temporal, row).position) - origin;
        let stored = packed.gaussians[row].center.map(|bits| f64::from(f32::from_bits(bits)));
        let off = DVec3::from_array(stored) - exact;
        assert!(off.length() <= 1e-7 * exact.length(), "row {row}: off by {off}");
    }
}

#[test]
fn quaternions_of_any_length_and_none() {
    let mut field = field(4, 0, None);
    field.rotations =
        vec![[0.6, 0.0, 0.8, 0.0], [3.0, 0.0, 4.0, 0.0], [0.0; 4], [f32::NAN, 0.0, f32::INFINITY, 1.0]];
    let packed = pack(&field, &Field::default(), DVec3::ZERO);
    let words = |row: usize| (packed.gaussians[row].rotation, packed.gaussians[row].rotation_scale & 0xffff);
    assert_eq!(words(0), words(1));
    for row in [2, 3] {
        assert_eq!(unpack_rotation(&packed.gaussians[row]), [1.0, 0.0, 0.0, 0.0]);
    }
}

#[test]
fn what_is_never_alive_is_not_drawn() {
    let mut field = field(1, 0, Some(Motion { order: 1, rotates: false }));
    let temporal = field.temporal.as_mut().expect("temporal columns");
    (temporal.tau[0], temporal.s[0]) = (1e20, 0.1);
    let packed = pack(&Field::default(), &field, DVec3::ZERO);
    assert!([0.0, 0.5, 1.0].iter().all(|&t| evaluate(&packed, 0, t).window < 1e-100));
}

#[test]
fn spherical_harmonics() {
    for degree in 1..=3 {
        let field = field(500, degree, None);
        let packed = pack(&field, &Field::default(), DVec3::ZERO);
        for (row, words) in packed.sh.chunks_exact(sh_words(degree)).enumerate() {
            let largest = f32::from_bits(words[0]);
            for (word, exact) in words[1..].iter().zip(&field.sh_of(row)[1..]) {
                let parts = [
                    signed(*word, 0, 11) / 1023.0,
                    signed(*word, 11, 11) / 1023.0,
                    signed(*word, 22, 10) / 511.0,
                ];
                for (channel, (part, steps)) in parts.into_iter().zip([1023.0, 1023.0, 511.0]).enumerate() {
                    let error = (part * largest - exact[channel]).abs();
                    assert!(error <= 0.501 * largest / steps, "row {row}: off by {error}");
                }
            }
        }
    }
}

#[test]
fn regions_share_their_records() {
    let static_field = field(3, 1, None);
    let dynamic_field = field(4, 2, Some(Motion { order: 1, rotates: false }));
    let packed = pack(&static_field, &dynamic_field, DVec3::ZERO);
    let motion = Some(Motion { order: 1, rotates: false });
    assert_eq!(packed.format.features, Features { sh_degree: 2, motion, ..Features::default() });
    assert_eq!((packed.gaussians.len(), packed.static_count), (7, 3));
    assert_eq!((packed.motion.len(), packed.sh.len()), (4 * 3, 7 * 9));
    // Coefficients that the static field does not have are zero.
    assert_eq!(packed.sh[4..9], [0; 5]);
}

#[test]
fn extremes_stay_finite() {
    let mut field = field(2, 1, Some(Motion { order: 1, rotates: false }));
    field.log_scales = vec![[-1e30, 1e30, 0.0], [5.0; 3]];
    field.sh[0] = [1e30, -1e30, 0.0];
    field.sh[1] = [3e38, -3e38, 1.0];
    let temporal = field.temporal.as_mut().expect("temporal columns");
    temporal.s = vec![1e-30, f32::INFINITY];
    temporal.motion = vec![[3e38, -3e38, 0.0], [1e-30, 0.0, 0.0]];
    let packed = pack(&Field::default(), &field, DVec3::ZERO);
    let scales = packed.gaussians[0];
    assert_eq!([scales.rotation_scale >> 16, scales.scales & 0xffff], [0, 0xffff]);
    assert!(packed.format.motion_units.iter().all(|unit| unit.is_finite() && *unit > 0.0));
    let halves = packed.motion.chunks_exact(3).flat_map(|words| [words[1], words[2]]);
    assert!(halves.flat_map(|w| [half(w, false), half(w, true)]).all(f32::is_finite));
    assert!(half(packed.gaussians[0].opacity_red, true) == 65504.0);
    assert_eq!(half(packed.motion[4], false), 0.0, "always on");
}
