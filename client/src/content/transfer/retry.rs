//! [`RetryPolicy`]: how long to wait for a server, how slow it may be, and how often to retry.

use std::time::Duration;

/// New bytes after which all retries are available again: a server that trickles has fewer.
pub(super) const PROGRESS_BYTES: u64 = 1000;

/// Timeouts, least rate and number of retries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RetryPolicy {
    /// Longest time for each of name resolution, connection and the head of the response.
    pub response_timeout: Duration,
    /// Longest time without a byte.
    pub read_timeout: Duration,
    /// Longest time of a request, beyond the time of its bytes at the least rate.
    pub grace: Duration,
    /// The least rate of a request.
    pub least_bytes_per_s: u32,
    /// Retries in a row without `PROGRESS_BYTES` of progress.
    pub retries: u32,
    /// Retries before the first byte.
    pub first_retries: u32,
    /// Wait before the first retry; each further wait is twice as long.
    pub first_wait: Duration,
}

impl Default for RetryPolicy {
    /// Timeouts of 10 s; 1000 bytes a second after 30 s; 5 retries within 8 s.
    fn default() -> RetryPolicy {
        RetryPolicy {
            response_timeout: Duration::from_secs(10),
            read_timeout: Duration::from_secs(10),
            grace: Duration::from_secs(30),
            least_bytes_per_s: 1000,
            retries: 5,
            first_retries: 5,
            first_wait: Duration::from_millis(250),
        }
    }
}

impl RetryPolicy {
    /// The policy for asking whether a cached file is current: a short timeout, and no retry before the
    /// first byte.
    pub(crate) fn for_revalidation(self) -> RetryPolicy {
        let response_timeout = self.response_timeout.min(Duration::from_secs(3));
        RetryPolicy { response_timeout, first_retries: 0, ..self }
    }
}
