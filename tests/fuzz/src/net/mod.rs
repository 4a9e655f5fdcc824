//! Dialogues between the player's downloader and a server that any bytes script. The downloader is the
//! player's own code; a [`request::Server`], honest or not, replaces HTTP.

#[path = "../../../../client/src/net/arrived.rs"]
#[allow(dead_code, unreachable_pub, reason = "the player uses the rest")]
mod arrived;
#[path = "../../../../client/src/net/fetch.rs"]
#[allow(dead_code, unreachable_pub, reason = "the player uses the rest")]
mod fetch;
#[path = "../../../../client/src/net/head.rs"]
#[allow(dead_code, unreachable_pub, reason = "the player uses the rest")]
mod head;
#[path = "../../../../client/src/net/meter.rs"]
#[allow(dead_code, unreachable_pub, reason = "the player uses the rest")]
mod meter;
pub(crate) mod request;
#[path = "../../../../client/src/net/transfer.rs"]
#[allow(dead_code, unreachable_pub, reason = "the player uses the rest")]
mod transfer;
#[path = "../../../../client/src/net/trouble.rs"]
#[allow(dead_code, unreachable_pub, reason = "the player uses the rest")]
mod trouble;

use std::time::Duration;

use codec::Limits;

use arrived::Arrived;
use fetch::{End, Fetch};
use request::{Script, versions};
use transfer::Patience;

/// No waiting, so that the input alone determines the dialogue.
const PATIENCE: Patience = Patience {
    answer: Duration::ZERO,
    silence: Duration::ZERO,
    retries: 5,
    first_retries: 5,
    first_wait: Duration::ZERO,
};

/// Longest time of a dialogue, which usually takes microseconds.
const TIMEOUT: Duration = Duration::from_secs(20);

/// Bytes that the downloader reads at a time, beyond the limits.
const READ_BYTES: usize = 64 << 10;

/// Runs the dialogue that `bytes` script.
///
/// # Panics
/// If the downloader hangs, keeps more bytes than its limits, or returns a clip that an honest server
/// does not have.
pub fn check_dialogue(bytes: &[u8]) {
    let script = Script::of(bytes);
    let (honest, known) = (script.is_honest(), script.known());
    let longest = versions().iter().map(Vec::len).max().unwrap_or(0);
    let limits = Limits { max_bytes: longest + 1000, ..Limits::default() };
    script.stage();
    let fetch = Fetch::start("", PATIENCE, limits.max_bytes, Arrived::new(limits), known.clone())
        .expect("a thread can be started");
    let mut state = fetch.wait(TIMEOUT, |state| state.end.is_some());
    let received = state.arrived.take();
    assert!(received.len() <= limits.max_bytes + READ_BYTES, "{} bytes received", received.len());
    match state.end.take().expect("every dialogue ends") {
        End::Complete { .. } => {
            assert!(!honest || versions().contains(&received), "{} bytes of no version", received.len());
        }
        End::Unchanged => assert!(known.is_some(), "unchanged without a known version"),
        End::Failed { fault, .. } => {
            let text = fault.to_string();
            assert!(!text.is_empty() && !text.contains('\n'), "one line: {text}");
        }
    }
}
