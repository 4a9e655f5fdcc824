//! [`Task`]: work that waits for a server, on a thread of its own.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::Duration;

use program::Fault;

use super::exchange::Exchange;

/// Work on a thread of its own. Dropping it closes its [`Exchange`], and leaves the thread behind.
#[derive(Debug)]
pub(crate) struct Task<T> {
    exchange: Arc<Exchange>,
    result: Receiver<Result<T, Fault>>,
    is_done: bool,
}

impl<T: Send + 'static> Task<T> {
    /// Begins `work`, which waits for answers of `exchange` only.
    ///
    /// # Errors
    /// [`Fault::Device`] if the system refuses a thread.
    pub(crate) fn begin(
        exchange: Arc<Exchange>,
        work: impl FnOnce() -> Result<T, Fault> + Send + 'static,
    ) -> Result<Task<T>, Fault> {
        let (sender, result) = channel();
        let thread = std::thread::Builder::new().name("transfer".into()).spawn(move || {
            // Nobody listens where it is not wanted any more.
            let _ = sender.send(work());
        });
        thread.map_err(|error| Fault::Device(format!("cannot start a thread: {error}")))?;
        Ok(Task { exchange, result, is_done: false })
    }

    /// The requests of the work.
    pub(crate) fn exchange(&self) -> &Exchange {
        &self.exchange
    }

    /// Waits for the result, for `time` at most.
    pub(crate) fn wait(&mut self, time: Duration) -> Option<Result<T, Fault>> {
        let result = match self.result.recv_timeout(time) {
            Ok(result) => result,
            Err(RecvTimeoutError::Timeout) => return None,
            Err(RecvTimeoutError::Disconnected) => Err(Fault::Defect(format!(
                "{}: it cannot be opened: report it with the player's log",
                self.exchange.name()
            ))),
        };
        self.is_done = true;
        Some(result)
    }
}

impl<T> Drop for Task<T> {
    fn drop(&mut self) {
        if !self.is_done {
            self.exchange.close();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::content::transfer::RetryPolicy;

    fn exchange() -> Arc<Exchange> {
        Arc::new(Exchange::new("http://host/a?key", RetryPolicy::default()).unwrap())
    }

    #[test]
    fn a_panic_of_the_work_is_a_defect() {
        let mut task: Task<()> = Task::begin(exchange(), || panic!("of the test")).unwrap();
        let result = task.wait(Duration::from_secs(60)).unwrap();
        assert!(matches!(result, Err(Fault::Defect(why)) if why.starts_with("http://host/a: ")));
    }

    #[test]
    fn nobody_waits_for_work_that_is_dropped() {
        let (end, ends) = channel::<()>();
        let mut task = Task::begin(exchange(), move || Ok(ends.recv().is_ok())).unwrap();
        assert!(task.wait(Duration::from_millis(10)).is_none());
        drop(task);
        end.send(()).unwrap();
    }
}
