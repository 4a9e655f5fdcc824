//! [`run_suite`]: all cases, one after another, each within a time limit.

use std::sync::mpsc;
use std::thread;
use std::time::Duration;

use client::gpu::Gpu;

use super::case::StabilityCase;
use super::result::CaseResult;
use super::run::run;

/// Time limit of a case, including the reference's images.
const PATIENCE: Duration = Duration::from_secs(180);

/// Measures `cases` on `gpu` and calls `on_result` with the result of each. The suite ends at a case that exceeds
/// the time limit, because that case still occupies the device.
pub fn run_suite(cases: Vec<StabilityCase>, gpu: &'static Gpu, mut on_result: impl FnMut(CaseResult)) {
    for case in cases {
        let unfinished = CaseResult {
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
            problem: Some("it did not finish; the cases after it were not run".into()),
        };
        let (sender, receiver) = mpsc::channel();
        thread::spawn(move || {
            // Fails after a timeout, when the receiver is gone.
            let _ = sender.send(run(&case, gpu));
        });
        match receiver.recv_timeout(PATIENCE) {
            Ok(result) => on_result(result),
            Err(mpsc::RecvTimeoutError::Timeout) => return on_result(unfinished),
            Err(mpsc::RecvTimeoutError::Disconnected) => {
                let problem = Some("the renderer panicked; its message is above".into());
                on_result(CaseResult { problem, ..unfinished });
            }
        }
    }
}
