//! [`RecentClips`]: the clips and playlists that were opened last, remembered in a small file.

use std::io;
use std::path::{Path, PathBuf, absolute};

use serde::{Deserialize, Serialize};

use crate::clips::{is_url, redacted};
use crate::state_file;

/// Name of the file in its folder, its version and its largest size.
const FILE: &str = "recent.json";
const VERSION: u32 = 1;
const FILE_BYTES: u64 = 1 << 20;

/// Most names that are remembered, and most bytes of one. All of them fit the file.
const NAMES: usize = 24;
const NAME_BYTES: usize = 4096;

/// What was opened last. The file is a convenience: a missing or damaged one is an empty list.
#[derive(Debug)]
pub(super) struct RecentClips {
    folder: Option<PathBuf>,
    /// Absolute paths and URLs, the last one first.
    names: Vec<String>,
}

#[derive(Serialize, Deserialize)]
struct Contents {
    version: u32,
    clips: Vec<String>,
}

impl RecentClips {
    /// Reads the file in `folder`; without one, nothing outlives the window.
    pub(super) fn open(folder: Option<PathBuf>) -> RecentClips {
        let names = folder.as_deref().and_then(read).unwrap_or_default();
        RecentClips { folder, names }
    }

    /// Absolute paths and URLs, the last one first.
    #[cfg(test)]
    fn names(&self) -> &[String] {
        &self.names
    }

    /// Those that can be opened, as far as is known without the network.
    pub(super) fn that_are_there(&self) -> impl Iterator<Item = &String> {
        self.names.iter().filter(|name| is_url(name) || Path::new(name).exists())
    }

    /// Remembers that a path or a URL was opened, also in the file. A URL with a password or a key in it is not
    /// remembered.
    pub(super) fn add(&mut self, name: &str) {
        let name = absolute_name(name);
        if name.len() > NAME_BYTES || is_url(&name) && redacted(&name) != name {
            return;
        }
        // Other windows may have written since.
        if let Some(names) = self.folder.as_deref().and_then(read) {
            self.names = names;
        }
        self.names.retain(|known| *known != name);
        self.names.insert(0, name);
        self.names.truncate(NAMES);
        let Some(folder) = &self.folder else { return };
        let contents = Contents { version: VERSION, clips: self.names.clone() };
        if let Err(error) = state_file::write(folder, FILE, &state_file::encode(&contents)) {
            log::warn!("cannot remember what was opened: {}: {error}", folder.join(FILE).display());
        }
    }
}

/// A path as it is from any working directory, or a URL.
pub(super) fn absolute_name(name: &str) -> String {
    let path = if is_url(name) { None } else { absolute(name).ok() };
    path.and_then(|path| path.to_str().map(String::from)).unwrap_or_else(|| name.into())
}

/// The names in the file, if it is there and whole.
fn read(folder: &Path) -> Option<Vec<String>> {
    let path = folder.join(FILE);
    let contents =
        state_file::read(&path, FILE_BYTES).and_then(|contents: Contents| match contents.version {
            VERSION => Ok(contents.clips),
            version => Err(io::Error::other(format!("version {version} instead of {VERSION}"))),
        });
    let fault = |error: &io::Error| {
        if error.kind() != io::ErrorKind::NotFound {
            log::warn!("{}: {error}: the list of clips opened last starts anew", path.display());
        }
    };
    let mut names = contents.inspect_err(fault).ok()?;
    names.retain(|name| name.len() <= NAME_BYTES);
    names.truncate(NAMES);
    Some(names)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_opened_last_comes_first_in_all_windows() {
        let folder = tempfile::tempdir().unwrap();
        let open = || RecentClips::open(Some(folder.path().join("new")));
        let (mut one, mut other) = (open(), open());
        one.add("/clips/a.aarc");
        other.add("https://host/b.aarc");
        one.add("/clips/c.aarc");
        one.add("/clips/a.aarc");
        assert_eq!(one.names(), ["/clips/a.aarc", "/clips/c.aarc", "https://host/b.aarc"]);
        assert_eq!(open().names(), one.names());
        assert!(one.that_are_there().eq(["https://host/b.aarc"]), "no such files");
        one.add("d.aarc");
        assert!(Path::new(&one.names()[0]).is_absolute(), "{:?}", one.names());
        (0..2 * NAMES).for_each(|i| one.add(&format!("/clips/{i}.aarc")));
        assert_eq!((one.names().len(), open().names().len()), (NAMES, NAMES));
    }

    #[test]
    fn secrets_and_endless_names_are_not_remembered() {
        let folder = tempfile::tempdir().unwrap();
        let mut recent = RecentClips::open(Some(folder.path().into()));
        for name in
            ["https://ann:key@host/a.aarc", "https://host/a.aarc?token=key", &"x".repeat(NAME_BYTES + 1)]
        {
            recent.add(name);
            assert!(recent.names().is_empty(), "{name}");
        }
        assert!(!folder.path().join(FILE).exists());
    }

    #[test]
    fn a_file_that_makes_no_sense_is_an_empty_list() {
        let folder = tempfile::tempdir().unwrap();
        let long = format!(r#"{{"version": 1, "clips": ["{}"]}}"#, "x".repeat(FILE_BYTES as usize));
        for text in
            ["", "{", "null", r#"{"version": 2, "clips": ["a"]}"#, r#"{"version": 1, "clips": 7}"#, &long]
        {
            std::fs::write(folder.path().join(FILE), text).unwrap();
            assert!(RecentClips::open(Some(folder.path().into())).names().is_empty(), "{text:.40}");
        }
        let mut recent = RecentClips::open(Some(folder.path().into()));
        recent.add("/a.aarc");
        assert_eq!(RecentClips::open(Some(folder.path().into())).names(), ["/a.aarc"]);
        for nowhere in [None, Some("/proc/nowhere".into())] {
            let mut recent = RecentClips::open(nowhere);
            recent.add("/a.aarc");
            recent.add("/b.aarc");
            assert_eq!(recent.names(), ["/b.aarc", "/a.aarc"]);
        }
    }
}
