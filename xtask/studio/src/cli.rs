//! The command line of `aarc-studio`; `cargo xtask` hands these commands over.

use std::sync::LazyLock;

use clap::{CommandFactory, Parser, Subcommand};
use program::generate::{self, GenerateOption};

use crate::commands;

/// The version of the program, and the versions of the files that it reads and writes.
pub static VERSION: LazyLock<String> = LazyLock::new(|| {
    let (major, minor) = (codec::VERSION_MAJOR, codec::VERSION_MINOR);
    let field = formats::FIELD_FILE_VERSION;
    format!(
        "{}\nwrites packages (.aarc) of version {major}.{minor}, reads {major}.x\nwrites and reads field \
         files (.ply) of version {field}",
        env!("CARGO_PKG_VERSION")
    )
});

/// The end of the long help: exit codes and examples.
const AFTER_HELP: &str = "\
Exit codes:
  0  done
  1  a check failed, or a defect of the program
  2  the command line asks for something impossible, an output cannot be written, or ffmpeg is not installed
  3  an input is missing, unreadable or damaged
  5  there is no graphics device

  An error is one line on standard error: what is wrong, where, and what to do. No output is left
  half-written. Shells report 130 where Ctrl-C ends a command; the file at the output's path stays as
  it was.

Examples:
  aarc-studio package scene/ -o clip.aarc --budget 40000
  aarc-studio ingest rig/ -o studio/
  aarc-studio fit studio/ -o field.ply
  aarc-studio inspect clip.aarc --json
  aarc-studio render clip.aarc --time 0.5 --size 640x480 --out reference.png
  aarc-studio --generate bash > ~/.local/share/bash-completion/completions/aarc-studio

xtask/README.md says more.";

/// Makes, inspects and renders clips of 4D Gaussians.
#[derive(Parser)]
#[command(name = "aarc-studio", bin_name = "aarc-studio", version, long_version = VERSION.as_str())]
#[command(after_long_help = AFTER_HELP, arg_required_else_help = true)]
#[command(args_conflicts_with_subcommands = true)]
pub struct Cli {
    #[command(flatten)]
    generate: GenerateOption,

    #[command(subcommand)]
    command: Option<Command>,
}

impl Cli {
    /// Runs the command, or prints the document of `--generate`.
    ///
    /// # Errors
    /// [`program::Fault`] with an exit code of its own; any other error is a failed check or a defect.
    pub fn run(&self) -> anyhow::Result<()> {
        if let Some(document) = self.generate.generate {
            generate::print(document, Cli::command())?;
        }
        self.command.as_ref().map_or(Ok(()), Command::run)
    }
}

/// The commands of the host tool.
#[derive(Subcommand)]
#[allow(missing_docs, reason = "clap would show them in place of the commands' own help")]
pub enum Command {
    Package(commands::package::Args),
    Join(commands::join::Args),
    Trim(commands::trim::Args),
    Poster(commands::poster::Args),
    Ingest(commands::ingest::Args),
    Fit(commands::fit::Args),
    Depths(commands::depths::Args),
    Inspect(commands::inspect::Args),
    Render(commands::render::Args),
    Eval(commands::eval::Args),
    Report(commands::report::Args),
    Export(commands::export::Args),
    Synth(commands::synth::Args),
}

impl Command {
    fn run(&self) -> anyhow::Result<()> {
        match self {
            Command::Package(args) => commands::package::run(args),
            Command::Join(args) => commands::join::run(args),
            Command::Trim(args) => commands::trim::run(args),
            Command::Poster(args) => commands::poster::run(args),
            Command::Ingest(args) => commands::ingest::run(args),
            Command::Fit(args) => commands::fit::run(args),
            Command::Depths(args) => commands::depths::run(args),
            Command::Inspect(args) => commands::inspect::run(args),
            Command::Render(args) => commands::render::run(args),
            Command::Eval(args) => commands::eval::run(args),
            Command::Report(args) => commands::report::run(args),
            Command::Export(args) => commands::export::run(args),
            Command::Synth(args) => commands::synth::run(args),
        }
    }
}

#[cfg(test)]
mod tests {
    use clap::ValueEnum;
    use program::generate::Generated;

    use super::*;

    #[test]
    fn every_generated_document_knows_every_command() {
        for &document in Generated::value_variants() {
            let text = String::from_utf8(generate::render(document, Cli::command())).expect("text");
            for command in Cli::command().get_subcommands() {
                let name = command.get_name();
                assert!(text.contains(name), "{document:?} lacks {name}");
            }
        }
    }

    #[test]
    fn the_man_page_has_every_option_of_every_command() {
        let page = String::from_utf8(generate::render(Generated::Man, Cli::command())).expect("text");
        // Roff escapes hyphens.
        let page = page.replace("\\-", "-");
        for command in Cli::command().get_subcommands() {
            let heading = format!(".SH {}\n", command.get_name().to_uppercase());
            let section = page.split(&heading).nth(1).expect(&heading);
            let section = section.split("\n.SH ").next().unwrap_or_default();
            assert!(section.contains(&format!("aarc-studio {}", command.get_name())), "{section}");
            // The synopsis names them, too.
            let (_, options) = section.split_once("\n.SS OPTIONS\n").expect("a list of options");
            for option in command.get_arguments().filter_map(|argument| argument.get_long()) {
                assert!(options.contains(&format!("--{option}")), "{heading}{option} is missing");
            }
        }
    }

    #[test]
    fn a_document_is_generated_without_a_command() {
        let parse = |line: &str| Cli::try_parse_from(line.split(' '));
        assert!(parse("aarc-studio --generate man").is_ok());
        assert!(parse("aarc-studio inspect clip.aarc").is_ok());
        for line in ["aarc-studio", "aarc-studio --generate", "aarc-studio --generate man inspect clip.aarc"]
        {
            assert!(parse(line).is_err(), "{line}");
        }
    }
}
