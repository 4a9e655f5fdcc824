//! [`PlacementStore`]: the last placement of each clip, in a small file.
//!
//! The file is a convenience: if it is missing or damaged, clips start in front of the viewer, and one line in
//! the log says why. A thread writes it, so that no frame waits for the disk.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Sender, channel};
use std::thread::JoinHandle;

use glam::DVec3;
use log::warn;
use serde::{Deserialize, Serialize};

use super::placement::Placement;
use crate::state_file::StateFile;

/// The file. [`CLIPS`] of the longest names fit.
const FILE: StateFile = StateFile { name: "placements.json", version: 1, max_bytes: 1 << 20 };

/// Number of remembered clips: the clips placed last.
const CLIPS: usize = 64;

/// Longest name of a clip, in bytes.
const KEY_BYTES: usize = 1 << 10;

/// Placements by the names of clips. Dropping the store waits until the file is written.
#[derive(Debug)]
pub struct PlacementStore {
    folder: PathBuf,
    /// In the order of placing.
    entries: Vec<Entry>,
    /// Whether the file is out of date.
    changed: bool,
    /// From the first save on.
    writer: Option<Writer>,
}

#[derive(Serialize, Deserialize)]
struct Contents<E> {
    placements: E,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Entry {
    clip: String,
    scale: f64,
    yaw_rad: f64,
    position_m: [f64; 3],
}

impl Entry {
    fn placement(&self) -> Placement {
        Placement::new(self.scale, self.yaw_rad, DVec3::from(self.position_m))
    }
}

impl PlacementStore {
    /// Reads the file in `folder`. A missing file is an empty store, and so is, with a warning, a damaged
    /// one.
    pub fn open(folder: &Path) -> PlacementStore {
        let path = FILE.path(folder);
        let entries = match read(folder) {
            Ok(entries) => entries,
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                log::info!("{}: not there yet: clips start in front of the viewer", path.display());
                Vec::new()
            }
            Err(error) => {
                warn!("{}: {error}: clips start in front of the viewer", path.display());
                Vec::new()
            }
        };
        PlacementStore { folder: folder.into(), entries, changed: false, writer: None }
    }

    /// Last placement of the clip `key`.
    pub fn get(&self, key: &str) -> Option<Placement> {
        self.entries.iter().rev().find(|entry| entry.clip == key).map(Entry::placement)
    }

    /// Remembers the placement of the clip `key`, without writing it yet. The store holds 64 clips and forgets the clip
    /// placed longest ago. Names longer than a kilobyte are ignored.
    pub fn set(&mut self, key: &str, placement: &Placement) {
        if key.len() > KEY_BYTES || self.get(key).as_ref() == Some(placement) {
            return;
        }
        self.entries.retain(|entry| entry.clip != key);
        self.entries.push(Entry {
            clip: key.into(),
            scale: placement.scale(),
            yaw_rad: placement.yaw(),
            position_m: placement.position().into(),
        });
        self.entries.drain(..self.entries.len().saturating_sub(CLIPS));
        self.changed = true;
    }

    /// Writes the file in the background, whole or not at all, if something changed or the last attempt
    /// failed. Failures go to the log.
    pub fn save(&mut self) {
        let failed = self.writer.as_ref().is_some_and(|writer| writer.failed.swap(false, Ordering::AcqRel));
        if !std::mem::take(&mut self.changed) && !failed {
            return;
        }
        let bytes = FILE.encode(&Contents { placements: &self.entries });
        let folder = &self.folder;
        // The thread ends only with the store.
        let _ = self.writer.get_or_insert_with(|| Writer::start(folder.clone())).files.send(bytes);
    }
}

impl Drop for PlacementStore {
    fn drop(&mut self) {
        let Some(Writer { files, thread, .. }) = self.writer.take() else { return };
        drop(files);
        if let Some(thread) = thread {
            let _ = thread.join();
        }
    }
}

/// The thread that writes the file.
#[derive(Debug)]
struct Writer {
    files: Sender<Vec<u8>>,
    /// Whether the last write failed.
    failed: Arc<AtomicBool>,
    /// `None` if the system refused a thread.
    thread: Option<JoinHandle<()>>,
}

impl Writer {
    fn start(folder: PathBuf) -> Writer {
        let (files, arriving) = channel::<Vec<u8>>();
        let failed = Arc::new(AtomicBool::new(false));
        let has_failed = failed.clone();
        let write_all = move || {
            for bytes in arriving {
                if let Err(error) = FILE.write(&folder, &bytes) {
                    warn!("cannot remember where clips stand: {}: {error}", FILE.path(&folder).display());
                    has_failed.store(true, Ordering::Release);
                }
            }
        };
        let thread = std::thread::Builder::new().name("placements".into()).spawn(write_all);
        let thread = thread.inspect_err(|error| warn!("cannot remember where clips stand: {error}")).ok();
        Writer { files, failed, thread }
    }
}

fn read(folder: &Path) -> io::Result<Vec<Entry>> {
    let Contents { placements: mut entries } = FILE.read::<Contents<Vec<Entry>>>(folder)?;
    entries.retain(|entry| entry.clip.len() <= KEY_BYTES);
    entries.drain(..entries.len().saturating_sub(CLIPS));
    Ok(entries)
}

#[cfg(test)]
mod tests {
    use std::fs;

    use glam::dvec3;

    use super::super::random::Random;
    use super::*;

    fn placement(x: f64) -> Placement {
        Placement::new(0.5, 1.0, dvec3(x, 0.0, -2.0))
    }

    /// Whether two placements are equal up to the rounding of their decimal form.
    fn same(a: &Placement, b: &Placement) -> bool {
        let close = |a: f64, b: f64| (a - b).abs() <= 1e-12 * b.abs().max(1.0);
        close(a.scale(), b.scale())
            && close(a.yaw(), b.yaw())
            && a.position().abs_diff_eq(b.position(), 1e-12)
    }

    #[test]
    fn placements_come_back() {
        let folder = tempfile::tempdir().unwrap();
        let inner = folder.path().join("new");
        let mut random = Random::new(30);
        let placements: Vec<Placement> = (0..20).map(|_| random.placement()).collect();
        let mut store = PlacementStore::open(&inner);
        for (number, placement) in placements.iter().enumerate() {
            store.set(&format!("clip \"{number}\"\n\u{e9}"), placement);
        }
        store.save();
        drop(store);
        let store = PlacementStore::open(&inner);
        for (number, placement) in placements.iter().enumerate() {
            let back = store.get(&format!("clip \"{number}\"\n\u{e9}")).unwrap();
            assert!(same(&back, placement), "{back:?} {placement:?}");
        }
        assert_eq!(store.get("another"), None);
        assert_eq!(fs::read_dir(&inner).unwrap().count(), 1, "nothing but the file is left");
    }

    #[test]
    fn the_clips_placed_longest_ago_are_forgotten() {
        let folder = tempfile::tempdir().unwrap();
        let mut store = PlacementStore::open(folder.path());
        for number in 0..CLIPS {
            store.set(&number.to_string(), &placement(number as f64));
        }
        store.set("0", &placement(-1.0));
        store.set("new", &placement(0.0));
        store.set(&"x".repeat(KEY_BYTES + 1), &placement(0.0));
        store.save();
        drop(store);
        let store = PlacementStore::open(folder.path());
        assert_eq!(store.get("0"), Some(placement(-1.0)), "it was placed again");
        assert!(store.get("1").is_none() && store.get("2").is_some() && store.get("new").is_some());
        assert_eq!(store.entries.len(), CLIPS);
    }

    #[test]
    fn a_file_that_makes_no_sense_is_a_fresh_start() {
        let folder = tempfile::tempdir().unwrap();
        let path = FILE.path(folder.path());
        let long = format!("[{}]", "1,".repeat(FILE.max_bytes as usize));
        for bytes in [
            &b""[..],
            b"{",
            b"null",
            b"\xff\xfe",
            br#"{"version": 2, "placements": []}"#,
            br#"{"version": 1, "placements": [{"clip": "a", "scale": "large"}]}"#,
            long.as_bytes(),
        ] {
            fs::write(&path, bytes).unwrap();
            let mut store = PlacementStore::open(folder.path());
            assert_eq!(store.get("a"), None);
            store.set("a", &placement(1.0));
            store.save();
            drop(store);
            assert_eq!(PlacementStore::open(folder.path()).get("a"), Some(placement(1.0)));
        }
        let wild = br#"{"version": 1, "placements":
            [{"clip": "a", "scale": 1e300, "yaw_rad": -1e9, "position_m": [1e30, 0, 0]}]}"#;
        fs::write(&path, wild).unwrap();
        let placement = PlacementStore::open(folder.path()).get("a").unwrap();
        assert!(placement.scale() == 20.0 && placement.position().x == 1000.0, "{placement:?}");
    }

    #[test]
    fn a_folder_that_cannot_be_written_is_tried_again() {
        let folder = tempfile::tempdir().unwrap();
        let blocked = folder.path().join("file");
        fs::write(&blocked, "").unwrap();
        let mut store = PlacementStore::open(&blocked);
        store.save();
        assert!(store.writer.is_none(), "there is nothing new");
        store.set("a", &placement(1.0));
        store.save();
        let failed = store.writer.as_ref().unwrap().failed.clone();
        let start = std::time::Instant::now();
        while !failed.load(Ordering::Acquire) && start.elapsed().as_secs() < 60 {
            std::thread::yield_now();
        }
        fs::remove_file(&blocked).unwrap();
        store.save();
        drop(store);
        assert!(PlacementStore::open(&blocked).get("a").is_some());
    }
}
