//! Prints what each layer of a clip costs when it arrives, decoded, packed and uploaded alone, and with all layers before
//! it: `cargo run --release --package aarc-tests --bin layers -- clip.aarc`.

use std::num::NonZero;
use std::path::Path;
use std::process::ExitCode;
use std::time::Instant;

use client::gpu::{Gpu, UploadedClip};
use codec::{Clip, Limits, contents, decode_parallel};
use program::Fault;

/// Number of times that everything is done, alone and with the layers before in turn, so that other work on the machine
/// meets both alike. Results are medians.
const RUNS: usize = 15;

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

/// What an arrival costs in each run.
#[derive(Default)]
struct Costs {
    decode_ms: Vec<f64>,
    /// Packing, uploading, and waiting for the device.
    upload_ms: Vec<f64>,
    bytes: usize,
}

impl Costs {
    /// Runs both steps once more.
    fn add(
        &mut self,
        gpu: &Gpu,
        decode: impl FnOnce(),
        upload: impl FnOnce() -> Result<usize, Fault>,
    ) -> Result<(), Fault> {
        let start = Instant::now();
        decode();
        self.decode_ms.push(start.elapsed().as_secs_f64() * 1e3);
        let start = Instant::now();
        self.bytes = upload()?;
        gpu.submit(gpu.encoder());
        gpu.wait()?;
        self.upload_ms.push(start.elapsed().as_secs_f64() * 1e3);
        Ok(())
    }

    /// Decoding and uploading, in each run.
    fn total_ms(&self) -> impl Iterator<Item = f64> {
        self.decode_ms.iter().zip(&self.upload_ms).map(|(decode_ms, upload_ms)| decode_ms + upload_ms)
    }

    fn row(&self) -> String {
        let [decode_ms, upload_ms] =
            [&self.decode_ms, &self.upload_ms].map(|times| median(times.iter().copied()));
        format!("{decode_ms:8.2} {upload_ms:8.2} {:9}", self.bytes)
    }
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

fn print_layers(path: &Path) -> Result<(), Fault> {
    let data = |error: String| Fault::Data(format!("{}: {error}", path.display()));
    let bytes = std::fs::read(path).map_err(|error| data(error.to_string()))?;
    let head = contents(&bytes, &Limits::default()).map_err(|error| data(error.to_string()))?;
    let threads = std::thread::available_parallelism().unwrap_or(NonZero::<usize>::MIN);
    let gpu = Gpu::new_headless()?;
    println!("{}, {}, {threads} threads, medians of {RUNS} runs", gpu.adapter_name, gpu.driver);
    println!("                     alone                            with those before");
    println!("layer  Gaussians  decode ms  upload ms      bytes  decode ms  upload ms      bytes");
    let mut before: Option<Clip> = None;
    let mut ratio = None;
    for (layer, end) in head.layer_bytes().into_iter().enumerate() {
        let prefix = &bytes[..end];
        let decode = || decode_parallel(prefix, &Limits::default(), threads);
        let clip = decode().map_err(|error| data(error.to_string()))?;
        let (mut alone, mut whole) = (Costs::default(), Costs::default());
        let upload = || UploadedClip::new(&gpu, &clip).map(|uploaded| uploaded.bytes());
        if let Some(earlier) = before {
            let further = || head.decode_layers(prefix, layer, &Limits::default(), threads);
            let mut appended = earlier.clone();
            appended.append(further().map_err(|error| data(error.to_string()))?);
            assert!(appended == clip, "layers that are appended are those decoded at once");
            for _ in 0..RUNS {
                let mut start = UploadedClip::new(&gpu, &earlier)?;
                let extend = || start.extend(&gpu, &clip).map(|()| start.bytes());
                alone.add(&gpu, || drop(further()), extend)?;
                whole.add(&gpu, || drop(decode()), upload)?;
            }
            ratio = Some(median(alone.total_ms().zip(whole.total_ms()).map(|(alone, whole)| alone / whole)));
        } else {
            for _ in 0..RUNS {
                alone.add(&gpu, || drop(decode()), upload)?;
            }
        }
        let row = if whole.bytes == 0 { &alone } else { &whole }.row();
        println!("{:5} {:10}   {}   {row}", layer + 1, head.layers[layer].total(), alone.row());
        before = Some(clip);
    }
    if let Some(ratio) = ratio {
        println!("last layer alone / whole: {ratio:.3}");
    }
    Ok(())
}
