//! [`PlacementStore`]: the last placement of each clip, in a small file.
//!
//! The file is a convenience: if it is missing or damaged, clips start in front of the viewer, and one line in
//! the log says why. A thread writes every change soon after it is made, so that no frame waits for the disk and a
//! player that is killed loses a quarter of a second at most. It adds the change to the file as it then is: another
//! player may have written, too.

use std::io;
use std::path::{Path, PathBuf};

use glam::DVec3;
use log::warn;
use serde::{Deserialize, Serialize};

use super::hands::Pose;
use super::placement::Placement;
use crate::state_file::{StateFile, StateWriter, exclusively};

/// The file. [`CLIPS`] of the longest names fit.
const FILE: StateFile = StateFile { name: "placements.json", version: 1, max_bytes: 1 << 20 };

/// Number of remembered clips: the clips placed last.
const CLIPS: usize = 64;

/// Longest name of a clip, in bytes.
const KEY_BYTES: usize = 1 << 10;

/// Faults of a file that does not hold placements. Others may pass, and what the file holds stays.
const FRESH_START: [io::ErrorKind; 4] =
    [io::ErrorKind::NotFound, io::ErrorKind::InvalidData, io::ErrorKind::UnexpectedEof, io::ErrorKind::Other];

/// Placements by the names of clips. Dropping the store waits until the file is written.
#[derive(Debug)]
pub struct PlacementStore {
    folder: PathBuf,
    entries: Entries,
    /// From the first change on.
    writer: Option<StateWriter<Entry>>,
}

#[derive(Serialize, Deserialize)]
struct Contents<E> {
    placements: E,
}

/// The clips placed last, in the order of placing.
#[derive(Debug, Default)]
struct Entries(Vec<Entry>);

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Entry {
    clip: String,
    scale: f64,
    yaw_rad: f64,
    position_m: [f64; 3],
}

impl Entry {
    fn new(clip: &str, placement: &Placement) -> Entry {
        Entry {
            clip: clip.into(),
            scale: placement.scale(),
            yaw_rad: placement.yaw(),
            position_m: placement.position().into(),
        }
    }

    fn placement(&self) -> Placement {
        Placement::new(self.scale, self.yaw_rad, DVec3::from(self.position_m))
    }
}

impl Entries {
    /// Reads the file in `folder`.
    ///
    /// # Errors
    /// If it is missing, damaged, or cannot be read.
    fn read(folder: &Path) -> io::Result<Entries> {
        let Contents { placements: mut entries } = FILE.read::<Contents<Vec<Entry>>>(folder)?;
        entries.retain(|entry| entry.clip.len() <= KEY_BYTES);
        entries.drain(..entries.len().saturating_sub(CLIPS));
        Ok(Entries(entries))
    }

    /// Adds a clip, or places it again, as the last one.
    fn put(&mut self, entry: Entry) {
        self.0.retain(|other| other.clip != entry.clip);
        self.0.push(entry);
        self.0.drain(..self.0.len().saturating_sub(CLIPS));
    }
}

impl PlacementStore {
    /// Reads the file in `folder`. A missing file is an empty store, and so is, with a warning, a damaged
    /// one.
    pub fn open(folder: &Path) -> PlacementStore {
        let path = FILE.path(folder);
        let entries = Entries::read(folder).unwrap_or_else(|error| {
            match error.kind() {
                io::ErrorKind::NotFound => {
                    log::info!("{}: not there yet: clips start in front of the viewer", path.display());
                }
                _ => warn!("{}: {error}: clips start in front of the viewer", path.display()),
            }
            Entries::default()
        });
        PlacementStore { folder: folder.into(), entries, writer: None }
    }

    /// Last placement of the clip `key`.
    pub fn get(&self, key: &str) -> Option<Placement> {
        self.entries.0.iter().rev().find(|entry| entry.clip == key).map(Entry::placement)
    }

    /// Remembers the placement of the clip `key`, and writes it in the background. The store holds 64 clips and forgets
    /// the clip placed longest ago. Names longer than a kilobyte are ignored. Failures of the disk go to the log; a
    /// change that could not be written is written with the next one, or when the store is dropped.
    pub fn set(&mut self, key: &str, placement: &Placement) {
        if key.len() > KEY_BYTES || self.get(key).as_ref() == Some(placement) {
            return;
        }
        self.put(Entry::new(key, placement));
    }

    /// Carries all placements over to another stage, whose origin the stage before sees at `old_from_new`.
    pub fn carry_over(&mut self, old_from_new: &Pose) {
        for entry in self.entries.0.clone() {
            self.put(Entry::new(&entry.clip, &entry.placement().seen_from(old_from_new)));
        }
    }

    fn put(&mut self, entry: Entry) {
        self.entries.put(entry.clone());
        let folder = &self.folder;
        let writer = self.writer.get_or_insert_with(|| StateWriter::start(FILE, folder.clone(), add));
        writer.write(entry);
    }
}

/// Adds `changes` to the file in `folder`, whole or not at all.
///
/// # Errors
/// If it cannot be written.
fn add(folder: &Path, changes: &[Entry]) -> io::Result<()> {
    exclusively(folder, || {
        let mut entries = match Entries::read(folder) {
            Ok(entries) => entries,
            // Missing, damaged, or of another version.
            Err(error) if FRESH_START.contains(&error.kind()) => Entries::default(),
            Err(error) => return Err(error),
        };
        changes.iter().for_each(|entry| entries.put(entry.clone()));
        FILE.write(folder, &FILE.encode(&Contents { placements: &entries.0 }))
    })
}

#[cfg(test)]
mod tests {
    use std::fs::{self, File};

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
        drop(store);
        let store = PlacementStore::open(folder.path());
        assert_eq!(store.get("0"), Some(placement(-1.0)), "it was placed again");
        assert!(store.get("1").is_none() && store.get("2").is_some() && store.get("new").is_some());
        assert_eq!(store.entries.0.len(), CLIPS);
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
    fn two_players_keep_the_changes_of_both() {
        let folder = tempfile::tempdir().unwrap();
        let mut stores = [0, 1].map(|_| PlacementStore::open(folder.path()));
        for number in 0..CLIPS / 2 {
            for (player, store) in stores.iter_mut().enumerate() {
                store.set(&format!("{player} {number}"), &placement(number as f64));
            }
        }
        drop(stores);
        let store = PlacementStore::open(folder.path());
        for (player, number) in [0, 1].into_iter().flat_map(|player| (0..CLIPS / 2).map(move |n| (player, n)))
        {
            assert_eq!(store.get(&format!("{player} {number}")), Some(placement(number as f64)), "{player}");
        }
    }

    #[test]
    fn a_player_that_holds_the_folder_for_ever_is_not_waited_for() {
        let folder = tempfile::tempdir().unwrap();
        let held = File::open(folder.path()).unwrap();
        held.lock().unwrap();
        let mut store = PlacementStore::open(folder.path());
        store.set("a", &placement(1.0));
        drop(store);
        assert_eq!(PlacementStore::open(folder.path()).get("a"), Some(placement(1.0)));
    }

    #[test]
    fn a_change_is_written_while_the_store_is_open() {
        let folder = tempfile::tempdir().unwrap();
        let mut store = PlacementStore::open(folder.path());
        store.set("a", &placement(1.0));
        let start = std::time::Instant::now();
        while !FILE.path(folder.path()).exists() {
            assert!(start.elapsed().as_secs() < 60, "a player that is killed would lose it");
            std::thread::yield_now();
        }
        assert_eq!(PlacementStore::open(folder.path()).get("a"), Some(placement(1.0)));
    }

    #[test]
    fn a_change_that_cannot_be_written_is_tried_again() {
        let folder = tempfile::tempdir().unwrap();
        let blocked = folder.path().join("file");
        fs::write(&blocked, "").unwrap();
        let changes = [Entry::new("a", &placement(1.0))];
        assert!(add(&blocked, &changes).is_err(), "the writer keeps it");
        fs::remove_file(&blocked).unwrap();
        add(&blocked, &changes).unwrap();
        assert!(PlacementStore::open(&blocked).get("a").is_some());
    }
}
