//! Dialogues between the player's downloader and a server that any bytes make up: the downloader's
//! own files, and in the place of HTTP a [`request::Server`] that keeps to it or does not.

#[path = "../../../../client/src/net/partial_file.rs"]
#[allow(dead_code, unreachable_pub, reason = "the player uses the rest")]
mod partial_file;
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
#[path = "../../../../client/src/net/request_error.rs"]
#[allow(dead_code, unreachable_pub, reason = "the player uses the rest")]
mod request_error;
#[path = "../../../../client/src/net/retry.rs"]
#[allow(dead_code, unreachable_pub, reason = "the player uses the rest")]
mod retry;

use std::time::Duration;

use codec::Limits;

use partial_file::PartialFile;
use fetch::{Fetch, Outcome};
use request::{Script, versions};
use retry::RetryPolicy;

/// Breaks are not waited after: what is fuzzed decides, not the clock.
const RETRY: RetryPolicy = RetryPolicy {
    response_timeout: Duration::ZERO,
    read_timeout: Duration::ZERO,
    retries: 5,
    first_retries: 5,
    first_wait: Duration::ZERO,
};

/// Longest time for a dialogue, which takes microseconds.
const LONGEST: Duration = Duration::from_secs(20);

/// Bytes that the downloader reads at a time, which come on top of the limits.
const READ_BYTES: usize = 64 << 10;

/// Holds the dialogue that `bytes` stand for.
///
/// # Panics
/// If the downloader hangs or keeps more than it may, or takes for a clip what is none of those that
/// an honest server has.
pub fn check_dialogue(bytes: &[u8]) {
    let script = Script::of(bytes);
    let (honest, known) = (script.is_honest(), script.known());
    let longest = versions().iter().map(Vec::len).max().unwrap_or(0);
    let limits = Limits { max_bytes: longest + 1000, ..Limits::default() };
    script.stage();
    let fetch = Fetch::start("", RETRY, limits.max_bytes, PartialFile::package(limits), known.clone())
        .expect("a thread can be started");
    let mut state = fetch.wait(LONGEST, |state| state.outcome.is_some());
    let kept = state.file.take();
    assert!(kept.len() <= limits.max_bytes + READ_BYTES, "{} bytes kept", kept.len());
    match state.outcome.take().expect("every dialogue ends") {
        Outcome::Complete { .. } => {
            assert!(!honest || versions().contains(&kept), "{} bytes of no version", kept.len());
        }
        Outcome::Unchanged => assert!(known.is_some(), "unchanged from nothing"),
        Outcome::Failed { fault, .. } => {
            let text = fault.to_string();
            assert!(!text.is_empty() && !text.contains('\n'), "one line: {text}");
        }
    }
}
