//! [`StateFile`]: a small JSON file of what the player remembers from run to run, `{"version": 1, ...}`.
//!
//! Each is a convenience: a missing or damaged one, or one of another version, is a fresh start. A [`StateWriter`]
//! writes one while the player runs.

use std::fs::{File, TryLockError};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Sender, channel};
use std::thread::{JoinHandle, sleep};
use std::time::{Duration, Instant};

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use tempfile::NamedTempFile;

use crate::regular_file::read_regular;
use crate::worker::join_in_time;

/// A file, by its name in the folder of the player's state.
#[derive(Clone, Copy, Debug)]
pub(crate) struct StateFile {
    pub(crate) name: &'static str,
    /// Version of its format. A file of another version is not read.
    pub(crate) version: u32,
    /// Most bytes that are read.
    pub(crate) max_bytes: u64,
}

/// The written form of `contents`.
#[derive(Serialize)]
struct Versioned<'a, T> {
    version: u32,
    #[serde(flatten)]
    contents: &'a T,
}

/// The part that is the same in every version.
#[derive(Deserialize)]
struct Version {
    version: u32,
}

impl StateFile {
    /// Its path.
    pub(crate) fn path(&self, folder: &Path) -> PathBuf {
        folder.join(self.name)
    }

    /// Reads the file in `folder`.
    ///
    /// # Errors
    /// If it is missing, no regular file, too large, of another version, or does not hold a `T`.
    pub(crate) fn read<T: DeserializeOwned>(&self, folder: &Path) -> io::Result<T> {
        let text = read_regular(&self.path(folder), self.max_bytes)?;
        // First the version: another one may hold something else.
        let Version { version } = serde_json::from_slice(&text)?;
        if version != self.version {
            return Err(io::Error::other(format!("version {version} instead of {}", self.version)));
        }
        Ok(serde_json::from_slice(&text)?)
    }

    /// The bytes of the file with these contents, a structure with named fields.
    pub(crate) fn encode(&self, contents: &impl Serialize) -> Vec<u8> {
        let versioned = Versioned { version: self.version, contents };
        let mut bytes = serde_json::to_vec_pretty(&versioned).expect("numbers and strings serialise");
        bytes.push(b'\n');
        bytes
    }

    /// Writes the file in `folder`, which is made if it is missing, whole or not at all. Waits for the disk.
    ///
    /// # Errors
    /// If it cannot be written.
    pub(crate) fn write(&self, folder: &Path, bytes: &[u8]) -> io::Result<()> {
        std::fs::create_dir_all(folder)?;
        let mut file = NamedTempFile::new_in(folder)?;
        file.write_all(bytes)?;
        // A headset may lose power at any time: first the bytes, then the name.
        file.as_file().sync_all()?;
        file.persist(self.path(folder))?;
        Ok(())
    }
}

/// Longest wait for another player that changes a file, and the time between two looks.
const LOCK_TIMEOUT: Duration = Duration::from_secs(1);
const LOCK_RETRY: Duration = Duration::from_millis(10);

/// Runs `work`, which reads and writes a file in `folder`, while no other player does. The folder is made if it is missing.
/// Where it cannot be locked in time, the later one of two players wins.
///
/// # Errors
/// If the folder cannot be made; the errors of `work`.
pub(crate) fn exclusively<R>(folder: &Path, work: impl FnOnce() -> io::Result<R>) -> io::Result<R> {
    std::fs::create_dir_all(folder)?;
    let lock = File::open(folder).ok().filter(is_locked);
    let result = work();
    drop(lock);
    result
}

/// Locks a folder, unless another player holds it for long: one that is stopped may hold it for ever.
fn is_locked(folder: &File) -> bool {
    let until = Instant::now() + LOCK_TIMEOUT;
    loop {
        match folder.try_lock() {
            Ok(()) => return true,
            Err(TryLockError::WouldBlock) if Instant::now() < until => sleep(LOCK_RETRY),
            Err(_) => return false,
        }
    }
}

/// Most changes that wait for a disk that cannot be written.
const CHANGES_MAX: usize = 1024;

/// Time between two writes: a slider that is dragged changes with every frame, and flash memory wears out.
const WRITE_INTERVAL: Duration = Duration::from_millis(250);

/// A thread that adds changes to a file soon after they are made, so that no frame waits for the disk, and what the viewer
/// has set is there if the player is killed. Dropping it waits until the file is written, as [`join_in_time`] does.
#[derive(Debug)]
pub(crate) struct StateWriter<C> {
    /// `None` while it is dropped.
    changes: Option<Sender<C>>,
    /// `None` if the system refused a thread.
    thread: Option<JoinHandle<()>>,
}

impl<C: Send + 'static> StateWriter<C> {
    /// Starts the thread. `add` adds changes to `file` in `folder`, in their order, and all that came within
    /// [`WRITE_INTERVAL`] of a write at once. Failures go to the log; `add` gets the changes again with the next one, and
    /// once more at the end.
    pub(crate) fn start(
        file: StateFile,
        folder: PathBuf,
        mut add: impl FnMut(&Path, &[C]) -> io::Result<()> + Send + 'static,
    ) -> StateWriter<C> {
        let (changes, arriving) = channel();
        let mut flush = move |unwritten: &mut Vec<C>| match add(&folder, unwritten) {
            Ok(()) => unwritten.clear(),
            Err(error) => {
                log::warn!("{}: {error}: it is not remembered", file.path(&folder).display());
                unwritten.drain(..unwritten.len().saturating_sub(CHANGES_MAX));
            }
        };
        let write_all = move || {
            let (mut unwritten, mut next_write) = (Vec::new(), Instant::now());
            while let Ok(change) = arriving.recv() {
                unwritten.push(change);
                let wait = || next_write.saturating_duration_since(Instant::now());
                unwritten.extend(std::iter::from_fn(|| arriving.recv_timeout(wait()).ok()));
                flush(&mut unwritten);
                next_write = Instant::now() + WRITE_INTERVAL;
            }
            if !unwritten.is_empty() {
                flush(&mut unwritten);
            }
        };
        let thread = std::thread::Builder::new().name("state".into()).spawn(write_all);
        let thread = thread.inspect_err(|error| log::warn!("{}: {error}: it is not remembered", file.name));
        StateWriter { changes: Some(changes), thread: thread.ok() }
    }

    /// Takes in a change.
    pub(crate) fn write(&self, change: C) {
        if let Some(changes) = &self.changes {
            // Without a thread, nothing is remembered.
            let _ = changes.send(change);
        }
    }
}

impl<C> Drop for StateWriter<C> {
    fn drop(&mut self) {
        self.changes = None;
        if let Some(thread) = self.thread.take() {
            join_in_time(thread);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, PartialEq, Serialize, Deserialize)]
    struct Contents {
        level: f32,
    }

    const FILE: StateFile = StateFile { name: "test.json", version: 3, max_bytes: 100 };

    #[test]
    fn a_file_comes_back_unless_it_is_large_or_of_another_version() {
        let folder = tempfile::tempdir().unwrap();
        let inner = folder.path().join("new");
        FILE.write(&inner, &FILE.encode(&Contents { level: 0.1 })).unwrap();
        assert_eq!(
            std::fs::read_to_string(FILE.path(&inner)).unwrap(),
            "{\n  \"version\": 3,\n  \"level\": 0.1\n}\n"
        );
        assert_eq!(FILE.read::<Contents>(&inner).unwrap(), Contents { level: 0.1 });
        assert_eq!(inner.read_dir().unwrap().count(), 1, "nothing but the file is left");
        let long = format!(r#"{{"version": 3, "level": 1, "more": "{}"}}"#, "x".repeat(100));
        for (text, expected) in [
            (r#"{"version": 2, "other": 7}"#, "version 2 instead of 3"),
            (r#"{"level": 1}"#, "missing field `version`"),
            (r#"{"version": 3}"#, "missing field `level`"),
            ("", "EOF"),
            (&long, "larger than 100 bytes"),
        ] {
            std::fs::write(FILE.path(&inner), text).unwrap();
            let error = FILE.read::<Contents>(&inner).unwrap_err().to_string();
            assert!(error.contains(expected), "{text}: {error}");
        }
    }

    #[test]
    #[cfg(unix)]
    fn a_pipe_is_no_state_and_is_not_waited_for() {
        let folder = tempfile::tempdir().unwrap();
        let pipe = FILE.path(folder.path());
        assert!(std::process::Command::new("mkfifo").arg(pipe).status().unwrap().success());
        let (send, sent) = channel();
        std::thread::spawn(move || send.send(FILE.read::<Contents>(folder.path()).is_err()));
        assert_eq!(sent.recv_timeout(Duration::from_secs(60)), Ok(true));
    }

    #[test]
    fn changes_that_cannot_be_written_come_again() {
        let (calls, called) = channel();
        let mut fails = true;
        let add = move |_: &Path, changes: &[u32]| {
            calls.send(changes.to_vec()).unwrap();
            if std::mem::take(&mut fails) { Err(io::Error::other("no disk")) } else { Ok(()) }
        };
        let writer = StateWriter::start(FILE, "folder".into(), add);
        writer.write(1);
        assert_eq!(called.recv(), Ok(vec![1]));
        drop(writer);
        assert_eq!(called.iter().collect::<Vec<_>>(), [[1]], "at the end");
    }

    #[test]
    fn changes_in_quick_succession_are_one_write() {
        let (calls, called) = channel();
        let add = move |_: &Path, changes: &[u32]| calls.send(changes.to_vec()).map_err(io::Error::other);
        let writer = StateWriter::start(FILE, "folder".into(), add);
        writer.write(0);
        assert_eq!(called.recv(), Ok(vec![0]), "the first one at once");
        (1..100).for_each(|change| writer.write(change));
        drop(writer);
        assert_eq!(called.iter().collect::<Vec<_>>(), [(1..100).collect::<Vec<_>>()]);
    }
}
