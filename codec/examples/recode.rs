//! Compares the coders `context` and `rans` on real fields: decodes packages, codes each field again with both
//! coders at the same precision, and prints bytes and decode times of both.
//!
//! `cargo run --release -p codec --features encode --example recode -- PACKAGE..`

use std::{env, error::Error, fs, hint::black_box, num::NonZero, time::Instant};

use codec::{AttributeSize, Clip, Coder, EncodeOptions, Limits, Source, decode, encode_parallel, measure};

/// Decodes of each coder, of which the fastest counts.
const ROUNDS: usize = 15;

const CODERS: [Coder; 2] = [Coder::Context, Coder::Rans];

fn main() -> Result<(), Box<dyn Error>> {
    let paths: Vec<String> = env::args().skip(1).collect();
    if paths.is_empty() {
        return Err("usage: recode PACKAGE..".into());
    }
    println!("package: Gaussians; bytes of context and rans, ratio; decode ms of both, ratio");
    for path in paths {
        let clip = decode(&fs::read(&path)?, &Limits::default())?;
        let packages = recoded(&clip)?;
        let [context, rans] = packages.each_ref().map(|package| package.len() as f64);
        let [context_ms, rans_ms] = times(&packages);
        let ratios = [rans / context, rans_ms / context_ms];
        println!(
            "{path}: {}; {context} {rans} {:.4}; {context_ms:.1} {rans_ms:.1} {:.3}",
            clip.len(),
            ratios[0],
            ratios[1]
        );
        let [context, rans] = packages.each_ref().map(|package| measure(package, &Limits::default()));
        for (AttributeSize { attribute, coded, .. }, rans) in context?.into_iter().zip(rans?) {
            println!(
                "  {attribute:20} {coded:10.0} {:10.0} {:+.2} %",
                rans.coded,
                100.0 * (rans.coded / coded - 1.0)
            );
        }
    }
    Ok(())
}

/// The field of a clip as a package of each coder, with the default precision.
fn recoded(clip: &Clip) -> Result<[Vec<u8>; 2], Box<dyn Error>> {
    let field = clip.merged();
    let source = Source { info: &clip.info, field: &field, plate: clip.plate.as_ref() };
    let threads = std::thread::available_parallelism().unwrap_or(NonZero::<usize>::MIN);
    let mut packages = [const { Vec::new() }; 2];
    for (coder, package) in CODERS.into_iter().zip(&mut packages) {
        let options = EncodeOptions { coder, ..EncodeOptions::default() };
        *package = encode_parallel(&source, &options, threads)?;
    }
    Ok(packages)
}

/// The shortest time to decode each package on one thread, in milliseconds. The coders take turns, so that both see
/// the same load.
fn times(packages: &[Vec<u8>; 2]) -> [f64; 2] {
    let mut best = [f64::INFINITY; 2];
    for _ in 0..ROUNDS {
        for (package, best) in packages.iter().zip(&mut best) {
            let start = Instant::now();
            black_box(decode(black_box(package), &Limits::default()).is_ok());
            *best = best.min(1e3 * start.elapsed().as_secs_f64());
        }
    }
    best
}
