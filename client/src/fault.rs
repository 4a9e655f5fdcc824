//! [`Fault`]: whose fault an error is, which decides the exit code.

use std::fmt;

/// An error with the exit code that it ends the program with. Anything else that reaches `main`
/// is a defect of this program and ends it with code 1.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Fault {
    /// The command line asks for something impossible, or an output cannot be written. Exit code 2.
    Usage(String),
    /// An input is missing, unreadable or not what it should be. Exit code 3.
    Data(String),
    /// An input could not be fetched. Exit code 4.
    Network(String),
    /// No display or no graphics device, or one that cannot do what is asked. Exit code 5.
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

    /// The same fault, saying what it is about.
    #[cfg(any(feature = "net", not(target_os = "android")))]
    pub(crate) fn about(mut self, subject: &str) -> Fault {
        let (Fault::Usage(message) | Fault::Data(message) | Fault::Network(message) | Fault::Device(message)) =
            &mut self;
        message.insert_str(0, &format!("{subject}: "));
        self
    }
}

/// One line, whatever servers and drivers put into it: what would end it or control a terminal is
/// shown as an escape.
impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (Fault::Usage(message) | Fault::Data(message) | Fault::Network(message) | Fault::Device(message)) =
            self;
        message.chars().try_for_each(|c| match c.is_control() {
            true => write!(f, "{}", c.escape_default()),
            false => write!(f, "{c}"),
        })
    }
}

impl std::error::Error for Fault {}
