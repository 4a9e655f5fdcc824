//! [`Watch`]: whether a fetch goes on: it ends when its caller drops it, and a request ends when its bytes
//! come too slowly.
//!
//! A request starts with some seconds. Each new byte of the file adds its share of a second at the least
//! rate, but never more than those seconds are left. So a request takes at most as long as its bytes take at
//! the least rate, and these seconds; and a server that was fast before cannot trickle for long.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use super::retry::RetryPolicy;

/// Shared by the thread of a fetch, which also looks at it while it waits for bytes, and its caller.
#[derive(Debug)]
pub(super) struct Watch {
    is_cancelled: AtomicBool,
    grace: Duration,
    least_bytes_per_s: u32,
    /// When the request is too slow.
    due: Mutex<Instant>,
}

impl Watch {
    /// A watch whose first request begins now.
    pub(super) fn new(retry: &RetryPolicy) -> Watch {
        let RetryPolicy { grace, least_bytes_per_s, .. } = *retry;
        let due = Mutex::new(Instant::now() + grace);
        Watch { is_cancelled: AtomicBool::new(false), grace, least_bytes_per_s, due }
    }

    /// Begins a request at `now`.
    pub(super) fn begin(&self, now: Instant) {
        *self.due() = now + self.grace;
    }

    /// Counts new bytes of the file that have arrived at `now`.
    pub(super) fn count(&self, now: Instant, bytes: u64) {
        let mut due = self.due();
        let seconds = bytes as f64 / f64::from(self.least_bytes_per_s.max(1));
        // More than the grace is capped below, and may be more than a duration holds.
        let earned = self.grace.min(Duration::try_from_secs_f64(seconds).unwrap_or(self.grace));
        *due = (*due + earned).min(now + self.grace);
    }

    /// Whether the bytes of the request come too slowly.
    pub(super) fn is_late(&self, now: Instant) -> bool {
        now >= *self.due()
    }

    /// Ends the fetch.
    pub(super) fn cancel(&self) {
        self.is_cancelled.store(true, Ordering::Relaxed);
    }

    /// Takes back [`Watch::cancel`].
    pub(super) fn resume(&self) {
        self.is_cancelled.store(false, Ordering::Relaxed);
    }

    /// Whether the caller has ended the fetch.
    pub(super) fn is_cancelled(&self) -> bool {
        self.is_cancelled.load(Ordering::Relaxed)
    }

    /// The least rate.
    pub(super) fn least_bytes_per_s(&self) -> u32 {
        self.least_bytes_per_s
    }

    fn due(&self) -> MutexGuard<'_, Instant> {
        self.due.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RETRY: RetryPolicy = RetryPolicy {
        response_timeout: Duration::from_secs(10),
        read_timeout: Duration::from_secs(10),
        grace: Duration::from_secs(30),
        least_bytes_per_s: 1000,
        retries: 5,
        first_retries: 5,
        first_wait: Duration::ZERO,
    };

    #[test]
    fn a_request_ends_after_its_grace_and_its_bytes_at_the_least_rate() {
        let (watch, start) = (Watch::new(&RETRY), Instant::now());
        let at = |seconds: u64| start + Duration::from_secs(seconds);
        watch.begin(start);
        assert!(!watch.is_late(at(29)) && watch.is_late(at(30)));
        // A byte every nine seconds buys nine milliseconds a minute.
        for seconds in (9..30).step_by(9) {
            watch.count(at(seconds), 1);
        }
        assert!(watch.is_late(at(31)));
        // Exactly the least rate goes on for ever.
        watch.begin(start);
        for seconds in 1..1000 {
            assert!(!watch.is_late(at(seconds)));
            watch.count(at(seconds), 1000);
        }
    }

    #[test]
    fn bytes_that_came_fast_do_not_pay_for_a_trickle() {
        let (watch, start) = (Watch::new(&RETRY), Instant::now());
        watch.begin(start);
        watch.count(start, u64::MAX);
        assert!(!watch.is_late(start + Duration::from_secs(29)));
        assert!(watch.is_late(start + Duration::from_secs(30)));
    }
}
