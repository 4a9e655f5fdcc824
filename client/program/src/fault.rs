//! [`Fault`]: an expected error, with the exit code that tells scripts its cause.

use std::fmt;

/// An expected error. Any other error that reaches `main` is a defect of the program, with exit code 1.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Fault {
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
            Fault::Usage(_) => 2,
            Fault::Data(_) => 3,
            Fault::Network(_) => 4,
            Fault::Device(_) => 5,
        }
    }

    /// The same fault with its message prefixed by `subject` and a colon.
    pub fn about(mut self, subject: &str) -> Fault {
        use Fault::{Data, Device, Network, Usage};
        let (Usage(message) | Data(message) | Network(message) | Device(message)) = &mut self;
        message.insert_str(0, &format!("{subject}: "));
        self
    }
}

/// One line. Control characters, which messages of servers, drivers and file names may contain, are
/// escaped.
impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        use Fault::{Data, Device, Network, Usage};
        let (Usage(message) | Data(message) | Network(message) | Device(message)) = self;
        message.chars().try_for_each(|c| match c.is_control() {
            true => write!(f, "{}", c.escape_default()),
            false => write!(f, "{c}"),
        })
    }
}

impl std::error::Error for Fault {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fault_is_one_line() {
        assert_eq!(Fault::Data("é a\nb\u{1b}[2J".into()).to_string(), "é a\\nb\\u{1b}[2J");
    }

    #[test]
    fn a_subject_comes_first() {
        let fault = Fault::Network("timed out".into()).about("a.aarc");
        assert_eq!(fault, Fault::Network("a.aarc: timed out".into()));
    }
}
