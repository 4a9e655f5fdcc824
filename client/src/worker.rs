//! [`Worker`]: a thread that carries out the latest request only; [`apart`], for its work that waits for a disk; and
//! [`join_in_time`], for threads that write a file while the player closes.
//!
//! A worker holds one event until the caller takes it, and goes on only then: a caller that takes none, as a headset
//! that was put down, has no clips pile up.

use std::any::Any;
use std::io;
use std::ops::ControlFlow;
use std::panic::{self, AssertUnwindSafe};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Interval between looks whether work that is apart is still wanted.
const LOOK_INTERVAL: Duration = Duration::from_millis(50);

/// A thread that carries out requests `R` and reports events `E`. A new request overtakes the request before it.
pub(crate) struct Worker<R, E> {
    /// `None` while the worker is dropped, which ends the thread.
    requests: Option<Sender<(u64, R)>>,
    shared: Arc<Shared<E>>,
    thread: Option<JoinHandle<()>>,
}

/// Where the work on a request reports its events.
pub(crate) struct Report<'a, E> {
    /// Reports an event, once the event before was taken; breaks if the request was overtaken.
    pub(crate) send: &'a dyn Fn(E) -> ControlFlow<()>,
    /// Whether the request was overtaken: what waits ends then.
    pub(crate) is_overtaken: &'a dyn Fn() -> bool,
}

/// What the work on the latest request panicked with; no event of it follows.
pub(crate) type Panic = Box<dyn Any + Send>;

/// What both threads share.
struct Shared<E> {
    state: Mutex<State<E>>,
    changed: Condvar,
}

struct State<E> {
    /// Number of the latest request.
    latest: u64,
    /// The next event of the latest request.
    event: Option<Result<E, Panic>>,
}

impl<E> Shared<E> {
    fn lock(&self) -> MutexGuard<'_, State<E>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits until the event before was taken, and leaves one of request `number`, unless it was overtaken.
    fn leave(&self, number: u64, event: Result<E, Panic>) -> ControlFlow<()> {
        let is_full = |state: &mut State<E>| state.latest == number && state.event.is_some();
        let waited = self.changed.wait_while(self.lock(), is_full);
        let mut state = waited.unwrap_or_else(PoisonError::into_inner);
        if state.latest != number {
            return ControlFlow::Break(());
        }
        state.event = Some(event);
        self.changed.notify_all();
        ControlFlow::Continue(())
    }

    /// Makes `number` the latest request, and forgets the event of the request before it.
    fn overtake(&self, number: impl FnOnce(u64) -> u64) -> u64 {
        let mut state = self.lock();
        state.latest = number(state.latest);
        let (latest, forgotten) = (state.latest, state.event.take());
        drop(state);
        drop(forgotten);
        self.changed.notify_all();
        latest
    }
}

impl<R: Send + 'static, E: Send + 'static> Worker<R, E> {
    /// Starts the thread, which carries requests out by `work` and calls `wake` after each event.
    ///
    /// # Errors
    /// If the system refuses another thread.
    pub(crate) fn new(
        work: impl Fn(R, &Report<'_, E>) + Send + 'static,
        wake: impl Fn() + Send + 'static,
    ) -> io::Result<Worker<R, E>> {
        let (requests, incoming) = channel::<(u64, R)>();
        let shared =
            Arc::new(Shared { state: Mutex::new(State { latest: 0, event: None }), changed: Condvar::new() });
        let ours = shared.clone();
        let thread = std::thread::Builder::new().name("loader".into()).spawn(move || {
            while let Ok(request) = incoming.recv() {
                // Requests that were overtaken while they waited are not begun.
                let (number, request) = incoming.try_iter().last().unwrap_or(request);
                let leave = |event| {
                    let flow = ours.leave(number, event);
                    wake();
                    flow
                };
                let report = Report {
                    send: &|event| leave(Ok(event)),
                    is_overtaken: &|| ours.lock().latest != number,
                };
                if let Err(panic) = panic::catch_unwind(AssertUnwindSafe(|| work(request, &report))) {
                    let _ = leave(Err(panic));
                }
            }
        })?;
        Ok(Worker { requests: Some(requests), shared, thread: Some(thread) })
    }

    /// Hands over a request, which overtakes all before it.
    pub(crate) fn request(&mut self, request: R) {
        let number = self.shared.overtake(|latest| latest + 1);
        if let Some(requests) = &self.requests {
            requests.send((number, request)).expect("the thread catches panics");
        }
    }

    /// The next event of the latest request, if there is one. Does not block.
    ///
    /// # Errors
    /// What the work panicked with.
    pub(crate) fn poll(&self) -> Result<Option<E>, Panic> {
        let event = self.shared.lock().event.take();
        self.shared.changed.notify_all();
        event.transpose()
    }

    /// Waits for the next event of the latest request, which must not be complete.
    ///
    /// # Errors
    /// What the work panicked with.
    #[cfg(not(target_os = "android"))]
    pub(crate) fn wait(&self) -> Result<E, Panic> {
        loop {
            if let Some(event) = self.wait_for(Duration::MAX)? {
                return Ok(event);
            }
        }
    }

    /// The next event of the latest request; `None` if there is none after `time`.
    ///
    /// # Errors
    /// What the work panicked with.
    pub(crate) fn wait_for(&self, time: Duration) -> Result<Option<E>, Panic> {
        let is_empty = |state: &mut State<E>| state.event.is_none();
        let waited = self.shared.changed.wait_timeout_while(self.shared.lock(), time, is_empty);
        let event = waited.unwrap_or_else(PoisonError::into_inner).0.event.take();
        self.shared.changed.notify_all();
        event.transpose()
    }
}

impl<R, E> Worker<R, E> {
    /// Lets the thread end by itself, once the request under way reports its next event.
    pub(crate) fn leave_behind(&mut self) {
        self.thread = None;
    }
}

impl<R, E> Drop for Worker<R, E> {
    /// Blocks until the request under way reports its next event, unless its thread was left behind: a graphics device
    /// must outlive the work on it.
    fn drop(&mut self) {
        self.shared.overtake(|_| u64::MAX);
        self.requests = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Takes an event of the work that [`apart`] does, and breaks to leave that work behind.
pub(crate) type OnEvent<'a, E> = &'a mut dyn FnMut(E) -> ControlFlow<()>;

/// Does `work` on a thread of its own, and passes its events on. `None` if `on_event` breaks or the work `is_overtaken`,
/// which is looked at every 50 ms: nothing ends a read of a disk that does not answer, so the thread is left behind.
///
/// # Errors
/// If the system refuses another thread.
///
/// # Panics
/// If `work` does.
pub(crate) fn apart<E: Send + 'static, T: Send + 'static>(
    work: impl FnOnce(OnEvent<'_, E>) -> T + Send + 'static,
    on_event: OnEvent<'_, E>,
    is_overtaken: &dyn Fn() -> bool,
) -> io::Result<Option<T>> {
    enum Sent<E, T> {
        Event(E),
        Done(T),
    }
    let (sender, sent) = channel();
    let thread = std::thread::Builder::new().name("opener".into()).spawn(move || {
        let done = work(&mut |event| match sender.send(Sent::Event(event)) {
            Ok(()) => ControlFlow::Continue(()),
            Err(_) => ControlFlow::Break(()),
        });
        // Nobody listens where it was left behind.
        let _ = sender.send(Sent::Done(done));
    })?;
    loop {
        match sent.recv_timeout(LOOK_INTERVAL) {
            Ok(Sent::Done(done)) => return Ok(Some(done)),
            Ok(Sent::Event(event)) => {
                if on_event(event).is_break() {
                    return Ok(None);
                }
            }
            Err(RecvTimeoutError::Timeout) if is_overtaken() => return Ok(None),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => {
                let panic = thread.join().expect_err("a thread that sends no result has panicked");
                panic::resume_unwind(panic)
            }
        }
    }
}

/// Longest wait for a thread that may wait for a disk itself: a folder on a server that is gone never answers.
const JOIN_TIMEOUT: Duration = Duration::from_secs(5);

/// Interval between looks whether such a thread has ended.
const JOIN_INTERVAL: Duration = Duration::from_millis(5);

/// Waits for the end of a thread that writes a file when the player closes, but no longer than [`JOIN_TIMEOUT`].
pub(crate) fn join_in_time(thread: JoinHandle<()>) {
    let start = Instant::now();
    while !thread.is_finished() && start.elapsed() < JOIN_TIMEOUT {
        std::thread::sleep(JOIN_INTERVAL);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_thread_is_waited_for_unless_it_never_ends() {
        let is_over = |work: fn()| {
            let (start, thread) = (Instant::now(), std::thread::spawn(work));
            join_in_time(thread);
            start.elapsed()
        };
        let slow = Duration::from_millis(100);
        assert!(is_over(|| std::thread::sleep(Duration::from_millis(100))) >= slow);
        assert!((JOIN_TIMEOUT..4 * JOIN_TIMEOUT).contains(&is_over(std::thread::park)));
    }

    const PATIENCE: Duration = Duration::from_secs(60);

    #[test]
    fn the_latest_request_wins() {
        let (permit, permits) = channel::<()>();
        let (begin, begun) = channel();
        // Reports the request for each permit until it is overtaken.
        let work = move |request: &'static str, report: &Report<'_, &'static str>| {
            begin.send(request).unwrap();
            while permits.recv().is_ok() && (report.send)(request).is_continue() {}
        };
        let (wake, woken) = channel();
        let mut worker = Worker::new(work, move || wake.send(()).unwrap()).unwrap();
        worker.request("a");
        assert_eq!(begun.recv().unwrap(), "a");
        permit.send(()).unwrap();
        assert_eq!(worker.wait().unwrap(), "a", "more of it may follow");
        worker.request("b");
        worker.request("c");
        (0..2).for_each(|_| permit.send(()).unwrap());
        assert_eq!(worker.wait().unwrap(), "c", "events of an overtaken request are dropped");
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
        let work = move |(), report: &Report<'_, ()>| {
            let _ = (0..ENOUGH).try_for_each(|_| {
                std::thread::sleep(Duration::from_millis(1));
                reported.send(()).unwrap();
                (report.send)(())
            });
        };
        let mut worker = Worker::new(work, || ()).unwrap();
        worker.request(());
        worker.wait().unwrap();
        drop(worker);
        assert!(reports.iter().count() < ENOUGH, "it was stopped");
    }

    #[test]
    fn work_that_waits_sees_that_it_was_overtaken() {
        let work = move |number: u32, report: &Report<'_, u32>| {
            while number == 0 && !(report.is_overtaken)() {
                std::thread::sleep(Duration::from_millis(1));
            }
            let _ = (report.send)(number);
        };
        let mut worker = Worker::new(work, || ()).unwrap();
        worker.request(0);
        assert!(worker.wait_for(Duration::from_millis(20)).unwrap().is_none());
        worker.request(1);
        assert_eq!(worker.wait().unwrap(), 1);
        worker.request(0);
        // Dropping overtakes it, too.
        drop(worker);
    }

    #[test]
    fn a_thread_that_is_left_behind_is_not_waited_for() {
        let (end, ends) = channel::<()>();
        let (ended, has_ended) = channel();
        let work = move |(), report: &Report<'_, ()>| {
            ends.recv().unwrap();
            ended.send((report.send)(()).is_break()).unwrap();
        };
        let mut worker = Worker::new(work, || ()).unwrap();
        worker.request(());
        worker.leave_behind();
        drop(worker);
        assert!(has_ended.try_recv().is_err());
        end.send(()).unwrap();
        assert!(has_ended.recv_timeout(PATIENCE).unwrap(), "it was overtaken");
    }

    #[test]
    fn work_apart_is_left_behind_by_those_who_do_not_want_it() {
        let (end, ends) = channel::<()>();
        let (ended, has_ended) = channel();
        let waits = move |_: OnEvent<'_, ()>| ended.send(ends.recv()).unwrap();
        assert!(apart(waits, &mut |()| ControlFlow::Continue(()), &|| true).unwrap().is_none());
        assert!(has_ended.try_recv().is_err());
        end.send(()).unwrap();
        assert!(has_ended.recv_timeout(PATIENCE).is_ok());

        let count = |on_event: OnEvent<'_, u32>| (0..3).take_while(|i| on_event(*i).is_continue()).count();
        let mut events = Vec::new();
        let mut on_event = |event| {
            events.push(event);
            if event < 2 { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
        };
        assert_eq!(apart(count, &mut on_event, &|| false).unwrap(), None);
        assert_eq!(events, [0, 1, 2]);
        let all = apart(count, &mut |_| ControlFlow::Continue(()), &|| false).unwrap();
        assert_eq!(all, Some(3));
    }

    #[test]
    #[should_panic(expected = "of the test")]
    fn a_panic_apart_is_a_panic() {
        let work = |_: OnEvent<'_, ()>| panic!("of the test");
        let _: Option<()> = apart(work, &mut |()| ControlFlow::Continue(()), &|| false).unwrap();
    }

    #[test]
    fn a_panic_ends_its_request_and_no_other() {
        let work = |defective: bool, report: &Report<'_, ()>| {
            assert!(!defective, "of the test");
            let _ = (report.send)(());
        };
        let (wake, woken) = channel();
        let mut worker = Worker::new(work, move || wake.send(()).unwrap()).unwrap();
        for _ in 0..2 {
            worker.request(true);
            let panic = loop {
                // A window that is not woken would load for ever. It may also be woken late, for an event that was
                // taken already.
                woken.recv_timeout(PATIENCE).unwrap();
                if let Err(panic) = worker.poll() {
                    break panic;
                }
            };
            assert_eq!(panic.downcast_ref(), Some(&"of the test"));
            worker.request(true);
            assert!(worker.wait().is_err());
            worker.request(false);
            worker.wait().unwrap();
        }
    }

    #[test]
    fn events_that_are_not_taken_do_not_pile_up() {
        let (reported, reports) = channel();
        let work = move |(), report: &Report<'_, u32>| {
            for event in 0.. {
                reported.send(event).unwrap();
                if (report.send)(event).is_break() {
                    return;
                }
            }
        };
        let mut worker = Worker::new(work, || ()).unwrap();
        worker.request(());
        let next = || reports.recv_timeout(PATIENCE).unwrap();
        assert_eq!((next(), next()), (0, 1));
        std::thread::sleep(Duration::from_millis(50));
        assert!(reports.try_recv().is_err(), "it waits with the second event");
        assert_eq!(worker.wait().unwrap(), 0);
        assert_eq!((next(), worker.poll().unwrap()), (2, Some(1)));
        worker.request(());
        assert_eq!(worker.wait().unwrap(), 0, "an event of the request before is forgotten");
        // It does not wait for ever for an event to be taken.
        drop(worker);
    }
}
