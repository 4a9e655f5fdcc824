//! [`Loss`]: whether a device is gone, and waiting for one that may go meanwhile.
//!
//! A driver gives a device up when it crashes, is reset or updated. From then on the graphics
//! interface takes calls without doing anything and tells of it once, from any thread; only where
//! somebody waits for the device at that moment, it panics.

use std::cell::Cell;
use std::panic::{self, AssertUnwindSafe};
use std::sync::{Arc, Once, OnceLock};

/// Why a device is gone, once it is.
pub(super) struct Loss(Arc<OnceLock<String>>);

impl Loss {
    /// Listens to what the graphics interface tells of `device`. Errors before it is gone are defects
    /// of the program and panic, unless somebody else listens to them.
    pub(super) fn watch(device: &wgpu::Device) -> Loss {
        let why: Arc<OnceLock<String>> = Arc::default();
        let told = why.clone();
        device.set_device_lost_callback(move |reason, message| {
            let why = if message.is_empty() { format!("{reason:?}").to_lowercase() } else { message };
            // The first one tells most.
            let _ = told.set(why);
        });
        let is_gone = why.clone();
        device.on_uncaptured_error(Arc::new(move |error| {
            // What was made of the device went with it, and is missed: of that, the loss is told.
            if is_gone.get().is_none() {
                panic!("{error}");
            }
        }));
        Loss(why)
    }

    /// Why the device is gone, if it is.
    pub(super) fn why(&self) -> Option<&str> {
        self.0.get().map(String::as_str)
    }

    /// Waits until `device` has done all that it was given.
    ///
    /// # Errors
    /// Why that will not be.
    pub(super) fn wait(&self, device: &wgpu::Device) -> Result<(), String> {
        let waited = quietly(|| device.poll(wgpu::PollType::wait_indefinitely()));
        match (self.why(), waited) {
            (Some(why), _) => Err(why.to_owned()),
            (None, Some(Ok(_))) => Ok(()),
            (None, Some(Err(error))) => Err(error.to_string()),
            (None, None) => Err("the driver failed".into()),
        }
    }
}

thread_local! {
    /// Whether panics of this thread are expected.
    static QUIET: Cell<bool> = const { Cell::new(false) };
}

/// What `work` returns; `None` where it panics, of which nothing is printed.
fn quietly<T>(work: impl FnOnce() -> T) -> Option<T> {
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let loud = panic::take_hook();
        panic::set_hook(Box::new(move |panic| {
            if !QUIET.get() {
                loud(panic);
            }
        }));
    });
    QUIET.set(true);
    // What was interrupted is a device that is gone.
    let result = panic::catch_unwind(AssertUnwindSafe(work));
    QUIET.set(false);
    result.ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_expected_panics_are_caught() {
        assert_eq!(quietly(|| 3), Some(3));
        assert_eq!(quietly(|| -> u8 { panic!("nobody sees this") }), None);
        assert!(!QUIET.get());
    }
}
