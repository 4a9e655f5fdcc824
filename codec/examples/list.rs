//! Decodes a package and lists it: metadata, layers, sections and the sizes of all columns.
//!
//! `cargo run -p codec --example list -- assets/demo.aarc`
//!
//! A damaged package gives one line on stderr that names the byte offset, and exit code 3.

use std::num::NonZero;
use std::process::ExitCode;
use std::{env, fs, thread};

use codec::{Clip, Contents, Error, Field, Limits, contents, decode_parallel};

fn main() -> ExitCode {
    let Some(path) = env::args_os().nth(1) else {
        eprintln!("usage: list CLIP.aarc");
        return ExitCode::from(2);
    };
    let bytes = match fs::read(&path) {
        Ok(bytes) => bytes,
        Err(error) => {
            eprintln!("{}: {error}", path.display());
            return ExitCode::from(2);
        }
    };
    match list(&bytes) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{}: {error}", path.display());
            ExitCode::from(3)
        }
    }
}

fn list(bytes: &[u8]) -> Result<(), Error> {
    // The head needs no decoding: a menu of clips can be built from the first kilobytes of each.
    let limits = Limits::default();
    let head = contents(bytes, &limits)?;
    list_head(&head);
    // Every chunk of 4096 Gaussians decodes independently.
    let threads = thread::available_parallelism().unwrap_or(NonZero::<usize>::MIN);
    list_clip(&decode_parallel(bytes, &limits, threads)?);
    Ok(())
}

fn list_head(head: &Contents) {
    let info = &head.info;
    println!("format {}.{}, coder {}", head.version_major, head.version_minor, head.coder.name());
    println!("duration {} s, {} frames/s", info.duration_s, info.fps);
    println!("up {:?}, {} m per unit, bounds {:?}", info.up, info.metres_per_unit, head.bounds);
    for viewpoint in &info.viewpoints {
        println!("viewpoint {:?} at {:?} towards {:?}", viewpoint.name, viewpoint.position, viewpoint.target);
    }
    println!("layer   static  dynamic  (up to its end)  bytes");
    for ((layer, end), bytes) in head.layers.iter().enumerate().zip(head.layer_bytes()) {
        println!("{layer:5} {:8} {:8} {bytes:24}", end.static_count, end.dynamic_count);
    }
    println!("layer region   chunk kind         offset   length      raw");
    for section in &head.sections {
        println!(
            "{:5} {:8} {:5} {:10} {:8} {:8} {:8}",
            section.layer,
            format!("{:?}", section.region),
            section.chunk,
            format!("{:?}", section.kind),
            section.offset,
            section.length,
            section.raw_length,
        );
    }
}

fn list_clip(clip: &Clip) {
    list_field("static", &clip.static_field);
    list_field("dynamic", &clip.dynamic_field);
    if let Some(plate) = &clip.plate {
        list_field("plate", plate);
    }
    for t in [0.0, 0.5, 1.0] {
        let candidates = clip.time_index.candidates(t, clip.layers.len()).flatten();
        let dynamic = candidates.filter(|&i| clip.dynamic_field.opacity_at(i, t) >= codec::ALPHA_MIN).count();
        println!("alive at {t}: {} static, {dynamic} dynamic", clip.static_field.len());
    }
}

fn list_field(region: &str, field: &Field) {
    print!("{region}: {} Gaussians, SH degree {}", field.len(), field.sh_degree);
    if let Some(temporal) = &field.temporal {
        let rotating = if temporal.rotation_rates.is_some() { "with" } else { "without" };
        print!(", motion order {}, {rotating} rotation rates", temporal.motion_order);
    }
    println!();
}
