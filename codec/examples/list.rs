//! Decodes a clip or a take and lists it: metadata, segments; of each its layers, sections and Gaussians.
//!
//! `cargo run -p codec --example list -- assets/demo.aarc`
//!
//! A damaged package gives one line on stderr that names the byte offset, and exit code 3.

use std::num::NonZero;
use std::process::ExitCode;
use std::{env, fs, thread};

use codec::{Clip, Contents, Error, Field, Limits, Take, VERSION_MAJOR, package};

fn main() -> ExitCode {
    let Some(path) = env::args_os().nth(1) else {
        eprintln!("usage: list PACKAGE.aarc");
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

/// Lists a clip or a take, and decodes one segment after the other; a damaged one is named and skipped.
///
/// # Errors
/// That of the head, or the first error of a segment, after the others were listed.
fn list(bytes: &[u8]) -> Result<(), Error> {
    // The head needs no decoding: a menu of clips can be built from the first kilobytes of each.
    let take = package(bytes, &Limits::default())?;
    list_table(&take);
    let mut first_error = None;
    for (index, segment) in take.segments.iter().enumerate() {
        // A file that was cut short ends within a segment, or before it.
        let start = usize::try_from(segment.offset).map_or(bytes.len(), |offset| offset.min(bytes.len()));
        let end = (start + segment.bytes()).min(bytes.len());
        if let Err(error) = list_segment(&take, index, &bytes[start..end]) {
            println!("segment {index}: {error}");
            first_error.get_or_insert(error);
        }
    }
    first_error.map_or(Ok(()), Err)
}

fn list_table(take: &Take) {
    let info = &take.info;
    println!("format {VERSION_MAJOR}.{}, coder {}", take.version_minor, take.coder.name());
    println!("duration {} s, {} frames/s", take.duration_s, info.fps);
    println!("up {:?}, {} m per unit, bounds {:?}", info.up, info.metres_per_unit, take.bounds);
    for viewpoint in &info.viewpoints {
        println!("viewpoint {:?} at {:?} towards {:?}", viewpoint.name, viewpoint.position, viewpoint.target);
    }
    println!("at most {} Gaussians at an instant", take.resident_max());
    println!("segment    start      end level      offset    bytes gaussians");
    for (index, segment) in take.segments.iter().enumerate() {
        println!(
            "{index:7} {:8.3} {:8.3} {:5} {:11} {:8} {:9}",
            segment.start_s,
            segment.end_s(),
            segment.level,
            segment.offset,
            segment.bytes(),
            segment.gaussians(),
        );
    }
}

/// Lists and decodes a segment, of which `bytes` are there.
///
/// # Errors
/// What is wrong with it.
fn list_segment(take: &Take, index: usize, bytes: &[u8]) -> Result<(), Error> {
    let limits = Limits::default();
    let head = take.segment_contents(index, bytes, &limits)?;
    // Every chunk of 4096 Gaussians decodes independently.
    let threads = thread::available_parallelism().unwrap_or(NonZero::<usize>::MIN);
    let clip = take.decode_segment(index, bytes, &limits, threads)?;
    println!("segment {index}, {} of {} layers", clip.layers.len(), clip.layers_announced.len());
    list_head(&head);
    list_clip(&clip);
    Ok(())
}

fn list_head(head: &Contents) {
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
