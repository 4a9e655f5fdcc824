//! Tests of the back end as a whole: pictures against the reference, gradients against differences.

use codec::{Camera, Field, Temporal};
use pulp::Arch;

use super::project::Projection;
use super::{ForwardPass, rasterize, rasterize_backward, render};
use crate::fit::backend::Gradient;
use crate::fit::parameters::{Parameters, Timeline};
use crate::fit::precision::Real;
use crate::fit::views::{FrameView, RenderedImage};
use crate::reference::{self, Order, RenderScene};

const TIMELINE: Timeline = Timeline { frames: 9 };

/// A camera from the front left; neither side of its image is a multiple of a tile's.
fn camera(width: u32, height: u32) -> Camera {
    Camera::look_at([-0.7, -0.4, -4.0], [0.1, 0.0, 0.0], [0.1, -1.0, 0.0], 0.8, width, height)
}

/// Moving, turning, overlapping needles and discs, partly outside the image or faded out.
fn cloud(seed: u64, n: usize, sh_degree: u8) -> Field {
    let mut random = fastrand::Rng::with_seed(seed);
    let mut signed = |scale: f32| (random.f32() * 2.0 - 1.0) * scale;
    let mut field = Field { sh_degree, ..Field::default() };
    let mut temporal = Temporal { motion_order: 3, rotation_rates: Some(Vec::new()), ..Temporal::default() };
    for _ in 0..n {
        field.centers.push([signed(2.0), signed(1.5), signed(2.0)]);
        let q = [1.1 + signed(1.0), signed(1.0), signed(1.0), signed(1.0)];
        let norm = q.iter().map(|x| x * x).sum::<f32>().sqrt();
        field.rotations.push(q.map(|x| x / norm));
        field.log_scales.push([-2.7 + signed(1.5), -2.7 + signed(1.5), -2.7 + signed(1.5)]);
        field.opacities.push(0.52 + signed(0.47));
        field
            .sh
            .extend((0..codec::sh_coefficients(sh_degree)).map(|_| [signed(0.6), signed(0.6), signed(0.6)]));
        temporal.tau.push(0.5 + signed(0.6));
        temporal.s.push(0.3 + signed(0.25));
        temporal.motion.extend((0..3).map(|_| [signed(0.5), signed(0.5), signed(0.5)]));
        temporal.rotation_rates.as_mut().unwrap().push([signed(1.0), signed(1.0), signed(1.0), signed(1.0)]);
    }
    field.temporal = Some(temporal);
    field
}

fn draw_field<T: Real>(field: &Field, camera: &Camera, frame: f64) -> RenderedImage<T> {
    render(&Parameters::<T>::from_field(field, TIMELINE), &FrameView { camera, frame }).image
}

/// Differences between the channels of a drawn picture and the reference's.
fn differences<T: Real>(field: &Field, camera: &Camera, frame: f64) -> Vec<f64> {
    let expected = reference::render(
        &RenderScene::from(field),
        camera,
        frame / TIMELINE.frames_per_clip(),
        Order::Depth,
    );
    let actual = draw_field::<T>(field, camera, frame);
    assert_eq!((actual.width, actual.height), (expected.width, expected.height));
    assert!(expected.pixels.iter().filter(|pixel| pixel[3] > 0.5).count() > 500, "much is seen");
    let pairs = actual.pixels.iter().flatten().zip(expected.pixels.iter().flatten());
    pairs.map(|(a, b)| (a.to_double() - b).abs()).collect()
}

#[test]
fn pictures_are_those_of_the_reference() {
    for (seed, degree, frame) in [(1, 0, 0.0), (2, 1, 3.0), (3, 2, 4.5), (4, 3, 8.0)] {
        let field = cloud(seed, 400, degree);
        let camera = camera(77, 53);
        let worst = differences::<f64>(&field, &camera, frame).into_iter().fold(0.0, f64::max);
        assert!(worst < 1e-9, "degree {degree}, frame {frame}: {worst:e}");
        // In single precision a fragment can fall on the other side of a threshold.
        let mut single = differences::<f32>(&field, &camera, frame);
        single.sort_by(f64::total_cmp);
        let (most, worst) = (single[single.len() * 995 / 1000], single[single.len() - 1]);
        assert!(most < 2e-5 && worst < 8e-3, "degree {degree}, frame {frame}: {most:e}, at most {worst:e}");
    }
}

#[test]
fn pictures_of_large_and_of_needle_like_splats_are_those_of_the_reference() {
    let mut field = cloud(5, 60, 1);
    for (row, scales) in field.log_scales.iter_mut().enumerate() {
        *scales = if row % 2 == 0 { [0.5, 0.2, -0.5] } else { [1.0, -6.0, -6.0] };
    }
    let worst = differences::<f64>(&field, &camera(77, 53), 4.0).into_iter().fold(0.0, f64::max);
    assert!(worst < 1e-9, "{worst:e}");
}

/// What a test changes, number by number.
fn columns(p: &mut Parameters<f64>) -> Vec<(&'static str, Vec<&mut f64>)> {
    vec![
        ("centers", p.centers.iter_mut().flatten().collect()),
        ("rotations", p.rotations.iter_mut().flatten().collect()),
        ("log_scales", p.log_scales.iter_mut().flatten().collect()),
        ("logits", p.logits.iter_mut().collect()),
        ("sh", p.sh.iter_mut().flatten().collect()),
        ("tau", p.tau.iter_mut().collect()),
        ("log_widths", p.log_widths.iter_mut().collect()),
        ("motion", p.motion.iter_mut().flatten().collect()),
        ("rotation_rates", p.rotation_rates.iter_mut().flatten().collect()),
    ]
}

/// Where the trajectories stand still from here on, at the positions and rotations of the frame.
fn frozen(parameters: &Parameters<f64>, frame: f64) -> Parameters<f64> {
    let mut frozen = parameters.clone();
    let order = usize::from(parameters.motion_order);
    for row in 0..parameters.tau.len() {
        let d = frame - parameters.tau[row];
        for k in 0..order {
            let c = parameters.motion[row * order + k];
            (0..3).for_each(|axis| frozen.centers[row][axis] += c[axis] * d.powi(k as i32 + 1));
        }
        if let Some(rate) = parameters.rotation_rates.get(row) {
            (0..4).for_each(|k| frozen.rotations[row][k] += rate[k] * d);
        }
    }
    frozen.motion.fill([0.0; 3]);
    frozen.rotation_rates.fill([0.0; 4]);
    frozen
}

/// Wide Gaussians, each over the whole image with an alpha between the bounds, at distinct depths: a
/// picture without jumps.
fn smooth(sh_degree: u8, motion_order: u8, rotates: bool) -> Parameters<f64> {
    let mut random = fastrand::Rng::with_seed(7);
    let mut signed = |scale: f64| (random.f64() * 2.0 - 1.0) * scale;
    let mut p = Parameters { sh_degree, motion_order, ..Parameters::default() };
    for row in 0..3 {
        p.centers.push([signed(1.0), signed(0.8), -0.8 + 0.6 * f64::from(row) + signed(0.1)]);
        p.rotations.push([1.5 + signed(1.0), signed(1.0), signed(1.0), signed(1.0)]);
        p.log_scales.push([0.5 + signed(0.3), 0.5 + signed(0.3), 0.5 + signed(0.3)]);
        p.logits.push(signed(0.7));
        p.sh.push([0.8, -3.0, 0.3].map(|mean| mean + signed(0.4)));
        p.sh.extend((1..codec::sh_coefficients(sh_degree)).map(|_| [signed(0.3), signed(0.3), signed(0.3)]));
        p.tau.push(4.0 + signed(1.5));
        p.log_widths.push(0.6 + signed(0.3));
        p.motion.extend((0..motion_order).map(|_| [signed(0.1), signed(0.1), signed(0.03)]));
        p.rotation_rates.extend(rotates.then(|| [signed(0.2), signed(0.2), signed(0.2), signed(0.2)]));
    }
    p
}

fn still(sh_degree: u8) -> Parameters<f64> {
    let mut p = smooth(sh_degree, 0, false);
    (p.tau, p.log_widths) = (Vec::new(), Vec::new());
    p
}

/// A number for each channel of each pixel: the gradient by the picture of their weighted sum.
fn weights<T: Real>(picture: &RenderedImage<T>) -> Vec<[T; 4]> {
    let mut random = fastrand::Rng::with_seed(11);
    picture.pixels.iter().map(|_| [(); 4].map(|()| T::from_f64(random.f64() * 2.0 - 1.0))).collect()
}

/// All gradients of a scene without jumps, against central differences.
fn check_gradients(parameters: &Parameters<f64>, view: &FrameView, detach_tau: bool, what: &str) {
    for row in 0..parameters.len() {
        let alone = render(&parameters.select(&[row]), view).image;
        let in_range = alone.pixels.iter().all(|pixel| pixel[3] > 0.005 && pixel[3] < 0.99);
        assert!(in_range, "{what}: Gaussian {row} covers the image");
    }
    let drawing = render(parameters, view);
    let weights = weights(&drawing.image);
    let loss = |parameters: &Parameters<f64>| -> f64 {
        let picture = render(parameters, view).image;
        picture.pixels.iter().flatten().zip(weights.iter().flatten()).map(|(a, b)| a * b).sum()
    };
    let mut gradient = drawing.backward(parameters, view, &weights, detach_tau);
    assert_eq!(gradient.rows, (0..parameters.len() as u32).collect::<Vec<_>>());
    assert_eq!(gradient.non_finite, 0);
    let step = 1e-5;
    for (column, (name, values)) in columns(&mut gradient.values).into_iter().enumerate() {
        // Only `tau` has two kinds of derivatives.
        let from =
            if name == "tau" && detach_tau { frozen(parameters, view.frame) } else { parameters.clone() };
        let (per_row, mut largest) = (values.len() / parameters.len(), 0.0_f64);
        for (index, value) in values.into_iter().enumerate() {
            let at = |offset: f64| {
                let mut moved = from.clone();
                *columns(&mut moved)[column].1[index] += offset;
                loss(&moved)
            };
            let expected = (at(step) - at(-step)) / (2.0 * step);
            let (row, number, tolerance) = (index / per_row, index % per_row, 1e-7 + 1e-6 * expected.abs());
            let close = (*value - expected).abs() <= tolerance;
            assert!(close, "{what}: {name}, row {row}, {number}: {value} for {expected} +- {tolerance:e}");
            largest = largest.max(expected.abs());
        }
        assert_eq!(largest > 1e-3, per_row > 0, "{what}: {name} matters");
    }
}

#[test]
fn gradients_are_those_of_differences() {
    let camera = camera(21, 18);
    let view = FrameView { camera: &camera, frame: 3.3 };
    for detach_tau in [true, false] {
        check_gradients(&smooth(0, 3, true), &view, detach_tau, "cubic and turning");
        check_gradients(&smooth(1, 1, false), &view, detach_tau, "linear");
        check_gradients(&smooth(2, 0, true), &view, detach_tau, "turning");
        check_gradients(&smooth(3, 2, true), &view, detach_tau, "quadratic and turning");
    }
    for degree in 0..=3 {
        check_gradients(&still(degree), &view, true, "still");
    }
}

#[test]
fn gradients_are_right_where_the_jacobian_is_not_taken_at_the_centre() {
    let camera = camera(21, 18);
    let view = FrameView { camera: &camera, frame: 0.0 };
    let mut parameters = still(1).select(&[0, 1]);
    let m = &camera.camera_from_world;
    // To the right of the image, and above and to the left of it: 1.6 times as far as its edge.
    for (row, [x, y]) in [(0, [0.8, 0.1]), (1, [-0.8, -0.7])] {
        let view = [x * 4.2, y * 4.2, 4.2 + f64::from(row as u8)];
        let from_eye = [0, 1, 2].map(|axis| (0..3).map(|r| m[r][axis] * view[r]).sum::<f64>());
        parameters.centers[row] = [0, 1, 2].map(|axis| camera.position()[axis] + from_eye[axis]);
        parameters.log_scales[row] = [0.9, 1.0, 1.1];
        parameters.logits[row] = 1.0;
    }
    check_gradients(&parameters, &view, true, "outside");
    // The Jacobian does not follow the centre: else these would be the gradients of another picture.
    let projection = Projection::new(&view);
    for row in 0..2 {
        let window = projection.window(&parameters, row).unwrap();
        let projected = projection.project(&parameters, row, window).unwrap();
        assert_eq!(projected.is_inside, [false, row == 0]);
    }
}

/// Moving the principal point moves what is drawn in the image, and nothing else.
#[test]
fn the_screen_gradient_is_that_by_the_centre_in_the_image() {
    let camera = camera(21, 18);
    let parameters = still(2).select(&[1]);
    let moved = |offset: [f64; 2]| {
        let mut camera = camera.clone();
        (0..2).for_each(|axis| camera.k[axis][2] += offset[axis]);
        render(&parameters, &FrameView { camera: &camera, frame: 0.0 }).image
    };
    let weights = weights(&moved([0.0; 2]));
    let loss = |offset| -> f64 {
        let pixels = moved(offset).pixels;
        pixels.iter().flatten().zip(weights.iter().flatten()).map(|(a, b)| a * b).sum()
    };
    let step = 1e-5;
    let by_x = (loss([step, 0.0]) - loss([-step, 0.0])) / (2.0 * step);
    let by_y = (loss([0.0, step]) - loss([0.0, -step])) / (2.0 * step);
    let expected = (by_x * 21.0 / 2.0).hypot(by_y * 18.0 / 2.0);
    let view = FrameView { camera: &camera, frame: 0.0 };
    let gradient = render(&parameters, &view).backward(&parameters, &view, &weights, true);
    assert!((gradient.screen[0] / expected - 1.0).abs() < 1e-6, "{} for {expected}", gradient.screen[0]);
}

/// Needles, small splats and pixels that finish: where differences fail, single precision is held to
/// double.
#[test]
fn gradients_in_single_precision_are_nearly_those_in_double() {
    let camera = camera(77, 53);
    let view = FrameView { camera: &camera, frame: 4.0 };
    let field = cloud(6, 300, 2);
    let double = Parameters::<f64>::from_field(&field, TIMELINE);
    let drawing = render(&double, &view);
    let weights = weights(&drawing.image);
    let mut double = drawing.backward(&double, &view, &weights, false);
    let single = Parameters::<f32>::from_field(&field, TIMELINE);
    let of_pixels: Vec<_> = weights.iter().map(|pixel| pixel.map(|x| x as f32)).collect();
    let single = render(&single, &view).backward(&single, &view, &of_pixels, false);
    assert_eq!(single.rows, double.rows);
    assert!(single.rows.len() > 150 && single.rows.len() < 300, "{} are drawn", single.rows.len());
    let to_double = |x: &f32| f64::from(*x);
    let centers: Vec<f64> = single.values.centers.iter().flatten().map(to_double).collect();
    let scales: Vec<f64> = single.values.log_scales.iter().flatten().map(to_double).collect();
    for (name, values) in columns(&mut double.values) {
        let single = match name {
            "centers" => &centers,
            "log_scales" => &scales,
            _ => continue,
        };
        let norm = |values: &mut dyn Iterator<Item = f64>| values.map(|x| x * x).sum::<f64>().sqrt();
        let error = norm(&mut single.iter().zip(&values).map(|(a, b)| a - **b));
        let size = norm(&mut values.iter().map(|x| **x));
        assert!(error < 1e-3 * size, "{name}: {error} of {size}");
    }
}

#[test]
fn threads_do_not_show() {
    let field = cloud(8, 3000, 3);
    let parameters = Parameters::<f32>::from_field(&field, TIMELINE);
    let camera = camera(150, 90);
    let view = FrameView { camera: &camera, frame: 4.0 };
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let drawing = render(&parameters, &view);
            let gradient = drawing.backward(&parameters, &view, &weights(&drawing.image), false);
            (drawing.image, gradient)
        })
    };
    let one = on(1);
    assert!(one.1.rows.len() > 1000 && one.1.non_finite == 0);
    assert_eq!(one, on(4));
}

#[test]
fn the_width_of_vectors_does_not_show() {
    let parameters = Parameters::<f32>::from_field(&cloud(13, 500, 0), TIMELINE);
    let camera = camera(77, 53);
    let ForwardPass { image: picture, splats, tiles, composited } =
        render(&parameters, &FrameView { camera: &camera, frame: 4.0 });
    let on = |arch| {
        let drawn = rasterize::rasterize(arch, &splats, &tiles, picture.width, picture.height);
        let by_pixels = weights(&picture);
        let back =
            rasterize_backward::rasterize_backward(arch, &splats, &tiles, &composited, &picture, &by_pixels);
        (drawn, back.iter().map(|gradient| format!("{gradient:?}")).collect::<Vec<_>>())
    };
    assert!(picture.pixels.iter().filter(|pixel| pixel[3] > 0.5).count() > 500, "much is seen");
    assert_eq!(on(Arch::Scalar), on(Arch::new()));
}

fn assert_finite(parameters: &Parameters<f32>, view: &FrameView) -> Gradient<f32> {
    let drawing = render(parameters, view);
    assert!(drawing.image.pixels.iter().flatten().all(|x| x.is_finite()), "a pixel is not finite");
    let gradient = drawing.backward(parameters, view, &weights(&drawing.image), false);
    let mut values = gradient.values.clone();
    let all = values.centers.iter_mut().chain(&mut values.log_scales).chain(&mut values.sh);
    let all = all.chain(&mut values.motion).flatten();
    let all = all.chain(values.rotations.iter_mut().chain(&mut values.rotation_rates).flatten());
    let mut all = all.chain(&mut values.logits).chain(&mut values.tau).chain(&mut values.log_widths);
    assert!(all.all(|x| x.is_finite()) && gradient.screen.iter().all(|x| x.is_finite()));
    gradient
}

#[test]
fn extreme_numbers_make_no_others() {
    let camera = camera(40, 30);
    let view = FrameView { camera: &camera, frame: 4.0 };
    let plain = Parameters::<f32>::from_field(&cloud(9, 40, 3), TIMELINE);
    let eye = camera.position().map(|x| x as f32);
    let mut around = plain.clone();
    for (row, distance) in [(0, 0.0), (1, 1e-3), (2, 0.011), (3, 0.3)] {
        let forward = camera.camera_from_world[2];
        around.centers[row] = [0, 1, 2].map(|axis| eye[axis] + distance * forward[axis] as f32);
        around.motion[3 * row..3 * row + 3].fill([0.0; 3]);
        around.tau[row] = 4.0;
        around.log_scales[row] = [2.0, 1.0, 0.0];
    }
    assert_finite(&around, &view);
    for number in
        [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 3e38, -3e38, 1e20, 60.0, -60.0, -300.0, 0.0, 1e-38]
    {
        for column in 0..9 {
            let mut strange = plain.clone();
            match column {
                0 => strange.centers[..20].fill([number; 3]),
                1 => strange.rotations[..20].fill([number; 4]),
                2 => strange.log_scales[..20].fill([number; 3]),
                3 => strange.logits[..20].fill(number),
                4 => strange.sh[..320].fill([number; 3]),
                5 => strange.tau[..20].fill(number),
                6 => strange.log_widths[..20].fill(number),
                7 => strange.motion[..60].fill([number; 3]),
                _ => strange.rotation_rates[..20].fill([number; 4]),
            }
            let gradient = assert_finite(&strange, &view);
            assert!(gradient.rows.iter().any(|row| *row >= 20), "the others are drawn");
        }
    }
    for frame in [f64::NAN, f64::INFINITY, -1e300] {
        assert_finite(&plain, &FrameView { camera: &camera, frame });
    }
}

#[test]
fn a_gradient_that_is_not_finite_is_contained() {
    let camera = camera(40, 30);
    let view = FrameView { camera: &camera, frame: 4.0 };
    let parameters = Parameters::<f32>::from_field(&cloud(10, 200, 1), TIMELINE);
    let drawing = render(&parameters, &view);
    let mut by_pixels = weights(&drawing.image);
    let good = drawing.backward(&parameters, &view, &by_pixels, true);
    by_pixels[0][1] = f32::NAN;
    let bad = drawing.backward(&parameters, &view, &by_pixels, true);
    assert!(
        bad.non_finite > 0 && bad.non_finite < bad.rows.len(),
        "{} of {}",
        bad.non_finite,
        bad.rows.len()
    );
    let mut cleared = 0;
    for row in 0..bad.rows.len() {
        let (good, bad) = (good.values.select(&[row]), bad.values.select(&[row]));
        cleared += usize::from(bad != good && bad == parameters.zeros(1));
    }
    assert_eq!(cleared, bad.non_finite);
}

#[test]
fn nothing_makes_a_black_picture() {
    let camera = camera(40, 30);
    let parameters = Parameters::<f32>::from_field(&cloud(12, 20, 1), TIMELINE);
    for (parameters, frame) in [(parameters.zeros(0), 0.0), (parameters, 1e4)] {
        let view = FrameView { camera: &camera, frame };
        let drawing = render(&parameters, &view);
        assert_eq!(drawing.image.pixels, vec![[0.0; 4]; 40 * 30]);
        let gradient = drawing.backward(&parameters, &view, &weights(&drawing.image), true);
        let expected = Gradient { values: parameters.zeros(0), ..Gradient::default() };
        assert_eq!(gradient, expected);
    }
}
