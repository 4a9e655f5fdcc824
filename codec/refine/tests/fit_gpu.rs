//! The back end for graphics devices against that for the CPU: images, gradients, losses, steps.
//!
//! Without a device the tests are reported as ignored.

#[path = "../src/fit/fixtures.rs"]
mod fixtures;

use std::process::ExitCode;

use codec::{Camera, PixelFilter};
use fixtures::{COLUMN_NAMES, TIMELINE};
use libtest_mimic::{Arguments, Completion, Failed, Trial};
use refine::capture::Response;
use refine::fit::gpu::Gpu;
use refine::fit::{
    Backend, Carried, Cpu, DeviceError, Fit, FitSettings, FrameView, Gradient, Learned, Lpips, Parameters,
    Photograph, Real, RenderedImage, Rig, Run, StepReport, Timeline, TrainingView, WeightTensor, cpu,
};

fn main() -> ExitCode {
    let arguments = Arguments::from_args();
    let trials = vec![
        trial("images match the CPU", images),
        trial("images and gradients of more pairs than the buffers held", many_pairs),
        trial("images of many tiles and of many Gaussians match the CPU", many_tiles_and_rows),
        trial("gradients match the CPU", gradients),
        trial("images and gradients near the camera match the CPU", fading),
        trial("gradients of several losses and views match the CPU", gradients_of_views),
        trial("the loss matches the CPU", losses),
        trial("a step matches the CPU", a_step),
        trial("cameras are learned as on the CPU", cameras),
        trial("a step without a response forgets the response before", forgotten),
        trial("a fit is reproducible bit by bit", repeatable),
        trial("fifty steps stay close to the CPU", fifty_steps),
        trial("steps that follow one with too many pairs begin again", too_many_pairs),
        trial("nothing waits within a step", in_flight),
        trial("steps in flight are those of a device that waits", in_flight_as_one_by_one),
        trial("capacity control follows the CPU", controls),
        trial("a training state survives the round trip", round_trip),
        trial("nothing visible renders black", nothing),
        trial("extreme parameters give finite results", extremes),
        trial("a non-finite gradient is contained", contained),
        trial("LPIPS is a term of the loss", perceptual),
        trial("a buffer that is too large is an error", too_large),
    ];
    libtest_mimic::run(&arguments, trials).exit_code()
}

/// A test that is ignored without a device.
fn trial(name: &'static str, test: fn(Gpu) -> Result<(), DeviceError>) -> Trial {
    Trial::ignorable_test(name, move || match Gpu::open() {
        Ok(gpu) => {
            println!("{}", gpu.name());
            test(gpu).map(|()| Completion::Completed).map_err(Failed::from)
        }
        Err(error) => Ok(Completion::ignored_with(error)),
    })
}

/// More tiles than a digit has values, then more rows than the groups of a sort take in one turn.
fn many_tiles_and_rows(mut gpu: Gpu) -> Result<(), DeviceError> {
    let large = camera(320, 280);
    let parameters = static_cloud(50, 300, 0);
    gpu.load(parameters.clone().into())?;
    let view = FrameView { camera: &large, time: 0.0 };
    assert_images(&mut gpu, &parameters, &view, "many tiles");
    let weights = weights(&large);
    let expected = cpu::render(&parameters, &view).backward(&parameters, &view, &weights, true);
    assert_gradients(&gpu.gradient(&view, &weights, true)?, &expected, "many tiles");
    let small = camera(48, 40);
    let mut parameters = static_cloud(51, 70_000, 0);
    parameters.log_scales.iter_mut().flatten().for_each(|x| *x -= 2.5);
    gpu.load(parameters.clone().into())?;
    assert_images(&mut gpu, &parameters, &FrameView { camera: &small, time: 0.0 }, "many rows");
    Ok(())
}

/// The camera of the fixtures, with its optical axis away from the centre of the image.
fn camera(width: u32, height: u32) -> Camera {
    let mut camera = fixtures::camera(width, height);
    camera.k[0][2] += 0.11 * f64::from(width);
    camera.k[1][2] -= 0.07 * f64::from(height);
    camera
}

fn cloud(seed: u64, count: usize, sh_degree: u8) -> Parameters<f32> {
    Parameters::from_field(&fixtures::cloud(seed, count, sh_degree), TIMELINE)
}

/// [`cloud`] without time.
fn static_cloud(seed: u64, count: usize, sh_degree: u8) -> Parameters<f32> {
    let cloud = cloud(seed, count, sh_degree);
    Parameters {
        tau: Vec::new(),
        log_widths: Vec::new(),
        motion_order: 0,
        motion: Vec::new(),
        rotation_rates: Vec::new(),
        ..cloud
    }
}

/// The same Gaussians with the mip filter.
fn compensated(parameters: &Parameters<f32>) -> Parameters<f32> {
    Parameters { filter: PixelFilter::Mip, ..parameters.clone() }
}

fn largest_difference(a: &RenderedImage<f32>, b: &RenderedImage<f32>) -> f32 {
    assert_eq!((a.width, a.height, a.pixels.len()), (b.width, b.height, b.pixels.len()));
    let pairs = a.pixels.as_flattened().iter().zip(b.pixels.as_flattened());
    pairs.map(|(a, b)| (a - b).abs()).fold(0.0, |most, x| if x > most || x.is_nan() { x } else { most })
}

fn assert_images(gpu: &mut Gpu, parameters: &Parameters<f32>, view: &FrameView, what: &str) {
    let expected = cpu::render(parameters, view).image;
    let visible = expected.pixels.iter().filter(|pixel| pixel[3] > 0.5).count();
    assert!(visible * 5 > expected.pixels.len(), "{what}: much is visible");
    let worst = largest_difference(&gpu.render(view).unwrap(), &expected);
    println!("{what}: {worst:e}");
    assert!(worst <= 1e-4, "{what}: {worst:e}");
}

fn images(mut gpu: Gpu) -> Result<(), DeviceError> {
    for (degree, frame, size) in
        [(3, 3.3, [64, 64]), (2, 0.0, [77, 53]), (1, 8.0, [16, 90]), (0, 4.5, [33, 20])]
    {
        let parameters = cloud(u64::from(degree) + 1, 500, degree);
        gpu.load(parameters.clone().into())?;
        let camera = camera(size[0], size[1]);
        let view = FrameView { camera: &camera, time: frame };
        assert_images(&mut gpu, &parameters, &view, &format!("degree {degree}, {size:?}"));
        let parameters = static_cloud(u64::from(degree) + 1, 500, degree);
        gpu.load(parameters.clone().into())?;
        assert_images(&mut gpu, &parameters, &view, &format!("static, degree {degree}, {size:?}"));
        let parameters = compensated(&parameters);
        gpu.load(parameters.clone().into())?;
        assert_images(&mut gpu, &parameters, &view, &format!("compensated, degree {degree}, {size:?}"));
    }
    Ok(())
}

fn many_pairs(mut gpu: Gpu) -> Result<(), DeviceError> {
    let mut parameters = static_cloud(5, 1500, 0);
    parameters.log_scales.fill([-0.5, -0.9, -0.7]);
    parameters.logits.iter_mut().for_each(|logit| *logit -= 2.0);
    gpu.load(parameters.clone().into())?;
    let camera = camera(150, 90);
    let view = FrameView { camera: &camera, time: 0.0 };
    assert_images(&mut gpu, &parameters, &view, "many pairs");
    // Opaque Gaussians saturate most tiles after a few splats.
    let mut opaque = parameters;
    opaque.logits.fill(6.0);
    let weights = weights(&camera);
    let mut fresh = Gpu::open()?;
    fresh.load(opaque.clone().into())?;
    let expected = cpu::render(&opaque, &view).backward(&opaque, &view, &weights, true);
    for what in ["many pairs", "many pairs again"] {
        assert_gradients(&fresh.gradient(&view, &weights, true)?, &expected, what);
    }
    Ok(())
}

fn weights(camera: &Camera) -> Vec<[f32; 4]> {
    fixtures::weights((camera.width * camera.height) as usize)
}

/// Name and numbers of each column.
fn columns(parameters: &Parameters<f32>) -> impl Iterator<Item = (&'static str, &[f32])> {
    COLUMN_NAMES.into_iter().zip(parameters.columns())
}

/// Norm of the difference of two columns, relative to the norm of the second.
fn relative(a: &[f32], b: &[f32]) -> f64 {
    assert_eq!(a.len(), b.len());
    let norm = |x: &mut dyn Iterator<Item = f64>| x.map(|x| x * x).sum::<f64>().sqrt();
    let differences = norm(&mut a.iter().zip(b).map(|(a, b)| f64::from(*a) - f64::from(*b)));
    let length = norm(&mut b.iter().map(|b| f64::from(*b)));
    if length > 0.0 { differences / length } else { differences }
}

fn assert_gradients(found: &Gradient<f32>, expected: &Gradient<f32>, what: &str) {
    assert_eq!(found.rows, expected.rows, "{what}");
    assert_eq!(found.non_finite, expected.non_finite, "{what}");
    for ((name, a), (_, b)) in columns(&found.values).zip(columns(&expected.values)) {
        let error = relative(a, b);
        println!("{what}: {name} {error:e}");
        assert!(error <= 1e-3, "{what}: {name} {error:e}");
    }
    let [view, expected_view] = [&found.view, &expected.view]
        .map(|view| [&[view.time, view.log_focal][..], &view.rotation, &view.translation].concat());
    let error = relative(&view, &expected_view);
    assert!(error <= 1e-3, "{what}: view {error:e}");
    let error = relative(&found.screen, &expected.screen);
    assert!(error <= 1e-3, "{what}: screen {error:e}");
}

fn gradients(mut gpu: Gpu) -> Result<(), DeviceError> {
    for (degree, frame, size, detach_tau) in [
        (3, 3.3, [64, 64], true),
        (3, 4.0, [64, 64], false),
        (1, 8.0, [77, 53], false),
        (0, 0.0, [77, 53], true),
    ] {
        let camera = camera(size[0], size[1]);
        let view = FrameView { camera: &camera, time: frame };
        let weights = weights(&camera);
        let clouds = [cloud(20 + u64::from(degree), 500, degree), static_cloud(30, 500, degree)];
        for parameters in clouds.into_iter().flat_map(|cloud| [compensated(&cloud), cloud]) {
            gpu.load(parameters.clone().into())?;
            let expected = cpu::render(&parameters, &view).backward(&parameters, &view, &weights, detach_tau);
            assert!(expected.rows.len() > 250, "{} are drawn", expected.rows.len());
            let found = gpu.gradient(&view, &weights, detach_tau)?;
            assert_gradients(&found, &expected, &format!("degree {degree}, frame {frame}, {detach_tau}"));
            // The first call leaves no trace.
            let again = gpu.gradient(&view, &weights, detach_tau)?;
            assert_gradients(&again, &expected, "again");
        }
    }
    Ok(())
}

/// Most of the cloud fades: the camera is 4 from its middle.
fn fading(mut gpu: Gpu) -> Result<(), DeviceError> {
    let camera = camera(64, 64);
    let view = FrameView { camera: &camera, time: 3.3 };
    let weights = weights(&camera);
    for (what, parameters) in [
        ("moving", cloud(20, 500, 2)),
        ("static", static_cloud(30, 500, 1)),
        ("compensated", compensated(&cloud(20, 2000, 2))),
        ("partly behind", {
            let behind = (0..500).map(|row| row % 2 == 0).collect();
            Parameters { behind, ..cloud(20, 500, 2) }
        }),
    ] {
        let near = 4.5;
        let faded = Parameters { near, ..parameters.clone() };
        gpu.load(faded.clone().into())?;
        assert_images(&mut gpu, &faded, &view, what);
        let forward = cpu::render(&faded, &view);
        let [x, y, z, w] = camera.camera_from_world[2];
        let is_in_ramp = |center: &&[f32; 3]| {
            let [a, b, c] = center.map(f64::from);
            (0.55 * near..near).contains(&(x * a + y * b + z * c + w))
        };
        let in_ramp = faded.centers.iter().filter(is_in_ramp).count();
        assert!(in_ramp > 200, "{what}: {in_ramp} are in the ramp");
        let expected = forward.backward(&faded, &view, &weights, false);
        assert_gradients(&gpu.gradient(&view, &weights, false)?, &expected, what);
        // What the distance changes is larger than what is tolerated.
        let whole = cpu::render(&parameters, &view);
        let difference = largest_difference(&whole.image, &forward.image);
        assert!(difference > 0.1, "{what}: {difference}");
    }
    Ok(())
}

/// Two losses in two views of unlike sizes, of one cloud and then of another, whose buffers are reused.
fn gradients_of_views(mut gpu: Gpu) -> Result<(), DeviceError> {
    let cameras = [camera(64, 64), camera(77, 53)];
    let views = [(&cameras[0], 3.3), (&cameras[1], 8.0)].map(|(camera, time)| FrameView { camera, time });
    let of_pixels = |i: usize, pixels: &[[f32; 4]]| {
        let weights = weights(&cameras[i]);
        let squares = pixels.iter().map(|pixel| pixel.map(|x| 0.5 - x));
        vec![squares.collect(), weights]
    };
    for parameters in [cloud(20, 500, 2), cloud(21, 500, 2)] {
        let results = |backend: &mut dyn Backend| -> Result<_, DeviceError> {
            let (mut images, mut gradients) = (Vec::new(), Vec::new());
            backend.load(parameters.clone().into())?;
            backend.render_each(&views, &mut |image| images.push(image))?;
            backend.gradients(&views, &of_pixels, &mut |of_view| gradients.push(of_view))?;
            Ok((images, gradients))
        };
        let (found, expected) = (results(&mut gpu)?, results(&mut Cpu::default())?);
        for (i, (found, expected)) in found.0.iter().zip(&expected.0).enumerate() {
            assert!(largest_difference(found, expected) <= 1e-4, "view {i}");
        }
        for (i, (found, expected)) in found.1.iter().zip(&expected.1).enumerate() {
            assert_eq!((found.len(), expected.len()), (2, 2), "view {i}");
            for (k, (found, expected)) in found.iter().zip(expected).enumerate() {
                assert_gradients(found, expected, &format!("view {i}, loss {k}"));
            }
        }
    }
    Ok(())
}

/// Renderings of another cloud as photographs. A corner is invalid.
fn training_views(size: [u32; 2], frames: &[f64]) -> Vec<TrainingView> {
    let target = cloud(77, 300, 0);
    let view = |frame: &f64| {
        let camera = camera(size[0], size[1]);
        let image = cpu::render(&target, &FrameView { camera: &camera, time: *frame }).image;
        let byte = |x: f32| (x.clamp(0.0, 1.0) * 255.0) as u8;
        let photograph = Photograph {
            width: size[0],
            height: size[1],
            pixels: image.pixels.iter().map(|pixel| pixel.map(byte)).collect(),
            valid: (0..size[0] * size[1]).map(|i| i % size[0] > 4 || i / size[0] > 9).collect(),
        };
        TrainingView { camera_id: 0, camera, time: *frame, photograph }
    };
    frames.iter().map(view).collect()
}

fn settings(steps: u64) -> FitSettings {
    // High, so that it shows in a few steps.
    let fragment_weight = 0.03;
    FitSettings { steps, floor: 0, fragment_weight, seed: 3, ..FitSettings::default() }
}

/// Fits `parameters` to `views` for `count` of `steps`. Returns the fit and the reports.
fn fitted(
    backend: &mut dyn Backend,
    parameters: &Parameters<f32>,
    views: &[TrainingView],
    [count, steps]: [u64; 2],
    lpips: Option<&Lpips<f32>>,
) -> Result<(Fit, Vec<StepReport>), DeviceError> {
    run_of(backend, new_fit(parameters, views, steps), views, count, lpips)
}

fn new_fit(parameters: &Parameters<f32>, views: &[TrainingView], steps: u64) -> Fit {
    Fit::new(settings(steps), parameters.clone(), TIMELINE, views.iter().map(|view| &view.camera))
}

/// Takes `count` steps of `fit`.
fn run_of(
    backend: &mut dyn Backend,
    fit: Fit,
    views: &[TrainingView],
    count: u64,
    lpips: Option<&Lpips<f32>>,
) -> Result<(Fit, Vec<StepReport>), DeviceError> {
    let mut run = Run::start(fit, backend)?;
    let all: Vec<&TrainingView> = views.iter().collect();
    let mut reports = Vec::new();
    for _ in 0..count {
        reports.extend(run.step(&all, lpips)?);
    }
    reports.extend(run.settle()?);
    Ok((run.pause()?, reports))
}

fn losses(mut gpu: Gpu) -> Result<(), DeviceError> {
    for size in [[64, 64], [77, 53], [5, 90]] {
        let (views, parameters) = (training_views(size, &[4.0]), cloud(40, 400, 3));
        let (_, expected) = fitted(&mut Cpu::default(), &parameters, &views, [1, 100], None)?;
        let (_, found) = fitted(&mut gpu, &parameters, &views, [1, 100], None)?;
        let (a, b) = (found[0], expected[0]);
        println!("{size:?}: {} for {}", a.loss, b.loss);
        assert!((a.loss / b.loss - 1.0).abs() < 1e-5, "{size:?}: {} for {}", a.loss, b.loss);
        assert_eq!((a.drawn, a.non_finite), (b.drawn, b.non_finite));
    }
    Ok(())
}

/// The columns of a fit, in single precision.
fn parameters_of(fit: &Fit) -> Parameters<f32> {
    Parameters::from_field(&fit.to_field(), TIMELINE)
}

fn a_step(mut gpu: Gpu) -> Result<(), DeviceError> {
    let views = training_views([64, 64], &[4.0]);
    let pasts = |row: usize| match row % 4 {
        0 => Carried::NONE,
        1 => Carried { share: 0.25, ..Carried::NONE },
        2 => Carried { share: 0.5, is_static: true, ..Carried::NONE },
        _ => Carried::FIXED,
    };
    let dynamic = cloud(41, 500, 3);
    let carried = (0..dynamic.len()).map(pasts).collect();
    let cases = [("dynamic", dynamic.clone(), None), ("static", static_cloud(41, 500, 0), None)];
    for (what, start, carried) in cases.into_iter().chain([("carried", dynamic, Some(carried))]) {
        let fit = new_fit(&start, &views, 100);
        let fit = match carried {
            Some(carried) => fit.carrying(carried),
            None => fit,
        };
        let expected = run_of(&mut Cpu::default(), fit.clone(), &views, 1, None)?.0;
        let found = run_of(&mut gpu, fit.clone(), &views, 1, None)?.0;
        let none = parameters_of(&fit);
        let (found, expected) = (parameters_of(&found), parameters_of(&expected));
        let all = columns(&found).zip(columns(&expected)).zip(columns(&none));
        for (((name, a), (_, b)), (_, before)) in all {
            let moved = |to: &[f32]| -> Vec<f32> { to.iter().zip(before).map(|(x, y)| x - y).collect() };
            let error = relative(&moved(a), &moved(b));
            println!("{what}: {name} {error:e}");
            assert!(error <= 1e-4, "{what}: {name} {error:e}");
        }
    }
    Ok(())
}

/// Photographs of two cameras. One camera is late, elsewhere and dim.
fn cameras(mut gpu: Gpu) -> Result<(), DeviceError> {
    let dim = Response { vignette: -0.2, ..Response::NEUTRAL };
    let learned =
        Learned { offsets: true, gains: false, colors: true, exposures: true, poses: true, focals: true };
    let views = training_views([77, 53], &[0.0, 2.0, 4.0, 6.0]);
    let views: Vec<TrainingView> =
        (0..).zip(views).map(|(i, view)| TrainingView { camera_id: i % 2, ..view }).collect();
    let start = cloud(46, 500, 2);
    let rig = Rig::new(learned, vec![Response::NEUTRAL, dim], 0);
    let fit = new_fit(&start, &views, 1000).seen_by(rig);
    let (by_cpu, expected) = run_of(&mut Cpu::default(), fit.clone(), &views, 40, None)?;
    let (by_gpu, found) = run_of(&mut gpu, fit, &views, 40, None)?;
    let numbers = |report: &StepReport| report.camera.expect("cameras are learned").map(|x| x as f32);
    for step in 0..2 {
        let (a, b) = (numbers(&found[step]), numbers(&expected[step]));
        for (what, range) in
            [("time", 0..1), ("pose", 1..7), ("focal", 7..8), ("colours", 8..20), ("vignette", 20..21)]
        {
            let error = relative(&a[range.clone()], &b[range]);
            println!("step {step}: {what} {error:e}");
            assert!(error <= 1e-2, "step {step}: {what} {error:e}");
        }
    }
    let [a, b] = [&by_gpu, &by_cpu].map(|fit| fit.rig().expect("a rig"));
    // The mean of the clocks stays.
    assert!((b.late(0) + b.late(1)).abs() < 1e-12 && b.late(1).abs() > 0.01, "{}", b.late(1));
    assert!((a.late(1) - b.late(1)).abs() < 0.1 * b.late(1).abs(), "{} {}", a.late(1), b.late(1));
    let [dim_a, dim_b] = [a, b].map(|rig| rig.response(1).vignette);
    assert!((dim_b + 0.2).abs() > 1e-3 && (dim_a - dim_b).abs() < 1e-5, "{dim_a} {dim_b}");
    Ok(())
}

fn forgotten(mut gpu: Gpu) -> Result<(), DeviceError> {
    let (views, start) = (training_views([64, 64], &[4.0]), cloud(47, 500, 2));
    let dim = Response { vignette: -0.5, ..Response::NEUTRAL };
    let seen = new_fit(&start, &views, 100).seen_by(Rig::new(Learned::default(), vec![dim], 0));
    run_of(&mut gpu, seen, &views, 1, None)?;
    let (_, found) = fitted(&mut gpu, &start, &views, [1, 100], None)?;
    let (_, expected) = fitted(&mut Cpu::default(), &start, &views, [1, 100], None)?;
    let (a, b) = (found[0].loss, expected[0].loss);
    assert!((a / b - 1.0).abs() < 1e-5, "{a} for {b}");
    Ok(())
}

fn fifty_steps(mut gpu: Gpu) -> Result<(), DeviceError> {
    let (views, start) = (training_views([64, 64], &[0.0, 4.0, 8.0]), cloud(42, 500, 2));
    let (by_cpu, expected) = fitted(&mut Cpu::default(), &start, &views, [50, 1000], None)?;
    let (by_gpu, found) = fitted(&mut gpu, &start, &views, [50, 1000], None)?;
    let (last, first) = (found[49].loss, found[1].loss);
    println!("loss {first} to {last}, on the CPU {}", expected[49].loss);
    assert!(last < 0.8 * first, "{first} {last}");
    for (a, b) in found.iter().zip(&expected) {
        assert!((a.loss / b.loss - 1.0).abs() < 1e-3, "{} for {}", a.loss, b.loss);
    }
    let [a, b] = [&by_gpu, &by_cpu].map(|fit| cpu::render(&parameters_of(fit), &views[1].view()).image);
    let squares = a.pixels.as_flattened().iter().zip(b.pixels.as_flattened()).map(|(a, b)| (a - b).powi(2));
    let rms = (squares.sum::<f32>() / a.pixels.len() as f32).sqrt();
    println!("root mean square difference {rms:e}");
    // A first step has the length of the learning rate even if the gradient is rounding noise.
    assert!(rms < 1e-2, "{rms:e}");
    Ok(())
}

fn repeatable(mut gpu: Gpu) -> Result<(), DeviceError> {
    let (views, start) = (training_views([64, 64], &[0.0, 4.0, 8.0]), cloud(45, 500, 1));
    let mut run = || Ok(fitted(&mut gpu, &start, &views, [30, 1000], None)?.0);
    let first = run()?;
    assert!(first == run()?, "bit by bit");
    Ok(())
}

fn too_many_pairs(mut gpu: Gpu) -> Result<(), DeviceError> {
    let views = training_views([160, 120], &[0.0, 2.0, 4.0, 6.0]);
    let learned = Learned { offsets: true, colors: true, ..Learned::default() };
    let mut start = cloud(48, 3000, 1);
    start.log_scales.fill([-1.0, -1.2, -1.5]);
    let rig = Rig::new(learned, vec![Response::NEUTRAL], 0);
    let fit = new_fit(&start, &views, 1000).seen_by(rig);
    let (expected, reported) = run_of(&mut gpu, fit.clone(), &views, 12, None)?;
    let grown = gpu.counts();
    assert!(grown.repeats > 0, "the first buffers are too small: {grown:?}");
    let (found, reports) = run_of(&mut gpu, fit, &views, 12, None)?;
    assert_eq!(gpu.counts().repeats, grown.repeats, "the buffers have grown");
    assert!(found == expected, "bit by bit");
    assert!(reports == reported && reports.len() == 12);
    Ok(())
}

fn in_flight(mut gpu: Gpu) -> Result<(), DeviceError> {
    let (views, start) = (training_views([64, 64], &[0.0, 4.0, 8.0]), cloud(42, 500, 2));
    let mut run = Run::start(new_fit(&start, &views, 1000), &mut gpu)?;
    let all: Vec<&TrainingView> = views.iter().collect();
    for step in 0..50 {
        let ended = run.step(&all, None)?.len();
        assert_eq!(ended, usize::from(step >= 2), "two steps are in flight");
    }
    assert_eq!(run.settle()?.len(), 2);
    drop(run);
    let counts = gpu.counts();
    println!("{counts:?}");
    assert_eq!((counts.steps, counts.submissions, counts.waits, counts.repeats), (50, 50, 1, 0));
    assert!(counts.dispatches <= 25 * counts.steps);
    Ok(())
}

/// A fit whose photographs grow and whose last view has many more pairs, with pictures taken between steps.
fn in_flight_as_one_by_one(mut gpu: Gpu) -> Result<(), DeviceError> {
    let mut start = cloud(49, 1500, 1);
    start.log_scales.iter_mut().flatten().for_each(|x| *x += 1.2);
    let [small, large] = [[40, 30], [192, 144]].map(|size| training_views(size, &[0.0, 4.0, 8.0]));
    let rig = Rig::new(Learned { colors: true, ..Learned::default() }, vec![Response::NEUTRAL], 0);
    let fit = new_fit(&start, &large, 1000).seen_by(rig);
    let run = |gpu: &mut Gpu, waits: bool| -> Result<_, DeviceError> {
        let mut run = Run::start(fit.clone(), gpu)?;
        let mut reports = Vec::new();
        for step in 0..14 {
            let views: Vec<&TrainingView> = if step < 5 { &small } else { &large }.iter().collect();
            reports.extend(run.step(&views, None)?);
            if waits {
                reports.extend(run.settle()?);
            }
            if step == 9 {
                run.render(&large[0])?;
            }
        }
        reports.extend(run.settle()?);
        Ok((run.pause()?, reports))
    };
    let (fit_in_flight, reports_in_flight) = run(&mut gpu, false)?;
    let repeats = gpu.counts().repeats;
    assert!(repeats > 1, "several steps began again: {repeats}");
    let (fit_one_by_one, reports_one_by_one) = run(&mut Gpu::open()?, true)?;
    assert!(reports_in_flight == reports_one_by_one, "{reports_in_flight:?}\n{reports_one_by_one:?}");
    assert!(fit_in_flight == fit_one_by_one, "bit by bit");
    Ok(())
}

fn controls(mut gpu: Gpu) -> Result<(), DeviceError> {
    // A control at step 100 of 1000, another at 200.
    let (views, start) = (training_views([48, 48], &[4.0]), cloud(43, 300, 0));
    let (by_cpu, _) = fitted(&mut Cpu::default(), &start, &views, [210, 1000], None)?;
    let (by_gpu, found) = fitted(&mut gpu, &start, &views, [210, 1000], None)?;
    println!("{} and {} of {}", by_gpu.len(), by_cpu.len(), start.len());
    assert!(by_cpu.len() != start.len(), "a control changed the count");
    assert!(by_gpu.len().abs_diff(by_cpu.len()) * 20 <= by_cpu.len(), "{} {}", by_gpu.len(), by_cpu.len());
    assert!(found[209].loss < found[0].loss);
    Ok(())
}

fn round_trip(mut gpu: Gpu) -> Result<(), DeviceError> {
    let views = training_views([48, 48], &[4.0]);
    for parameters in [cloud(44, 300, 2), static_cloud(44, 301, 0), cloud(44, 0, 1)] {
        let (fit, _) = fitted(&mut Cpu::default(), &parameters, &views, [3, 100], None)?;
        assert!(Run::start(fit.clone(), &mut gpu)?.pause()? == fit, "bit by bit");
    }
    Ok(())
}

fn nothing(mut gpu: Gpu) -> Result<(), DeviceError> {
    let camera = camera(40, 30);
    let views = training_views([40, 30], &[1e4]);
    for parameters in [cloud(12, 0, 1), cloud(12, 20, 1)] {
        gpu.load(parameters.clone().into())?;
        let view = FrameView { camera: &camera, time: 1e4 };
        assert_eq!(gpu.render(&view)?.pixels, vec![[0.0; 4]; 40 * 30]);
        let gradient = gpu.gradient(&view, &weights(&camera), true)?;
        assert!(gradient.rows.is_empty() && gradient.non_finite == 0);
        let (fit, reports) = fitted(&mut gpu, &parameters, &views, [2, 100], None)?;
        assert_eq!((reports[1].drawn, reports[1].non_finite), (0, 0));
        assert_eq!(fit.to_field(), fitted(&mut gpu, &parameters, &views, [0, 100], None)?.0.to_field());
    }
    Ok(())
}

fn extremes(mut gpu: Gpu) -> Result<(), DeviceError> {
    let camera = camera(40, 30);
    let view = FrameView { camera: &camera, time: 4.0 };
    let (plain, mip) = (cloud(9, 40, 3), compensated(&cloud(9, 40, 3)));
    let mut check = |extreme: &Parameters<f32>, view: &FrameView| -> Result<(), DeviceError> {
        gpu.load(extreme.clone().into())?;
        let image = gpu.render(view)?;
        assert!(image.pixels.as_flattened().iter().all(|x| x.is_finite()));
        let gradient = gpu.gradient(view, &weights(&camera), true)?;
        let numbers = gradient.values.columns().concat();
        assert!(numbers.iter().chain(&gradient.screen).all(|x| x.is_finite()));
        let expected = cpu::render(extreme, view).backward(extreme, view, &weights(&camera), true);
        assert_eq!(gradient.rows, expected.rows, "the same are drawn");
        Ok(())
    };
    for plain in [&plain, &mip] {
        check(&fixtures::around_the_camera(plain, &camera), &view)?;
        for extreme in fixtures::with_extreme_numbers(plain) {
            check(&extreme, &view)?;
        }
    }
    for frame in fixtures::EXTREME_FRAMES {
        check(&plain, &FrameView { camera: &camera, time: frame })?;
    }
    Ok(())
}

fn contained(mut gpu: Gpu) -> Result<(), DeviceError> {
    let camera = camera(40, 30);
    let view = FrameView { camera: &camera, time: 4.0 };
    let parameters = cloud(10, 200, 1);
    gpu.load(parameters.clone().into())?;
    let mut by_pixels = weights(&camera);
    let good = gpu.gradient(&view, &by_pixels, true)?;
    by_pixels[15 * 40 + 20][1] = f32::NAN;
    let bad = gpu.gradient(&view, &by_pixels, true)?;
    assert!(
        bad.non_finite > 0 && bad.non_finite < bad.rows.len(),
        "{} of {}",
        bad.non_finite,
        bad.rows.len()
    );
    let cleared: Vec<usize> =
        (0..bad.rows.len()).filter(|row| bad.values.select(&[*row]) == parameters.zeros(1)).collect();
    assert!(cleared.len() >= bad.non_finite, "{} of {}", cleared.len(), bad.non_finite);
    let others: Vec<usize> = (0..bad.rows.len()).filter(|row| !cleared.contains(row)).collect();
    assert!(others.len() > 50, "{} are left", others.len());
    let (bad, good) = (bad.values.select(&others), good.values.select(&others));
    for ((name, a), (_, b)) in columns(&bad).zip(columns(&good)) {
        assert!(relative(a, b) < 1e-5, "{name}");
    }
    Ok(())
}

/// LPIPS by the AlexNet of the fixtures.
fn alexnet() -> Lpips<f32> {
    Lpips::new(&fixtures::alexnet()).expect("all tensors are there")
}

fn perceptual(mut gpu: Gpu) -> Result<(), DeviceError> {
    let (views, start, lpips) = (training_views([48, 48], &[4.0]), cloud(45, 400, 1), alexnet());
    let (_, expected) = fitted(&mut Cpu::default(), &start, &views, [4, 100], Some(&lpips))?;
    let (_, found) = fitted(&mut gpu, &start, &views, [4, 100], Some(&lpips))?;
    let (_, without) = fitted(&mut gpu, &start, &views, [1, 100], None)?;
    assert!(found[0].loss > without[0].loss + 1e-3, "{} {}", found[0].loss, without[0].loss);
    for (a, b) in found.iter().zip(&expected) {
        println!("{} for {}", a.loss, b.loss);
        assert!((a.loss / b.loss - 1.0).abs() < 1e-3, "{} for {}", a.loss, b.loss);
    }
    Ok(())
}

fn too_large(mut gpu: Gpu) -> Result<(), DeviceError> {
    // 9 floats per pixel are 39 GB.
    gpu.load(cloud(46, 10, 0).into())?;
    let [large, small] = [1 << 15, 16].map(|side| camera(side, side));
    match gpu.render(&FrameView { camera: &large, time: 0.0 }) {
        Err(error @ DeviceError::TooLarge { .. }) => println!("{error}"),
        other => panic!("{other:?}"),
    }
    // The device still works.
    gpu.render(&FrameView { camera: &small, time: 0.0 })?;
    Ok(())
}
