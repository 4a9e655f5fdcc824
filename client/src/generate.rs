//! What an installation adds to the program: its manual page and completions for shells, made of the
//! command line itself.

use std::io::{self, Write};

use clap::{CommandFactory, ValueEnum};
use clap_complete::Shell;

use crate::args::Args;
use crate::fault::Fault;

/// What can be generated.
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

/// Prints it on standard output.
///
/// # Errors
/// [`Fault::Usage`] if nobody takes it.
pub fn print(what: Generated) -> Result<(), Fault> {
    let bytes = generate(what);
    io::stdout()
        .write_all(&bytes)
        .map_err(|error| Fault::Usage(format!("cannot write to standard output: {error}")))
}

fn generate(what: Generated) -> Vec<u8> {
    let mut command = Args::command();
    let shell = match what {
        Generated::Man => {
            let mut page = Vec::new();
            clap_mangen::Man::new(command).render(&mut page).expect("memory takes it");
            return page;
        }
        Generated::Bash => Shell::Bash,
        Generated::Elvish => Shell::Elvish,
        Generated::Fish => Shell::Fish,
        Generated::PowerShell => Shell::PowerShell,
        Generated::Zsh => Shell::Zsh,
    };
    let name = command.get_name().to_owned();
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut command, name, &mut script);
    script
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_knows_every_option() {
        for &what in Generated::value_variants() {
            let text = String::from_utf8(generate(what)).expect("text");
            // Without what the page says of fonts and dashes.
            let plain = text.replace(r"\fR", "").replace('\\', "");
            let dashes = if what == Generated::Fish { "-l " } else { "--" };
            for option in Args::command().get_arguments().filter_map(|option| option.get_long()) {
                let option = format!("{dashes}{option}");
                // Not as the beginning of a longer one.
                let mut ends = plain.match_indices(&option).map(|(at, _)| &plain[at + option.len()..]);
                let goes_on = |c: char| c == '-' || c.is_alphanumeric();
                assert!(ends.any(|rest| !rest.starts_with(goes_on)), "{what:?} lacks {option}");
            }
        }
        let page = String::from_utf8(generate(Generated::Man)).expect("text");
        assert!(page.contains(".SH OPTIONS") && page.contains("Exit codes"), "{page}");
    }
}
