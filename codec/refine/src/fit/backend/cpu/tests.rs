//! Tests of the whole back end: images against the naive rasteriser, gradients against finite differences.

use codec::{Camera, Field, PixelFilter};
use pulp::Arch;

use super::project::Instant;
use super::rasterize_backward::rasterize_backward;
use super::{Cpu, ForwardPass, render};
use crate::capture::Response;
use crate::fit::backend::{Backend, Gradient, StepConfig, TrainingState};
use crate::fit::cameras::{CAMERA_NUMBERS, Learned, Rig, respond, respond_backward};
use crate::fit::fixtures::{
    COLUMN_NAMES, EXTREME_FRAMES, TIMELINE, around_the_camera, camera, cloud, weights, with_extreme_numbers,
};
use crate::fit::optimizer::LearningRates;
use crate::fit::parameters::{Bounds, Parameters};
use crate::fit::views::{FrameView, Photograph, RenderedImage, TrainingView};
use crate::raster::{Real, naive, rasterize};

fn render_field<T: Real>(field: &Field, camera: &Camera, frame: f64) -> RenderedImage<T> {
    render(&Parameters::<T>::from_field(field, TIMELINE), &FrameView { camera, time: frame }).image
}

/// Differences between the channels of an image and the channels of the naive image.
fn differences<T: Real>(field: &Field, camera: &Camera, frame: f64) -> Vec<f64> {
    let expected = naive::draw(&[field], camera, frame / TIMELINE.intervals);
    let actual = render_field::<T>(field, camera, frame);
    assert_eq!((actual.width, actual.height), (camera.width, camera.height));
    assert_eq!(actual.pixels.len(), expected.len());
    assert!(expected.iter().filter(|pixel| pixel[3] > 0.5).count() > 500, "much is visible");
    let pairs = actual.pixels.iter().flatten().zip(expected.iter().flatten());
    pairs.map(|(a, b)| (a.to_double() - b).abs()).collect()
}

#[test]
fn images_match_the_naive_images() {
    let plain = [(1, 0, 0.0), (2, 1, 3.0), (3, 2, 4.5), (4, 3, 8.0)];
    for (filter, (seed, degree, frame)) in PixelFilter::ALL.into_iter().flat_map(|f| plain.map(|p| (f, p))) {
        let field = Field { filter, ..cloud(seed, 400, degree) };
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
fn images_of_large_and_of_needle_like_splats_match_the_naive_images() {
    let mut field = cloud(5, 60, 1);
    for (row, scales) in field.log_scales.iter_mut().enumerate() {
        *scales = if row % 2 == 0 { [0.5, 0.2, -0.5] } else { [1.0, -6.0, -6.0] };
    }
    for filter in PixelFilter::ALL {
        field.filter = filter;
        let worst = differences::<f64>(&field, &camera(77, 53), 4.0).into_iter().fold(0.0, f64::max);
        assert!(worst < 1e-9, "{filter:?}: {worst:e}");
    }
}

/// Gaussians of a thousandth of a pixel to a pixel.
#[test]
fn images_of_compensated_subpixel_splats_match_the_naive_images() {
    let mut field = Field { filter: PixelFilter::Mip, ..cloud(14, 9000, 0) };
    for (row, scales) in field.log_scales.iter_mut().enumerate() {
        let thin = -6.0 - (row % 7) as f32;
        *scales = if row % 2 == 0 { [-3.0, -3.3, -3.6] } else { [-2.5, thin, thin] };
    }
    let worst = differences::<f64>(&field, &camera(77, 53), 4.0).into_iter().fold(0.0, f64::max);
    assert!(worst < 1e-9, "{worst:e}");
    let mut single = differences::<f32>(&field, &camera(77, 53), 4.0);
    single.sort_by(f64::total_cmp);
    assert!(single[single.len() * 99 / 100] < 1e-4, "{:e}", single[single.len() * 99 / 100]);
}

/// The Gaussians at the frame, without motion.
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

/// Wide Gaussians at distinct depths, each with an unclamped alpha over the whole image and unclamped colours: the image is
/// differentiable.
fn smooth(sh_degree: u8, motion_order: u8, rotates: bool) -> Parameters<f64> {
    let mut random = fastrand::Rng::with_seed(7);
    let mut signed = |scale: f64| (random.f64() * 2.0 - 1.0) * scale;
    let mut p = Parameters { sh_degree, motion_order, ..Parameters::default() };
    for row in 0..3 {
        p.centers.push([signed(1.0), signed(0.8), -0.8 + 0.6 * f64::from(row) + signed(0.1)]);
        p.rotations.push([1.5 + signed(1.0), signed(1.0), signed(1.0), signed(1.0)]);
        p.log_scales.push([0.5 + signed(0.3), 0.5 + signed(0.3), 0.5 + signed(0.3)]);
        p.logits.push(signed(0.7));
        p.sh.push([0.4, -0.5, 0.3].map(|mean| mean + signed(0.4)));
        p.sh.extend((1..codec::sh_coefficients(sh_degree)).map(|_| [signed(0.1), signed(0.1), signed(0.1)]));
        p.tau.push(4.0 + signed(1.5));
        p.log_widths.push(0.6 + signed(0.3));
        p.motion.extend((0..motion_order).map(|_| [signed(0.1), signed(0.1), signed(0.03)]));
        p.rotation_rates.extend(rotates.then(|| [signed(0.2), signed(0.2), signed(0.2), signed(0.2)]));
    }
    p
}

fn static_scene(sh_degree: u8) -> Parameters<f64> {
    let mut p = smooth(sh_degree, 0, false);
    (p.tau, p.log_widths) = (Vec::new(), Vec::new());
    p
}

/// Compares all gradients of a differentiable scene with central differences.
fn check_gradients(parameters: &Parameters<f64>, view: &FrameView, detach_tau: bool, what: &str) {
    for row in 0..parameters.len() {
        let alone = render(&parameters.select(&[row]), view).image;
        let in_range = alone.pixels.iter().all(|pixel| pixel[3] > 0.005 && pixel[3] < 0.99);
        assert!(in_range, "{what}: Gaussian {row} covers the image");
    }
    let forward = render(parameters, view);
    let weights = weights(forward.image.pixels.len());
    let loss = |parameters: &Parameters<f64>| -> f64 {
        let picture = render(parameters, view).image;
        picture.pixels.iter().flatten().zip(weights.iter().flatten()).map(|(a, b)| a * b).sum()
    };
    let gradient = forward.backward(parameters, view, &weights, detach_tau);
    assert_eq!(gradient.rows, (0..parameters.len() as u32).collect::<Vec<_>>());
    assert_eq!(gradient.non_finite, 0);
    let step = 1e-5;
    for (column, (name, values)) in COLUMN_NAMES.into_iter().zip(gradient.values.columns()).enumerate() {
        // Detaching changes the derivative with respect to `tau` alone.
        let from =
            if name == "tau" && detach_tau { frozen(parameters, view.time) } else { parameters.clone() };
        let (per_row, mut largest) = (values.len() / parameters.len(), 0.0_f64);
        for (index, value) in values.iter().enumerate() {
            let at = |offset: f64| {
                let mut moved = from.clone();
                moved.columns_mut()[column][index] += offset;
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
fn gradients_match_finite_differences() {
    let camera = camera(21, 18);
    let view = FrameView { camera: &camera, time: 3.3 };
    for detach_tau in [true, false] {
        check_gradients(&smooth(0, 3, true), &view, detach_tau, "cubic and rotating");
        check_gradients(&smooth(1, 1, false), &view, detach_tau, "linear");
        check_gradients(&smooth(2, 0, true), &view, detach_tau, "rotating");
        check_gradients(&smooth(3, 2, true), &view, detach_tau, "quadratic and rotating");
    }
    for degree in 0..=3 {
        check_gradients(&static_scene(degree), &view, true, "static");
    }
}

/// An image of a few pixels, so that footprints as small as the filter cover it.
#[test]
fn gradients_match_through_compensated_opacities() {
    let camera = camera(4, 3);
    let view = FrameView { camera: &camera, time: 3.3 };
    let mip = |parameters| Parameters { filter: PixelFilter::Mip, ..parameters };
    for row in 0..3 {
        let parameters = mip(smooth(1, 2, true)).select(&[row]);
        let instant = Instant::new(&view, &parameters);
        let window = instant.window(&parameters, 0).unwrap();
        let trace = instant.project(&parameters, 0, window).unwrap();
        let factor = trace.projected.splat.opacity / window.opacity;
        assert!((0.3..0.98).contains(&factor), "row {row}: {factor}");
    }
    for detach_tau in [true, false] {
        check_gradients(&mip(smooth(1, 2, true)), &view, detach_tau, "compensated");
    }
    check_gradients(&mip(static_scene(0)), &view, true, "compensated, static");
}

#[test]
fn gradients_match_where_gaussians_fade_near_the_camera() {
    let camera = camera(21, 18);
    let view = FrameView { camera: &camera, time: 3.3 };
    let mut parameters = smooth(1, 2, true);
    let depths: Vec<f64> = render(&parameters, &view).splats.iter().map(|splat| splat.depth).collect();
    // All are in the ramp.
    let [least, most] = [f64::min, f64::max].map(|f| depths.iter().copied().reduce(f).unwrap());
    parameters.near = 1.05 * most;
    assert!(least > 0.6 * parameters.near, "{depths:?}");
    check_gradients(&parameters, &view, false, "faded");
    check_gradients(
        &Parameters { filter: PixelFilter::Mip, ..parameters },
        &view,
        false,
        "faded, compensated",
    );
}

/// A plate is behind what moves at any depth, as the player draws it, and its gradient knows.
#[test]
fn what_is_behind_is_drawn_last() {
    let camera = camera(21, 18);
    let view = FrameView { camera: &camera, time: 3.3 };
    let parameters = smooth(1, 2, true);
    let rows = parameters.len();
    let nearest = render(&parameters, &view).splats[0].row as usize;
    let behind = Parameters { behind: (0..rows).map(|row| row == nearest).collect(), ..parameters.clone() };
    let drawn = render(&behind, &view);
    assert_eq!(drawn.splats.last().unwrap().row as usize, nearest);
    let alpha = |image: &crate::fit::views::RenderedImage<f64>| -> Vec<f64> {
        image.pixels.iter().map(|pixel| pixel[3]).collect()
    };
    assert!(drawn.image != render(&parameters, &view).image, "the order is another");
    let pairs = alpha(&drawn.image).into_iter().zip(alpha(&render(&parameters, &view).image));
    assert!(pairs.into_iter().all(|(a, b)| (a - b).abs() < 1e-9), "alpha does not depend on the order");
    check_gradients(&behind, &view, false, "behind");
}

#[test]
fn a_clamped_color_has_the_gradient_that_leads_back() {
    let camera = camera(21, 18);
    let view = FrameView { camera: &camera, time: 0.0 };
    let mut parameters = static_scene(0).select(&[0]);
    parameters.sh[0] = [-4.0, 0.0, 4.0];
    let forward = render(&parameters, &view);
    for (weight, signs) in [(1.0, [0.0, 1.0, 1.0]), (-1.0, [-1.0, -1.0, 0.0])] {
        let weights = vec![[weight; 4]; forward.image.pixels.len()];
        let gradient = forward.backward(&parameters, &view, &weights, true).values.sh[0];
        let found = gradient.map(|x| if x == 0.0 { 0.0 } else { x.signum() });
        assert_eq!(found, signs, "{gradient:?}");
    }
}

#[test]
fn gradients_match_where_the_slope_is_clamped() {
    let camera = camera(21, 18);
    let view = FrameView { camera: &camera, time: 0.0 };
    let mut parameters = static_scene(1).select(&[0, 1]);
    let m = &camera.camera_from_world;
    // 1.6 times as far from the axis as the edge of the image: to the right, and above to the left.
    for (row, [x, y]) in [(0, [0.8, 0.1]), (1, [-0.8, -0.7])] {
        let view = [x * 4.2, y * 4.2, 4.2 + f64::from(row as u8)];
        let from_eye = [0, 1, 2].map(|axis| (0..3).map(|r| m[r][axis] * view[r]).sum::<f64>());
        parameters.centers[row] = [0, 1, 2].map(|axis| camera.position()[axis] + from_eye[axis]);
        parameters.log_scales[row] = [0.9, 1.0, 1.1];
        parameters.logits[row] = 1.0;
    }
    check_gradients(&parameters, &view, true, "outside");
    // The clamped slope does not depend on the centre.
    let instant = Instant::new(&view, &parameters);
    for row in 0..2 {
        let window = instant.window(&parameters, row).unwrap();
        let trace = instant.project(&parameters, row, window).unwrap();
        assert_eq!(trace.projected.footprint.is_inside, [false, row == 0]);
    }
}

/// Compares the gradient with respect to all numbers of a camera with central differences.
fn check_camera_gradient(parameters: &Parameters<f64>, what: &str) {
    let camera = camera(21, 18);
    let photograph = Photograph { width: 21, height: 18, pixels: vec![[0; 4]; 21 * 18], valid: Vec::new() };
    let view = TrainingView { camera_id: 1, camera, time: 3.3, photograph };
    let response = Response {
        color: [[0.9, 0.1, 0.0, 0.05], [0.0, 1.1, 0.1, -0.03], [0.1, 0.0, 0.8, 0.02]],
        vignette: -0.2,
    };
    let learned = Learned { offsets: true, ..Learned::default() };
    let rig = Rig::new(learned, vec![Response::NEUTRAL, response], 0);
    let weights = weights(view.photograph.pixels.len());
    let loss = |numbers: &[f64; CAMERA_NUMBERS]| -> f64 {
        let seen = rig.clone().with_numbers(1, numbers).seen(&view, None);
        let image = render(parameters, &seen.view()).image;
        let pixels = respond(&image, &seen.response);
        pixels.iter().flatten().zip(weights.iter().flatten()).map(|(a, b)| a * b).sum()
    };
    let seen = rig.seen(&view, None);
    let forward = render(parameters, &seen.view());
    let mut d_image = weights.clone();
    let by_response = respond_backward(&forward.image, &seen.response, &mut d_image);
    for detach_tau in [true, false] {
        let gradient = forward.backward(parameters, &seen.view(), &d_image, detach_tau);
        let step = 1e-5;
        for (number, found) in gradient.view.numbers(&by_response).into_iter().enumerate() {
            let at = |offset: f64| {
                let mut numbers = [0.0; CAMERA_NUMBERS];
                numbers[number] = offset;
                loss(&numbers)
            };
            let expected = (at(step) - at(-step)) / (2.0 * step);
            // The first is the time.
            let matters = !(number == 0 && parameters.tau.is_empty());
            assert_eq!(expected.abs() > 1e-3, matters, "{what}: {number}");
            let tolerance = 1e-7 + 1e-6 * expected.abs();
            assert!((found - expected).abs() <= tolerance, "{what}: {number}: {found} for {expected}");
        }
    }
}

#[test]
fn gradients_of_the_camera_match_finite_differences() {
    check_camera_gradient(&smooth(3, 3, true), "cubic and rotating");
    check_camera_gradient(&smooth(1, 1, false), "linear");
    check_camera_gradient(&static_scene(2), "static");
    let mip = Parameters { filter: PixelFilter::Mip, ..smooth(2, 2, true) };
    check_camera_gradient(&mip, "compensated");
    check_camera_gradient(&Parameters { near: 5.0, ..smooth(1, 1, false) }, "faded");
}

/// Moving the principal point moves the projected centres, and nothing else.
#[test]
fn the_screen_gradient_matches_a_moved_principal_point() {
    let camera = camera(21, 18);
    let parameters = static_scene(2).select(&[1]);
    let moved = |offset: [f64; 2]| {
        let mut camera = camera.clone();
        (0..2).for_each(|axis| camera.k[axis][2] += offset[axis]);
        render(&parameters, &FrameView { camera: &camera, time: 0.0 }).image
    };
    let weights = weights(21 * 18);
    let loss = |offset| -> f64 {
        let pixels = moved(offset).pixels;
        pixels.iter().flatten().zip(weights.iter().flatten()).map(|(a, b)| a * b).sum()
    };
    let step = 1e-5;
    let by_x = (loss([step, 0.0]) - loss([-step, 0.0])) / (2.0 * step);
    let by_y = (loss([0.0, step]) - loss([0.0, -step])) / (2.0 * step);
    let expected = (by_x * 21.0 / 2.0).hypot(by_y * 18.0 / 2.0);
    let view = FrameView { camera: &camera, time: 0.0 };
    let gradient = render(&parameters, &view).backward(&parameters, &view, &weights, true);
    assert!((gradient.screen[0] / expected - 1.0).abs() < 1e-6, "{} for {expected}", gradient.screen[0]);
}

/// Needles, small splats and saturated pixels, for which finite differences fail: compares single with
/// double precision.
#[test]
fn gradients_in_single_precision_match_double() {
    let camera = camera(77, 53);
    let view = FrameView { camera: &camera, time: 4.0 };
    for filter in PixelFilter::ALL {
        let field = Field { filter, ..cloud(6, 300, 2) };
        single_matches_double(&field, &view);
    }
}

fn single_matches_double(field: &Field, view: &FrameView) {
    let double = Parameters::<f64>::from_field(field, TIMELINE);
    let forward = render(&double, view);
    let weights = weights(forward.image.pixels.len());
    let double = forward.backward(&double, view, &weights, false);
    let single = Parameters::<f32>::from_field(field, TIMELINE);
    let of_pixels: Vec<_> = weights.iter().map(|pixel| pixel.map(|x| x as f32)).collect();
    let single = render(&single, view).backward(&single, view, &of_pixels, false);
    assert_eq!(single.rows, double.rows);
    assert!(single.rows.len() > 150 && single.rows.len() < 300, "{} are drawn", single.rows.len());
    for column in [0, 2] {
        let (single, double) = (single.values.columns()[column], double.values.columns()[column]);
        let norm = |values: &mut dyn Iterator<Item = f64>| values.map(|x| x * x).sum::<f64>().sqrt();
        let error = norm(&mut single.iter().zip(double).map(|(a, b)| f64::from(*a) - b));
        let size = norm(&mut double.iter().copied());
        assert!(error < 1e-3 * size, "{}: {error} of {size}", COLUMN_NAMES[column]);
    }
}

#[test]
fn results_do_not_depend_on_threads() {
    let field = cloud(8, 3000, 3);
    let parameters = Parameters::<f32>::from_field(&field, TIMELINE);
    let camera = camera(150, 90);
    let view = FrameView { camera: &camera, time: 4.0 };
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let forward = render(&parameters, &view);
            let gradient = forward.backward(&parameters, &view, &weights(forward.image.pixels.len()), false);
            (forward.image, gradient, stepped(&parameters, &view))
        })
    };
    let one = on(1);
    assert!(one.1.rows.len() > 1000 && one.1.non_finite == 0);
    assert_eq!(one, on(4));
}

/// The state after two steps towards a gray photograph, and their losses.
fn stepped(parameters: &Parameters<f32>, view: &FrameView) -> (TrainingState, [f64; 2]) {
    let (width, height) = (view.camera.width, view.camera.height);
    let pixels = vec![[90, 90, 90, 255]; (width * height) as usize];
    let photograph = Photograph { width, height, pixels, valid: Vec::new() };
    let config = StepConfig {
        rates: LearningRates::new(1.0, TIMELINE, parameters),
        bounds: Bounds::new(1.0, TIMELINE),
        detach_tau: true,
        fragment_weight: 1e-3,
        response: None,
        lpips: None,
    };
    let mut backend = Cpu::default();
    backend.load(parameters.clone().into()).unwrap();
    let losses = [(); 2].map(|()| {
        backend.begin_step(view, &photograph, &config).unwrap();
        backend.end_step().unwrap().loss
    });
    (backend.store().unwrap(), losses)
}

/// Three Gaussians far apart among rows that have faded.
#[test]
fn gradients_find_their_rows_among_many() {
    let alone = smooth(1, 2, true);
    let rows = [3, 300, 700];
    let source = |row: usize| rows.iter().position(|at| *at == row).unwrap_or(0);
    let mut among = alone.select(&(0..900).map(source).collect::<Vec<_>>());
    for row in (0..900).filter(|row| !rows.contains(row)) {
        among.tau[row] = -100.0;
    }
    let camera = camera(40, 30);
    let view = FrameView { camera: &camera, time: 4.0 };
    let gradient = |parameters: &Parameters<f64>| {
        let forward = render(parameters, &view);
        let gradient = forward.backward(parameters, &view, &weights(forward.image.pixels.len()), false);
        (forward.image.pixels, gradient)
    };
    let ((image, expected), (found_image, found)) = (gradient(&alone), gradient(&among));
    assert_eq!((image, expected.rows), (found_image, vec![0, 1, 2]));
    assert_eq!(
        (found.rows, found.values, found.screen),
        (vec![3, 300, 700], expected.values, expected.screen)
    );
}

#[test]
fn results_do_not_depend_on_the_vector_width() {
    let parameters = Parameters::<f32>::from_field(&cloud(13, 500, 0), TIMELINE);
    let camera = camera(77, 53);
    let instant = Instant::new(&FrameView { camera: &camera, time: 4.0 }, &parameters);
    let projected = |arch| format!("{:?}", instant.project_all(arch, &parameters));
    assert_eq!(projected(Arch::Scalar), projected(Arch::new()));
    let ForwardPass { image: picture, splats, tiles, drawn, .. } =
        render(&parameters, &FrameView { camera: &camera, time: 4.0 });
    let on = |arch| {
        let drawn_image = rasterize(arch, &splats, &tiles);
        let by_pixels = weights(picture.pixels.len());
        let back = rasterize_backward(arch, &splats, &tiles, &drawn, &picture, &by_pixels);
        (drawn_image, back.iter().map(|gradient| format!("{gradient:?}")).collect::<Vec<_>>())
    };
    assert!(picture.pixels.iter().filter(|pixel| pixel[3] > 0.5).count() > 500, "much is visible");
    assert_eq!(on(Arch::Scalar), on(Arch::new()));
}

fn assert_finite(parameters: &Parameters<f32>, view: &FrameView) -> Gradient<f32> {
    let forward = render(parameters, view);
    assert!(forward.image.pixels.as_flattened().iter().all(|x| x.is_finite()), "a pixel is not finite");
    let gradient = forward.backward(parameters, view, &weights(forward.image.pixels.len()), false);
    let numbers = gradient.values.columns().concat();
    assert!(numbers.iter().chain(&gradient.screen).all(|x| x.is_finite()), "a derivative is not finite");
    gradient
}

#[test]
fn extreme_parameters_give_finite_results() {
    let camera = camera(40, 30);
    let view = FrameView { camera: &camera, time: 4.0 };
    for filter in PixelFilter::ALL {
        let plain = Parameters::<f32>::from_field(&Field { filter, ..cloud(9, 40, 3) }, TIMELINE);
        assert_finite(&around_the_camera(&plain, &camera), &view);
        for extreme in with_extreme_numbers(&plain) {
            let gradient = assert_finite(&extreme, &view);
            assert!(gradient.rows.iter().any(|row| *row >= 20), "the others are drawn");
        }
        for frame in EXTREME_FRAMES {
            assert_finite(&plain, &FrameView { camera: &camera, time: frame });
        }
    }
}

#[test]
fn a_non_finite_gradient_is_contained() {
    let camera = camera(40, 30);
    let view = FrameView { camera: &camera, time: 4.0 };
    let parameters = Parameters::<f32>::from_field(&cloud(10, 200, 1), TIMELINE);
    let forward = render(&parameters, &view);
    let mut by_pixels = weights(forward.image.pixels.len());
    let good = forward.backward(&parameters, &view, &by_pixels, true);
    by_pixels[0][1] = f32::NAN;
    let bad = forward.backward(&parameters, &view, &by_pixels, true);
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
fn nothing_visible_renders_black() {
    let camera = camera(40, 30);
    let parameters = Parameters::<f32>::from_field(&cloud(12, 20, 1), TIMELINE);
    for (parameters, frame) in [(parameters.zeros(0), 0.0), (parameters, 1e4)] {
        let view = FrameView { camera: &camera, time: frame };
        let forward = render(&parameters, &view);
        assert_eq!(forward.image.pixels, vec![[0.0; 4]; 40 * 30]);
        let gradient = forward.backward(&parameters, &view, &weights(forward.image.pixels.len()), true);
        let expected = Gradient { values: parameters.zeros(0), ..Gradient::default() };
        assert_eq!(gradient, expected);
    }
}
