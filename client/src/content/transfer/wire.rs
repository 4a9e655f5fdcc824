//! Connections that end with their fetch: [`Wire`] looks at the [`Watch`] while bytes are awaited, and
//! [`Secure`] says in words why a server refuses TLS.
//!
//! The HTTP library blocks until bytes arrive. Below TLS and HTTP, every byte passes here, also those that
//! these layers read without passing on any.

use std::io::ErrorKind;
use std::sync::Arc;
use std::time::{Duration, Instant};

use ureq::Error;
use ureq::unversioned::transport::{
    Buffers, ConnectionDetails, Connector, NextTimeout, RustlsConnector, Transport, time,
};

use super::watch::Watch;

/// How often to look at the watch.
const LOOK_INTERVAL: Duration = Duration::from_millis(200);

/// Wraps connections so that they end when the watch says so.
#[derive(Debug)]
pub(super) struct Wire(pub(super) Arc<Watch>);

impl<In: Transport> Connector<In> for Wire {
    type Out = Wired<In>;

    fn connect(&self, _: &ConnectionDetails<'_>, chained: Option<In>) -> Result<Option<Wired<In>>, Error> {
        Ok(chained.map(|inner| Wired { inner, watch: self.0.clone() }))
    }
}

/// A connection that ends with its fetch.
#[derive(Debug)]
pub(super) struct Wired<T> {
    inner: T,
    watch: Arc<Watch>,
}

impl<T: Transport> Transport for Wired<T> {
    fn buffers(&mut self) -> &mut dyn Buffers {
        self.inner.buffers()
    }

    fn transmit_output(&mut self, amount: usize, timeout: NextTimeout) -> Result<(), Error> {
        self.inner.transmit_output(amount, timeout)
    }

    fn await_input(&mut self, timeout: NextTimeout) -> Result<bool, Error> {
        let timeout = timeout.for_read();
        let start = Instant::now();
        loop {
            let now = Instant::now();
            if self.watch.is_cancelled() || self.watch.is_late(now) {
                // The watch knows the reason.
                return Err(Error::Io(ErrorKind::TimedOut.into()));
            }
            let left = timeout.after.saturating_sub(now - start);
            let slice = left.min(LOOK_INTERVAL);
            let within = NextTimeout { after: time::Duration::Exact(slice), ..timeout };
            match self.inner.await_input(within) {
                Err(Error::Timeout(_)) if slice < left => {}
                input => return input,
            }
        }
    }

    fn is_open(&mut self) -> bool {
        self.inner.is_open()
    }

    fn is_tls(&self) -> bool {
        self.inner.is_tls()
    }
}

/// Why a server has no secure connection.
const NO_TLS: &str = "the server does not speak TLS: try the URL with http://";

/// The error of a connection that was reset before it was secure.
pub(super) const HANDSHAKE_RESET: &str =
    "the server ends it before it begins (if it does not speak TLS, try the URL with http://)";

/// Wraps connections in TLS.
#[derive(Debug, Default)]
pub(super) struct Secure(RustlsConnector);

impl<In: Transport> Connector<In> for Secure {
    type Out = <RustlsConnector as Connector<In>>::Out;

    fn connect(
        &self,
        details: &ConnectionDetails<'_>,
        chained: Option<In>,
    ) -> Result<Option<Self::Out>, Error> {
        self.0.connect(details, chained).map_err(handshake_error)
    }
}

/// The error of a TLS handshake, with its likely reason.
fn handshake_error(error: Error) -> Error {
    match error {
        // What comes back is no TLS, or nothing.
        Error::Io(error)
            if error.kind() == ErrorKind::UnexpectedEof
                || error.to_string().contains("InvalidContentType") =>
        {
            Error::Tls(NO_TLS)
        }
        // So does a server that speaks no TLS, and a network that is bad.
        Error::Io(error) if error.kind() == ErrorKind::ConnectionReset => Error::Tls(HANDSHAKE_RESET),
        error => error,
    }
}

#[cfg(test)]
mod tests {
    use std::io;

    use ureq::Timeout;

    use super::*;
    use crate::content::transfer::retry::RetryPolicy;

    /// A connection on which nothing arrives within the first `timeouts` waits.
    #[derive(Debug)]
    struct Silent {
        timeouts: usize,
    }

    impl Transport for Silent {
        fn buffers(&mut self) -> &mut dyn Buffers {
            unreachable!("no bytes pass")
        }

        fn transmit_output(&mut self, _: usize, _: NextTimeout) -> Result<(), Error> {
            unreachable!("no bytes pass")
        }

        fn await_input(&mut self, timeout: NextTimeout) -> Result<bool, Error> {
            match self.timeouts.checked_sub(1) {
                Some(timeouts) => {
                    self.timeouts = timeouts;
                    Err(Error::Timeout(timeout.reason))
                }
                None => Ok(true),
            }
        }

        fn is_open(&mut self) -> bool {
            true
        }
    }

    #[test]
    fn bytes_are_awaited_until_the_timeout_or_the_end_of_the_fetch() {
        let retry = RetryPolicy { grace: Duration::from_secs(3600), ..RetryPolicy::default() };
        let watch = Arc::new(Watch::new(&retry));
        let await_input = |timeouts, after| {
            let timeout = NextTimeout {
                after: time::Duration::Exact(after),
                reason: Timeout::RecvBody,
                ..NextTimeout::default()
            };
            Wired { inner: Silent { timeouts }, watch: watch.clone() }.await_input(timeout)
        };
        let long = Duration::from_secs(3600);
        assert!(matches!(await_input(3, long), Ok(true)), "the watch was looked at in between");
        assert!(matches!(await_input(1, LOOK_INTERVAL / 2), Err(Error::Timeout(Timeout::RecvBody))));
        watch.cancel();
        assert!(matches!(await_input(3, long), Err(Error::Io(_))));
    }

    #[test]
    fn a_refused_certificate_is_not_the_absence_of_tls() {
        let error = |kind, text: &str| handshake_error(Error::Io(io::Error::new(kind, text)));
        for (kind, text) in [(ErrorKind::UnexpectedEof, ""), (ErrorKind::InvalidData, "InvalidContentType")] {
            assert!(matches!(error(kind, text), Error::Tls(NO_TLS)), "{kind}");
        }
        assert!(matches!(error(ErrorKind::ConnectionReset, ""), Error::Tls(HANDSHAKE_RESET)));
        assert!(matches!(error(ErrorKind::InvalidData, "invalid peer certificate"), Error::Io(_)));
    }
}
