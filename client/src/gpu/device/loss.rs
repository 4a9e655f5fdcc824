//! [`Loss`]: detects the loss of a device.
//!
//! A driver loses its device when it crashes, is reset or is updated. From then on the graphics API accepts
//! calls without effect and reports the loss once, from any thread. It panics only in a wait for the device
//! that is in progress at that moment.

#![allow(clippy::missing_const_for_thread_local, reason = "it is const; the lint errs for Android")]

use std::any::Any;
use std::cell::RefCell;
use std::ops::Deref;
use std::panic::{self, AssertUnwindSafe};
use std::sync::{Arc, Once, OnceLock};

/// The cause of the loss, once the device is lost.
#[derive(Clone)]
pub(in crate::gpu) struct Loss(Arc<OnceLock<String>>);

impl Loss {
    /// Listens to the loss and the errors of `device`. Errors on a device that is not lost are defects of the
    /// program and panic, unless another handler replaces this one.
    pub(super) fn listen(device: &wgpu::Device) -> Loss {
        let why: Arc<OnceLock<String>> = Arc::default();
        let first_cause = why.clone();
        device.set_device_lost_callback(move |reason, message| {
            let why = if message.is_empty() { format!("{reason:?}").to_lowercase() } else { message };
            // The first cause is the most specific.
            let _ = first_cause.set(why);
        });
        let is_gone = why.clone();
        device.on_uncaptured_error(Arc::new(move |error| {
            // Errors after the loss are its consequences.
            if is_gone.get().is_none() {
                panic!("{error}");
            }
        }));
        Loss(why)
    }

    /// The cause of the loss; `None` if the device is not lost.
    pub(super) fn why(&self) -> Option<&str> {
        self.0.get().map(String::as_str)
    }

    /// Waits until `device` has finished all submitted work.
    ///
    /// # Errors
    /// The cause of a loss or failed wait.
    pub(super) fn wait(&self, device: &wgpu::Device) -> Result<(), String> {
        let waited = self.catch(|| device.poll(wgpu::PollType::wait_indefinitely()))?;
        match (self.why(), waited) {
            (Some(why), _) => Err(why.to_owned()),
            (None, Ok(_)) => Ok(()),
            (None, Err(error)) => Err(error.to_string()),
        }
    }

    /// Runs `work`.
    ///
    /// # Errors
    /// The cause of the loss, if `work` panics on a lost device.
    ///
    /// # Panics
    /// If `work` panics on a device that is not lost.
    pub(super) fn catch<T>(&self, work: impl FnOnce() -> T) -> Result<T, String> {
        catch_silently(work).or_else(|panic| match self.why() {
            Some(why) => Err(why.to_owned()),
            None => {
                log::error!("{}", panic.message);
                panic::resume_unwind(panic.payload)
            }
        })
    }
}

#[cfg(feature = "window")]
impl Loss {
    /// Drops the image of a window. The graphics API releases an image of a lost device only on a panicking
    /// thread; until then, no other device can use the window.
    pub(in crate::gpu) fn release(&self, image: wgpu::SurfaceTexture) {
        if self.why().is_some() {
            let _ = catch_silently(move || {
                let _image = image;
                panic!("releases the image");
            });
        }
    }
}

/// A value whose drop panics after the device is lost; this wrapper catches the panic.
pub(in crate::gpu) struct Fragile<T> {
    /// `None` only while dropping.
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
            let _ = catch_silently(|| drop(held));
        }
    }
}

/// A caught panic, not printed.
struct Panic {
    /// The message that the default hook would have printed.
    message: String,
    payload: Box<dyn Any + Send>,
}

thread_local! {
    /// `Some` while panics of this thread are expected: the message of the last one.
    static MESSAGE: RefCell<Option<String>> = const { RefCell::new(None) };
}

/// Runs `work` and catches its panic without printing it.
fn catch_silently<T>(work: impl FnOnce() -> T) -> Result<T, Panic> {
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let default_hook = panic::take_hook();
        panic::set_hook(Box::new(move |panic| {
            let is_expected = MESSAGE
                .with_borrow_mut(|message| message.as_mut().map(|message| *message = panic.to_string()));
            if is_expected.is_none() {
                default_hook(panic);
            }
        }));
    });
    MESSAGE.set(Some(String::new()));
    // Only a lost device is left in an inconsistent state; otherwise the panic is resumed.
    let result = panic::catch_unwind(AssertUnwindSafe(work));
    let message = MESSAGE.take().unwrap_or_default();
    result.map_err(|payload| Panic { message, payload })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_expected_panics_are_caught() {
        assert_eq!(catch_silently(|| 3).ok(), Some(3));
        let panic = catch_silently(|| -> u8 { panic!("an expected panic") }).err().unwrap();
        assert!(panic.message.contains("an expected panic"), "{}", panic.message);
        assert_eq!(MESSAGE.take(), None);
    }

    #[test]
    fn a_panic_is_resumed_unless_the_device_is_lost() {
        let loss = Loss(Arc::default());
        assert_eq!(loss.catch(|| 3), Ok(3));
        let defect = catch_silently(|| loss.catch(|| -> u8 { panic!("a defect") })).err().unwrap();
        assert_eq!(defect.payload.downcast_ref(), Some(&"a defect"));
        loss.0.set("reset".into()).unwrap();
        assert_eq!(loss.catch(|| -> u8 { panic!("of the loss") }), Err("reset".into()));
    }
}
