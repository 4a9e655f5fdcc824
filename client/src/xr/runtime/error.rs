//! [`Halt`]: why a session stops, and a sentence for each failure of the runtime.

use openxr::sys::Result as Code;
use program::Fault;

/// Why a session cannot continue.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(in crate::xr) enum Halt {
    /// The runtime has dropped it; the program may open another one.
    SessionLost,
    /// The run is over.
    Fault(Fault),
}

impl From<Fault> for Halt {
    fn from(fault: Fault) -> Halt {
        Halt::Fault(fault)
    }
}

/// Adds to a result of the runtime what the program was doing.
pub(in crate::xr) trait During<T> {
    /// Turns a failure into a fault.
    ///
    /// # Errors
    /// [`Fault::Device`].
    fn fault(self, what: &str) -> Result<T, Fault>;

    /// Turns a failure within a session, which may be lost, into a [`Halt`].
    ///
    /// # Errors
    /// See [`Halt`].
    fn halt(self, what: &str) -> Result<T, Halt>;
}

impl<T> During<T> for Result<T, Code> {
    fn fault(self, what: &str) -> Result<T, Fault> {
        self.map_err(|code| fault(what, code))
    }

    fn halt(self, what: &str) -> Result<T, Halt> {
        self.map_err(|code| match code {
            Code::ERROR_SESSION_LOST => Halt::SessionLost,
            code => Halt::Fault(fault(what, code)),
        })
    }
}

/// The fault of a runtime that ended during the run.
pub(in crate::xr) fn instance_lost() -> Fault {
    Fault::Device("the OpenXR runtime went away: start it again, then this program".into())
}

/// The fault of a runtime that drops its sessions as soon as they are opened.
pub(in crate::xr) fn sessions_dropped() -> Fault {
    Fault::Device("the OpenXR runtime drops its session at once: restart the runtime".into())
}

/// The fault of a headset with a number of `views` that is not two.
pub(in crate::xr) fn other_eyes(views: usize) -> Fault {
    let views = if views == 1 { "1 view".into() } else { format!("{views} views") };
    Fault::Device(format!("the headset has {views}, and two are drawn: choose another runtime"))
}

fn fault(what: &str, code: Code) -> Fault {
    Fault::Device(match code {
        Code::ERROR_INSTANCE_LOST => return instance_lost(),
        Code::ERROR_RUNTIME_UNAVAILABLE => {
            "no OpenXR runtime is active: start one and make it the system's, \
                                            or let XR_RUNTIME_JSON name its description"
                .into()
        }
        Code::ERROR_RUNTIME_FAILURE if what == STARTING => {
            "the OpenXR runtime does not start: see that its service is running and the headset connected"
                .into()
        }
        Code::ERROR_FORM_FACTOR_UNSUPPORTED => {
            "the OpenXR runtime knows no headset: connect one, or choose another runtime".into()
        }
        Code::ERROR_VIEW_CONFIGURATION_TYPE_UNSUPPORTED => {
            "the headset does not show a picture to each of two eyes: choose another runtime".into()
        }
        Code::ERROR_FORM_FACTOR_UNAVAILABLE => {
            "the headset is not available: connect it and switch it on, then start again".into()
        }
        code => format!("OpenXR runtime: {what} failed ({code:?}): start it again, then this program"),
    })
}

/// What the program does while a runtime starts.
pub(in crate::xr) const STARTING: &str = "starting";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_failure_has_a_sentence() {
        let sentence = |what: &str, code: Code| {
            let Err(Fault::Device(sentence)) = Err::<(), _>(code).fault(what) else { panic!("{code:?}") };
            sentence
        };
        assert!(
            sentence(STARTING, Code::ERROR_RUNTIME_UNAVAILABLE).starts_with("no OpenXR runtime is active")
        );
        assert!(sentence(STARTING, Code::ERROR_RUNTIME_FAILURE).contains("does not start"));
        assert!(sentence("finding it", Code::ERROR_FORM_FACTOR_UNSUPPORTED).contains("no headset"));
        assert!(sentence("a frame", Code::ERROR_INSTANCE_LOST).contains("went away"));
        let other = sentence("a frame", Code::ERROR_CALL_ORDER_INVALID);
        assert!(other.contains("a frame failed") && other.contains("CALL_ORDER_INVALID"), "{other}");
    }

    #[test]
    fn only_a_lost_session_may_be_renewed() {
        assert_eq!(Err::<(), _>(Code::ERROR_SESSION_LOST).halt("x"), Err(Halt::SessionLost));
        assert_eq!(Err::<(), _>(Code::ERROR_INSTANCE_LOST).halt("x"), Err(Halt::Fault(instance_lost())));
        assert_eq!(Ok::<_, Code>(3).halt("x"), Ok(3));
    }
}
