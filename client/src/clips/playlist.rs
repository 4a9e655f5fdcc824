//! [`Playlist`]: clips that play one after the other: named by a small JSON file, which `xtask/PLAYLIST.md` describes, in
//! a folder, or named together.

#[cfg(feature = "formats")]
use std::ffi::OsStr;
use std::ops::ControlFlow;
use std::path::Path;

use program::Fault;
use serde::Deserialize;

use super::folder::clips_in;
#[cfg(not(feature = "net"))]
use crate::content::no_net;
#[cfg(feature = "net")]
use crate::content::transfer::document;
use crate::content::url::{UNKNOWN_SCHEME, has_user_info, is_secure, is_url, join, redacted, scheme};
use crate::content::{OpenEvent, SourceOptions, read_file};
#[cfg(feature = "net")]
use crate::content::{Progress, net_options};

/// Most bytes of a playlist.
pub const BYTES_MAX: usize = 1 << 20;

/// Most clips of a playlist.
pub const CLIPS_MAX: usize = 10_000;

/// Most bytes of the paths and URLs of a playlist: each entry may repeat the folder or URL of the playlist.
const RESOLVED_MAX: usize = 16 << 20;

/// Version of the playlist format.
const VERSION: u32 = 1;

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

/// Whether `names` stand for several clips: they are several, or the name of a playlist or of a folder of clips.
pub fn is_list(names: &[String]) -> bool {
    match names {
        [] => false,
        [name] => is_playlist(name) || is_folder(name),
        _ => true,
    }
}

/// Whether a name is the path of a folder of clips that can be named. Fields beside them are what they were made of, or
/// are to become.
fn is_folder(name: &str) -> bool {
    let path = Path::new(name);
    path.is_dir() && clips_in(path).iter().any(|clip| clip.to_str().is_some())
}

/// Whether a path or URL names a playlist rather than a clip: it ends in `.json`. A path of a file name of SOG names a
/// field, if this program reads fields.
pub fn is_playlist(name: &str) -> bool {
    #[cfg(feature = "formats")]
    let is_field = !is_url(name)
        && Path::new(name).file_name().and_then(OsStr::to_str).is_some_and(formats::is_field_file);
    #[cfg(not(feature = "formats"))]
    let is_field = false;
    let redacted = redacted(name);
    let extension = Path::new(&redacted).extension();
    !is_field && extension.is_some_and(|extension| extension.eq_ignore_ascii_case("json"))
}

/// Lists the clips that `names` stand for, in order: of a playlist and of a folder its clips. `on_event` takes progress
/// and notes; where it breaks, the result is `None`.
///
/// # Errors
/// As for a clip: [`Fault::Data`], [`Fault::Network`] or [`Fault::Usage`] with the name of a playlist.
pub fn open(
    names: &[String],
    options: &SourceOptions,
    on_event: &mut dyn FnMut(OpenEvent) -> ControlFlow<()>,
) -> Result<Option<Playlist>, Fault> {
    let mut clips = Vec::new();
    for name in names {
        if is_playlist(name) {
            let Some(playlist) = open_file(name, options, on_event)? else { return Ok(None) };
            clips.extend(playlist.clips);
        } else if is_folder(name) {
            // One whose name is not text cannot be opened.
            clips.extend(clips_in(Path::new(name)).iter().filter_map(|clip| clip.to_str().map(String::from)));
        } else {
            clips.push(name.clone());
        }
    }
    Ok(Some(Playlist { clips }))
}

/// Opens the playlist with this path or URL.
fn open_file(
    name: &str,
    options: &SourceOptions,
    on_event: &mut dyn FnMut(OpenEvent) -> ControlFlow<()>,
) -> Result<Option<Playlist>, Fault> {
    if is_url(name) {
        return fetch(name, options, on_event);
    }
    if scheme(name).is_some() {
        return Err(Fault::Usage(format!("{}: {UNKNOWN_SCHEME}", redacted(name))));
    }
    let clips = read_file(Path::new(name), BYTES_MAX).and_then(|bytes| parse(name, &bytes));
    let clips = clips.map_err(|reason| Fault::Data(format!("{name}: {reason}")))?;
    Ok(Some(Playlist { clips }))
}

#[cfg(feature = "net")]
fn fetch(
    url: &str,
    options: &SourceOptions,
    on_event: &mut dyn FnMut(OpenEvent) -> ControlFlow<()>,
) -> Result<Option<Playlist>, Fault> {
    let progress = &mut |progress: &Progress| on_event(OpenEvent::Progress(progress.clone()));
    let is_sound = &|bytes: &[u8]| parse(url, bytes).is_ok();
    let options = net_options(options);
    let Some(document) = document(url, &options, BYTES_MAX, is_sound, progress)? else {
        return Ok(None);
    };
    if let Some(note) = document.note
        && on_event(OpenEvent::Note(note)).is_break()
    {
        return Ok(None);
    }
    // Where redirects led: entries are relative to that.
    let clips = parse(&document.url, &document.bytes)
        .map_err(|reason| Fault::Data(format!("{}: {reason}", redacted(url))))?;
    Ok(Some(Playlist { clips }))
}

#[cfg(not(feature = "net"))]
fn fetch(
    url: &str,
    _options: &SourceOptions,
    _on_event: &mut dyn FnMut(OpenEvent) -> ControlFlow<()>,
) -> Result<Option<Playlist>, Fault> {
    Err(no_net(url))
}

/// Parses the playlist `name`; relative entries start from its folder.
fn parse(name: &str, bytes: &[u8]) -> Result<Vec<String>, String> {
    let Versioned { version } = serde_json::from_slice(bytes)
        .map_err(|error| format!("no playlist ({error}): write {{\"version\": 1, \"clips\": [..]}}"))?;
    if version != VERSION {
        return Err(format!(
            "a playlist of version {version}; this player reads version {VERSION}: update the player"
        ));
    }
    let Manifest { clips, .. } = serde_json::from_slice(bytes)
        .map_err(|error| format!("{error}: write {{\"version\": 1, \"clips\": [..]}}"))?;
    match clips.len() {
        0 => return Err("the playlist has no clip: name one in \"clips\"".into()),
        count if count > CLIPS_MAX => {
            return Err(format!("{count} clips; a playlist has {CLIPS_MAX} at most: make several"));
        }
        _ => {}
    }
    let resolve =
        |(i, entry): (usize, &String)| resolve(name, entry).map_err(|reason| format!("clips[{i}] {reason}"));
    let mut bytes_left = RESOLVED_MAX;
    let counted = |resolved: Result<String, String>| {
        let resolved = resolved?;
        let too_long = || format!("its paths and URLs take more than {RESOLVED_MAX} bytes: make several");
        bytes_left = bytes_left.checked_sub(resolved.len()).ok_or_else(too_long)?;
        Ok(resolved)
    };
    clips.iter().enumerate().map(resolve).map(counted).collect()
}

/// Path or URL of an entry of the playlist `base`.
fn resolve(base: &str, entry: &str) -> Result<String, String> {
    if entry.is_empty() || entry.chars().any(char::is_control) {
        return Err("is neither a path nor a URL: name a clip".into());
    }
    if is_playlist(entry) {
        return Err(format!("is a playlist itself, {}: name its clips", redacted(entry)));
    }
    if scheme(entry).is_some() {
        let refused = |why: &str| Err(format!("is {}: {why}", redacted(entry)));
        return match is_url(entry) {
            false => refused(UNKNOWN_SCHEME),
            true if has_user_info(entry) => {
                refused("a playlist passes on no user name and password: leave them out")
            }
            // A list that was fetched encrypted names no clip that would be fetched in the open.
            true if is_secure(base) && !is_secure(entry) => refused("it leads from https to http: use https"),
            true => Ok(entry.into()),
        };
    }
    if is_url(base) {
        return Ok(join(base, entry));
    }
    let path = Path::new(base).parent().unwrap_or(Path::new("")).join(entry);
    Ok(path.into_os_string().into_string().expect("both parts are text"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(name: &str, text: &str) -> Result<Vec<String>, String> {
        super::parse(name, text.as_bytes())
    }

    #[test]
    fn playlists_differ_from_clips() {
        for name in ["a.json", "a/b.JSON", "https://h/list.json?key=1#x", "https://h/meta.json"] {
            assert!(is_playlist(name), "{name}");
        }
        for name in ["a.aarc", "json", "https://h/a.aarc?list.json", ".json"] {
            assert!(!is_playlist(name), "{name}");
        }
        for name in ["field/meta.json", "field/lod-meta.json"] {
            assert_eq!(is_playlist(name), cfg!(not(feature = "formats")));
        }
    }

    #[test]
    fn names_that_multiply_are_refused() {
        let clips = vec!["a.aarc"; CLIPS_MAX];
        let text = serde_json::json!({"version": 1, "clips": clips}).to_string();
        let folder = "x/".repeat(1 << 10);
        assert!(parse(&format!("{folder}a.json"), &text).unwrap_err().contains("more than 16777216 bytes"));
        assert_eq!(parse(&format!("{}a.json", &folder[..1 << 10]), &text).unwrap().len(), CLIPS_MAX);
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
                "https://h:8/shows/x%20y/a.aarc",
                "https://h:8/shows/b/c%20d%231.aarc",
                "https://h:8/e.aarc",
                "https://o/f.aarc?g"
            ],
            "without user name and password"
        );
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
        for (base, clip, what) in [
            ("https://h/l.json", "http://h/a?key", "is http://h/a: it leads from https to http"),
            ("https://h/l.json", "file:///key", "is file:///key: clips come from"),
            ("l.json", "ftp://h/a?key", "is ftp://h/a: clips come from"),
            ("l.json", "https://ann:key@h/a", "is https://h/a: a playlist passes on no user name"),
        ] {
            let error = parse(base, &format!(r#"{{"version":1,"clips":["{clip}"]}}"#)).unwrap_err();
            assert!(error.contains(what), "{error}");
            assert!(clip.starts_with("file") || !error.contains("key"), "{error}");
        }
        // Nesting without end.
        assert!(parse("l.json", &"[".repeat(BYTES_MAX)).is_err());
    }

    #[test]
    fn a_file_is_read_up_to_the_limit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("l.json");
        let name = path.to_str().unwrap();
        let open = || open(&[name.into()], &SourceOptions::default(), &mut |_| ControlFlow::Continue(()));
        assert!(open().unwrap_err().to_string().starts_with(name));
        std::fs::write(&path, r#"{"version":1,"clips":["a.aarc"]}"#).unwrap();
        let expected = folder.path().join("a.aarc").to_str().unwrap().to_owned();
        assert_eq!(open().unwrap().unwrap().clips, [expected]);
        std::fs::write(&path, " ".repeat(BYTES_MAX + 1)).unwrap();
        assert!(open().unwrap_err().to_string().contains("larger than 1 MiB"));
    }

    #[test]
    fn folders_and_several_names_are_lists_of_clips() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
        std::fs::create_dir(folder.path().join("clips")).unwrap();
        for name in ["clips/b.aarc", "clips/a.aarc", "clips/notes.txt", "c.aarc"] {
            std::fs::write(path(name), "").unwrap();
        }
        std::fs::write(path("l.json"), r#"{"version":1,"clips":["c.aarc"]}"#).unwrap();
        let names = ["clips", "l.json", "d.aarc"].map(path);
        let listed = open(&names, &SourceOptions::default(), &mut |_| ControlFlow::Continue(()));
        assert_eq!(
            listed.unwrap().unwrap().clips,
            ["clips/a.aarc", "clips/b.aarc", "c.aarc", "d.aarc"].map(path)
        );
        assert!(is_list(&names) && is_list(&names[..1]) && is_list(&names[1..2]));
        // Beside the fields that they were made of: an output folder of 3D Gaussian Splatting, and a file.
        let output = folder.path().join("clips/point_cloud/iteration_7");
        std::fs::create_dir_all(&output).unwrap();
        for field in [output.join("point_cloud.ply"), folder.path().join("clips/a.ply")] {
            std::fs::write(field, "").unwrap();
            assert!(is_list(&names[..1]));
        }
        std::fs::create_dir(folder.path().join("empty")).unwrap();
        assert!(!is_list(&names[2..]) && !is_list(&[]) && !is_list(&[path("empty")]));
    }
}
