//! Prints what each layer of a clip costs when it arrives, decoded, packed and uploaded alone, and with all layers before
//! it: `cargo run --release --package aarc-tests --bin layers -- clip.aarc`.

use std::num::NonZero;
use std::path::Path;
use std::process::ExitCode;
use std::time::Instant;

use client::gpu::{
    ChannelDepth, FrameLayout, Gpu, PackedLayers, PackedSegment, Renderer, SlotId, Span, TakeLayout,
};
use codec::{Clip, Layers, Limits, contents, decode_parallel};
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

/// A clip in GPU memory.
struct Uploaded {
    layout: TakeLayout,
    renderer: Renderer,
    segment: SlotId,
    bytes: usize,
}

impl Uploaded {
    fn new(gpu: &Gpu, clip: &Clip) -> Result<Uploaded, Fault> {
        let (layout, frame) =
            (TakeLayout::for_clip(clip), FrameLayout::plain(ChannelDepth::Eight.format(), 1));
        let mut renderer = Renderer::new_take(gpu, layout, frame)?;
        let slots = renderer.slots().expect("it has its own segments");
        let segment = slots.insert(PackedSegment::new(clip, Span::WHOLE, &layout)?).expect("it has its room");
        let bytes = slots.upload(gpu, usize::MAX);
        Ok(Uploaded { layout, renderer, segment, bytes })
    }

    /// Packs and uploads further layers; returns the number of bytes.
    fn extend(mut self, gpu: &Gpu, layers: &Layers) -> Result<usize, Fault> {
        let packed = PackedLayers::new(layers, Span::WHOLE, &self.layout)?;
        let slots = self.renderer.slots().expect("it has its own segments");
        slots.append(self.segment, packed);
        Ok(slots.upload(gpu, usize::MAX))
    }
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
        let upload = || Uploaded::new(&gpu, &clip).map(|uploaded| uploaded.bytes);
        if let Some(earlier) = before {
            let further = || head.decode_layers(prefix, layer, &Limits::default(), threads);
            let mut appended = earlier.clone();
            appended.append(further().map_err(|error| data(error.to_string()))?);
            assert!(appended == clip, "layers that are appended are those decoded at once");
            for _ in 0..RUNS {
                let start = Uploaded::new(&gpu, &earlier)?;
                let layers = further().map_err(|error| data(error.to_string()))?;
                alone.add(&gpu, || drop(further()), || start.extend(&gpu, &layers))?;
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
