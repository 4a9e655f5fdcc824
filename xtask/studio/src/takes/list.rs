//! [`List`]: a text file that names takes, and [`Shard`]: one machine's share of it.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use program::Fault;

use crate::messages::unreadable;
use crate::scene::name_of;

/// Maximum number of takes in a list: the maximum of clips in a playlist.
pub const TAKES_MAX: usize = 10_000;

/// Maximum size of a list in bytes.
const LIST_BYTES: u64 = 4 << 20;

/// One of many scenes or captures.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ListedTake {
    /// Path of the scene or capture.
    pub path: PathBuf,
    /// Name of its output without extension, unique in the list.
    pub name: String,
}

/// The takes of a list, in its order.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct List {
    /// Path of the list.
    pub path: PathBuf,
    /// At least one.
    pub takes: Vec<ListedTake>,
}

impl List {
    /// Reads a list: a path in each line, relative to the folder of the list; skips empty
    /// lines and lines that begin with `#`.
    ///
    /// # Errors
    /// [`Fault::Data`] that names the list and the line: unreadable, too long, empty, or two takes
    /// whose outputs would have the same name.
    pub fn read(path: &Path) -> Result<List, Fault> {
        let bad = |what: String| Fault::Data(format!("{}: {what}", path.display()));
        let mut text = String::new();
        let file = File::open(path).map_err(|error| unreadable(path, &error))?;
        file.take(LIST_BYTES + 1).read_to_string(&mut text).map_err(|error| unreadable(path, &error))?;
        if text.len() as u64 > LIST_BYTES {
            return Err(bad(format!(
                "longer than {} MiB, the most that is read; make several lists",
                LIST_BYTES >> 20
            )));
        }
        let folder = path.parent().unwrap_or(Path::new(""));
        let mut lines_by_name = BTreeMap::new();
        let mut takes = Vec::new();
        for (i, line) in text.lines().enumerate() {
            let line = line.trim();
            if line.is_empty() || line.starts_with('#') {
                continue;
            }
            let take = folder.join(line);
            let name = name_of(&take);
            if let Some(first) = lines_by_name.insert(name.clone(), i + 1) {
                let second = i + 1;
                return Err(bad(format!(
                    "lines {first} and {second} would both become \"{name}\": rename one of them"
                )));
            }
            takes.push(ListedTake { path: take, name });
        }
        match takes.len() {
            0 => Err(bad("names no take: write the path of one in each line".into())),
            count if count > TAKES_MAX => {
                Err(bad(format!("{count} takes, and at most {TAKES_MAX} are taken; make several lists")))
            }
            _ => Ok(List { path: path.into(), takes }),
        }
    }

    /// The takes of a shard.
    pub fn in_shard(&self, shard: Shard) -> impl Iterator<Item = &ListedTake> {
        shard.select(self.takes.iter())
    }
}

/// One of several equal shares of takes or parts, which are dealt out in turn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    index: usize,
    count: usize,
}

impl Shard {
    /// All of them.
    pub const ALL: Shard = Shard { index: 0, count: 1 };

    /// The items of the shard.
    pub fn select<I: Iterator>(self, all: I) -> impl Iterator<Item = I::Item> {
        all.skip(self.index).step_by(self.count)
    }

    /// The shard as part of a file name.
    pub fn file_name(&self) -> String {
        format!("{}-of-{}", self.index, self.count)
    }
}

impl std::fmt::Display for Shard {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}/{}", self.index, self.count)
    }
}

impl FromStr for Shard {
    type Err = String;

    /// From `I/N`, counted from 0, as Slurm and Kubernetes do.
    fn from_str(text: &str) -> Result<Shard, String> {
        let parts = text.split_once('/').and_then(|(i, n)| Some((i.parse().ok()?, n.parse().ok()?)));
        match parts {
            Some((index, count)) if index < count && count <= TAKES_MAX => Ok(Shard { index, count }),
            _ => Err(format!("I/N, from 0/N to N-1/N, N being at most {TAKES_MAX}")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<List, Fault> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("takes.txt");
        std::fs::write(&path, text).unwrap();
        let mut list = List::read(&path)?;
        for take in &mut list.takes {
            take.path = take.path.strip_prefix(folder.path()).unwrap_or(&take.path).to_owned();
        }
        Ok(list)
    }

    fn take(path: &str, name: &str) -> ListedTake {
        ListedTake { path: path.into(), name: name.into() }
    }

    #[test]
    fn lines_are_paths_from_the_folder_of_the_list() {
        let text = "# a day's work\n\n walk.v2 \r\nfields/run.v2.ply\n/elsewhere/jump.spz\nwalk.2026-11-01\nsit/meta.json\n";
        let list = read(text).unwrap();
        let expected = [
            take("walk.v2", "walk.v2"),
            take("fields/run.v2.ply", "run.v2"),
            take("/elsewhere/jump.spz", "jump"),
            // Whether it is there or not.
            take("walk.2026-11-01", "walk.2026-11-01"),
            take("sit/meta.json", "sit"),
        ];
        assert_eq!(list.takes, expected);
    }

    #[test]
    fn bad_lists_are_refused() {
        let error = |text: &str| read(text).unwrap_err().to_string();
        assert!(error("# nothing\n").contains("names no take"));
        let twice = error("a/run.ply\n\nb/run.spz\n");
        assert!(twice.contains("lines 1 and 3") && twice.contains("\"run\""), "{twice}");
        let many: String = (0..=TAKES_MAX).map(|i| format!("{i}\n")).collect();
        assert!(error(&many).contains("at most 10000"));
        assert!(error(&"x".repeat(LIST_BYTES as usize + 1)).contains("longer than 4 MiB"));
        assert!(List::read(Path::new("nowhere.txt")).unwrap_err().to_string().contains("nowhere.txt"));
    }

    #[test]
    fn shards_share_all_takes_out() {
        let list =
            List { path: "takes.txt".into(), takes: (0..7).map(|i| take("x", &i.to_string())).collect() };
        let names = |shard: &str| -> Vec<&str> {
            list.in_shard(shard.parse().unwrap()).map(|take| take.name.as_str()).collect()
        };
        assert_eq!(
            (names("0/3"), names("1/3"), names("2/3")),
            (vec!["0", "3", "6"], vec!["1", "4"], vec!["2", "5"])
        );
        assert_eq!(names("0/1").len(), 7);
        assert!(names("8/9").is_empty(), "more shards than takes");
        for text in ["", "1", "1/", "/2", "2/2", "-1/2", "0/0", "1/2/3", "0/10001"] {
            assert!(text.parse::<Shard>().is_err(), "{text}");
        }
    }
}
