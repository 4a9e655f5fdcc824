//! Dialogues between the player's transfers and a server that any bytes script. The transfers are the
//! player's own code; a [`request::Server`], honest or not, replaces HTTP.

#[path = "../../../../client/src/content/transfer/cache.rs"]
#[allow(dead_code, unreachable_pub, reason = "the player uses the rest")]
mod cache;
#[path = "../../../../client/src/content/transfer/exchange.rs"]
#[allow(dead_code, unreachable_pub, reason = "the player uses the rest")]
mod exchange;
#[path = "../../../../client/src/content/transfer/head.rs"]
#[allow(dead_code, unreachable_pub, reason = "the player uses the rest")]
mod head;
#[path = "../../../../client/src/content/transfer/meter.rs"]
#[allow(dead_code, unreachable_pub, reason = "the player uses the rest")]
mod meter;
#[path = "../../../../client/src/content/transfer/remote_file.rs"]
#[allow(dead_code, unreachable_pub, reason = "the player uses the rest")]
mod remote_file;
pub(crate) mod request;
#[path = "../../../../client/src/content/transfer/request_error.rs"]
#[allow(dead_code, unreachable_pub, reason = "the player uses the rest")]
mod request_error;
#[path = "../../../../client/src/content/transfer/retry.rs"]
#[allow(dead_code, unreachable_pub, reason = "the player uses the rest")]
mod retry;
#[path = "../../../../client/src/content/transfer/state.rs"]
#[allow(dead_code, unreachable_pub, reason = "the player uses the rest")]
mod state;
#[path = "../../../../client/src/content/transfer/watch.rs"]
#[allow(dead_code, unreachable_pub, reason = "the player uses the rest")]
mod watch;
#[path = "../../../../client/src/content/transfer/whole_file.rs"]
#[allow(dead_code, unreachable_pub, reason = "the player uses the rest")]
mod whole_file;

use std::time::Duration;

use codec::{Limits, contents, decode};
use program::Fault;

use remote_file::RemoteFile;
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

/// Runs the dialogue that `bytes` script.
///
/// # Panics
/// If the player reads more bytes than it asks for, a clip that an honest server does not have, or parts of two versions
/// that the server tells apart.
pub fn check_dialogue(bytes: &[u8]) {
    let script = Script::parse(bytes);
    let (is_honest, tells_versions, known) = (script.is_honest(), script.tells_versions(), script.known());
    script.stage();
    let file = RemoteFile::new("http://host/clip.aarc", RETRY, None).expect("nothing is asked yet");
    match read(&file, known.as_deref()) {
        Ok(None) => assert!(known.is_some(), "unchanged without a known version"),
        Ok(Some(clip)) => {
            let is_one = versions().contains(&clip);
            let is_clip = || decode(&clip, &Limits::default()).is_ok();
            assert!(
                !is_honest || is_one || !tells_versions && !is_clip(),
                "{} bytes of no version",
                clip.len()
            );
        }
        Err(fault) => {
            let text = fault.to_string();
            assert!(!text.is_empty() && !text.contains('\n'), "one line: {text}");
        }
    }
}

/// Reads a clip as the player does: its head, and one layer after the other. `None` if the version `known` is current.
fn read(file: &RemoteFile, known: Option<&str>) -> Result<Option<Vec<u8>>, Fault> {
    if !file.connect(known)? {
        return Ok(None);
    }
    let first = &versions()[0];
    let contents = contents(first, &Limits::default()).expect("a package");
    let head_bytes = contents.head_bytes as u64;
    let mut clip = file.read(0, &[head_bytes])?;
    file.set_head(&clip, true);
    // Of versions with other layers, these are parts like any others.
    let ends: Vec<u64> = contents.layer_bytes().into_iter().map(|end| end as u64).collect();
    for layers in 1..=ends.len() {
        let before = clip;
        clip = file.read(0, &ends[..layers])?;
        assert!(clip.len() as u64 <= ends[layers - 1], "{} bytes of {}", clip.len(), ends[layers - 1]);
        assert!(clip.starts_with(&before), "what was read changes");
        if clip.len() as u64 == ends[layers - 1] {
            file.keep(0, &ends[..layers], 0, false);
        }
    }
    Ok(Some(clip))
}
