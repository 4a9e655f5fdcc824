//! [`parse`]: the command line, whose errors are one sentence like all others.

#[cfg(not(target_os = "android"))]
use std::io::{Write, stderr};
#[cfg(not(target_os = "android"))]
use std::process::ExitCode;

#[cfg(not(target_os = "android"))]
use clap::{Command, Error, FromArgMatches, error::ErrorKind};

/// Parses the command line of `command`.
///
/// # Errors
/// The exit code, after printing what there is to print: the help or the version, or what is wrong.
#[cfg(not(target_os = "android"))]
pub fn parse<C: FromArgMatches>(command: Command) -> Result<C, ExitCode> {
    let parsed = command.try_get_matches().and_then(|matches| C::from_arg_matches(&matches));
    parsed.map_err(|error| {
        // Nothing can be reported if an output is closed.
        if error.use_stderr() {
            let _ = writeln!(stderr(), "error: {}", sentence(&error));
            ExitCode::from(2)
        } else {
            let _ = error.print();
            ExitCode::SUCCESS
        }
    })
}

/// An error of the parser as one line.
#[cfg(not(target_os = "android"))]
fn sentence(error: &Error) -> String {
    match error.kind() {
        // The message is the help.
        ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand => {
            "no command was given; --help lists what can be given".into()
        }
        _ => usage_line(&error.render().to_string()),
    }
}

/// The error of the parser's `message` as one line: its first paragraph, with its hint if it has one. Of URLs,
/// which may hold secrets, only the scheme is left.
pub fn usage_line(message: &str) -> String {
    let without_secrets = |word: &str| match word.split_once("://") {
        Some((scheme, rest)) => format!("{scheme}://...{}", if rest.ends_with('\'') { "'" } else { "" }),
        None => word.to_owned(),
    };
    let mut paragraphs = message
        .split("\n\n")
        .map(|paragraph| paragraph.split_whitespace().map(without_secrets).collect::<Vec<_>>().join(" "));
    let error = paragraphs.next().unwrap_or_default();
    let error = error.trim_start_matches("error: ");
    let hint = |text: String| {
        let hint = text.strip_prefix("tip: ")?;
        ["a similar ", "some similar "].iter().any(|start| hint.starts_with(start)).then(|| hint.to_owned())
    };
    match paragraphs.find_map(hint) {
        Some(hint) => format!("{error}: {hint}"),
        None => format!("{error}; --help lists what can be given"),
    }
}

#[cfg(test)]
mod tests {
    use clap::Arg;

    use super::*;

    fn line(arguments: &[&str]) -> String {
        let command = Command::new("tool")
            .arg(Arg::new("size").long("size").value_name("WxH").required(true))
            .arg(Arg::new("sort").long("sort").value_parser(["depth", "radial"]));
        sentence(&command.try_get_matches_from([&["tool"], arguments].concat()).unwrap_err())
    }

    #[test]
    fn an_error_is_one_line_with_a_next_step() {
        assert_eq!(
            line(&[]),
            "the following required arguments were not provided: --size <WxH>; --help lists what can be given"
        );
        assert_eq!(
            line(&["--size", "1", "--sort", "x"]),
            "invalid value 'x' for '--sort <sort>' [possible values: depth, radial]; \
             --help lists what can be given"
        );
        let similar = line(&["--siz", "1"]);
        assert!(similar.ends_with(": a similar argument exists: '--size'"), "{similar}");
        let tool = ["export", "exports"]
            .into_iter()
            .fold(Command::new("tool"), |tool, name| tool.subcommand(Command::new(name)));
        let similar = sentence(&tool.try_get_matches_from(["tool", "exporz"]).unwrap_err());
        assert!(similar.contains("'exporz': some similar subcommands exist: '"), "{similar}");
    }

    #[test]
    fn a_missing_command_is_one_line() {
        let tool = Command::new("tool").subcommand_required(true).arg_required_else_help(true);
        let error = tool.subcommand(Command::new("fit")).try_get_matches_from(["tool"]).unwrap_err();
        assert_eq!(sentence(&error), "no command was given; --help lists what can be given");
    }

    #[test]
    fn urls_lose_their_secrets() {
        let unexpected = line(&["--size", "1", "https://ann:pass@host/a?key"]);
        assert!(unexpected.starts_with("unexpected argument 'https://...' found"), "{unexpected}");
    }
}
