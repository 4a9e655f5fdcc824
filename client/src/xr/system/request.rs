//! [`IntentRequest`]: an Android intent as the command line that asks for the same.

use std::path::PathBuf;

use clap::Parser;
use program::Fault;

use crate::args::Args;
use crate::clips::clips_in;

/// What an intent asks for.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct IntentRequest {
    /// A path or URL.
    pub(super) clip: Option<String>,
    /// Options of the command line, separated by blanks.
    pub(super) options: Option<String>,
}

/// The command line of an intent. An intent without a clip names the first clip, by name, of the first of
/// the `folders` that has any; without one, the demo plays.
///
/// # Errors
/// [`Fault::Usage`] if the options cannot be parsed.
pub(super) fn command_line(request: IntentRequest, folders: &[PathBuf]) -> Result<Args, Fault> {
    let options = request.options.unwrap_or_default();
    let mut args = Args::try_parse_from(["aarc", "--xr"].into_iter().chain(options.split_whitespace()))
        .map_err(|error| {
            let text = error.to_string();
            let what = text.lines().next().unwrap_or_default().trim_start_matches("error: ");
            Fault::Usage(format!("the intent's args, {options:?}: {what}"))
        })?;
    args.clip = request.clip.or(args.clip).or_else(|| {
        let clip = folders.iter().find_map(|folder| clips_in(folder).into_iter().next())?;
        clip.into_os_string().into_string().ok()
    });
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
        let clip =
            |clip, options| command_line(request(clip, options), &folders).unwrap().clip.map(PathBuf::from);
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
    fn options_are_those_of_the_command_line() {
        let args = command_line(request(None, Some(" --frames 10..20  --stats s.json ")), &[]).unwrap();
        assert!(args.xr && args.frames == Some(10..20) && args.stats == Some("s.json".into()));
        for options in ["--frames 3..3", "--headless --out o", "--nothing", "a b", "--help"] {
            let Err(Fault::Usage(message)) = command_line(request(None, Some(options)), &[]) else {
                panic!("{options} is refused")
            };
            assert!(message.contains(options) && !message.contains('\n'), "{message}");
        }
    }
}
