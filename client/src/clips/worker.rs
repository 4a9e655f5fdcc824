//! [`Worker`]: a thread that carries out the latest request only.

use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};
use std::thread::JoinHandle;

/// A thread that carries out requests `R` and reports events `E`. A new request overtakes the one before.
pub(super) struct Worker<R, E> {
    /// `None` while the worker is dropped, which ends the thread.
    requests: Option<Sender<(u64, R)>>,
    events: Receiver<(u64, E)>,
    thread: Option<JoinHandle<()>>,
    latest: Arc<AtomicU64>,
}

/// Reports an event; breaks once the request was overtaken.
pub(super) type Report<'a, E> = &'a dyn Fn(E) -> ControlFlow<()>;

/// The thread has panicked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Ended;

impl<R: Send + 'static, E: Send + 'static> Worker<R, E> {
    /// Starts the thread, which carries requests out by `work` and calls `wake` after each event.
    ///
    /// # Errors
    /// If the system refuses another thread.
    pub(super) fn new(
        work: impl Fn(R, Report<'_, E>) + Send + 'static,
        wake: impl Fn() + Send + 'static,
    ) -> std::io::Result<Worker<R, E>> {
        let (requests, incoming) = channel::<(u64, R)>();
        let (report, events) = channel();
        let latest = Arc::new(AtomicU64::new(0));
        let current = latest.clone();
        let thread = std::thread::Builder::new().name("loader".into()).spawn(move || {
            while let Ok(request) = incoming.recv() {
                // Requests that were overtaken while they waited are not begun.
                let (number, request) = incoming.try_iter().last().unwrap_or(request);
                work(request, &|event| {
                    // The receiver goes away together with `current` being overtaken.
                    let _ = report.send((number, event));
                    wake();
                    let is_latest = current.load(Ordering::Relaxed) == number;
                    if is_latest { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
                });
            }
        })?;
        Ok(Worker { requests: Some(requests), events, thread: Some(thread), latest })
    }

    /// Hands over a request, which overtakes all before it.
    pub(super) fn request(&mut self, request: R) {
        let number = self.latest.fetch_add(1, Ordering::Relaxed) + 1;
        if let Some(requests) = &self.requests {
            // A thread that has panicked is found out by the next `poll` or `wait`.
            let _ = requests.send((number, request));
        }
    }

    /// The next event of the latest request, if there is one. Does not block.
    pub(super) fn poll(&self) -> Result<Option<E>, Ended> {
        loop {
            match self.events.try_recv() {
                Ok((number, event)) if self.is_latest(number) => return Ok(Some(event)),
                Ok(_) => {}
                Err(TryRecvError::Empty) => return Ok(None),
                Err(TryRecvError::Disconnected) => return Err(Ended),
            }
        }
    }

    /// Waits for the next event of the latest request, which must not be complete.
    #[cfg(any(not(target_os = "android"), test))]
    pub(super) fn wait(&self) -> Result<E, Ended> {
        loop {
            match self.events.recv() {
                Ok((number, event)) if self.is_latest(number) => return Ok(event),
                Ok(_) => {}
                Err(_) => return Err(Ended),
            }
        }
    }

    fn is_latest(&self, number: u64) -> bool {
        number == self.latest.load(Ordering::Relaxed)
    }
}

impl<R, E> Drop for Worker<R, E> {
    /// Blocks until the request under way reports its next event: the graphics device must outlive it.
    fn drop(&mut self) {
        self.latest.store(u64::MAX, Ordering::Relaxed);
        self.requests = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn the_latest_request_wins() {
        let (permit, permits) = channel::<()>();
        let (begin, begun) = channel();
        // Reports the request for each permit until it is overtaken.
        let work = move |request: &'static str, report: Report<'_, &'static str>| {
            begin.send(request).unwrap();
            while permits.recv().is_ok() && report(request).is_continue() {}
        };
        let (wake, woken) = channel();
        let mut worker = Worker::new(work, move || wake.send(()).unwrap()).unwrap();
        worker.request("a");
        assert_eq!(begun.recv().unwrap(), "a");
        permit.send(()).unwrap();
        assert_eq!(worker.wait(), Ok("a"), "more of it may follow");
        worker.request("b");
        worker.request("c");
        (0..2).for_each(|_| permit.send(()).unwrap());
        assert_eq!(worker.wait(), Ok("c"), "events of an overtaken request are dropped");
        assert_eq!(begun.recv().unwrap(), "c", "b was never begun");
        assert!(woken.try_iter().count() >= 2);
        drop(permit);
        drop(worker);
    }

    #[test]
    fn it_ends_when_the_request_under_way_reports_its_next_event() {
        const ENOUGH: usize = 60_000;
        let (reported, reports) = channel();
        // Runs for a minute unless it is stopped.
        let work = move |(), report: Report<'_, ()>| {
            let _ = (0..ENOUGH).try_for_each(|_| {
                std::thread::sleep(Duration::from_millis(1));
                reported.send(()).unwrap();
                report(())
            });
        };
        let mut worker = Worker::new(work, || ()).unwrap();
        worker.request(());
        assert_eq!(worker.wait(), Ok(()));
        drop(worker);
        assert!(reports.iter().count() < ENOUGH, "it was stopped");
    }

    #[test]
    fn a_thread_that_panicked_is_found_out() {
        let mut worker = Worker::new(|(), _: Report<'_, ()>| panic!("of the test"), || ()).unwrap();
        worker.request(());
        assert_eq!(worker.wait(), Err(Ended));
        worker.request(());
        assert_eq!(worker.poll(), Err(Ended));
    }
}
