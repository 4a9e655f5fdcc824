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
        self.0.connect(details, chained).map_err(|error| match error {
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
        })
    }
}
