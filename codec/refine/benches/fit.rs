//! Measures a step of a fit on the CPU and on a graphics device, for three sizes: `cargo xtask bench fit`.
//!
//! Times depend on the machine; the counts of a device do not. "Least" is what a step cannot do without: the parameters, the
//! gradient and the two moments of the Gaussians that it draws, and the pixels of image and photograph, each once. How long a
//! device takes at least for these bytes follows from a copy between two of its buffers.

use std::process::ExitCode;
use std::time::{Duration, Instant};

use codec::{Camera, Field, Temporal, sh_coefficients};
use refine::fit::gpu::Gpu;
use refine::fit::{
    Backend, Cpu, DensityRule, DeviceError, Fit, FitSettings, Parameters, Photograph, Run, Timeline,
    TrainingView,
};
use serde_json::{Value, json};

/// Frames of the captures.
const FRAMES: usize = 60;

/// Cameras of the captures, on a ring about the origin.
const CAMERAS: usize = 8;

/// Steps before the measured ones; the least and the most of these, and the time after which they end.
const WARM_UP: u64 = 2;
const STEPS: std::ops::RangeInclusive<u64> = 2..=200;
const LONGEST: Duration = Duration::from_secs(4);

/// What is fitted.
struct Size {
    name: &'static str,
    gaussians: usize,
    /// Of these, how many stand still.
    still: usize,
    sh_degree: u8,
    /// Width and height of the photographs.
    pixels: [u32; 2],
}

const SIZES: [Size; 3] = [
    Size { name: "stage", gaussians: 24_000, still: 0, sh_degree: 1, pixels: [256, 188] },
    Size { name: "paper", gaussians: 222_000, still: 0, sh_degree: 3, pixels: [512, 375] },
    Size { name: "film", gaussians: 120_000, still: 10_000, sh_degree: 1, pixels: [640, 360] },
];

fn main() -> ExitCode {
    let is_json = std::env::args().any(|argument| argument == "--json");
    let mut rows = Vec::new();
    if !is_json {
        print_header();
    }
    let measured = measure(&mut |row| {
        if !is_json {
            print(&row);
        }
        rows.push(row);
    });
    if let Err(error) = measured {
        eprintln!("error: {error}");
        return ExitCode::FAILURE;
    }
    match is_json {
        true => println!("{:#}", json!({ "rows": rows })),
        false => {
            println!("waits, submissions: in 100 steps; MB: what all kernels of a step touch, each once")
        }
    }
    ExitCode::SUCCESS
}

/// Measures each size on each back end, and gives the rows to `take`.
fn measure(take: &mut dyn FnMut(Value)) -> Result<(), DeviceError> {
    for size in &SIZES {
        let views = size.views();
        let parameters = size.parameters();
        let (ms, drawn) = measured(&mut Cpu::default(), &parameters, &views)?;
        take(size.row("cpu", None, ms, drawn));
        match Gpu::open() {
            Ok(gpu) => take(on_device(gpu, size, &parameters, &views)?),
            Err(error) => eprintln!("note: {error}"),
        }
    }
    Ok(())
}

/// The row of a device.
fn on_device(
    mut gpu: Gpu,
    size: &Size,
    parameters: &Parameters<f32>,
    views: &[TrainingView],
) -> Result<Value, DeviceError> {
    let (ms, drawn) = measured(&mut gpu, parameters, views)?;
    let counts = gpu.counts();
    let steps = counts.steps as f64;
    let mut row = size.row("gpu", gpu.device(), ms, drawn);
    let [width, height] = size.pixels.map(u64::from);
    let least = drawn * 4 * gpu.gaussian_bytes() + width * height * (16 + 4);
    let per_100 = |count: u64| 100.0 * count as f64 / steps;
    row["waits_per_100"] = json!(per_100(counts.waits));
    row["submissions_per_100"] = json!(per_100(counts.submissions));
    row["repeats_per_100"] = json!(per_100(counts.repeats));
    row["dispatches"] = json!(counts.dispatches as f64 / (counts.steps + counts.repeats) as f64);
    row["bytes_step"] = json!((counts.touched_bytes as f64 / steps).round());
    row["bytes_written_by_host"] = json!((counts.written_bytes as f64 / steps).round());
    row["bytes_least"] = json!(least);
    row["ms_least_by_bytes"] = json!(least as f64 / gpu.copied_bytes_a_ms()?);
    gpu.time_parts()?;
    let timed = measured_steps(&mut gpu, parameters, views)?.1;
    let ms_of = |(name, ms): (&'static str, f64)| (name.to_owned(), json!(ms / timed as f64));
    row["parts_ms"] = Value::Object(gpu.part_times().into_iter().map(ms_of).collect());
    Ok(row)
}

/// Milliseconds a step, and the mean number of Gaussians drawn.
fn measured(
    backend: &mut dyn Backend,
    parameters: &Parameters<f32>,
    views: &[TrainingView],
) -> Result<(f64, u64), DeviceError> {
    let (ms, _, drawn) = measured_steps(backend, parameters, views)?;
    Ok((ms, drawn))
}

/// Milliseconds a step after the first ones, the number of all steps, and the mean number of Gaussians drawn.
fn measured_steps(
    backend: &mut dyn Backend,
    parameters: &Parameters<f32>,
    views: &[TrainingView],
) -> Result<(f64, u64, u64), DeviceError> {
    // No capacity control: the number of Gaussians stays.
    let settings = FitSettings { floor: 0, rule: DensityRule::Fixed, ..FitSettings::default() };
    let cameras = views.iter().map(|view| &view.camera);
    let fit = Fit::new(settings, parameters.clone(), Timeline::even(FRAMES), cameras);
    let all: Vec<&TrainingView> = views.iter().collect();
    let mut run = Run::start(fit, backend)?;
    let mut reports = Vec::new();
    for _ in 0..WARM_UP {
        reports.extend(run.step(&all, None)?);
    }
    reports.extend(run.settle()?);
    let start = Instant::now();
    let mut steps = 0;
    while steps < *STEPS.start() || (steps < *STEPS.end() && start.elapsed() < LONGEST) {
        reports.extend(run.step(&all, None)?);
        steps += 1;
    }
    reports.extend(run.settle()?);
    let ms = 1e3 * start.elapsed().as_secs_f64() / steps as f64;
    let drawn = reports.iter().map(|report| report.drawn).sum::<usize>() / reports.len();
    Ok((ms, WARM_UP + steps, drawn as u64))
}

impl Size {
    fn row(&self, backend: &str, adapter: Option<&str>, ms: f64, drawn: u64) -> Value {
        let [width, height] = self.pixels;
        json!({
            "name": self.name, "backend": backend, "adapter": adapter, "size": format!("{width}x{height}"),
            "gaussians": self.gaussians, "sh_degree": self.sh_degree, "ms_step": ms, "drawn": drawn,
        })
    }

    /// Gaussians in a ball, as large as they are far apart, each of those that move seen in a tenth of the frames.
    fn parameters(&self) -> Parameters<f32> {
        let mut random = fastrand::Rng::with_seed(1);
        let mut signed = |scale: f32| (random.f32() * 2.0 - 1.0) * scale;
        let mut field = Field { sh_degree: self.sh_degree, ..Field::default() };
        let mut temporal = Temporal { motion_order: 3, ..Temporal::default() };
        let alive = (self.still + (self.gaussians - self.still) / 10) as f32;
        let log_scale = (0.9 * alive.powf(-1.0 / 3.0)).ln();
        for row in 0..self.gaussians {
            field.centers.push([signed(1.0), signed(1.0), signed(1.0)]);
            field.rotations.push([1.0, 0.0, 0.0, 0.0]);
            field.log_scales.push([signed(0.4), signed(0.4), signed(0.4)].map(|x| log_scale + x));
            field.opacities.push(0.5 + signed(0.4));
            let harmonics = sh_coefficients(self.sh_degree);
            field.sh.extend((0..harmonics).map(|_| [signed(0.4), signed(0.4), signed(0.4)]));
            temporal.tau.push(0.5 + signed(0.5));
            temporal.s.push(if row < self.still { f32::INFINITY } else { 0.017 });
            temporal.motion.extend((0..3).map(|_| [signed(0.1), signed(0.1), signed(0.1)]));
        }
        field.temporal = Some(temporal);
        Parameters::from_field(&field, Timeline::even(FRAMES))
    }

    /// Photographs of smooth colours, one of each camera in some of the frames.
    fn views(&self) -> Vec<TrainingView> {
        let [width, height] = self.pixels;
        let view = |i: usize| {
            let (sin, cos) = (std::f64::consts::TAU * i as f64 / CAMERAS as f64).sin_cos();
            let camera =
                Camera::look_at([3.0 * sin, 0.5, 3.0 * cos], [0.0; 3], [0.0, 1.0, 0.0], 0.8, width, height);
            let color = |pixel: u32| {
                let at = [pixel % width, pixel / width].map(|x| (x * 255 / width.max(height)) as u8);
                [at[0], at[1], (40 * i) as u8, 255]
            };
            let pixels = (0..width * height).map(color).collect();
            let photograph = Photograph { width, height, pixels, valid: Vec::new() };
            let time = ((7 * i) % FRAMES) as f64;
            TrainingView { camera_id: i % CAMERAS, camera, time, photograph }
        };
        (0..2 * CAMERAS).map(view).collect()
    }
}

fn print_header() {
    println!(
        "{:<7}{:<5}{:>9}{:>10}{:>4}{:>9}{:>11}{:>8}{:>8}{:>8}{:>8}{:>9}{:>9}  adapter",
        "",
        "",
        "size",
        "Gaussians",
        "SH",
        "drawn",
        "ms a step",
        "waits",
        "submit",
        "kernels",
        "MB",
        "least MB",
        "least ms"
    );
}

fn print(row: &Value) {
    let number = |row: &Value, key: &str, digits: usize| {
        row[key].as_f64().map_or_else(|| "-".into(), |x| format!("{x:.digits$}"))
    };
    let [name, backend, size] = ["name", "backend", "size"].map(|key| row[key].as_str().unwrap_or_default());
    let mb = |key: &str| row[key].as_f64().map_or_else(|| "-".into(), |bytes| format!("{:.1}", bytes * 1e-6));
    println!(
        "{name:<7}{backend:<5}{size:>9}{:>10}{:>4}{:>9}{:>11}{:>8}{:>8}{:>8}{:>8}{:>9}{:>9}  {}",
        number(row, "gaussians", 0),
        number(row, "sh_degree", 0),
        number(row, "drawn", 0),
        number(row, "ms_step", 2),
        number(row, "waits_per_100", 1),
        number(row, "submissions_per_100", 1),
        number(row, "dispatches", 1),
        mb("bytes_step"),
        mb("bytes_least"),
        number(row, "ms_least_by_bytes", 3),
        row["adapter"].as_str().unwrap_or("-"),
    );
    if let Some(parts) = row["parts_ms"].as_object().filter(|parts| !parts.is_empty()) {
        let part = |(name, ms): (&String, &Value)| format!("{name} {:.3}", ms.as_f64().unwrap_or(f64::NAN));
        println!("       ms: {}", parts.iter().map(part).collect::<Vec<_>>().join(", "));
    }
}
