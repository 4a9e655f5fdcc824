//! [`Loss`]: whether a device is gone, and waiting for one that may go meanwhile.
//!
//! A driver gives a device up when it crashes, is reset or updated. From then on the graphics
//! interface takes calls without doing anything and tells of it once, from any thread; only where
//! somebody waits for the device at that moment, it panics.

#![allow(clippy::missing_const_for_thread_local, reason = "it is const; for Android that is not seen")]

use std::any::Any;
use std::cell::RefCell;
use std::ops::Deref;
use std::panic::{self, AssertUnwindSafe};
use std::sync::{Arc, Once, OnceLock};

/// Why a device is gone, once it is.
#[derive(Clone)]
pub(in crate::gpu) struct Loss(Arc<OnceLock<String>>);

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
        let waited = self.catch(|| device.poll(wgpu::PollType::wait_indefinitely()))?;
        match (self.why(), waited) {
            (Some(why), _) => Err(why.to_owned()),
            (None, Ok(_)) => Ok(()),
            (None, Err(error)) => Err(error.to_string()),
        }
    }

    /// What `work` returns.
    ///
    /// # Errors
    /// Why the device is gone, where that made `work` panic.
    ///
    /// # Panics
    /// If `work` panics on a device that is there.
    pub(super) fn catch<T>(&self, work: impl FnOnce() -> T) -> Result<T, String> {
        quietly(work).or_else(|panic| match self.why() {
            Some(why) => Err(why.to_owned()),
            None => {
                log::error!("{}", panic.told);
                panic::resume_unwind(panic.payload)
            }
        })
    }
}

#[cfg(feature = "window")]
impl Loss {
    /// Drops the image of a window. One of a device that is gone the graphics interface takes back only
    /// from a thread that panics, and as long as it is out, the window cannot be given to another device.
    pub(in crate::gpu) fn let_go(&self, image: wgpu::SurfaceTexture) {
        if self.why().is_some() {
            let _ = quietly(move || {
                let _image = image;
                panic!("nobody hears this");
            });
        }
    }
}

/// What panics when it is dropped after the device is gone: dropped without that.
pub(in crate::gpu) struct Fragile<T> {
    /// Until it is dropped.
    held: Option<T>,
    loss: Loss,
}

impl<T> Fragile<T> {
    pub(super) fn new(held: T, loss: &Loss) -> Fragile<T> {
        Fragile { held: Some(held), loss: loss.clone() }
    }
}

impl<T> Deref for Fragile<T> {
    type Target = T;

    fn deref(&self) -> &T {
        self.held.as_ref().expect("not yet dropped")
    }
}

impl<T> Drop for Fragile<T> {
    fn drop(&mut self) {
        let held = self.held.take();
        if self.loss.why().is_some() {
            let _ = quietly(|| drop(held));
        }
    }
}

/// A panic of which nothing was printed.
struct Panic {
    /// What would have been.
    told: String,
    payload: Box<dyn Any + Send>,
}

thread_local! {
    /// Where panics of this thread may be expected, what the last one said.
    static TOLD: RefCell<Option<String>> = const { RefCell::new(None) };
}

/// What `work` returns, or its panic.
fn quietly<T>(work: impl FnOnce() -> T) -> Result<T, Panic> {
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let loud = panic::take_hook();
        panic::set_hook(Box::new(move |panic| {
            let is_told = TOLD.with_borrow_mut(|told| told.as_mut().map(|told| *told = panic.to_string()));
            if is_told.is_none() {
                loud(panic);
            }
        }));
    });
    TOLD.set(Some(String::new()));
    // What was interrupted is a device that is gone; where it is not, the panic goes on.
    let result = panic::catch_unwind(AssertUnwindSafe(work));
    let told = TOLD.take().unwrap_or_default();
    result.map_err(|payload| Panic { told, payload })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_expected_panics_are_caught() {
        assert_eq!(quietly(|| 3).ok(), Some(3));
        let panic = quietly(|| -> u8 { panic!("nobody sees this") }).err().unwrap();
        assert!(panic.told.contains("nobody sees this"), "{}", panic.told);
        assert_eq!(TOLD.take(), None);
    }

    #[test]
    fn a_panic_goes_on_unless_the_device_is_gone() {
        let loss = Loss(Arc::default());
        assert_eq!(loss.catch(|| 3), Ok(3));
        let defect = quietly(|| loss.catch(|| -> u8 { panic!("a defect") })).err().unwrap();
        assert_eq!(defect.payload.downcast_ref(), Some(&"a defect"));
        loss.0.set("reset".into()).unwrap();
        assert_eq!(loss.catch(|| -> u8 { panic!("of the loss") }), Err("reset".into()));
    }
}
