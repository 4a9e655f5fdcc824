//! Rows of parameters: [joined](joined()) and moved in [time](later()), and their [lives].

use refine::fit::{Parameters, Timeline};

/// The rows of `first` and then the rows of `second`. Parameters without rows need not have the columns of the others.
pub(super) fn joined(mut first: Parameters<f32>, second: Parameters<f32>) -> Parameters<f32> {
    if first.is_empty() {
        return second;
    }
    if second.is_empty() {
        return first;
    }
    first.append(second);
    first
}

/// The rows with times that count from a moment `shift` intervals later.
pub(super) fn later(mut parameters: Parameters<f32>, shift: f64) -> Parameters<f32> {
    parameters.tau.iter_mut().for_each(|tau| *tau = (f64::from(*tau) - shift) as f32);
    parameters
}

/// Birth and death of each row in seconds of the take; `None` for one that is never alive.
pub(super) fn lives(
    parameters: &Parameters<f32>,
    interval_s: f64,
    [from_s, to_s]: [f64; 2],
) -> Vec<Option<[f64; 2]>> {
    let timeline = Timeline { frames: 2, intervals: (to_s - from_s) / interval_s };
    let field = parameters.to_field(timeline);
    let second = |t: f64| from_s + t * (to_s - from_s);
    (0..field.len()).map(|row| field.life(row).map(|(birth, death)| [second(birth), second(death)])).collect()
}
