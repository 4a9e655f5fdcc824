//! [`StateFile`]: a small JSON file of what the player remembers from run to run, `{"version": 1, ...}`.
//!
//! Each is a convenience: a missing or damaged one, or one of another version, is a fresh start. A [`StateWriter`]
//! writes one while the player runs.

use std::fs::File;
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use tempfile::NamedTempFile;

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
    /// If it is missing, too large, of another version, or does not hold a `T`.
    pub(crate) fn read<T: DeserializeOwned>(&self, folder: &Path) -> io::Result<T> {
        let mut text = String::new();
        File::open(self.path(folder))?.take(self.max_bytes + 1).read_to_string(&mut text)?;
        if text.len() as u64 > self.max_bytes {
            return Err(io::Error::other(format!("larger than {} bytes", self.max_bytes)));
        }
        // First the version: another one may hold something else.
        let Version { version } = serde_json::from_str(&text)?;
        if version != self.version {
            return Err(io::Error::other(format!("version {version} instead of {}", self.version)));
        }
        Ok(serde_json::from_str(&text)?)
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

/// Wait from a change to its writing, in which further changes arrive: a slider that is dragged has 60 a second.
const SETTLES: Duration = Duration::from_millis(300);

/// A thread that writes a file soon after it has changed, so that no frame waits for the disk, and little is lost if
/// the player is killed. Dropping it waits until the file is written.
#[derive(Debug)]
pub(crate) struct StateWriter {
    /// `None` while it is dropped.
    changes: Option<Sender<Vec<u8>>>,
    /// `None` if the system refused a thread.
    thread: Option<JoinHandle<()>>,
}

impl StateWriter {
    /// Starts the thread, which writes `file` in `folder`. A failure goes to the log.
    pub(crate) fn start(file: StateFile, folder: PathBuf) -> StateWriter {
        let (changes, arriving) = channel::<Vec<u8>>();
        let write_all = move || {
            while let Ok(mut bytes) = arriving.recv() {
                let until = Instant::now() + SETTLES;
                while let Ok(later) = arriving.recv_timeout(until.saturating_duration_since(Instant::now())) {
                    bytes = later;
                }
                if let Err(error) = file.write(&folder, &bytes) {
                    log::warn!("{}: {error}: it is not remembered", file.path(&folder).display());
                }
            }
        };
        let thread = std::thread::Builder::new().name("state".into()).spawn(write_all);
        let thread = thread.inspect_err(|error| log::warn!("{}: {error}: it is not remembered", file.name));
        StateWriter { changes: Some(changes), thread: thread.ok() }
    }

    /// Takes in what the file is to hold, by [`StateFile::encode`].
    pub(crate) fn write(&self, bytes: Vec<u8>) {
        if let Some(changes) = &self.changes {
            // Without a thread, nothing is remembered.
            let _ = changes.send(bytes);
        }
    }
}

impl Drop for StateWriter {
    fn drop(&mut self) {
        self.changes = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
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
}
