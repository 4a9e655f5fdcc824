//! [`Fault`]: an error in one sentence, with the exit code that tells scripts its cause; and [`exit_code`] of any
//! error.

use std::error::Error;
use std::fmt;

/// An error, with a sentence that says what is wrong, where, and what to do.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Fault {
    /// A defect of the program, which ended a part of it and not all. Exit code 1.
    Defect(String),
    /// The command line asks for something impossible, or an output cannot be written. Exit code 2.
    Usage(String),
    /// An input is missing, unreadable or malformed. Exit code 3.
    Data(String),
    /// An input could not be fetched. Exit code 4.
    Network(String),
    /// A display, a graphics device or a program is missing, or the device failed. Exit code 5.
    Device(String),
}

impl Fault {
    /// The exit code.
    pub fn exit_code(&self) -> u8 {
        match self {
            Fault::Defect(_) => 1,
            Fault::Usage(_) => 2,
            Fault::Data(_) => 3,
            Fault::Network(_) => 4,
            Fault::Device(_) => 5,
        }
    }

    /// The same fault with its message prefixed by `subject` and a colon.
    pub fn about(mut self, subject: &str) -> Fault {
        use Fault::{Data, Defect, Device, Network, Usage};
        let (Defect(message) | Usage(message) | Data(message) | Network(message) | Device(message)) =
            &mut self;
        message.insert_str(0, &format!("{subject}: "));
        self
    }
}

/// One line. Control characters, which messages of servers, drivers and file names may contain, are
/// escaped.
impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        use Fault::{Data, Defect, Device, Network, Usage};
        let (Defect(message) | Usage(message) | Data(message) | Network(message) | Device(message)) = self;
        message.chars().try_for_each(|c| match c.is_control() {
            true => write!(f, "{}", c.escape_default()),
            false => write!(f, "{c}"),
        })
    }
}

impl Error for Fault {}

/// The exit code of an error: the code of the [`Fault`] that it is or was caused by; 1 without a fault, for a check
/// that failed or a defect.
pub fn exit_code(error: &(dyn Error + 'static)) -> u8 {
    match (error.downcast_ref::<Fault>(), error.source()) {
        (Some(fault), _) => fault.exit_code(),
        (None, Some(cause)) => exit_code(cause),
        (None, None) => 1,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fault_is_one_line() {
        assert_eq!(Fault::Data("é a\nb\u{1b}[2J".into()).to_string(), "é a\\nb\\u{1b}[2J");
    }

    /// An error with a cause.
    #[derive(Debug)]
    struct Wrapped(Fault);

    impl fmt::Display for Wrapped {
        fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str("about a take")
        }
    }

    impl Error for Wrapped {
        fn source(&self) -> Option<&(dyn Error + 'static)> {
            Some(&self.0)
        }
    }

    #[test]
    fn the_exit_code_is_that_of_the_cause() {
        assert_eq!(exit_code(&Fault::Data("damaged".into())), 3);
        assert_eq!(exit_code(&Wrapped(Fault::Device("gone".into()))), 5);
        assert_eq!(exit_code(&fmt::Error), 1);
        assert_eq!(exit_code(&Fault::Defect("of the program".into())), 1);
    }

    #[test]
    fn a_subject_comes_first() {
        let fault = Fault::Network("timed out".into()).about("a.aarc");
        assert_eq!(fault, Fault::Network("a.aarc: timed out".into()));
    }
}
