//! [`parse`]: the command line, whose errors are one sentence like all others.

#[cfg(not(target_os = "android"))]
use std::process::ExitCode;

/// Parses the command line.
///
/// # Errors
/// The exit code, after printing what there is to print: the help or the version, or what is wrong.
#[cfg(not(target_os = "android"))]
pub fn parse<C: clap::Parser>() -> Result<C, ExitCode> {
    C::try_parse().map_err(|error| {
        if error.use_stderr() {
            eprintln!("error: {}", usage_line(&error.render().to_string()));
            ExitCode::from(2)
        } else {
            // Nothing can be reported if standard output is closed.
            let _ = error.print();
            ExitCode::SUCCESS
        }
    })
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
    match paragraphs.find_map(|text| text.strip_prefix("tip: a similar ").map(String::from)) {
        Some(hint) => format!("{error}: a similar {hint}"),
        None => format!("{error}; --help lists what can be given"),
    }
}

#[cfg(test)]
mod tests {
    use clap::{Arg, Command};

    use super::*;

    fn line(arguments: &[&str]) -> String {
        let command = Command::new("tool")
            .arg(Arg::new("size").long("size").value_name("WxH").required(true))
            .arg(Arg::new("sort").long("sort").value_parser(["depth", "radial"]));
        let error = command.try_get_matches_from([&["tool"], arguments].concat()).unwrap_err();
        usage_line(&error.render().to_string())
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
    }

    #[test]
    fn urls_lose_their_secrets() {
        let unexpected = line(&["--size", "1", "https://ann:pass@host/a?key"]);
        assert!(unexpected.starts_with("unexpected argument 'https://...' found"), "{unexpected}");
    }
}
