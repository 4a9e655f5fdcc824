//! The man page of a program and its completions for shells, rendered from its command line.

use std::io::{self, Write};

use clap::{Command, ValueEnum};
use clap_complete::Shell;

use crate::Fault;

/// A document that can be generated from a command line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Generated {
    /// The manual page, in roff.
    Man,
    /// Completions for this shell.
    Bash,
    /// Completions for this shell.
    Elvish,
    /// Completions for this shell.
    Fish,
    /// Completions for this shell.
    #[value(name = "powershell")]
    PowerShell,
    /// Completions for this shell.
    Zsh,
}

/// Prints the document on standard output.
///
/// # Errors
/// [`Fault::Usage`] if standard output is closed.
pub fn print(document: Generated, command: Command) -> Result<(), Fault> {
    io::stdout()
        .write_all(&render(document, command))
        .map_err(|error| Fault::Usage(format!("cannot write to standard output: {error}")))
}

/// The document, UTF-8 text.
pub fn render(document: Generated, mut command: Command) -> Vec<u8> {
    let mut text = Vec::new();
    let shell = match document {
        Generated::Man => {
            clap_mangen::Man::new(command).render(&mut text).expect("a vector accepts all writes");
            return text;
        }
        Generated::Bash => Shell::Bash,
        Generated::Elvish => Shell::Elvish,
        Generated::Fish => Shell::Fish,
        Generated::PowerShell => Shell::PowerShell,
        Generated::Zsh => Shell::Zsh,
    };
    let name = command.get_name().to_owned();
    clap_complete::generate(shell, &mut command, name, &mut text);
    text
}
