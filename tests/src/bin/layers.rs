//! Prints what each layer of a clip costs when it arrives, decoded, packed and uploaded alone, and with all layers before
//! it: `cargo run --release --package aarc-tests --bin layers -- clip.aarc`.

use std::num::NonZero;
use std::path::Path;
use std::process::ExitCode;
use std::time::Instant;

use client::gpu::{Gpu, GpuClip};
use codec::{Clip, Limits, contents, decode_parallel};
use program::Fault;

/// Number of times that everything is done. Times are medians.
const RUNS: usize = 9;

fn main() -> ExitCode {
    let Some(path) = std::env::args_os().nth(1) else {
        eprintln!("error: of which clip? layers CLIP.aarc");
        return ExitCode::from(2);
    };
    match print_layers(Path::new(&path)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(fault) => {
            eprintln!("error: {fault}");
            ExitCode::from(fault.exit_code())
        }
    }
}

/// Milliseconds of a layer.
struct Cost {
    decode_ms: f64,
    /// Packing, uploading, and waiting for the device.
    upload_ms: f64,
    bytes: usize,
}

fn print_layers(path: &Path) -> Result<(), Fault> {
    let data = |error: String| Fault::Data(format!("{}: {error}", path.display()));
    let bytes = std::fs::read(path).map_err(|error| data(error.to_string()))?;
    let head = contents(&bytes, &Limits::default()).map_err(|error| data(error.to_string()))?;
    let threads = std::thread::available_parallelism().unwrap_or(NonZero::<usize>::MIN);
    let gpu = Gpu::new_headless()?;
    println!("{}, {}, {threads} threads, medians of {RUNS} runs", gpu.adapter_name, gpu.driver);
    println!(
        "layer  Gaussians    alone: decode  upload      bytes    with those before: decode  upload      bytes"
    );
    let mut before: Option<(Clip, GpuClip)> = None;
    let mut last = None;
    for (layer, end) in head.layer_bytes().into_iter().enumerate() {
        let prefix = &bytes[..end];
        let decode = || decode_parallel(prefix, &Limits::default(), threads);
        let mut clip = decode().map_err(|error| data(error.to_string()))?;
        let whole = cost(&gpu, || drop(decode()), || GpuClip::upload(&gpu, &clip))?;
        let mut on_gpu = GpuClip::upload(&gpu, &clip)?;
        let alone = match before {
            None => Cost { ..whole },
            Some((mut earlier, start)) => {
                let further = || head.decode_layers(prefix, layer, &Limits::default(), threads);
                let decoded = further().map_err(|error| data(error.to_string()))?;
                earlier.append(decoded);
                assert!(earlier == clip, "layers that are appended are those decoded at once");
                clip = earlier;
                on_gpu = start.extended(&gpu, &clip)?;
                cost(&gpu, || drop(further()), || start.extended(&gpu, &clip))?
            }
        };
        println!(
            "{:5} {:10}    {:10.2} ms {:4.2} ms {:9}    {:20.2} ms {:4.2} ms {:9}",
            layer + 1,
            head.layers[layer].total(),
            alone.decode_ms,
            alone.upload_ms,
            alone.bytes,
            whole.decode_ms,
            whole.upload_ms,
            whole.bytes,
        );
        before = Some((clip, on_gpu));
        last = Some((alone, whole));
    }
    if let Some((alone, whole)) = last {
        let total = |cost: &Cost| cost.decode_ms + cost.upload_ms;
        println!("last layer alone / whole: {:.3}", total(&alone) / total(&whole));
    }
    Ok(())
}

/// Runs both steps several times.
fn cost(gpu: &Gpu, decode: impl Fn(), upload: impl Fn() -> Result<GpuClip, Fault>) -> Result<Cost, Fault> {
    let (mut decoding, mut uploading, mut bytes) = (Vec::new(), Vec::new(), 0);
    for _ in 0..RUNS {
        let start = Instant::now();
        decode();
        decoding.push(start.elapsed().as_secs_f64() * 1e3);
        let start = Instant::now();
        let on_gpu = upload()?;
        gpu.submit(gpu.encoder());
        gpu.wait()?;
        uploading.push(start.elapsed().as_secs_f64() * 1e3);
        bytes = on_gpu.uploaded_bytes();
    }
    let median = |mut times: Vec<f64>| {
        times.sort_by(f64::total_cmp);
        times[RUNS / 2]
    };
    Ok(Cost { decode_ms: median(decoding), upload_ms: median(uploading), bytes })
}
