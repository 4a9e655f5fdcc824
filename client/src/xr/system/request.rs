//! [`IntentRequest`]: an Android intent as the command line that asks for the same.
//!
//! Any app on the headset can send one, so only development builds take all options from it. Others take those
//! that change how the clip plays, and none that writes a file.

use std::path::PathBuf;

use clap::parser::ValueSource;
use clap::{CommandFactory, FromArgMatches};
use program::{Fault, usage_line};

use crate::args::Args;
use crate::clips::clips_in;
use crate::content::redacted;

/// Names of the arguments that every build takes.
const PLAYBACK: [&str; 9] =
    ["clips", "xr", "layer", "sort", "cutoff", "quality", "near", "standing", "inside"];

/// Which options of an intent a build takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::xr) enum Trust {
    /// All options of the command line: a development build.
    All,
    /// Only those that change how the clip plays.
    Playback,
}

/// What an intent asks for.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(in crate::xr) struct IntentRequest {
    /// A path or URL.
    pub(in crate::xr) clip: Option<String>,
    /// Options of the command line, separated by blanks.
    pub(in crate::xr) options: Option<String>,
}

/// The command line of an intent. An intent without a clip names the first clip, by name, of the first of
/// the `folders` that has any; without one, the demo plays.
///
/// # Errors
/// [`Fault::Usage`] if the options cannot be parsed, or this build does not take one of them.
pub(in crate::xr) fn command_line(
    request: IntentRequest,
    folders: &[PathBuf],
    trust: Trust,
) -> Result<Args, Fault> {
    let options = request.options.unwrap_or_default();
    let fault = |what: &str| {
        let words: Vec<String> = options.split_whitespace().map(redacted).collect();
        Fault::Usage(format!("the intent's args, {:?}: {what}", words.join(" ")))
    };
    let refused = |error: clap::Error| fault(&usage_line(&error.to_string()));
    let line = ["aarc", "--xr"].into_iter().chain(options.split_whitespace());
    let matches = Args::command().try_get_matches_from(line).map_err(refused)?;
    let command = Args::command();
    let mut names = command.get_arguments().map(|argument| argument.get_id().as_str());
    let is_given = |name: &str| matches.value_source(name) == Some(ValueSource::CommandLine);
    if trust == Trust::Playback
        && let Some(name) = names.find(|name| is_given(name) && !PLAYBACK.contains(name))
    {
        return Err(fault(&format!("--{name} is only for development builds: pack one without --release")));
    }
    let mut args = Args::from_arg_matches(&matches).map_err(refused)?;
    if let Some(clip) = request.clip {
        args.clips = vec![clip];
    } else if args.clips.is_empty() {
        let clip = folders.iter().find_map(|folder| clips_in(folder).into_iter().next());
        args.clips.extend(clip.and_then(|clip| clip.into_os_string().into_string().ok()));
    }
    Ok(args)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn request(clip: Option<&str>, options: Option<&str>) -> IntentRequest {
        IntentRequest { clip: clip.map(String::from), options: options.map(String::from) }
    }

    #[test]
    fn the_intent_comes_before_the_folders_and_those_before_the_demo() {
        let (first, second) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        let folders = [first.path().to_owned(), "/nowhere".into(), second.path().to_owned()];
        let clip = |clip, options| {
            let args = command_line(request(clip, options), &folders, Trust::Playback);
            args.unwrap().clips.first().map(PathBuf::from)
        };
        assert_eq!(clip(None, None), None, "the demo");
        for name in ["b.aarc", "c.aarc", "a.txt"] {
            std::fs::write(second.path().join(name), "").unwrap();
        }
        assert_eq!(clip(None, None), Some(second.path().join("b.aarc")));
        std::fs::write(first.path().join("d.aarc"), "").unwrap();
        assert_eq!(clip(None, None), Some(first.path().join("d.aarc")));
        assert_eq!(clip(None, Some("--layer 1 e.aarc")), Some("e.aarc".into()));
        assert_eq!(clip(Some("f.aarc"), Some("e.aarc")), Some("f.aarc".into()));
    }

    #[test]
    fn a_development_build_takes_the_options_of_the_command_line() {
        let parse = |options| command_line(request(None, Some(options)), &[], Trust::All);
        let args = parse(" --frames 10..20  --stats s.json ").unwrap();
        assert!(args.xr && args.frames == Some(10..20) && args.stats == Some("s.json".into()));
        for options in ["--frames 3..3", "--headless --out o", "--nothing", "--help"] {
            let Err(Fault::Usage(message)) = parse(options) else { panic!("{options} is refused") };
            assert!(message.contains(options) && !message.contains('\n'), "{message}");
        }
    }

    #[test]
    fn errors_tell_no_secrets() {
        let secret = request(None, Some("--sort https://ann:key@h/b?key"));
        let message = command_line(secret, &[], Trust::All).unwrap_err().to_string();
        assert!(message.contains("https://h/b") && !message.contains("key"), "{message}");
    }

    #[test]
    fn other_builds_take_only_options_of_playing() {
        let parse = |options: &str| command_line(request(None, Some(options)), &[], Trust::Playback);
        let args = parse("--layer 2 --sort depth --cutoff 5 --quality least --near a.aarc").unwrap();
        assert!(args.xr && args.layer == Some(2) && args.clips == ["a.aarc"]);
        // Each option of the command line, also those that come later.
        for option in Args::command().get_arguments() {
            let (name, Some(long)) = (option.get_id().as_str(), option.get_long()) else { continue };
            if PLAYBACK.contains(&name) {
                continue;
            }
            let value = match name {
                "frames" => "0..9",
                "time" | "seconds" => "1",
                "size" => "9x9",
                _ => "x",
            };
            let value = if option.get_action().takes_values() { value } else { "" };
            assert!(parse(&format!("--{long} {value}")).is_err(), "--{long}");
        }
        for options in ["--frames 0..9", "--frames 0..9 --stats placements.json", "--frames 0..9 --out eyes"]
        {
            let Err(Fault::Usage(message)) = parse(options) else { panic!("{options} is refused") };
            assert!(message.contains("development builds"), "{message}");
        }
    }
}
