//! [`Loader`]: loads clips in the background, on a thread of its own, the latest one only.

use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Sender, channel};
use std::thread::JoinHandle;

/// A thread that loads what is ordered.
pub(crate) struct Loader<O> {
    /// `None` once the thread has been told to end.
    orders: Option<Sender<(u64, O)>>,
    thread: Option<JoinHandle<()>>,
    latest: Arc<AtomicU64>,
}

/// Hands on something that came of an order, and whether to go on with it: nobody waits for more of
/// one that was overtaken.
pub(crate) type Tell<'a, T> = &'a dyn Fn(T) -> ControlFlow<()>;

impl<O: Send + 'static> Loader<O> {
    /// Starts a thread that carries orders out with `load`. What that tells is handed to `deliver`,
    /// together with the number of the order.
    ///
    /// # Errors
    /// If the system refuses another thread.
    pub(crate) fn new<T>(
        load: impl Fn(O, Tell<'_, T>) + Send + 'static,
        deliver: impl Fn(u64, T) + Send + 'static,
    ) -> std::io::Result<Loader<O>> {
        let (orders, incoming) = channel::<(u64, O)>();
        let latest = Arc::new(AtomicU64::new(0));
        let current = latest.clone();
        let thread = std::thread::Builder::new().name("loader".into()).spawn(move || {
            while let Ok(order) = incoming.recv() {
                // Orders that were overtaken while waiting are not begun.
                let (number, order) = incoming.try_iter().last().unwrap_or(order);
                load(order, &|told| {
                    deliver(number, told);
                    let is_latest = current.load(Ordering::Relaxed) == number;
                    if is_latest { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
                });
            }
        })?;
        Ok(Loader { orders: Some(orders), thread: Some(thread), latest })
    }

    /// Orders something; all orders before it are void.
    pub(crate) fn load(&mut self, order: O) {
        let number = self.latest.fetch_add(1, Ordering::Relaxed) + 1;
        if let Some(orders) = &self.orders {
            // The thread outlives the sender: it cannot have gone away.
            let _ = orders.send((number, order));
        }
    }

    /// Whether an order is still the latest.
    pub(crate) fn is_latest(&self, number: u64) -> bool {
        number == self.latest.load(Ordering::Relaxed)
    }
}

impl<O> Drop for Loader<O> {
    /// Waits until the order under way next tells something: the graphics device must not go away
    /// below it.
    fn drop(&mut self) {
        self.latest.store(u64::MAX, Ordering::Relaxed);
        self.orders = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::{Receiver, Sender, channel};

    use super::*;

    /// A loader that says when it begins, waits for permits, and tells the order back for each
    /// until nobody wants it.
    struct Gated {
        loader: Loader<&'static str>,
        begun: Receiver<&'static str>,
        permit: Sender<()>,
        delivered: Receiver<(u64, &'static str)>,
    }

    fn gated() -> Gated {
        let (permit, permits) = channel();
        let (begin, begun) = channel();
        let (deliver, delivered) = channel();
        let load = move |order, tell: Tell<'_, &'static str>| {
            begin.send(order).unwrap();
            while permits.recv().is_ok() && tell(order).is_continue() {}
        };
        let loader = Loader::new(load, move |number, order| deliver.send((number, order)).unwrap()).unwrap();
        Gated { loader, begun, permit, delivered }
    }

    #[test]
    fn the_latest_order_wins() {
        let Gated { mut loader, begun, permit, delivered } = gated();
        loader.load("a");
        assert_eq!(begun.recv().unwrap(), "a");
        permit.send(()).unwrap();
        let (number, order) = delivered.recv().unwrap();
        assert!(order == "a" && loader.is_latest(number), "more of it may follow");
        loader.load("b");
        loader.load("c");
        (0..2).for_each(|_| permit.send(()).unwrap());
        // Whether "a" tells once more depends on how soon it notices.
        let (number, order) = loop {
            match delivered.recv().unwrap() {
                (number, "a") => assert!(!loader.is_latest(number), "overtaken while it was loaded"),
                told => break told,
            }
        };
        assert!(order == "c" && loader.is_latest(number), "b was never begun");
        assert_eq!(begun.recv().unwrap(), "c");
        drop(permit);
    }

    #[test]
    fn it_goes_away_when_the_order_under_way_tells_something() {
        const ENOUGH: usize = 60_000;
        let (deliver, delivered) = channel();
        // It would go on for a minute if nobody told it that it is not wanted.
        let load = |(), tell: Tell<'_, ()>| {
            let _ = (0..ENOUGH).try_for_each(|_| {
                std::thread::sleep(std::time::Duration::from_millis(1));
                tell(())
            });
        };
        let mut loader = Loader::new(load, move |_, ()| deliver.send(()).unwrap()).unwrap();
        loader.load(());
        delivered.recv().unwrap();
        drop(loader);
        assert!(delivered.iter().count() + 1 < ENOUGH, "it was told to stop");
    }
}
