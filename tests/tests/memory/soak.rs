//! The short form of `soak`: twenty seconds of everything, and longer where few rounds fit in, after
//! which nothing is left that was not there before.

use std::time::Duration;

use aarc_tests::gpu::{self, Passes};
use aarc_tests::soak::soak;
use libtest_mimic::Trial;

use crate::HEAP;

const DURATION: Duration = Duration::from_secs(20);

/// The tests of this file.
pub(crate) fn trials() -> Vec<Trial> {
    vec![gpu::trial("playing on and on leaves nothing behind", Passes::Shared, |_| {
        let account = soak(DURATION, || HEAP.current_usage() as u64, |_| ())?;
        let done = [account.downloads, account.frames, account.seeks, account.resizes, account.losses];
        if done.contains(&0) {
            return Err(format!("something was not tried: {done:?}"));
        }
        account.check()
    })]
}
