//! The graphics device's back end of fits against the CPU's: pictures, gradients, losses, steps.
//!
//! Ignored, visibly, where there is no device.

use std::process::ExitCode;

use codec::{Camera, Field, Temporal, sh_coefficients};
use libtest_mimic::{Arguments, Completion, Failed, Trial};
use refine::fit::gpu::Gpu;
use refine::fit::{
    Backend, Cpu, DensityRule, DeviceError, Fit, FitSettings, FrameView, Gradient, Lpips, Parameters,
    Photograph, RenderedImage, Run, StepReport, Timeline, TrainingView, cpu,
};

const TIMELINE: Timeline = Timeline { frames: 9 };

fn main() -> ExitCode {
    let arguments = Arguments::from_args();
    let trials = vec![
        trial("pictures are those of the CPU", pictures),
        trial("pictures and gradients of more pairs than there was room for", many_pairs),
        trial("gradients are those of the CPU", gradients),
        trial("the loss is that of the CPU", losses),
        trial("a step is that of the CPU", a_step),
        trial("the same fit comes out the same each time", repeatable),
        trial("fifty steps stay close to those of the CPU", fifty_steps),
        trial("the number of Gaussians changes as on the CPU", controls),
        trial("what was loaded comes back", round_trip),
        trial("nothing makes a black picture", nothing),
        trial("extreme numbers make no others", extremes),
        trial("a gradient that is not finite is contained", contained),
        trial("LPIPS is a part of the loss", perceptual),
        trial("what is too large is said", too_large),
    ];
    libtest_mimic::run(&arguments, trials).exit_code()
}

/// A test that needs a device, ignored where there is none.
fn trial(name: &'static str, test: fn(Gpu) -> Result<(), DeviceError>) -> Trial {
    Trial::ignorable_test(name, move || match Gpu::open() {
        Ok(gpu) => {
            println!("{}", gpu.name());
            test(gpu).map(|()| Completion::Completed).map_err(Failed::from)
        }
        Err(error) => Ok(Completion::ignored_with(error)),
    })
}

/// A camera from the front left, whose optical axis does not meet the image's middle.
fn camera(width: u32, height: u32) -> Camera {
    let mut camera =
        Camera::look_at([-0.7, -0.4, -4.0], [0.1, 0.0, 0.0], [0.1, -1.0, 0.0], 0.8, width, height);
    camera.k[0][2] += 0.11 * f64::from(width);
    camera.k[1][2] -= 0.07 * f64::from(height);
    camera
}

/// Moving, turning, overlapping needles and discs, partly outside the image or faded out.
fn cloud(seed: u64, count: usize, sh_degree: u8) -> Parameters<f32> {
    let mut random = fastrand::Rng::with_seed(seed);
    let mut signed = |scale: f32| (random.f32() * 2.0 - 1.0) * scale;
    let mut field = Field { sh_degree, ..Field::default() };
    let mut temporal = Temporal { motion_order: 3, rotation_rates: Some(Vec::new()), ..Temporal::default() };
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
        temporal.rotation_rates.as_mut().unwrap().push([signed(1.0), signed(1.0), signed(1.0), signed(1.0)]);
    }
    field.temporal = Some(temporal);
    Parameters::from_field(&field, TIMELINE)
}

/// The same without time.
fn still(seed: u64, count: usize, sh_degree: u8) -> Parameters<f32> {
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

fn largest_difference(a: &RenderedImage<f32>, b: &RenderedImage<f32>) -> f32 {
    assert_eq!((a.width, a.height, a.pixels.len()), (b.width, b.height, b.pixels.len()));
    let pairs = a.pixels.as_flattened().iter().zip(b.pixels.as_flattened());
    pairs.map(|(a, b)| (a - b).abs()).fold(0.0, |most, x| if x > most || x.is_nan() { x } else { most })
}

fn assert_pictures(gpu: &mut Gpu, parameters: &Parameters<f32>, view: &FrameView, what: &str) {
    let expected = cpu::render(parameters, view).image;
    let seen = expected.pixels.iter().filter(|pixel| pixel[3] > 0.5).count();
    assert!(seen * 5 > expected.pixels.len(), "{what}: much is seen");
    let worst = largest_difference(&gpu.render(view).unwrap(), &expected);
    println!("{what}: {worst:e}");
    assert!(worst <= 1e-4, "{what}: {worst:e}");
}

fn pictures(mut gpu: Gpu) -> Result<(), DeviceError> {
    for (degree, frame, size) in
        [(3, 3.3, [64, 64]), (2, 0.0, [77, 53]), (1, 8.0, [16, 90]), (0, 4.5, [33, 20])]
    {
        let parameters = cloud(u64::from(degree) + 1, 500, degree);
        gpu.load(parameters.clone().into())?;
        let camera = camera(size[0], size[1]);
        let view = FrameView { camera: &camera, frame };
        assert_pictures(&mut gpu, &parameters, &view, &format!("degree {degree}, {size:?}"));
        let parameters = still(u64::from(degree) + 1, 500, degree);
        gpu.load(parameters.clone().into())?;
        assert_pictures(&mut gpu, &parameters, &view, &format!("still, degree {degree}, {size:?}"));
    }
    Ok(())
}

fn many_pairs(mut gpu: Gpu) -> Result<(), DeviceError> {
    let mut parameters = still(5, 1500, 0);
    parameters.log_scales.fill([-0.5, -0.9, -0.7]);
    parameters.logits.iter_mut().for_each(|logit| *logit -= 2.0);
    gpu.load(parameters.clone().into())?;
    let camera = camera(150, 90);
    let view = FrameView { camera: &camera, frame: 0.0 };
    assert_pictures(&mut gpu, &parameters, &view, "many pairs");
    // Behind opaque ones no light comes to most splats of a tile.
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

/// A number for each channel of each pixel: the gradient by the picture of their weighted sum.
fn weights(camera: &Camera) -> Vec<[f32; 4]> {
    let mut random = fastrand::Rng::with_seed(11);
    (0..camera.width * camera.height).map(|_| [(); 4].map(|()| random.f32() * 2.0 - 1.0)).collect()
}

/// Name and numbers of each column.
fn columns(p: &Parameters<f32>) -> [(&'static str, &[f32]); 9] {
    [
        ("centers", p.centers.as_flattened()),
        ("rotations", p.rotations.as_flattened()),
        ("log_scales", p.log_scales.as_flattened()),
        ("logits", &p.logits),
        ("sh", p.sh.as_flattened()),
        ("tau", &p.tau),
        ("log_widths", &p.log_widths),
        ("motion", p.motion.as_flattened()),
        ("rotation_rates", p.rotation_rates.as_flattened()),
    ]
}

/// How long the difference of two columns is, as part of the second.
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
    for ((name, a), (_, b)) in columns(&found.values).into_iter().zip(columns(&expected.values)) {
        let error = relative(a, b);
        println!("{what}: {name} {error:e}");
        assert!(error <= 1e-3, "{what}: {name} {error:e}");
    }
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
        let view = FrameView { camera: &camera, frame };
        let weights = weights(&camera);
        for parameters in [cloud(20 + u64::from(degree), 500, degree), still(30, 500, degree)] {
            gpu.load(parameters.clone().into())?;
            let expected = cpu::render(&parameters, &view).backward(&parameters, &view, &weights, detach_tau);
            assert!(expected.rows.len() > 250, "{} are drawn", expected.rows.len());
            let found = gpu.gradient(&view, &weights, detach_tau)?;
            assert_gradients(&found, &expected, &format!("degree {degree}, frame {frame}, {detach_tau}"));
            // Nothing is left of the first time.
            let again = gpu.gradient(&view, &weights, detach_tau)?;
            assert_gradients(&again, &expected, "again");
        }
    }
    Ok(())
}

/// What one set of Gaussians shows, for another to be fitted to; part of it is masked, and part is not seen.
fn shots(size: [u32; 2], frames: &[f64]) -> Vec<TrainingView> {
    let target = cloud(77, 300, 0);
    let shot = |frame: &f64| {
        let camera = camera(size[0], size[1]);
        let picture = cpu::render(&target, &FrameView { camera: &camera, frame: *frame }).image;
        let byte = |x: f32| (x.clamp(0.0, 1.0) * 255.0) as u8;
        let photograph = Photograph {
            width: size[0],
            height: size[1],
            pixels: picture.pixels.iter().map(|pixel| pixel.map(byte)).collect(),
            valid: (0..size[0] * size[1]).map(|i| i % size[0] > 4 || i / size[0] > 9).collect(),
        };
        TrainingView { camera, frame: *frame, photograph }
    };
    frames.iter().map(shot).collect()
}

fn settings(steps: u64) -> FitSettings {
    FitSettings { steps, floor: 0, rule: DensityRule::Floor, detach_tau: true, seed: 3 }
}

/// A fit of `parameters` to `shots` that has taken `count` of `steps`, and what it said on the way.
fn fitted(
    backend: &mut dyn Backend,
    parameters: &Parameters<f32>,
    shots: &[TrainingView],
    [count, steps]: [u64; 2],
    lpips: Option<&Lpips<f32>>,
) -> Result<(Fit, Vec<StepReport>), DeviceError> {
    let cameras = shots.iter().map(|shot| &shot.camera);
    let mut run = Run::start(Fit::new(settings(steps), parameters.clone(), TIMELINE, cameras), backend)?;
    let all: Vec<&TrainingView> = shots.iter().collect();
    let said = (0..count).map(|_| run.step(&all, lpips)).collect::<Result<_, _>>()?;
    Ok((run.pause()?, said))
}

fn losses(mut gpu: Gpu) -> Result<(), DeviceError> {
    for size in [[64, 64], [77, 53], [5, 90]] {
        let (shots, parameters) = (shots(size, &[4.0]), cloud(40, 400, 3));
        let (_, expected) = fitted(&mut Cpu::default(), &parameters, &shots, [1, 100], None)?;
        let (_, found) = fitted(&mut gpu, &parameters, &shots, [1, 100], None)?;
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
    let shots = shots([64, 64], &[4.0]);
    for (what, start) in [("moving", cloud(41, 500, 3)), ("still", still(41, 500, 0))] {
        let expected = fitted(&mut Cpu::default(), &start, &shots, [1, 100], None)?.0;
        let found = fitted(&mut gpu, &start, &shots, [1, 100], None)?.0;
        let none = parameters_of(&fitted(&mut Cpu::default(), &start, &shots, [0, 100], None)?.0);
        let (found, expected) = (parameters_of(&found), parameters_of(&expected));
        let all = columns(&found).into_iter().zip(columns(&expected)).zip(columns(&none));
        for (((name, a), (_, b)), (_, before)) in all {
            let moved = |to: &[f32]| -> Vec<f32> { to.iter().zip(before).map(|(x, y)| x - y).collect() };
            let error = relative(&moved(a), &moved(b));
            println!("{what}: {name} {error:e}");
            assert!(error <= 1e-4, "{what}: {name} {error:e}");
        }
    }
    Ok(())
}

fn fifty_steps(mut gpu: Gpu) -> Result<(), DeviceError> {
    let (shots, start) = (shots([64, 64], &[0.0, 4.0, 8.0]), cloud(42, 500, 2));
    let (by_cpu, expected) = fitted(&mut Cpu::default(), &start, &shots, [50, 1000], None)?;
    let (by_gpu, found) = fitted(&mut gpu, &start, &shots, [50, 1000], None)?;
    let (last, first) = (found[49].loss, found[1].loss);
    println!("loss {first} to {last}, on the CPU {}", expected[49].loss);
    assert!(last < 0.8 * first, "{first} {last}");
    for (a, b) in found.iter().zip(&expected) {
        assert!((a.loss / b.loss - 1.0).abs() < 1e-3, "{} for {}", a.loss, b.loss);
    }
    let [a, b] = [&by_gpu, &by_cpu].map(|fit| cpu::render(&parameters_of(fit), &shots[1].view()).image);
    let squares = a.pixels.as_flattened().iter().zip(b.pixels.as_flattened()).map(|(a, b)| (a - b).powi(2));
    let rms = (squares.sum::<f32>() / a.pixels.len() as f32).sqrt();
    println!("root mean square difference {rms:e}");
    // A step has the length of its rate also where the gradient is nearly nothing and its sign chance.
    assert!(rms < 1e-2, "{rms:e}");
    Ok(())
}

fn repeatable(mut gpu: Gpu) -> Result<(), DeviceError> {
    let (shots, start) = (shots([64, 64], &[0.0, 4.0, 8.0]), cloud(45, 500, 1));
    let mut run = || Ok(fitted(&mut gpu, &start, &shots, [30, 1000], None)?.0);
    let first = run()?;
    assert!(first == run()?, "bit by bit");
    Ok(())
}

fn controls(mut gpu: Gpu) -> Result<(), DeviceError> {
    // A control at step 100 of 1000, another at 200.
    let (shots, start) = (shots([48, 48], &[4.0]), cloud(43, 300, 0));
    let (by_cpu, _) = fitted(&mut Cpu::default(), &start, &shots, [210, 1000], None)?;
    let (by_gpu, found) = fitted(&mut gpu, &start, &shots, [210, 1000], None)?;
    println!("{} and {} of {}", by_gpu.len(), by_cpu.len(), start.len());
    assert!(by_cpu.len() != start.len(), "a control has changed their number");
    assert!(by_gpu.len().abs_diff(by_cpu.len()) * 20 <= by_cpu.len(), "{} {}", by_gpu.len(), by_cpu.len());
    assert!(found[209].loss < found[0].loss);
    Ok(())
}

fn round_trip(mut gpu: Gpu) -> Result<(), DeviceError> {
    let shots = shots([48, 48], &[4.0]);
    for parameters in [cloud(44, 300, 2), still(44, 301, 0), cloud(44, 0, 1)] {
        let (fit, _) = fitted(&mut Cpu::default(), &parameters, &shots, [3, 100], None)?;
        assert!(Run::start(fit.clone(), &mut gpu)?.pause()? == fit, "bit by bit");
    }
    Ok(())
}

fn nothing(mut gpu: Gpu) -> Result<(), DeviceError> {
    let camera = camera(40, 30);
    let shots = shots([40, 30], &[1e4]);
    for parameters in [cloud(12, 0, 1), cloud(12, 20, 1)] {
        gpu.load(parameters.clone().into())?;
        let view = FrameView { camera: &camera, frame: 1e4 };
        assert_eq!(gpu.render(&view)?.pixels, vec![[0.0; 4]; 40 * 30]);
        let gradient = gpu.gradient(&view, &weights(&camera), true)?;
        assert!(gradient.rows.is_empty() && gradient.non_finite == 0);
        let (fit, said) = fitted(&mut gpu, &parameters, &shots, [2, 100], None)?;
        assert_eq!((said[1].drawn, said[1].non_finite), (0, 0));
        assert_eq!(fit.to_field(), fitted(&mut gpu, &parameters, &shots, [0, 100], None)?.0.to_field());
    }
    Ok(())
}

fn extremes(mut gpu: Gpu) -> Result<(), DeviceError> {
    let camera = camera(40, 30);
    let view = FrameView { camera: &camera, frame: 4.0 };
    let plain = cloud(9, 40, 3);
    let eye = camera.position().map(|x| x as f32);
    let mut around = plain.clone();
    for (row, distance) in [(0, 0.0), (1, 1e-3), (2, 0.011), (3, 0.3)] {
        let forward = camera.camera_from_world[2];
        around.centers[row] = [0, 1, 2].map(|axis| eye[axis] + distance * forward[axis] as f32);
        around.motion[3 * row..3 * row + 3].fill([0.0; 3]);
        around.tau[row] = 4.0;
        around.log_scales[row] = [2.0, 1.0, 0.0];
    }
    let mut check = |strange: &Parameters<f32>, view: &FrameView| -> Result<(), DeviceError> {
        gpu.load(strange.clone().into())?;
        let picture = gpu.render(view)?;
        assert!(picture.pixels.as_flattened().iter().all(|x| x.is_finite()));
        let gradient = gpu.gradient(view, &weights(&camera), true)?;
        let finite = columns(&gradient.values).iter().all(|(_, column)| column.iter().all(|x| x.is_finite()));
        assert!(finite && gradient.screen.iter().all(|x| x.is_finite()));
        let expected = cpu::render(strange, view).backward(strange, view, &weights(&camera), true);
        assert_eq!(gradient.rows, expected.rows, "the same are drawn");
        Ok(())
    };
    check(&around, &view)?;
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
            check(&strange, &view)?;
        }
    }
    for frame in [f64::NAN, f64::INFINITY, -1e300] {
        check(&plain, &FrameView { camera: &camera, frame })?;
    }
    Ok(())
}

fn contained(mut gpu: Gpu) -> Result<(), DeviceError> {
    let camera = camera(40, 30);
    let view = FrameView { camera: &camera, frame: 4.0 };
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
    for ((name, a), (_, b)) in columns(&bad).into_iter().zip(columns(&good)) {
        assert!(relative(a, b) < 1e-5, "{name}");
    }
    Ok(())
}

/// AlexNet with weights by a formula.
fn alex() -> Lpips<f32> {
    let bytes =
        |values: Vec<f64>| -> Vec<u8> { values.iter().flat_map(|x| (*x as f32).to_le_bytes()).collect() };
    let weights = |count: usize, layer: usize, scale: f64| -> Vec<f64> {
        (0..count).map(|i| (((i * 7919 + layer * 104_729) % 1009) as f64 / 1009.0 - 0.5) * scale).collect()
    };
    let layers = [(0, 3, 64, 11), (3, 64, 192, 5), (6, 192, 384, 3), (8, 384, 256, 3), (10, 256, 256, 3)];
    let mut tensors = Vec::new();
    for (i, (number, inputs, outputs, side)) in layers.into_iter().enumerate() {
        let fan_in = inputs * side * side;
        let values = bytes(weights(outputs * fan_in, number, (24.0 / fan_in as f64).sqrt()));
        tensors.push((format!("features.{number}.weight"), vec![outputs, inputs, side, side], values));
        tensors.push((
            format!("features.{number}.bias"),
            vec![outputs],
            bytes(weights(outputs, number + 100, 0.2)),
        ));
        let head = bytes((0..outputs).map(|channel| ((channel * 31 + i) % 97) as f64 / 97.0).collect());
        tensors.push((format!("lin{i}.model.1.weight"), vec![1, outputs, 1, 1], head));
    }
    let views = tensors.iter().map(|(name, shape, bytes)| {
        let view = safetensors::tensor::TensorView::new(safetensors::Dtype::F32, shape.clone(), bytes);
        (name.clone(), view.expect("shapes fit"))
    });
    let file = safetensors::tensor::serialize(views, None).expect("tensors have names");
    Lpips::from_safetensors(&file).expect("all tensors are there")
}

fn perceptual(mut gpu: Gpu) -> Result<(), DeviceError> {
    let (shots, start, lpips) = (shots([48, 48], &[4.0]), cloud(45, 400, 1), alex());
    let (_, expected) = fitted(&mut Cpu::default(), &start, &shots, [4, 100], Some(&lpips))?;
    let (_, found) = fitted(&mut gpu, &start, &shots, [4, 100], Some(&lpips))?;
    let (_, without) = fitted(&mut gpu, &start, &shots, [1, 100], None)?;
    assert!(found[0].loss > without[0].loss + 1e-3, "{} {}", found[0].loss, without[0].loss);
    for (a, b) in found.iter().zip(&expected) {
        println!("{} for {}", a.loss, b.loss);
        assert!((a.loss / b.loss - 1.0).abs() < 1e-3, "{} for {}", a.loss, b.loss);
    }
    Ok(())
}

fn too_large(mut gpu: Gpu) -> Result<(), DeviceError> {
    // 15 numbers a pixel are 64 GB.
    gpu.load(cloud(46, 10, 0).into())?;
    let [large, small] = [1 << 15, 16].map(|side| camera(side, side));
    match gpu.render(&FrameView { camera: &large, frame: 0.0 }) {
        Err(error @ DeviceError::TooLarge { .. }) => println!("{error}"),
        other => panic!("{other:?}"),
    }
    // And it goes on.
    gpu.render(&FrameView { camera: &small, frame: 0.0 })?;
    Ok(())
}
