//! [`Fault`]: whose fault an error is, which decides the exit code.

use std::fmt;

/// An error with the exit code that it ends the program with. Anything else that reaches `main`
/// is a defect of this program and ends it with code 1.
#[derive(Debug)]
pub enum Fault {
    /// The command line asks for something impossible. Exit code 2.
    Usage(String),
    /// An input is missing, unreadable or not what it should be. Exit code 3.
    Data(String),
    /// No display or no graphics device, or a needed program is missing. Exit code 5.
    Device(String),
}

impl Fault {
    /// The exit code.
    pub fn exit_code(&self) -> u8 {
        match self {
            Fault::Usage(_) => 2,
            Fault::Data(_) => 3,
            Fault::Device(_) => 5,
        }
    }
}

/// One line, whatever names out of files are in it: what would end it or control a terminal is shown
/// as an escape.
impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (Fault::Usage(message) | Fault::Data(message) | Fault::Device(message)) = self;
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
}
