//! [`Options`] of transfers, and what all transfers report alike.

use std::time::Duration;

use codec::Limits;
use program::Fault;

use super::cache::Cache;
use super::retry::RetryPolicy;

/// Time between two reports of progress: short, and still long enough to read the numbers.
pub(crate) const REPORT_INTERVAL: Duration = Duration::from_millis(250);

/// Options of a download.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// The cache, if downloads are cached.
    pub cache: Option<Cache>,
    /// Timeouts and retries.
    pub retry: RetryPolicy,
    /// Limits on the package.
    pub limits: Limits,
}

/// Says that a cached version plays because the server was not reached.
pub(crate) fn cached_version_note(fault: &Fault) -> String {
    format!("{fault}; the version cached on this device plays")
}
