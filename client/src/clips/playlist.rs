//! [`Playlist`]: clips that play one after the other, named by a small JSON file; `xtask/PLAYLIST.md`
//! describes it.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use percent_encoding::{AsciiSet, NON_ALPHANUMERIC, utf8_percent_encode};
use program::Fault;
use serde::Deserialize;

use super::event::LoadEvent;
use super::file::read;
use super::url::{is_url, printable, redacted};

/// Most bytes of a playlist.
pub const BYTES_MAX: usize = 1 << 20;

/// Most clips of a playlist.
pub const CLIPS_MAX: usize = 10_000;

/// Version of the playlist format.
const VERSION: u32 = 1;

/// Characters that are percent-encoded in a URL: all but the unreserved ones (RFC 3986, 2.3).
const RESERVED: &AsciiSet = &NON_ALPHANUMERIC.remove(b'-').remove(b'.').remove(b'_').remove(b'~');

/// The clips of a playlist.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Playlist {
    /// Paths and URLs, at least one.
    pub clips: Vec<String>,
}

/// A playlist of any version.
#[derive(Deserialize)]
struct Versioned {
    version: u32,
}

/// A playlist of this version.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Manifest {
    #[serde(rename = "version")]
    _version: u32,
    clips: Vec<String>,
}

/// Whether a path or URL names a playlist rather than a clip: it ends in `.json`.
pub fn is_playlist(name: &str) -> bool {
    Path::new(&printable(name)).extension().is_some_and(|extension| extension.eq_ignore_ascii_case("json"))
}

/// Opens the playlist with this path or URL. Downloads are cached in `cache_dir`. `on_event` takes progress
/// and notes; where it breaks, the result is `None`.
///
/// # Errors
/// As for a clip: [`Fault::Data`], [`Fault::Network`] or [`Fault::Usage`] with the name of the playlist.
pub fn open(
    name: &str,
    cache_dir: Option<PathBuf>,
    on_event: &mut dyn FnMut(LoadEvent) -> ControlFlow<()>,
) -> Result<Option<Playlist>, Fault> {
    let bytes = if is_url(name) {
        match fetch(name, cache_dir, on_event)? {
            Some(bytes) => bytes,
            None => return Ok(None),
        }
    } else {
        read(Path::new(name), BYTES_MAX).map_err(|reason| Fault::Data(format!("{name}: {reason}")))?
    };
    let playlist = Playlist::parse(name, &bytes);
    playlist.map(Some).map_err(|reason| Fault::Data(format!("{}: {reason}", printable(name))))
}

/// Opens a playlist as [`open`] does, without a way to stop.
///
/// # Errors
/// As for [`open`].
#[cfg(feature = "window")]
pub(crate) fn wait(
    name: &str,
    cache_dir: Option<PathBuf>,
    mut on_event: impl FnMut(&LoadEvent),
) -> Result<Playlist, Fault> {
    let opened = open(name, cache_dir, &mut |event| {
        on_event(&event);
        ControlFlow::Continue(())
    });
    opened.map(|playlist| playlist.expect("it is never stopped"))
}

#[cfg(feature = "net")]
fn fetch(
    url: &str,
    cache_dir: Option<PathBuf>,
    on_event: &mut dyn FnMut(LoadEvent) -> ControlFlow<()>,
) -> Result<Option<Vec<u8>>, Fault> {
    use super::source::net_options;
    let progress =
        &mut |progress: &super::progress::Progress| on_event(LoadEvent::Progress(progress.clone()));
    let is_sound = &|bytes: &[u8]| Playlist::parse(url, bytes).is_ok();
    let options = net_options(cache_dir);
    let Some(document) = crate::net::document(url, &options, BYTES_MAX, is_sound, progress)? else {
        return Ok(None);
    };
    if let Some(note) = document.note
        && on_event(LoadEvent::Note(note)).is_break()
    {
        return Ok(None);
    }
    Ok(Some(document.bytes))
}

#[cfg(not(feature = "net"))]
fn fetch(
    url: &str,
    _cache_dir: Option<PathBuf>,
    _on_event: &mut dyn FnMut(LoadEvent) -> ControlFlow<()>,
) -> Result<Option<Vec<u8>>, Fault> {
    Err(super::source::no_net(url))
}

impl Playlist {
    /// Parses the playlist `name`; relative entries start from its folder.
    fn parse(name: &str, bytes: &[u8]) -> Result<Playlist, String> {
        let Versioned { version } = serde_json::from_slice(bytes)
            .map_err(|error| format!("no playlist, which is {{\"version\": 1, \"clips\": [..]}}: {error}"))?;
        if version != VERSION {
            return Err(format!("a playlist of version {version}; this player reads version {VERSION}"));
        }
        let Manifest { clips, .. } = serde_json::from_slice(bytes).map_err(|error| error.to_string())?;
        match clips.len() {
            0 => return Err("the playlist has no clip".into()),
            count if count > CLIPS_MAX => {
                return Err(format!("{count} clips; a playlist has {CLIPS_MAX} at most"));
            }
            _ => {}
        }
        let resolve = |(i, entry): (usize, &String)| {
            resolve(name, entry).map_err(|reason| format!("clips[{i}] {reason}"))
        };
        Ok(Playlist { clips: clips.iter().enumerate().map(resolve).collect::<Result<_, _>>()? })
    }
}

/// Path or URL of an entry of the playlist `base`.
fn resolve(base: &str, entry: &str) -> Result<String, String> {
    if entry.is_empty() || entry.chars().any(char::is_control) {
        return Err("is neither a path nor a URL".into());
    }
    if is_playlist(entry) {
        return Err(format!("is a playlist itself, {}", printable(entry)));
    }
    if is_url(entry) {
        let is_secure = |url: &str| url.get(..6).is_some_and(|start| start.eq_ignore_ascii_case("https:"));
        // A list that was fetched encrypted names no clip that would be fetched in the open.
        return match is_secure(base) && !is_secure(entry) {
            true => Err(format!("leads from https to http, {}", redacted(entry))),
            false => Ok(entry.into()),
        };
    }
    if is_url(base) {
        return Ok(join(base, entry));
    }
    let path = Path::new(base).parent().unwrap_or(Path::new("")).join(entry);
    Ok(path.into_os_string().into_string().expect("both parts are text"))
}

/// URL of the path `entry`, relative to the folder of the URL `base` (RFC 3986, 5.2). The path is written as
/// on disk: characters with a meaning in URLs are encoded.
fn join(base: &str, entry: &str) -> String {
    let base = base.split(['?', '#']).next().unwrap_or_default();
    let host_at = base.find("://").map_or(0, |at| at + 3);
    let path_at = base[host_at..].find('/').map_or(base.len(), |at| host_at + at);
    let (server, path) = base.split_at(path_at);
    let mut parts: Vec<String> = Vec::new();
    if !entry.starts_with('/') {
        let folder = path.rsplit_once('/').map_or("", |(folder, _)| folder);
        parts.extend(folder.split('/').filter(|part| !part.is_empty()).map(String::from));
    }
    for part in entry.split('/') {
        match part {
            "" | "." => {}
            ".." => drop(parts.pop()),
            part => parts.push(utf8_percent_encode(part, RESERVED).to_string()),
        }
    }
    format!("{server}/{}", parts.join("/"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(name: &str, text: &str) -> Result<Vec<String>, String> {
        Playlist::parse(name, text.as_bytes()).map(|playlist| playlist.clips)
    }

    #[test]
    fn playlists_differ_from_clips() {
        for name in ["a.json", "a/b.JSON", "https://h/list.json?key=1#x"] {
            assert!(is_playlist(name), "{name}");
        }
        for name in ["a.aarc", "json", "https://h/a.aarc?list.json", ".json"] {
            assert!(!is_playlist(name), "{name}");
        }
    }

    #[test]
    fn entries_are_relative_to_the_folder_of_the_playlist() {
        let text =
            r#"{"version": 1, "clips": ["a.aarc", "../b/c d#1.aarc", "/e.aarc", "https://o/f.aarc?g"]}"#;
        assert_eq!(
            parse("shows/today.json", text).unwrap(),
            ["shows/a.aarc", "shows/../b/c d#1.aarc", "/e.aarc", "https://o/f.aarc?g"]
        );
        assert_eq!(parse("today.json", text).unwrap()[0], "a.aarc");
        assert_eq!(
            parse("https://ann:x@h:8/shows/x%20y/today.json?key=a/b", text).unwrap(),
            [
                "https://ann:x@h:8/shows/x%20y/a.aarc",
                "https://ann:x@h:8/shows/b/c%20d%231.aarc",
                "https://ann:x@h:8/e.aarc",
                "https://o/f.aarc?g"
            ]
        );
        let clip = |entry: &str| {
            parse("http://h/l.json", &format!(r#"{{"version":1,"clips":["{entry}"]}}"#)).unwrap()
        };
        assert_eq!(clip("../../a.aarc"), ["http://h/a.aarc"]);
        assert_eq!(clip("./ä/100%.aarc"), ["http://h/%C3%A4/100%25.aarc"]);
    }

    #[test]
    fn malformed_playlists_are_refused_in_one_line() {
        let clips = |count: usize| format!(r#"{{"version":1,"clips":[{}]}}"#, vec!["\"a\""; count].join(","));
        assert_eq!(parse("l.json", &clips(CLIPS_MAX)).unwrap().len(), CLIPS_MAX);
        for (text, what) in [
            ("", "no playlist"),
            ("<!doctype html>", "no playlist"),
            ("[]", "no playlist"),
            (r#"{"clips":["a"]}"#, "no playlist"),
            (r#"{"version":2,"entries":[]}"#, "version 2; this player reads version 1"),
            (r#"{"version":1}"#, "clips"),
            (r#"{"version":1,"clips":[]}"#, "no clip"),
            (r#"{"version":1,"clips":[1]}"#, "invalid type"),
            (r#"{"version":1,"clips":["a"],"loop":1}"#, "unknown field `loop`"),
            (r#"{"version":1,"clips":["a",""]}"#, "clips[1] is neither"),
            (r#"{"version":1,"clips":["a\nb"]}"#, "clips[0] is neither"),
            (r#"{"version":1,"clips":["l.json"]}"#, "a playlist itself"),
            (clips(CLIPS_MAX + 1).as_str(), "10001 clips"),
        ] {
            let error = parse("l.json", text).unwrap_err();
            assert!(error.contains(what) && !error.contains('\n'), "{text}: {error}");
        }
        let down = parse("https://h/l.json", r#"{"version":1,"clips":["http://h/a?key"]}"#).unwrap_err();
        assert!(down.contains("from https to http, http://h/a") && !down.contains("key"), "{down}");
        // Nesting without end.
        assert!(parse("l.json", &"[".repeat(BYTES_MAX)).is_err());
    }

    #[test]
    fn a_file_is_read_up_to_the_limit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("l.json");
        let name = path.to_str().unwrap();
        let open = || open(name, None, &mut |_| ControlFlow::Continue(()));
        assert!(open().unwrap_err().to_string().starts_with(name));
        std::fs::write(&path, r#"{"version":1,"clips":["a.aarc"]}"#).unwrap();
        let expected = folder.path().join("a.aarc").to_str().unwrap().to_owned();
        assert_eq!(open().unwrap().unwrap().clips, [expected]);
        std::fs::write(&path, " ".repeat(BYTES_MAX + 1)).unwrap();
        assert!(open().unwrap_err().to_string().contains("larger than 1 MiB"));
    }
}
