//! Fixtures of the tests of fits, for the unit tests and `tests/fit_gpu.rs`, which includes this file.

use std::collections::BTreeMap;

use codec::{Camera, Field, Temporal, sh_coefficients};

use super::{Parameters, Real, Timeline, WeightTensor};

pub(crate) const TIMELINE: Timeline = Timeline::even(9);

/// Names of the columns of [`Parameters::columns`].
pub(crate) const COLUMN_NAMES: [&str; 9] =
    ["centers", "rotations", "log_scales", "logits", "sh", "tau", "log_widths", "motion", "rotation_rates"];

/// A camera at the front left.
pub(crate) fn camera(width: u32, height: u32) -> Camera {
    Camera::look_at([-0.7, -0.4, -4.0], [0.1, 0.0, 0.0], [0.1, -1.0, 0.0], 0.8, width, height)
}

/// Moving, rotating, overlapping needles and discs, some outside the image or faded out.
pub(crate) fn cloud(seed: u64, count: usize, sh_degree: u8) -> Field {
    let mut random = fastrand::Rng::with_seed(seed);
    let mut signed = |scale: f32| (random.f32() * 2.0 - 1.0) * scale;
    let mut field = Field { sh_degree, ..Field::default() };
    let mut temporal = Temporal { motion_order: 3, ..Temporal::default() };
    let mut rates = Vec::new();
    for _ in 0..count {
        field.centers.push([signed(2.0), signed(1.5), signed(2.0)]);
        let q = [1.1 + signed(1.0), signed(1.0), signed(1.0), signed(1.0)];
        let norm = q.iter().map(|x| x * x).sum::<f32>().sqrt();
        field.rotations.push(q.map(|x| x / norm));
        field.log_scales.push([-2.7 + signed(1.5), -2.7 + signed(1.5), -2.7 + signed(1.5)]);
        field.opacities.push(0.52 + signed(0.47));
        field.sh.extend((0..sh_coefficients(sh_degree)).map(|_| [signed(0.6), signed(0.6), signed(0.6)]));
        temporal.tau.push(0.5 + signed(0.6));
        temporal.s.push(0.3 + signed(0.25));
        temporal.motion.extend((0..3).map(|_| [signed(0.5), signed(0.5), signed(0.5)]));
        rates.push([signed(1.0), signed(1.0), signed(1.0), signed(1.0)]);
    }
    temporal.rotation_rates = Some(rates);
    field.temporal = Some(temporal);
    field
}

/// A weight for each channel of each pixel: the gradient of the weighted sum of an image.
pub(crate) fn weights<T: Real>(pixels: usize) -> Vec<[T; 4]> {
    let mut random = fastrand::Rng::with_seed(11);
    (0..pixels).map(|_| [(); 4].map(|()| T::from_f64(random.f64() * 2.0 - 1.0))).collect()
}

/// `plain` with four large Gaussians at and just in front of the camera.
pub(crate) fn around_the_camera(plain: &Parameters<f32>, camera: &Camera) -> Parameters<f32> {
    let eye = camera.position().map(|x| x as f32);
    let forward = camera.camera_from_world[2];
    let mut around = plain.clone();
    for (row, distance) in [(0, 0.0), (1, 1e-3), (2, 0.011), (3, 0.3)] {
        around.centers[row] = [0, 1, 2].map(|axis| eye[axis] + distance * forward[axis] as f32);
        around.motion[3 * row..3 * row + 3].fill([0.0; 3]);
        around.tau[row] = 4.0;
        around.log_scales[row] = [2.0, 1.0, 0.0];
    }
    around
}

/// `plain` with an extreme number in all of one column of the first 20 rows: every number, every column.
pub(crate) fn with_extreme_numbers(plain: &Parameters<f32>) -> impl Iterator<Item = Parameters<f32>> {
    let numbers =
        [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 3e38, -3e38, 1e20, 60.0, -60.0, -300.0, 0.0, 1e-38];
    let cases = numbers.into_iter().flat_map(|number| (0..COLUMN_NAMES.len()).map(move |c| (number, c)));
    cases.map(|(number, c)| {
        let mut extreme = plain.clone();
        let column = &mut extreme.columns_mut()[c];
        let end = column.len() / plain.len() * 20;
        column[..end].fill(number);
        extreme
    })
}

/// Frames at which nothing is visible, or that are not finite.
pub(crate) const EXTREME_FRAMES: [f64; 3] = [f64::NAN, f64::INFINITY, -1e300];

/// Pseudo-random weights of a layer, in `[-scale / 2, scale / 2]`.
pub(crate) fn layer_weights(count: usize, layer: usize, scale: f64) -> impl Iterator<Item = f64> {
    (0..count).map(move |i| (((i * 7919 + layer * 104_729) % 1009) as f64 / 1009.0 - 0.5) * scale)
}

/// AlexNet for LPIPS, with weights from a formula.
pub(crate) fn alexnet() -> BTreeMap<String, WeightTensor> {
    let layers = [(0, 3, 64, 11), (3, 64, 192, 5), (6, 192, 384, 3), (8, 384, 256, 3), (10, 256, 256, 3)];
    let mut tensors = BTreeMap::new();
    let mut add = |name: String, shape: Vec<usize>, values: &mut dyn Iterator<Item = f64>| {
        tensors.insert(name, WeightTensor { shape, values: values.map(|x| x as f32).collect() });
    };
    for (i, (number, inputs, outputs, side)) in layers.into_iter().enumerate() {
        let fan_in = inputs * side * side;
        let scale = (24.0 / fan_in as f64).sqrt();
        let kernel = &mut layer_weights(outputs * fan_in, number, scale);
        add(format!("features.{number}.weight"), vec![outputs, inputs, side, side], kernel);
        let bias = &mut layer_weights(outputs, number + 100, 0.2);
        add(format!("features.{number}.bias"), vec![outputs], bias);
        let head = &mut (0..outputs).map(|channel| ((channel * 31 + i) % 97) as f64 / 97.0);
        add(format!("lin{i}.model.1.weight"), vec![1, outputs, 1, 1], head);
    }
    tensors
}
