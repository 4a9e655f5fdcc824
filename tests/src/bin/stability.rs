//! Runs the stability suite for `cargo xtask report --stability`: all cases, one after the other, and
//! one along each field or package whose path is given.
//!
//! Prints JSON, a value a line: the [`Header`], then a [`Row`] for each case as soon as it is
//! measured. A case that does not end is a row that says so, and the last one.

use std::path::Path;
use std::process::ExitCode;
use std::sync::mpsc;
use std::thread;
use std::time::Duration;

use aarc_tests::ending;
use aarc_tests::gpu::{Passes, device};
use aarc_tests::stability::{Case, Meter, along, cases, run};
use client::gpu::Gpu;
use peak_alloc::PeakAlloc;
use studio::report::Subject;
use studio::report::stability::{Header, Row};

#[global_allocator]
static HEAP: PeakAlloc = PeakAlloc;

/// How long a case may take with the reference's pictures.
const PATIENCE: Duration = Duration::from_secs(180);

fn main() -> ExitCode {
    ending::code(suite())
}

fn suite() -> anyhow::Result<()> {
    let mut cases = cases();
    for path in std::env::args_os().skip(1) {
        cases.push(along(&Subject::load(Path::new(&path))?));
    }
    let gpu = device(Passes::Shared)?;
    let header = Header { adapter: gpu.adapter_name.clone(), driver: gpu.driver.clone(), cases: cases.len() };
    println!("{}", serde_json::to_string(&header)?);
    for case in cases {
        let (row, ended) = patiently(case, gpu);
        println!("{}", serde_json::to_string(&row)?);
        if !ended {
            break;
        }
    }
    Ok(())
}

/// Measures a case; whether that came to an end.
fn patiently(case: Case, gpu: &'static Gpu) -> (Row, bool) {
    let without_end = Row {
        group: case.group.into(),
        case: case.name.clone(),
        outcome: "fails".into(),
        deviation: None,
        bound: case.bound,
        unit: case.measure.unit().into(),
        package: String::new(),
        gaussians: 0,
        pictures: 0,
        seconds: PATIENCE.as_secs_f64(),
        bytes: 0,
        how: case.how.into(),
        problem: Some("it hangs: the cases after it were not run".into()),
    };
    let (sender, receiver) = mpsc::channel();
    thread::spawn(move || {
        // Nobody listens to a row that comes too late.
        let _ = sender.send(run(&case, gpu, Meter::new(&HEAP)));
    });
    match receiver.recv_timeout(PATIENCE) {
        Ok(row) => (row, true),
        Err(mpsc::RecvTimeoutError::Timeout) => (without_end, false),
        Err(mpsc::RecvTimeoutError::Disconnected) => {
            (Row { problem: Some("the renderer panicked; its message is above".into()), ..without_end }, true)
        }
    }
}
