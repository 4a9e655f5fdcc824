//! The short form of the program `soak`: plays for twenty seconds, or longer if few rounds fit in, and
//! checks that memory is flat.

use std::time::Duration;

use aarc_tests::gpu::{self, Passes};
use aarc_tests::soak::soak;
use libtest_mimic::Trial;

use crate::HEAP;

const DURATION: Duration = Duration::from_secs(20);

/// The tests of this file.
pub(crate) fn trials() -> Vec<Trial> {
    vec![gpu::trial("memory is flat while clips play", Passes::Shared, |_| {
        let account = soak(DURATION, || HEAP.current_usage() as u64, |_| ())?;
        let done = [account.downloads, account.frames, account.seeks, account.resizes, account.losses];
        if done.contains(&0) {
            return Err(format!("something was not tried: {done:?}"));
        }
        account.check()
    })]
}
