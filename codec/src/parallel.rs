//! [`try_for_each`]: work items, such as the chunks of a package, on several threads.

use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread;

/// Gives `items` in order to `workers`. The last worker runs on the calling thread, each other one
/// on a thread of its own; if the system cannot start a thread, the remaining workers do its work.
///
/// # Errors
/// The error of the first item, in order, that fails: the same for any number of workers. Items
/// after it may be skipped.
pub(crate) fn try_for_each<T: Send, E: Send, W: FnMut(T) -> Result<(), E> + Send>(
    items: impl Iterator<Item = T> + Send,
    mut workers: Vec<W>,
) -> Result<(), E> {
    let queue = Mutex::new(Queue { items: items.enumerate(), failed: None });
    // A closure, so that the lock is released before the work begins.
    let next = || lock(&queue).next();
    let run = |mut work: W| {
        while let Some((number, item)) = next() {
            if let Err(error) = work(item) {
                lock(&queue).fail(number, error);
            }
        }
    };
    thread::scope(|scope| {
        let last = workers.pop();
        for work in workers {
            let _ = thread::Builder::new().spawn_scoped(scope, || run(work));
        }
        last.map(run);
    });
    let failed = queue.into_inner().unwrap_or_else(PoisonError::into_inner).failed;
    failed.map_or(Ok(()), |(_, error)| Err(error))
}

/// Items not yet given out, and the first one known to have failed.
struct Queue<I, E> {
    items: I,
    failed: Option<(usize, E)>,
}

impl<T, E, I: Iterator<Item = (usize, T)>> Queue<I, E> {
    fn next(&mut self) -> Option<(usize, T)> {
        // All items before a failed one have been given out.
        if self.failed.is_some() { None } else { self.items.next() }
    }

    fn fail(&mut self, number: usize, error: E) {
        if self.failed.as_ref().is_none_or(|(first, _)| number < *first) {
            self.failed = Some((number, error));
        }
    }
}

/// Locks even a poisoned mutex: another thread's panic reaches the caller at the end of the scope,
/// and the queue is consistent until then.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use std::sync::Condvar;
    use std::time::Duration;

    use super::*;

    /// Longest wait for another thread.
    const PATIENCE: Duration = Duration::from_secs(60);

    #[test]
    fn every_item_is_processed_once() {
        for threads in [1, 2, 3, 16] {
            let mut seen = [0; 100];
            let work = |(slot, number): (&mut usize, usize)| {
                *slot += number;
                Ok::<(), ()>(())
            };
            try_for_each(seen.iter_mut().zip(1..), vec![work; threads]).unwrap();
            assert!(seen.into_iter().eq(1..=100));
        }
    }

    /// Each item waits for the end of all later ones, which only as many threads can run.
    #[test]
    fn items_that_end_in_the_reverse_order_keep_their_places() {
        for count in [2, 3, 7] {
            let (ended, changed) = (Mutex::new(0), Condvar::new());
            let mut places = vec![None; count];
            let work = |(number, place): (usize, &mut Option<usize>)| {
                let is_early = |ended: &mut usize| *ended < count - 1 - number;
                let mut waited = changed.wait_timeout_while(lock(&ended), PATIENCE, is_early).unwrap();
                assert!(!waited.1.timed_out(), "{count} items do not run at once");
                *place = Some(number);
                *waited.0 += 1;
                changed.notify_all();
                Err(number)
            };
            assert_eq!(try_for_each(places.iter_mut().enumerate(), vec![work; count]), Err(0));
            assert!(places.into_iter().eq((0..count).map(Some)));
        }
    }

    #[test]
    fn the_first_failure_in_order_is_returned() {
        for threads in [1, 2, 3, 16] {
            let work = |number: u64| {
                // The later an item, the sooner it fails.
                thread::sleep(Duration::from_micros(10 * (100 - number)));
                if number >= 20 { Err(number) } else { Ok(()) }
            };
            assert_eq!(try_for_each(0..100, vec![work; threads]), Err(20));
        }
    }
}
