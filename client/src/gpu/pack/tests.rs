//! Error bounds of every packed quantity: the unpacking here is that of the WGSL.

use codec::sh_coefficients;

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
        let mut vector = |reach: f32| [0; 3].map(|_| random.between(-reach, reach));
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
    let packed = pack(&field, &Field::default());
    assert_eq!(packed.features, Features { sh_degree: 0, motion: None });
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
            let log = packed.ranges.log_scale_min + packed.ranges.log_scale_step * step as f32;
            let error = (log - field.log_scales[row][axis]).abs();
            assert!(error < 1.1e-4, "row {row}: scale off by {error}");
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

#[test]
fn trajectories_windows_and_turning() {
    let motion = Motion { order: 3, rotates: true };
    let field = field(2000, 0, Some(motion));
    let packed = pack(&Field::default(), &field);
    assert_eq!(packed.features.motion, Some(motion));
    let temporal = field.temporal.as_ref().expect("temporal columns");
    for (row, words) in packed.motion.chunks_exact(motion.words()).enumerate() {
        assert_eq!(f32::from_bits(words[0]), temporal.tau[row], "window centres are exact");
        let half_at = |k: usize| half(words[1 + k / 2], k % 2 == 1);
        let relative = |value: f32, exact: f32| (value - exact).abs() / exact.abs();
        // Half a step of an f16: 2^-11 / 2 of the value, plus rounding of the units.
        let most = 2.5e-4 * 2.0;
        assert!(relative(half_at(0), 1.0 / temporal.s[row]) < most);
        for (power, v) in temporal.motion_of(row).iter().enumerate() {
            for (axis, &exact) in v.iter().enumerate() {
                let value = half_at(1 + 3 * power + axis) * packed.ranges.motion_units[power];
                // What is a millionth of the largest may round more.
                assert!(relative(value, exact) < most || exact.abs() < 1e-5, "{value} for {exact}");
            }
        }
        // The packed quaternion may be the opposite of the field's: the rates then are, too.
        let rates = temporal.rotation_rates.as_ref().expect("rates");
        let q = unpack_rotation(&packed.gaussians[row]);
        let sign: f32 = q.iter().zip(field.rotations[row]).map(|(a, b)| a * b).sum::<f32>().signum();
        for (k, &exact) in rates[row].iter().enumerate() {
            let rate = half_at(10 + k) * packed.ranges.rate_unit * sign;
            assert!(relative(rate, exact) < most || exact.abs() < 1e-3, "{rate} for {exact}");
        }
    }
}

#[test]
fn spherical_harmonics() {
    for degree in 1..=3 {
        let field = field(500, degree, None);
        let packed = pack(&field, &Field::default());
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
    let still = field(3, 1, None);
    let moving = field(4, 2, Some(Motion { order: 1, rotates: false }));
    let packed = pack(&still, &moving);
    assert_eq!(packed.features, Features { sh_degree: 2, motion: Some(Motion { order: 1, rotates: false }) });
    assert_eq!((packed.gaussians.len(), packed.ranges.first_moving), (7, 3));
    assert_eq!((packed.motion.len(), packed.sh.len()), (4 * 3, 7 * 9));
    // Coefficients that the still region does not have are zero.
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
    let packed = pack(&Field::default(), &field);
    let Ranges { log_scale_min, log_scale_step, motion_units, .. } = packed.ranges;
    assert!(log_scale_min == -20.0 && log_scale_step * 65535.0 < 40.1);
    assert!(motion_units[0].is_finite() && motion_units[0] > 0.0);
    let halves = packed.motion.chunks_exact(3).flat_map(|words| [words[1], words[2]]);
    assert!(halves.flat_map(|w| [half(w, false), half(w, true)]).all(f32::is_finite));
    assert!(half(packed.gaussians[0].opacity_red, true) == 65504.0);
    assert_eq!(half(packed.motion[4], false), 0.0, "always on");
}
