//! The man page of a program and its completions for shells, rendered from its command line.

use std::io::{self, Write};

use clap::{Command, ValueEnum};
use clap_complete::Shell;
use clap_mangen::Man;

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

/// The option that names such a document.
#[derive(clap::Args, Clone, Copy, Debug)]
pub struct GenerateOption {
    /// Print the man page, or completions for a shell, and exit.
    #[arg(long, value_enum, value_name = "WHAT", exclusive = true)]
    pub generate: Option<Generated>,
}

/// Prints the document on standard output.
///
/// # Errors
/// [`Fault::Usage`] if standard output is closed.
pub fn print(document: Generated, command: Command) -> Result<(), Fault> {
    io::stdout().write_all(&render(document, command)).map_err(|error| {
        Fault::Usage(format!("cannot write to standard output: {error}: give it another place"))
    })
}

/// The document, UTF-8 text.
pub fn render(document: Generated, mut command: Command) -> Vec<u8> {
    let shell = match document {
        Generated::Man => return man_page(command).expect("a vector accepts all writes"),
        Generated::Bash => Shell::Bash,
        Generated::Elvish => Shell::Elvish,
        Generated::Fish => Shell::Fish,
        Generated::PowerShell => Shell::PowerShell,
        Generated::Zsh => Shell::Zsh,
    };
    let mut text = Vec::new();
    let name = command.get_name().to_owned();
    clap_complete::generate(shell, &mut command, name, &mut text);
    text
}

/// The manual page: one for the program and all its commands, so that one file holds every option.
fn man_page(mut command: Command) -> io::Result<Vec<u8>> {
    // Gives each command its full name, for the synopsis.
    command.build();
    let page = Man::new(command.clone());
    let mut text = Vec::new();
    page.render_title(&mut text)?;
    page.render_name_section(&mut text)?;
    page.render_synopsis_section(&mut text)?;
    page.render_description_section(&mut text)?;
    page.render_options_section(&mut text)?;
    for command in command.get_subcommands().filter(|command| command.get_name() != "help") {
        let page = Man::new(command.clone());
        let mut section = Vec::new();
        page.render_synopsis_section(&mut section)?;
        page.render_description_section(&mut section)?;
        page.render_options_section(&mut section)?;
        writeln!(text, ".SH {}", command.get_name().to_uppercase())?;
        // The sections of a command are subsections of the page.
        let section = String::from_utf8(section).expect("roff of text is text");
        text.extend(section.replace("\n.SH ", "\n.SS ").bytes());
    }
    page.render_extra_section(&mut text)?;
    page.render_version_section(&mut text)?;
    Ok(text)
}
