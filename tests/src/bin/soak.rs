//! Plays for as many minutes as the command line says, and prints what memory there is, at every
//! tenth of the time: `cargo run --release --package aarc-tests --bin soak -- 120`.

use std::process::ExitCode;
use std::time::Duration;

use aarc_tests::soak::{Account, soak};
use client::gpu::Gpu;
use peak_alloc::PeakAlloc;

#[global_allocator]
static HEAP: PeakAlloc = PeakAlloc;

fn main() -> ExitCode {
    let minutes = std::env::args().nth(1).and_then(|minutes| minutes.parse::<f64>().ok());
    let Some(minutes) = minutes.filter(|minutes| (0.0..1e5).contains(minutes)) else {
        eprintln!("error: how long? soak MINUTES");
        return ExitCode::from(2);
    };
    match Gpu::new_headless() {
        Ok(gpu) => println!("{}, {}", gpu.adapter_name, gpu.driver),
        Err(fault) => {
            eprintln!("error: {fault}");
            return ExitCode::from(fault.exit_code());
        }
    }
    let mut told = 0.0;
    let played = soak(
        Duration::from_secs_f64(60.0 * minutes),
        || HEAP.current_usage() as u64,
        |account| {
            let seconds = account.samples.last().map_or(0.0, |sample| sample.seconds);
            if account.rounds == 1 || seconds >= told + 6.0 * minutes {
                told = seconds;
                println!("{}", line(account));
            }
        },
    );
    match played.and_then(|account| account.check().map(|()| account)) {
        Ok(account) => {
            println!("flat: {}", line(&account));
            ExitCode::SUCCESS
        }
        Err(what) => {
            eprintln!("error: {what}");
            ExitCode::FAILURE
        }
    }
}

fn line(account: &Account) -> String {
    let Account { rounds, downloads, frames, played_s, seeks, resizes, losses, samples, .. } = account;
    let sample = samples.last().cloned().unwrap_or_default();
    let megabytes = |bytes: u64| bytes as f64 / f64::from(1 << 20);
    format!(
        "{:.1} min: {frames} frames, {:.1} min of playing, {rounds} clips ({downloads} downloads), {seeks} seeks, steps \
         and pauses, {resizes} resizes, {losses} devices lost; {:.1} MiB resident, {:.2} MiB heap, {:.1} MiB of the device",
        sample.seconds / 60.0,
        played_s / 60.0,
        megabytes(sample.resident_bytes),
        megabytes(sample.heap_bytes),
        megabytes(sample.gpu_bytes),
    )
}
