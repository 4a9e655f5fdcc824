//! The clips of a folder, and [`Neighbours`]: those before and after one of them.

use std::path::{Path, PathBuf};

use program::output::folder_of;

use super::url::is_url;

/// Which way to go through clips.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Direction {
    #[cfg_attr(not(feature = "window"), allow(dead_code, reason = "a headset only goes forward"))]
    Back,
    #[cfg_attr(not(any(feature = "window", feature = "xr")), allow(dead_code, reason = "of a display"))]
    Forward,
}

/// The clips before and after one in its folder, by name: after the last comes the first.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Neighbours {
    previous: Option<String>,
    next: Option<String>,
}

impl Neighbours {
    /// Those of the clip `name`, a path of any extension. A URL and the demo have none, and neither has the only
    /// clip of a folder.
    pub(super) fn of(name: Option<&str>) -> Neighbours {
        let Some(path) = name.filter(|name| !is_url(name)).map(Path::new) else {
            return Neighbours::default();
        };
        let mut clips = clips_in(folder_of(path));
        // One whose name is not text cannot be opened.
        clips.retain(|clip| clip.file_name() != path.file_name() && clip.to_str().is_some());
        let after = clips.iter().position(|clip| clip.file_name() > path.file_name());
        let before = after.unwrap_or(clips.len()).checked_sub(1);
        let name = |clip: Option<&PathBuf>| clip?.to_str().map(String::from);
        Neighbours {
            previous: name(before.map_or(clips.last(), |before| clips.get(before))),
            next: name(after.map_or(clips.first(), |after| clips.get(after))),
        }
    }

    /// The neighbour in a direction.
    pub(super) fn get(&self, direction: Direction) -> Option<&String> {
        match direction {
            Direction::Back => self.previous.as_ref(),
            Direction::Forward => self.next.as_ref(),
        }
    }
}

/// The paths of the clips in a folder, sorted by name.
pub(crate) fn clips_in(folder: &Path) -> Vec<PathBuf> {
    let entries = folder.read_dir().into_iter().flatten().flatten();
    let mut clips: Vec<_> = entries
        .map(|entry| entry.path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "aarc") && path.is_file())
        .collect();
    clips.sort();
    clips
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clips_of_a_folder_follow_one_another() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        for name in ["b.aarc", "a.aarc", "c.aarc", "b.ply"] {
            std::fs::write(path(name), "").unwrap();
        }
        std::fs::create_dir(path("d.aarc")).unwrap();
        let beside = |name: &str| {
            let Neighbours { previous, next } = Neighbours::of(path(name).to_str());
            [previous, next].map(|name| name.map(PathBuf::from))
        };
        let both = |names: [&str; 2]| names.map(|name| Some(path(name)));
        assert_eq!(beside("a.aarc"), both(["c.aarc", "b.aarc"]));
        assert_eq!(beside("b.aarc"), both(["a.aarc", "c.aarc"]));
        assert_eq!(beside("c.aarc"), both(["b.aarc", "a.aarc"]));
        assert_eq!(beside("b.other"), both(["b.aarc", "c.aarc"]), "of whatever name");
        for name in ["a.aarc", "b.aarc"] {
            std::fs::remove_file(path(name)).unwrap();
        }
        assert_eq!(beside("c.aarc"), [None, None]);
        for none in [None, Some("/nowhere/a.aarc"), Some("http://host/a.aarc")] {
            assert_eq!(Neighbours::of(none), Neighbours::default());
        }
    }
}
