//! [`RecentClips`]: the clips and playlists that were opened last, remembered in a small file.
//!
//! A thread reads and writes the file, so that no frame waits for it. It adds what was opened to what is in the
//! file by then, since other windows write it, too, and the whole list is seen in this window afterwards.

use std::io;
use std::path::{Path, PathBuf, absolute};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use serde::{Deserialize, Serialize};

use crate::content::{is_url, redacted};
use crate::state_file::{StateFile, StateWriter, exclusively};

/// The file. All names fit it.
const FILE: StateFile = StateFile { name: "recent.json", version: 1, max_bytes: 1 << 20 };

/// Most names that are remembered, and most bytes of one.
const NAMES: usize = 24;
const NAME_BYTES: usize = 4096;

/// What was opened last. The file is a convenience: a missing or damaged one is an empty list. Dropping the list waits
/// until the file is written.
#[derive(Debug)]
pub(super) struct RecentClips {
    list: Arc<List>,
    /// `None` without a folder. Its changes are the list's unwritten names.
    writer: Option<StateWriter<()>>,
}

/// The list that the window sees.
#[derive(Debug)]
struct List {
    names: Mutex<Names>,
    /// Whether it has changed since [`RecentClips::take_changed`].
    is_changed: AtomicBool,
}

/// Absolute paths and URLs.
#[derive(Debug)]
struct Names {
    /// The last one first.
    all: Vec<String>,
    /// Those that are not in the file yet, the last one last.
    unwritten: Vec<String>,
}

#[derive(Serialize, Deserialize)]
struct Contents {
    clips: Vec<String>,
}

impl RecentClips {
    /// Reads the file in `folder`; without one, nothing outlives the window.
    pub(super) fn open(folder: Option<PathBuf>) -> RecentClips {
        let all = folder.as_deref().and_then(read).unwrap_or_default();
        let names = Names { all, unwritten: Vec::new() };
        let list = Arc::new(List { names: Mutex::new(names), is_changed: AtomicBool::new(false) });
        let ours = list.clone();
        let writer =
            folder.map(|folder| StateWriter::start(FILE, folder, move |folder, _| ours.write(folder)));
        RecentClips { list, writer }
    }

    /// Their names, the last one first.
    pub(super) fn names(&self) -> Vec<String> {
        self.list.lock().all.clone()
    }

    /// Whether the list has changed since the last call.
    pub(super) fn take_changed(&self) -> bool {
        self.list.is_changed.swap(false, Ordering::AcqRel)
    }

    /// Remembers that a path or a URL was opened, in the background also in the file. A URL with a password or a key in
    /// it is not remembered.
    pub(super) fn add(&mut self, name: &str) {
        let name = absolute_name(name);
        if name.len() > NAME_BYTES || is_url(&name) && redacted(&name) != name {
            return;
        }
        let mut names = self.list.lock();
        add(&mut names.all, name.clone());
        self.list.is_changed.store(true, Ordering::Release);
        if let Some(writer) = &self.writer {
            names.unwritten.push(name);
            writer.write(());
        }
    }
}

impl List {
    fn lock(&self) -> MutexGuard<'_, Names> {
        self.names.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds the unwritten names to the file in `folder`. The list gets what other windows have written.
    fn write(&self, folder: &Path) -> io::Result<()> {
        let written = std::mem::take(&mut self.lock().unwritten);
        let result = exclusively(folder, || {
            let mut clips = read(folder).unwrap_or_else(|| self.lock().all.clone());
            written.iter().for_each(|name| add(&mut clips, name.clone()));
            let contents = Contents { clips };
            FILE.write(folder, &FILE.encode(&contents)).map(|()| contents.clips)
        });
        let mut names = self.lock();
        let mut all = match result {
            Ok(clips) => clips,
            Err(error) => {
                let excess = written.len().saturating_sub(NAMES);
                names.unwritten.splice(0..0, written.into_iter().skip(excess));
                return Err(error);
            }
        };
        // Opened while the disk was busy: they are in the list already.
        names.unwritten.iter().for_each(|name| add(&mut all, name.clone()));
        if names.all != all {
            names.all = all;
            self.is_changed.store(true, Ordering::Release);
        }
        Ok(())
    }
}

/// Puts a name in front of the others.
fn add(names: &mut Vec<String>, name: String) {
    names.retain(|known| *known != name);
    names.insert(0, name);
    names.truncate(NAMES);
}

/// A path as it is from any working directory, or a URL.
fn absolute_name(name: &str) -> String {
    let path = if is_url(name) { None } else { absolute(name).ok() };
    path.and_then(|path| path.to_str().map(String::from)).unwrap_or_else(|| name.into())
}

/// The names in the file, if it is there and whole.
fn read(folder: &Path) -> Option<Vec<String>> {
    let fault = |error: &io::Error| {
        if error.kind() != io::ErrorKind::NotFound {
            let path = FILE.path(folder);
            log::warn!("{}: {error}: the list of clips opened last starts anew", path.display());
        }
    };
    let Contents { clips: mut names } = FILE.read(folder).inspect_err(fault).ok()?;
    names.retain(|name| name.len() <= NAME_BYTES);
    names.truncate(NAMES);
    Some(names)
}

#[cfg(test)]
mod tests {
    use std::time::{Duration, Instant};

    use super::*;

    const PATIENCE: Duration = Duration::from_secs(60);

    impl RecentClips {
        /// Waits until the list is this one.
        fn becomes(&self, expected: &[&str]) -> bool {
            let start = Instant::now();
            while self.names() != expected && start.elapsed() < PATIENCE {
                std::thread::sleep(Duration::from_millis(1));
            }
            self.names() == expected
        }
    }

    /// Opens the list in a folder, adds names, and closes it.
    fn add_all(folder: &Path, names: &[&str]) {
        let mut recent = RecentClips::open(Some(folder.into()));
        names.iter().for_each(|name| recent.add(name));
    }

    #[test]
    fn what_was_opened_last_comes_first_in_all_windows() {
        let folder = tempfile::tempdir().unwrap();
        let inner = folder.path().join("new");
        let open = || RecentClips::open(Some(inner.clone()));
        let mut one = open();
        one.add("/clips/a.aarc");
        assert_eq!(one.names(), ["/clips/a.aarc"], "the list does not wait for the file");
        assert!(one.take_changed());
        drop(one);
        let mut one = open();
        add_all(&inner, &["https://host/b.aarc"]);
        one.add("/clips/c.aarc");
        assert!(one.becomes(&["/clips/c.aarc", "https://host/b.aarc", "/clips/a.aarc"]), "{:?}", one.names());
        one.add("/clips/a.aarc");
        assert_eq!(one.names(), ["/clips/a.aarc", "/clips/c.aarc", "https://host/b.aarc"]);
        one.add("d.aarc");
        assert!(Path::new(&one.names()[0]).is_absolute(), "{:?}", one.names());
        (0..2 * NAMES).for_each(|i| one.add(&format!("/clips/{i}.aarc")));
        let names = one.names();
        drop(one);
        assert_eq!((names.len(), open().names()), (NAMES, names), "everything is written at the end");
        assert_eq!(inner.read_dir().unwrap().count(), 1, "nothing but the file is left");
    }

    /// A folder that another player has locked keeps its readers waiting, as a busy disk does.
    #[cfg(unix)]
    #[test]
    fn a_busy_disk_blocks_no_frame_and_loses_nothing() {
        use std::fs::File;
        use std::sync::mpsc::channel;

        let folder = tempfile::tempdir().unwrap();
        let mut recent = RecentClips::open(Some(folder.path().into()));
        let other = File::open(folder.path()).unwrap();
        other.lock().unwrap();
        std::fs::write(FILE.path(folder.path()), r#"{"version": 1, "clips": ["/other.aarc"]}"#).unwrap();
        let (done, is_done) = channel();
        std::thread::spawn(move || {
            recent.add("/a.aarc");
            // By now the thread waits for the folder.
            std::thread::sleep(Duration::from_millis(50));
            recent.add("/b.aarc");
            let _ = done.send(recent);
        });
        let recent = is_done.recv_timeout(PATIENCE).expect("a frame waits for the disk");
        assert_eq!(recent.names(), ["/b.aarc", "/a.aarc"]);
        drop(other);
        drop(recent);
        let names = RecentClips::open(Some(folder.path().into())).names();
        assert_eq!(names, ["/b.aarc", "/a.aarc", "/other.aarc"]);
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
        drop(recent);
        assert!(!FILE.path(folder.path()).exists());
    }

    #[test]
    fn a_file_that_makes_no_sense_is_an_empty_list() {
        let folder = tempfile::tempdir().unwrap();
        let open = || RecentClips::open(Some(folder.path().into()));
        let long = format!(r#"{{"version": 1, "clips": ["{}"]}}"#, "x".repeat(FILE.max_bytes as usize));
        for text in
            ["", "{", "null", r#"{"version": 2, "clips": ["a"]}"#, r#"{"version": 1, "clips": 7}"#, &long]
        {
            std::fs::write(FILE.path(folder.path()), text).unwrap();
            assert!(open().names().is_empty(), "{text:.40}");
        }
        add_all(folder.path(), &["/a.aarc"]);
        assert_eq!(open().names(), ["/a.aarc"]);
        for nowhere in [None, Some("/proc/nowhere".into())] {
            let mut recent = RecentClips::open(nowhere);
            recent.add("/a.aarc");
            recent.add("/b.aarc");
            assert_eq!(recent.names(), ["/b.aarc", "/a.aarc"]);
        }
    }

    #[test]
    fn what_could_not_be_written_is_written_with_the_next_clip() {
        let folder = tempfile::tempdir().unwrap();
        let blocked = folder.path().join("file");
        std::fs::write(&blocked, "").unwrap();
        let mut recent = RecentClips::open(Some(blocked.clone()));
        recent.add("/a.aarc");
        // The thread fails within microseconds.
        std::thread::sleep(Duration::from_millis(500));
        std::fs::remove_file(&blocked).unwrap();
        add_all(&blocked, &["/other.aarc"]);
        recent.add("/b.aarc");
        drop(recent);
        let mut names = RecentClips::open(Some(blocked)).names();
        names.sort();
        assert_eq!(names, ["/a.aarc", "/b.aarc", "/other.aarc"]);
    }
}
