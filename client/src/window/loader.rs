//! [`Loader`]: loads what is dropped on the window, on a thread of its own, the latest one only.

use std::path::{Path, PathBuf};
use std::sync::mpsc::{Sender, channel};
use std::thread::JoinHandle;

/// A thread that loads.
pub(crate) struct Loader {
    /// `None` once the thread has been told to end.
    orders: Option<Sender<(u64, PathBuf)>>,
    thread: Option<JoinHandle<()>>,
    latest: u64,
}

impl Loader {
    /// Starts a thread that turns paths into values with `load` and hands them to `deliver`,
    /// together with the number of the order.
    ///
    /// # Errors
    /// If the system refuses another thread.
    pub(crate) fn new<T>(
        load: impl Fn(&Path) -> T + Send + 'static,
        deliver: impl Fn(u64, T) + Send + 'static,
    ) -> std::io::Result<Loader> {
        let (orders, incoming) = channel::<(u64, PathBuf)>();
        let thread = std::thread::Builder::new().name("loader".into()).spawn(move || {
            while let Ok(order) = incoming.recv() {
                // Orders that were overtaken while waiting are not begun.
                let (number, path) = incoming.try_iter().last().unwrap_or(order);
                deliver(number, load(&path));
            }
        })?;
        Ok(Loader { orders: Some(orders), thread: Some(thread), latest: 0 })
    }

    /// Orders `path`; all orders before it are void.
    pub(crate) fn load(&mut self, path: PathBuf) {
        self.latest += 1;
        if let Some(orders) = &self.orders {
            // The thread outlives the sender: it cannot have gone away.
            let _ = orders.send((self.latest, path));
        }
    }

    /// Whether an order is still the latest.
    pub(crate) fn is_latest(&self, number: u64) -> bool {
        number == self.latest
    }
}

impl Drop for Loader {
    /// Waits for the order under way: the graphics device must not go away below it.
    fn drop(&mut self) {
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

    /// A loader whose loading says when it begins, waits for a permit, and gives the path back.
    struct Gated {
        loader: Loader,
        begun: Receiver<PathBuf>,
        permit: Sender<()>,
        delivered: Receiver<(u64, PathBuf)>,
    }

    fn gated() -> Gated {
        let (permit, permits) = channel();
        let (begin, begun) = channel();
        let (deliver, delivered) = channel();
        let load = move |path: &Path| {
            begin.send(path.to_path_buf()).unwrap();
            permits.recv().unwrap();
            path.to_path_buf()
        };
        let loader = Loader::new(load, move |number, path| deliver.send((number, path)).unwrap()).unwrap();
        Gated { loader, begun, permit, delivered }
    }

    #[test]
    fn the_latest_order_wins() {
        let Gated { mut loader, begun, permit, delivered } = gated();
        loader.load("a".into());
        assert_eq!(begun.recv().unwrap(), Path::new("a"));
        loader.load("b".into());
        loader.load("c".into());
        permit.send(()).unwrap();
        let (number, path) = delivered.recv().unwrap();
        assert!(path == Path::new("a") && !loader.is_latest(number), "overtaken while it was loaded");
        permit.send(()).unwrap();
        let (number, path) = delivered.recv().unwrap();
        assert!(path == Path::new("c") && loader.is_latest(number), "b was never begun");
        assert_eq!(begun.recv().unwrap(), Path::new("c"));
    }

    #[test]
    fn it_goes_away_after_the_order_under_way() {
        let Gated { mut loader, begun, permit, delivered } = gated();
        loader.load("a".into());
        begun.recv().unwrap();
        permit.send(()).unwrap();
        drop(loader);
        assert_eq!(delivered.iter().count(), 1);
    }
}
