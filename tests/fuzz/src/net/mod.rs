//! Dialogues between the player's downloader and a server that any bytes script. The downloader is the
//! player's own code; a [`request::Server`], honest or not, replaces HTTP.

#[path = "../../../../client/src/net/fetch.rs"]
#[allow(dead_code, unreachable_pub, reason = "the player uses the rest")]
mod fetch;
#[path = "../../../../client/src/net/head.rs"]
#[allow(dead_code, unreachable_pub, reason = "the player uses the rest")]
mod head;
#[path = "../../../../client/src/net/meter.rs"]
#[allow(dead_code, unreachable_pub, reason = "the player uses the rest")]
mod meter;
#[path = "../../../../client/src/net/partial_file.rs"]
#[allow(dead_code, unreachable_pub, reason = "the player uses the rest")]
mod partial_file;
pub(crate) mod request;
#[path = "../../../../client/src/net/request_error.rs"]
#[allow(dead_code, unreachable_pub, reason = "the player uses the rest")]
mod request_error;
#[path = "../../../../client/src/net/retry.rs"]
#[allow(dead_code, unreachable_pub, reason = "the player uses the rest")]
mod retry;
#[path = "../../../../client/src/net/transfer.rs"]
#[allow(dead_code, unreachable_pub, reason = "the player uses the rest")]
mod transfer;

#[path = "../../../../client/src/net/watch.rs"]
#[allow(dead_code, unreachable_pub, reason = "the player uses the rest")]
mod watch;

use std::time::Duration;

use codec::Limits;

use fetch::{Fetch, FetchOptions, Outcome};
use partial_file::PartialFile;
use request::{Script, versions};
use retry::RetryPolicy;

/// No waiting, so that the input alone determines the dialogue.
const RETRY: RetryPolicy = RetryPolicy {
    response_timeout: Duration::ZERO,
    read_timeout: Duration::ZERO,
    grace: Duration::ZERO,
    least_bytes_per_s: 1,
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
    let script = Script::parse(bytes);
    let (honest, known) = (script.is_honest(), script.known());
    let longest = versions().iter().map(Vec::len).max().unwrap_or(0);
    let limits = Limits { max_bytes: longest + 1000, ..Limits::default() };
    script.stage();
    let options =
        FetchOptions { url: String::new(), retry: RETRY, max_bytes: limits.max_bytes, cached: known.clone() };
    let fetch = Fetch::start(options, PartialFile::package(limits)).expect("a thread can be started");
    let mut state = fetch.wait(TIMEOUT, |state| state.outcome.is_some());
    let received = state.file.take();
    assert!(received.len() <= limits.max_bytes + READ_BYTES, "{} bytes received", received.len());
    match state.outcome.take().expect("every dialogue ends") {
        Outcome::Complete { .. } => {
            assert!(!honest || versions().contains(&received), "{} bytes of no version", received.len());
        }
        Outcome::Take => assert!(!honest, "no version is a take"),
        Outcome::Unchanged => assert!(known.is_some(), "unchanged without a known version"),
        Outcome::Failed { fault, .. } => {
            let text = fault.to_string();
            assert!(!text.is_empty() && !text.contains('\n'), "one line: {text}");
        }
    }
}
