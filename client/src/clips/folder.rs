//! The clips of a folder, and [`Neighbours`]: the clips before and after one of them.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use program::output::folder_of;

use crate::content::is_url;

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
pub(crate) struct Neighbours {
    /// All clips of the folder, and the clip that has the neighbours.
    clips: Arc<[String]>,
    /// Number of this clip among them.
    position: usize,
}

impl Neighbours {
    /// Those of the clip `name`, a path of any extension. A URL and the demo have none, and neither has the only
    /// clip of a folder.
    pub(super) fn find(name: Option<&str>) -> Neighbours {
        let Some(path) = name.filter(|name| !is_url(name)).map(Path::new) else {
            return Neighbours::default();
        };
        let mut clips = clips_in(folder_of(path));
        // One whose name is not text cannot be opened.
        clips.retain(|clip| clip.file_name() != path.file_name() && clip.to_str().is_some());
        let position = clips.partition_point(|clip| clip.file_name() < path.file_name());
        clips.insert(position, path.into());
        let clips = clips.iter().filter_map(|clip| clip.to_str().map(String::from)).collect();
        Neighbours { clips, position }
    }

    /// The neighbour in a direction.
    pub(super) fn get(&self, direction: Direction) -> Option<&String> {
        Some(&self.clips[self.number(direction)?])
    }

    /// The neighbour in a direction, and its neighbours as far as is known.
    pub(super) fn step(&self, direction: Direction) -> Option<(String, Neighbours)> {
        let position = self.number(direction)?;
        Some((self.clips[position].clone(), Neighbours { clips: self.clips.clone(), position }))
    }

    /// Number of the neighbour in a direction.
    fn number(&self, direction: Direction) -> Option<usize> {
        let count = self.clips.len();
        let distance = match direction {
            Direction::Back => count.checked_sub(1)?,
            Direction::Forward => 1,
        };
        (count > 1).then(|| (self.position + distance) % count)
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
            let neighbours = Neighbours::find(path(name).to_str());
            [Direction::Back, Direction::Forward]
                .map(|direction| neighbours.get(direction).map(PathBuf::from))
        };
        let both = |names: [&str; 2]| names.map(|name| Some(path(name)));
        assert_eq!(beside("a.aarc"), both(["c.aarc", "b.aarc"]));
        assert_eq!(beside("b.aarc"), both(["a.aarc", "c.aarc"]));
        assert_eq!(beside("c.aarc"), both(["b.aarc", "a.aarc"]));
        assert_eq!(beside("b.other"), both(["b.aarc", "c.aarc"]), "of whatever name");
        // From step to step as from listing to listing.
        let mut neighbours = Neighbours::find(path("b.aarc").to_str());
        for expected in ["a.aarc", "c.aarc", "b.aarc", "a.aarc"] {
            let (name, next) = neighbours.step(Direction::Back).unwrap();
            assert_eq!(Path::new(&name), path(expected));
            assert_eq!(next, Neighbours::find(Some(&name)));
            neighbours = next;
        }
        for name in ["a.aarc", "b.aarc"] {
            std::fs::remove_file(path(name)).unwrap();
        }
        assert_eq!(beside("c.aarc"), [None, None]);
        for none in [None, Some("/nowhere/a.aarc"), Some("http://host/a.aarc")] {
            let neighbours = Neighbours::find(none);
            assert!(
                neighbours.get(Direction::Back).is_none() && neighbours.step(Direction::Forward).is_none()
            );
        }
    }
}
