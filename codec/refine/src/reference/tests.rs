//! Tests of the renderer as a whole against closed forms and independent computations.

use std::f64::consts::PI;

use codec::{ALPHA_MIN, Camera, Clip, ClipInfo, Field, LayerEnd, PixelFilter, Temporal, TimeIndex};
use glam::{DQuat, DVec2, DVec3, dvec2};

use super::*;
use crate::fit::fixtures;
use crate::raster::naive;

const WIDTH: u32 = 64;
const HEIGHT: u32 = 48;
const FOCAL: f64 = 100.0;

/// A camera at the origin that looks along +z.
fn camera() -> Camera {
    Camera {
        width: WIDTH,
        height: HEIGHT,
        k: [[FOCAL, 0.0, f64::from(WIDTH) / 2.0], [0.0, FOCAL, f64::from(HEIGHT) / 2.0], [0.0, 0.0, 1.0]],
        camera_from_world: [
            [1.0, 0.0, 0.0, 0.0],
            [0.0, 1.0, 0.0, 0.0],
            [0.0, 0.0, 1.0, 0.0],
            [0.0, 0.0, 0.0, 1.0],
        ],
    }
}

/// A round Gaussian.
#[derive(Clone, Copy)]
struct Ball {
    center: [f32; 3],
    sigma: f32,
    opacity: f32,
    color: [f32; 3],
}

impl Ball {
    fn at(center: [f32; 3], color: [f32; 3]) -> Ball {
        Ball { center, sigma: 0.1, opacity: 0.6, color }
    }
}

const RED: [f32; 3] = [1.0, 0.0, 0.0];
const BLUE: [f32; 3] = [0.0, 0.0, 1.0];
const WHITE: [f32; 3] = [1.0, 1.0, 1.0];

/// The degree 0 coefficient of a colour.
fn constant(color: [f32; 3]) -> [f32; 3] {
    color.map(|c| ((f64::from(c) - 0.5) * 2.0 * PI.sqrt()) as f32)
}

fn field(balls: &[Ball]) -> Field {
    Field {
        centers: balls.iter().map(|ball| ball.center).collect(),
        rotations: vec![[1.0, 0.0, 0.0, 0.0]; balls.len()],
        log_scales: balls.iter().map(|ball| [ball.sigma.ln(); 3]).collect(),
        opacities: balls.iter().map(|ball| ball.opacity).collect(),
        sh: balls.iter().map(|ball| constant(ball.color)).collect(),
        ..Field::default()
    }
}

/// Gives every row of `field` the window `tau`, `s` and the motion `v`.
fn dynamic_field(mut field: Field, tau: f32, s: f32, v: &[[f32; 3]]) -> Field {
    field.temporal = Some(Temporal {
        tau: vec![tau; field.len()],
        s: vec![s; field.len()],
        motion_order: v.len() as u8,
        motion: v.repeat(field.len()),
        rotation_rates: None,
    });
    field
}

/// Elongated, rotated, overlapping Gaussians, partly outside the image.
fn cloud(seed: u64, n: usize) -> Field {
    let mut random = fastrand::Rng::with_seed(seed);
    let mut signed = |scale: f64| ((random.f64() * 2.0 - 1.0) * scale) as f32;
    let mut field = Field { sh_degree: 1, ..Field::default() };
    for _ in 0..n {
        field.centers.push([signed(1.6), signed(1.2), 3.5 + signed(2.0)]);
        let q = DQuat::from_xyzw(
            f64::from(signed(1.0)),
            f64::from(signed(1.0)),
            f64::from(signed(1.0)),
            1.1 + f64::from(signed(1.0)),
        );
        let q = q.normalize();
        field.rotations.push([q.w, q.x, q.y, q.z].map(|c| c as f32));
        field.log_scales.push([-3.0 + signed(1.5), -3.0 + signed(1.5), -3.0 + signed(1.5)]);
        field.opacities.push(0.52 + signed(0.48));
        for _ in 0..4 {
            field.sh.push([signed(1.0), signed(1.0), signed(1.0)]);
        }
    }
    field
}

fn assert_close(actual: [f64; 4], expected: [f64; 4], tolerance: f64, what: &str) {
    let close = actual.iter().zip(&expected).all(|(a, b)| (a - b).abs() <= tolerance);
    assert!(close, "{what}: {actual:?}, {expected:?} expected");
}

/// The pixel that contains the projection of `[x, y, depth]`.
fn pixel_of(x: f64, y: f64, depth: f64) -> (u32, u32) {
    let column = FOCAL * x / depth + f64::from(WIDTH) / 2.0;
    let row = FOCAL * y / depth + f64::from(HEIGHT) / 2.0;
    (column as u32, row as u32)
}

/// All degrees and filters, moving and turning, fading near the eye, with a plate.
#[test]
fn pictures_match_the_naive_pictures() {
    let camera = fixtures::camera(77, 53);
    let plate = Field { near: 1.0, ..fixtures::cloud(20, 100, 0) };
    for (filter, degree) in PixelFilter::ALL.into_iter().flat_map(|filter| [0, 1, 2, 3].map(|d| (filter, d)))
    {
        let near = f32::from(degree) * 1.5;
        let field = Field { filter, near, ..fixtures::cloud(21 + u64::from(degree), 300, degree) };
        let t = 0.2 + 0.2 * f64::from(degree);
        let image = render(&RenderScene::from(&field).with_plate(&plate), &camera, t, Order::Depth);
        let expected = naive::draw(&[&field, &plate], &camera, t);
        assert!(expected.iter().filter(|pixel| pixel[3] > 0.5).count() > 500, "much is visible");
        for (pixel, (actual, expected)) in image.pixels.iter().zip(&expected).enumerate() {
            assert_close(*actual, *expected, 1e-9, &format!("{filter:?}, degree {degree}, pixel {pixel}"));
        }
    }
}

/// What they have in common is computed once; others of nearly the same footprint are computed one by one.
#[test]
fn gaussians_of_one_footprint_are_drawn_as_others() {
    let views = [PosedView { camera: fixtures::camera(77, 53), t: 0.4 }];
    let few = fixtures::cloud(20, 12, 1);
    let mut same = few.select(&(0..600).map(|i| i / 50).collect::<Vec<_>>());
    // Other colours.
    for (i, color) in same.sh.iter_mut().enumerate() {
        color[i % 3] += 0.1 * (i % 7) as f32;
    }
    let mut others = same.clone();
    others.opacities.iter_mut().step_by(2).for_each(|opacity| *opacity *= 1.0 - f32::EPSILON);
    let [a, b] = [&same, &others].map(|field| {
        let PosedView { camera, t } = &views[0];
        let image = render(&RenderScene::from(field), camera, *t, Order::Depth);
        let contributions = contributions(field, camera, *t, Order::Depth);
        (image, contributions, sensitivities(field, None, &views, || ()).unwrap().field)
    });
    assert!(a.0.max_difference(&b.0) < 1e-5, "{}", a.0.max_difference(&b.0));
    let close = |a: f64, b: f64| (a - b).abs() <= 1e-5 * b.abs() + 1e-9;
    for row in 0..same.len() {
        assert!(close(a.1[row].weight, b.1[row].weight), "{row}: {:?}, {:?}", a.1[row], b.1[row]);
        let [a, b] = [a.2[row], b.2[row]].map(|row| [row.color, row.geometry].map(f64::from));
        assert!(close(a[0], b[0]) && close(a[1], b[1]), "{row}: {a:?}, {b:?}");
    }
}

#[test]
fn the_color_of_each_gaussian_is_clamped() {
    let mut field = field(&[Ball { opacity: 1.0, ..Ball::at([0.02, 0.02, 4.0], WHITE) }]);
    field.sh = vec![[-4.0, 0.0, 4.0]];
    let [r, g, b, a] = render(&(&field).into(), &camera(), 0.0, Order::Depth).pixel(32, 24);
    assert!(a > 0.99, "{a}");
    assert_close([r / a, g / a, b / a, 1.0], [0.0, 0.5, 1.0, 1.0], 1e-12, "colours");
}

#[test]
fn one_gaussian_is_its_closed_form() {
    let ball = Ball { sigma: 0.12, opacity: 0.8, ..Ball::at([0.0, 0.0, 4.0], [0.2, 0.5, 0.9]) };
    let image = render(&(&field(&[ball])).into(), &camera(), 0.0, Order::Depth);
    let variance = (FOCAL * 0.12 / 4.0f64).powi(2) + 0.3;
    let mut drawn = 0;
    for y in 0..HEIGHT {
        for x in 0..WIDTH {
            let d = dvec2(f64::from(x) + 0.5 - 32.0, f64::from(y) + 0.5 - 24.0);
            let alpha = f64::from(0.8f32) * (-0.5 * d.length_squared() / variance).exp();
            let alpha = if alpha < ALPHA_MIN { 0.0 } else { alpha };
            drawn += usize::from(alpha > 0.0);
            let expected = [0.2 * alpha, 0.5 * alpha, 0.9 * alpha, alpha];
            assert_close(image.pixel(x, y), expected, 1e-6, &format!("pixel {x},{y}"));
        }
    }
    assert!(drawn > 200 && drawn < 500, "{drawn} pixels drawn");
}

/// The closed form of a compensated Gaussian, from a twentieth of a pixel to several pixels.
#[test]
fn the_mip_filter_compensates_the_opacity() {
    for sigma in [0.002, 0.02, 0.2f32] {
        let ball = Ball { sigma, opacity: 0.95, ..Ball::at([0.02, 0.02, 4.0], WHITE) };
        let field = Field { filter: PixelFilter::Mip, ..field(&[ball]) };
        let sharp = (FOCAL * f64::from(sigma) / 4.0).powi(2);
        let expected = f64::from(0.95f32) * sharp / (sharp + 0.1);
        let image = render(&(&field).into(), &camera(), 0.0, Order::Depth);
        // The centre of the ball is the centre of a pixel.
        let alpha = image.pixel(32, 24)[3];
        let expected = if expected < ALPHA_MIN { 0.0 } else { expected };
        // Off the axis by 0.3 degrees, which stretches it by 1e-5.
        assert!((alpha - expected).abs() < 1e-4, "{sigma}: {alpha} for {expected}");
    }
}

/// Drawn at 8 times the resolution and averaged, the picture of a subpixel needle keeps its sum with the mip filter.
#[test]
fn the_mip_filter_keeps_the_sum_of_a_picture_at_any_resolution() {
    let mut needle = field(&[Ball { opacity: 0.9, ..Ball::at([0.013, -0.007, 4.0], WHITE) }]);
    needle.log_scales[0] = [0.3f32.ln(), 0.01f32.ln(), 0.01f32.ln()];
    needle.rotations[0] = [0.9f32.sqrt(), 0.0, 0.0, 0.1f32.sqrt()];
    let sum = |filter, times: u32| {
        let mut camera = camera();
        (camera.width, camera.height) = (times * WIDTH, times * HEIGHT);
        camera.k[..2].iter_mut().flatten().for_each(|x| *x *= f64::from(times));
        let field = Field { filter, ..needle.clone() };
        let image = render(&(&field).into(), &camera, 0.0, Order::Depth);
        image.pixels.iter().map(|pixel| pixel[3]).sum::<f64>() / f64::from(times * times)
    };
    // The exact sum, less the tails below 1/255.
    let exact = 2.0 * PI * 0.9 * (FOCAL / 4.0f64).powi(2) * 0.3 * 0.01;
    for times in [1, 2, 4, 8] {
        let mip = sum(PixelFilter::Mip, times) / exact;
        assert!((0.9..1.01).contains(&mip), "{times}: {mip}");
    }
    assert!(sum(PixelFilter::Blur, 1) > 1.8 * exact, "blur adds to it");
}

/// Compares the covariance with finite differences of the projection.
#[test]
fn footprint_is_the_projected_covariance() {
    let field = cloud(1, 50);
    let camera = Camera::look_at([0.3, -0.4, -0.6], [0.1, 0.2, 3.0], [0.1, -1.0, 0.2], 0.9, 80, 60);
    let project = |p: DVec3| {
        let m = &camera.camera_from_world;
        let [x, y, z] = [0, 1, 2].map(|r| m[r][0] * p.x + m[r][1] * p.y + m[r][2] * p.z + m[r][3]);
        dvec2(camera.k[0][0] * x / z + camera.k[0][2], camera.k[1][1] * y / z + camera.k[1][2])
    };
    let mut compared = 0;
    for row in 0..field.len() {
        let alive = alive::Alive { row, opacity: 1.0 };
        let Some(splat) = evaluate::evaluate(&field, &[alive], &camera, 0.0).pop() else { continue };
        let center = DVec3::from_array(field.position_at(row, 0.0));
        let [x, y] = splat.center;
        assert!((dvec2(x, y) - project(center)).length() < 1e-9);
        if !(0.0..=80.0).contains(&x) || !(0.0..=60.0).contains(&y) {
            continue;
        }
        let [w, x, y, z] = field.rotation_at(row, 0.0);
        let u = DVec3::new(x, y, z);
        let mut expected = [0.3, 0.0, 0.3];
        for (axis, &log_scale) in [DVec3::X, DVec3::Y, DVec3::Z].iter().zip(&field.log_scales[row]) {
            // q axis q*, written out.
            let turned = axis + 2.0 * w * u.cross(*axis) + 2.0 * u.cross(u.cross(*axis));
            let h = 1e-5;
            let slope = (project(center + h * turned) - project(center - h * turned)) / (2.0 * h);
            let image = slope * f64::from(log_scale).exp();
            expected[0] += image.x * image.x;
            expected[1] += image.x * image.y;
            expected[2] += image.y * image.y;
        }
        for (a, b) in splat.covariance.iter().zip(&expected) {
            assert!((a - b).abs() < 1e-6 * expected[0].max(expected[2]), "row {row}: {a} for {b}");
        }
        compared += 1;
    }
    assert!(compared > 20, "{compared} rows compared");
}

#[test]
fn the_jacobian_is_clamped_outside_the_image() {
    let mut camera = camera();
    camera.k[0][2] = 20.0;
    let alive = [alive::Alive { row: 0, opacity: 1.0 }];
    // The image ends at x/z = 0.44 and -0.2; the margin on both sides is 0.3 * 0.32.
    for (x, slope) in [(0.5, 0.5), (30.0, 0.536), (-30.0, -0.296)] {
        let field = field(&[Ball::at([x, 0.0, 1.0], WHITE)]);
        let splat = evaluate::evaluate(&field, &alive, &camera, 0.0)[0];
        assert!((splat.center[0] - (100.0 * f64::from(x) + 20.0)).abs() < 1e-9, "centres are not clamped");
        let expected = (FOCAL * 0.1).powi(2) * (1.0 + slope * slope) + 0.3;
        assert!((splat.covariance[0] - expected).abs() < 1e-4, "{} for {expected}", splat.covariance[0]);
    }
}

#[test]
fn nearer_is_in_front_and_ties_stay_in_row_order() {
    let (near, far) = (Ball::at([0.0, 0.0, 3.0], RED), Ball::at([0.0, 0.0, 4.0], BLUE));
    let image = |balls: &[Ball]| render(&(&field(balls)).into(), &camera(), 0.0, Order::Depth);
    let a = image(&[near]).pixel(32, 24)[3];
    let b = image(&[far]).pixel(32, 24)[3];
    let expected = [a, 0.0, b * (1.0 - a), 1.0 - (1.0 - a) * (1.0 - b)];
    assert_close(image(&[far, near]).pixel(32, 24), expected, 1e-6, "over");
    assert_eq!(image(&[near, far]), image(&[far, near]));
    let tie = Ball { color: BLUE, ..near };
    let first = image(&[near, tie]).pixel(32, 24);
    assert!(first[0] > first[2], "{first:?}: the first row is in front");
}

#[test]
fn radial_order_differs_from_depth() {
    // Off axis: nearer along the axis, but farther from the eye.
    let side = Ball::at([0.9, 0.0, 3.0], RED);
    let center = Ball { sigma: 0.5, ..Ball::at([0.1, 0.0, 3.05], BLUE) };
    let field = field(&[side, center]);
    let (x, y) = pixel_of(0.9, 0.0, 3.0);
    let [depth, radial] = [Order::Depth, Order::Radial]
        .map(|order| render(&(&field).into(), &camera(), 0.0, order).pixel(x, y));
    assert!((depth[3] - radial[3]).abs() < 1e-12);
    assert!(depth[0] > radial[0] + 0.05 && depth[2] < radial[2] - 0.05, "{depth:?} {radial:?}");
}

#[test]
fn a_pixel_stops_before_the_fragment_that_would_finish_it() {
    let wall = |depth| Ball { sigma: 50.0, opacity: 1.0, ..Ball::at([0.0, 0.0, depth], RED) };
    let translucent = Ball { sigma: 50.0, opacity: 0.1, ..Ball::at([0.0, 0.0, 4.0], BLUE) };
    let image = |balls: &[Ball]| render(&(&field(balls)).into(), &camera(), 0.0, Order::Depth);
    // Alpha is capped at 0.999. The second wall would leave 1e-6, so the pixel stops before it.
    let stopped = image(&[wall(2.0), wall(3.0), translucent]).pixel(32, 24);
    assert_close(stopped, [0.999, 0.0, 0.0, 0.999], 1e-7, "two walls");
    // A translucent fragment after one wall leaves 9e-4 and is drawn.
    let drawn = image(&[wall(2.0), translucent]).pixel(32, 24);
    assert_close(drawn, [0.999, 0.0, 1e-4, 0.9991], 1e-6, "one wall");
}

#[test]
fn opacity_follows_the_window() {
    let static_part = field(&[Ball { opacity: 0.9, ..Ball::at([0.005, 0.005, 1.0], WHITE) }]);
    let field = dynamic_field(static_part, 0.4, 0.1, &[]);
    let peak = |t| render(&(&field).into(), &camera(), t, Order::Depth).pixel(32, 24)[3];
    for t in [0.1, 0.35, 0.4, 0.55, 0.7] {
        let expected = 0.9 * (-0.5 * ((t - 0.4) / 0.1f64).powi(2)).exp();
        assert!((peak(t) - expected).abs() < 1e-6, "t {t}: {} for {expected}", peak(t));
    }
    let (_, end) = field.alive_interval(0).unwrap();
    assert!(peak(end - 1e-6) > 0.0);
    assert_eq!(peak(end + 1e-6), 0.0);
    assert_eq!(peak(f64::NAN), 0.0);
}

#[test]
fn centres_follow_the_cubic() {
    let ball = Ball { sigma: 0.004, ..Ball::at([-0.093, 0.047, 2.0], WHITE) };
    let field = dynamic_field(
        field(&[ball]),
        0.25,
        f32::INFINITY,
        &[[0.4, 0.1, 0.0], [0.0, -0.6, 1.0], [0.3, 0.2, -0.5]],
    );
    for t in [0.0, 0.25, 0.6, 1.0] {
        let d: f64 = t - 0.25;
        let x = -0.093 + 0.4 * d + 0.3 * d.powi(3);
        let y = 0.047 + 0.1 * d - 0.6 * d.powi(2) + 0.2 * d.powi(3);
        let z = 2.0 + d.powi(2) - 0.5 * d.powi(3);
        let image = render(&(&field).into(), &camera(), t, Order::Depth);
        let brightest =
            (0..image.pixels.len()).max_by(|&a, &b| image.pixels[a][3].total_cmp(&image.pixels[b][3]));
        let (column, row) = pixel_of(x, y, z);
        assert_eq!(brightest, Some((row * WIDTH + column) as usize), "t {t}");
    }
}

#[test]
fn rotation_rates_turn_the_footprint() {
    let mut turning = dynamic_field(field(&[Ball::at([0.0, 0.0, 2.0], WHITE)]), 0.2, f32::INFINITY, &[]);
    turning.log_scales[0] = [-1.5, -4.0, -4.0];
    turning.temporal.as_mut().unwrap().rotation_rates = Some(vec![[-0.2, 0.1, 0.3, 0.8]]);
    let t = 0.7;
    let q = DQuat::from_xyzw(0.05, 0.15, 0.4, 0.9).normalize();
    let mut turned = turning.clone();
    turned.temporal = None;
    turned.rotations[0] = [q.w, q.x, q.y, q.z].map(|c| c as f32);
    let actual = render(&(&turning).into(), &camera(), t, Order::Depth);
    assert!(actual.max_difference(&render(&(&turned).into(), &camera(), t, Order::Depth)) < 1e-6);
    assert!(actual.max_difference(&render(&(&turning).into(), &camera(), 0.2, Order::Depth)) > 0.1);
}

#[test]
fn color_depends_on_the_direction() {
    let mut field = field(&[Ball { opacity: 1.0, ..Ball::at([0.0, 0.0, 2.0], [0.5; 3]) }]);
    field.sh_degree = 1;
    // Red grows along +z, green along +x.
    field.sh = vec![[0.0; 3], [0.0; 3], [0.4, 0.0, 0.0], [0.0, -0.4, 0.0]];
    let linear = 0.4 * (0.75 / PI).sqrt();
    let seen = |from: [f64; 3]| {
        let camera = Camera::look_at(from, [0.0, 0.0, 2.0], [0.0, -1.0, 0.0], 0.5, 33, 33);
        let [r, g, _, a] = render(&(&field).into(), &camera, 0.0, Order::Depth).pixel(16, 16);
        (r / a, g / a)
    };
    let (front, side) = (seen([0.0; 3]), seen([-2.0, 0.0, 2.0]));
    assert!((front.0 - 0.5 - linear).abs() < 1e-6 && (front.1 - 0.5).abs() < 1e-6, "{front:?}");
    assert!((side.0 - 0.5).abs() < 1e-6 && (side.1 - 0.5 - linear).abs() < 1e-6, "{side:?}");
}

#[test]
fn the_plate_is_behind_at_any_depth() {
    let front = field(&[Ball::at([0.0, 0.0, 4.0], RED)]);
    let plate = field(&[Ball { sigma: 1.0, opacity: 0.5, ..Ball::at([0.0, 0.0, 1.0], BLUE) }]);
    let alone = |field: &Field| render(&field.into(), &camera(), 0.0, Order::Depth).pixel(32, 24);
    let (f, p) = (alone(&front), alone(&plate));
    let both =
        render(&RenderScene::from(&front).with_plate(&plate), &camera(), 0.0, Order::Depth).pixel(32, 24);
    let expected = [0, 1, 2, 3].map(|c| f[c] + p[c] * (1.0 - f[3]));
    assert_close(both, expected, 1e-12, "front over plate");
}

#[test]
fn the_subject_is_what_is_before_the_plate() {
    let front = field(&[Ball::at([0.0, 0.0, 3.0], RED)]);
    let plate = field(&[Ball::at([0.1, 0.0, 2.0], BLUE), Ball::at([0.6, 0.0, 2.0], BLUE)]);
    let scene = RenderScene::from(&front).with_plate(&plate);
    let (whole, subject) = render_with_subject(&scene, &camera(), 0.0, Order::Depth);
    assert_eq!(whole, render(&scene, &camera(), 0.0, Order::Depth));
    let alone = render(&(&front).into(), &camera(), 0.0, Order::Depth);
    assert!(subject.iter().zip(&alone.pixels).all(|(alpha, pixel)| *alpha == pixel[3]));
    assert!(whole.pixels.iter().zip(&subject).any(|(pixel, alpha)| pixel[3] > 0.5 && *alpha == 0.0));
}

#[test]
fn gaussians_fade_near_the_eye() {
    let alpha = |depth: f32, near: f32| {
        let field = Field { near, ..field(&[Ball::at([0.0, 0.0, depth], WHITE)]) };
        render(&(&field).into(), &camera(), 0.0, Order::Depth).pixel(32, 24)[3]
    };
    for depth in [-1.0, 0.0, 0.3, 0.5] {
        assert_eq!(alpha(depth, 1.0), 0.0, "depth {depth}");
    }
    let whole = alpha(1.0, 1.0);
    assert_eq!(whole, alpha(1.0, 0.0));
    assert!((alpha(0.75, 1.0) / alpha(0.75, 0.0) - 0.5).abs() < 1e-3);
    assert!(alpha(1e-3, 0.0) > 0.5, "nothing fades without a distance");
}

#[test]
fn layers_of_a_clip_are_prefixes_drawn_together() {
    let static_part = field(&[Ball::at([0.0, 0.0, 4.0], RED), Ball::at([0.1, 0.0, 4.0], BLUE)]);
    let dynamic_part = dynamic_field(
        field(&[Ball::at([0.0, 0.1, 3.0], WHITE), Ball::at([0.0, 0.0, 5.0], BLUE)]),
        0.5,
        1.0,
        &[],
    );
    let layers =
        vec![LayerEnd { static_count: 1, dynamic_count: 1 }, LayerEnd { static_count: 2, dynamic_count: 2 }];
    let clip = Clip {
        info: ClipInfo::default(),
        bounds: [[-1.0; 3], [5.0; 3]],
        static_field: static_part.clone(),
        dynamic_field: dynamic_part.clone(),
        layers: layers.clone(),
        layers_announced: layers,
        time_index: TimeIndex::default(),
        plate: None,
    };
    let draw = |scene: RenderScene| render(&scene, &camera(), 0.5, Order::Depth);
    let coarse = (static_part.select(&[0]), dynamic_part.select(&[0]));
    let expected = RenderScene {
        prefixes: vec![FieldPrefix::whole(&coarse.0), FieldPrefix::whole(&coarse.1)],
        plates: Vec::new(),
    };
    assert_eq!(draw(RenderScene::from_layers(&clip, 1)), draw(expected));
    assert_eq!(draw(RenderScene::from_layers(&clip, 0)), draw(RenderScene::from_layers(&clip, 1)));
    assert_eq!(draw(RenderScene::from_layers(&clip, 9)), draw(RenderScene::from(&clip)));
    assert_ne!(draw(RenderScene::from(&clip)), draw(RenderScene::from_layers(&clip, 1)));
    // The moving ball at depth 3 covers the still balls at 4, the ball at 5 does not.
    let mut joined = field(&[]);
    for (part, row) in [(&static_part, 0), (&static_part, 1), (&dynamic_part, 0), (&dynamic_part, 1)] {
        joined.centers.push(part.centers[row]);
        joined.rotations.push(part.rotations[row]);
        joined.log_scales.push(part.log_scales[row]);
        joined.opacities.push(part.opacities[row]);
        joined.sh.push(part.sh[row]);
    }
    assert_eq!(draw(RenderScene::from(&joined)), draw(RenderScene::from(&clip)));
}

#[test]
fn a_take_is_the_union_of_the_segments_that_hold_the_instant() {
    let [red, green, blue] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let balls = [red, green, blue].map(|color| field(&[Ball::at([0.0, 0.0, 2.0], constant(color))]));
    let [first, second, plate] = &balls;
    // Clip times 0.25 and 0.5 of a segment of 2 s from 1 s on.
    let pulse = dynamic_field(second.clone(), 0.25, 0.05, &[[1.0, 0.0, 0.0]]);
    let span = |start_s, duration_s| SceneSpan { take_s: 4.0, start_s, duration_s };
    let take = RenderScene::of_take([
        (span(-1.0, 2.0), RenderScene::from(first).with_plate(plate)),
        (span(1.0, 2.0), RenderScene::from(&pulse)),
        (span(3.0, 1.0), RenderScene::from(first)),
    ]);
    let draw = |scene: &RenderScene, t: f64| render(scene, &camera(), t, Order::Depth);
    let seconds = |t_s: f64| draw(&take, t_s / 4.0);
    assert_eq!(seconds(0.5), draw(&RenderScene::from(first).with_plate(plate), 0.0));
    for t_s in [1.0, 1.5, 2.0, 2.75] {
        assert_eq!(seconds(t_s), draw(&RenderScene::from(&pulse), (t_s - 1.0) / 2.0), "{t_s} s");
    }
    assert_ne!(seconds(1.5), seconds(2.0));
    // The last instant belongs to the last segment, and times are cut to the take.
    for t_s in [3.0, 4.0, 5.0] {
        assert_eq!(seconds(t_s), draw(&RenderScene::from(first), 0.0), "{t_s} s");
    }
    assert_eq!(coverage(&take, &[camera()], 0.125, Radius::Exact).alive, 2);
    assert_eq!(coverage(&take, &[camera()], 0.5, Radius::Exact).alive, 0);
    let held = render_held(&take, &camera(), 0.375, Order::Depth, (&camera(), 0.37));
    assert_eq!(held, seconds(1.5));
    // A segment that spans the take is shown as its clip, also beyond the ends.
    let start = dynamic_field(second.clone(), 0.0, 0.05, &[[1.0, 0.0, 0.0]]);
    let alone = RenderScene::of_take([(span(0.0, 4.0), RenderScene::from(&start))]);
    assert_eq!(draw(&alone, -0.02), draw(&RenderScene::from(&start), -0.02));
    assert_ne!(draw(&alone, -0.02), draw(&alone, 0.0));
}

#[test]
fn the_picture_does_not_depend_on_threads() {
    let field = cloud(2, 800);
    let draw = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| render(&(&field).into(), &camera(), 0.0, Order::Depth))
    };
    let one = draw(1);
    assert!(one.pixels.iter().filter(|p| p[3] > 0.5).count() > 500, "the cloud is seen");
    assert_eq!(one, draw(3));
}

#[test]
fn extreme_numbers_never_give_nan() {
    let mut field = cloud(3, 12);
    field.centers[0] = [3e38, -3e38, 3e38];
    field.centers[1] = [3e38, 0.0, 0.02];
    field.centers[2] = [0.0, 0.0, 0.010001];
    field.log_scales[3] = [88.0, -100.0, 88.0];
    field.log_scales[4] = [3e38; 3];
    field.log_scales[5] = [-3e38; 3];
    field.sh[6 * 4] = [3e38; 3];
    field.opacities[7] = 1.0;
    field.rotations[8] = [0.0; 4];
    let mut field = dynamic_field(field, 0.5, 1e-38, &[[3e38; 3]; 3]);
    let temporal = field.temporal.as_mut().unwrap();
    temporal.rotation_rates = Some(vec![[-3e38, 3e38, 0.0, 0.0]; 12]);
    for row in 0..11 {
        temporal.s[row] = f32::INFINITY;
        temporal.motion[row * 3..row * 3 + 3].fill([0.0; 3]);
    }
    for t in [0.0, 0.5, 1.0, f64::MAX, f64::INFINITY, f64::NAN] {
        for order in [Order::Depth, Order::Radial] {
            let image = render(&(&field).into(), &camera(), t, order);
            assert!(image.pixels.iter().flatten().all(|c| c.is_finite()), "t {t}");
        }
        coverage(&(&field).into(), &[camera()], t, Radius::Fixed(f64::MAX));
    }
}

/// Tests each quad pixel by pixel, with axes from the eigenvalue equation.
#[test]
fn coverage_counts_the_pixel_centres_in_the_quads() {
    let field = cloud(4, 60);
    let rows: Vec<_> = (0..60).map(|row| alive::Alive { row, opacity: field.opacity_at(row, 0.0) }).collect();
    let mut visible = 0;
    for radius in [Radius::Exact, Radius::AtMost(2.0), Radius::Fixed(8f64.sqrt())] {
        let mut expected = Coverage { alive: 0, drawn: 0, fragments: 0 };
        for alive in rows.iter().filter(|alive| alive.opacity >= ALPHA_MIN) {
            expected.alive += 1;
            let Some(splat) = evaluate::evaluate(&field, &[*alive], &camera(), 0.0).pop() else { continue };
            let exact = (2.0 * (255.0 * splat.opacity).ln()).sqrt();
            let r = match radius {
                Radius::Exact => exact,
                Radius::AtMost(most) => exact.min(most),
                Radius::Fixed(r) => r,
            };
            let [xx, xy, yy] = splat.covariance;
            let root = ((xx - yy).powi(2) + 4.0 * xy * xy).sqrt();
            let (long, short) = ((xx + yy + root) / 2.0, (xx + yy - root) / 2.0);
            let axis = dvec2(xy, long - xx).normalize();
            let mut inside = 0;
            for y in 0..HEIGHT {
                for x in 0..WIDTH {
                    let d = dvec2(f64::from(x) + 0.5, f64::from(y) + 0.5) - DVec2::from_array(splat.center);
                    let in_quad =
                        axis.dot(d).abs() <= r * long.sqrt() && axis.perp().dot(d).abs() <= r * short.sqrt();
                    inside += u64::from(in_quad);
                    let q = (yy * d.x * d.x - 2.0 * xy * d.x * d.y + xx * d.y * d.y) / (long * short);
                    let seen = splat.opacity * (-0.5 * q).exp() >= ALPHA_MIN;
                    assert!(in_quad || !seen || radius != Radius::Exact, "a visible pixel is cut off");
                    visible += u64::from(seen && radius == Radius::Exact);
                }
            }
            expected.drawn += usize::from(inside > 0);
            expected.fragments += inside;
        }
        assert_eq!(coverage(&(&field).into(), &[camera()], 0.0, radius), expected, "{radius:?}");
        // Both eyes draw the same Gaussians, and shade the fragments of each.
        let both = coverage(&(&field).into(), &[camera(), camera()], 0.0, radius);
        assert_eq!(both, Coverage { fragments: 2 * expected.fragments, ..expected }, "{radius:?}");
        assert!(expected.drawn > 20 && expected.fragments > 2000);
        if radius == Radius::Exact {
            let ratio = expected.fragments as f64 / visible as f64;
            assert!((1.0..1.5).contains(&ratio), "a quad has 4/pi times the area of its ellipse: {ratio}");
        }
    }
}

/// Compares with pictures in which one Gaussian is white and all others are black.
#[test]
fn contributions_are_the_blending_weights() {
    let mut field = cloud(5, 40);
    field.sh_degree = 0;
    field.sh = vec![constant([0.0; 3]); 40];
    let field = dynamic_field(field, 0.4, 0.5, &[[0.2, 0.1, 0.0]]);
    let t = 0.7;
    let actual = contributions(&field, &camera(), t, Order::Depth);
    assert_eq!(actual.len(), 40);
    let mut seen = 0;
    for (row, actual) in actual.iter().enumerate() {
        let mut lit = field.clone();
        lit.sh[row] = constant([1.0; 3]);
        let image = render(&(&lit).into(), &camera(), t, Order::Depth);
        let weights: Vec<f64> = image.pixels.iter().map(|pixel| pixel[0]).collect();
        let close = |a: f64, b: f64| assert!((a - b).abs() < 1e-4 * (1.0 + b), "row {row}: {a} for {b}");
        close(actual.weight, weights.iter().sum());
        close(actual.weight_max, weights.iter().copied().fold(0.0, f64::max));
        // A Gaussian alone has hits of opacity times its number of pixels.
        let image = render(&(&field.select(&[row])).into(), &camera(), t, Order::Depth);
        let pixels = image.pixels.iter().filter(|pixel| pixel[3] > 0.0).count() as f64;
        let alone = contributions(&field.select(&[row]), &camera(), t, Order::Depth)[0];
        close(alone.hits, pixels * field.opacity_at(row, t));
        assert!(actual.hits <= alone.hits * (1.0 + 1e-12));
        seen += usize::from(actual.weight > 0.1 && actual.hits < alone.hits);
    }
    assert!(seen > 10, "{seen} rows are seen, partly hidden");
}

#[test]
fn contributions_do_not_depend_on_threads() {
    let field = cloud(6, 700);
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| contributions(&field, &camera(), 0.0, Order::Depth))
    };
    assert_eq!(on(1), on(3));
}

#[test]
fn only_the_order_is_held() {
    let scene = cloud(5, 40);
    let scene = RenderScene::from(&scene);
    let here = camera();
    let picture = render(&scene, &here, 0.5, Order::Depth);
    assert_eq!(render_held(&scene, &here, 0.5, Order::Depth, (&here, 0.5)), picture);
    // Red is in front of blue from here, and behind it from the other side.
    let pair = field(&[Ball::at([0.0, 0.0, 2.0], RED), Ball::at([0.0, 0.0, 3.0], BLUE)]);
    let pair = RenderScene::from(&pair);
    let behind = Camera::look_at([0.0, 0.0, 5.0], [0.0, 0.0, 0.0], [0.0, -1.0, 0.0], 0.5, WIDTH, HEIGHT);
    let color = |image: Image| image.pixel(WIDTH / 2, HEIGHT / 2);
    let [red, _, blue, _] = color(render(&pair, &here, 0.0, Order::Depth));
    assert!(red > blue);
    let [red, _, blue, _] = color(render_held(&pair, &here, 0.0, Order::Depth, (&behind, 0.0)));
    assert!(red < blue);
    // Gaussians that were not alive in the earlier frame are missing.
    let late = dynamic_field(field(&[Ball::at([0.0, 0.0, 2.0], RED)]), 0.9, 0.05, &[]);
    let missing = render_held(&(&late).into(), &here, 0.9, Order::Depth, (&here, 0.1));
    assert_eq!(missing, Image::new(WIDTH, HEIGHT));
}
