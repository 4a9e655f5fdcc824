//! [`Volume`]: how loud sound is, remembered in a small file.
//!
//! The file is a convenience: if it is missing or damaged, sound is as loud as it was recorded.

use std::io;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::state_file::{StateFile, StateWriter};

/// The file.
const FILE: StateFile = StateFile { name: "sound.json", version: 1, max_bytes: 4096 };

/// How loud sound is. A change is written as soon as it is made.
#[derive(Debug)]
pub(crate) struct Volume {
    folder: Option<PathBuf>,
    remembered: Loudness,
    /// What was given to the writer last.
    written: Loudness,
    /// From the first change on.
    writer: Option<StateWriter<Loudness>>,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Loudness {
    level: f32,
    is_muted: bool,
}

impl Default for Loudness {
    fn default() -> Loudness {
        Loudness { level: 1.0, is_muted: false }
    }
}

impl Volume {
    /// Reads the file in `folder`; without one, nothing is remembered.
    pub(crate) fn open(folder: Option<PathBuf>) -> Volume {
        let remembered = folder.as_deref().and_then(|folder| match read(folder) {
            Ok(loudness) => Some(loudness),
            Err(error) => {
                if error.kind() != io::ErrorKind::NotFound {
                    log::warn!("{}: {error}: sound is as loud as recorded", FILE.path(folder).display());
                }
                None
            }
        });
        let remembered = remembered.unwrap_or_default();
        Volume { folder, remembered, written: remembered, writer: None }
    }

    /// From 0 to 1; 1 is as loud as recorded.
    pub(crate) fn level(&self) -> f32 {
        self.remembered.level
    }

    /// Sets the level, cut to 0 to 1. Sound is then heard.
    #[cfg(any(test, feature = "window"))]
    pub(crate) fn set_level(&mut self, level: f32) {
        if level.is_finite() {
            self.remembered = Loudness { level: level.clamp(0.0, 1.0), is_muted: false };
            self.save();
        }
    }

    pub(crate) fn is_muted(&self) -> bool {
        self.remembered.is_muted
    }

    pub(crate) fn toggle_muted(&mut self) {
        self.remembered.is_muted = !self.remembered.is_muted;
        self.save();
    }

    /// The factor of all samples: the square of the level, which sounds even from 0 to 1.
    #[cfg_attr(not(feature = "audio"), allow(dead_code, reason = "there is nothing to multiply"))]
    pub(crate) fn gain(&self) -> f32 {
        if self.is_muted() { 0.0 } else { self.level() * self.level() }
    }

    /// Writes the file in the background, if something changed.
    fn save(&mut self) {
        let Some(folder) = self.folder.as_ref().filter(|_| self.remembered != self.written) else { return };
        self.written = self.remembered;
        let writer = self.writer.get_or_insert_with(|| {
            StateWriter::start(FILE, folder.clone(), |folder, changes: &[Loudness]| {
                changes.last().map_or(Ok(()), |latest| FILE.write(folder, &FILE.encode(latest)))
            })
        });
        writer.write(self.remembered);
    }
}

fn read(folder: &Path) -> io::Result<Loudness> {
    let loudness: Loudness = FILE.read(folder)?;
    if !(0.0..=1.0).contains(&loudness.level) {
        return Err(io::Error::other(format!("level {}", loudness.level)));
    }
    Ok(loudness)
}

#[cfg(test)]
mod volume_tests {
    use std::time::{Duration, Instant};

    use super::*;

    #[test]
    fn a_change_is_remembered_although_the_player_is_killed() {
        let folder = tempfile::tempdir().unwrap();
        let mut volume = Volume::open(Some(folder.path().into()));
        volume.set_level(0.9);
        // Seconds until a change is in the file, while the volume lives.
        let mut wait_s = || {
            volume.toggle_muted();
            let (start, expected) = (Instant::now(), volume.remembered);
            while read(folder.path()).ok() != Some(expected) {
                assert!(start.elapsed().as_secs() < 60, "{:?}", read(folder.path()));
                std::thread::sleep(Duration::from_millis(1));
            }
            start.elapsed().as_secs_f64()
        };
        // A busy machine may keep some of them waiting.
        assert!((0..20).any(|_| wait_s() < 0.1), "nobody waits so long before the player is killed");
    }

    #[test]
    fn the_volume_is_remembered_and_a_damaged_file_is_a_fresh_start() {
        let folder = tempfile::tempdir().unwrap();
        let open = || Volume::open(Some(folder.path().join("new")));
        let mut volume = open();
        assert_eq!((volume.level(), volume.is_muted(), volume.gain()), (1.0, false, 1.0));
        volume.set_level(0.5);
        volume.set_level(f32::NAN);
        assert_eq!(volume.gain(), 0.25);
        volume.toggle_muted();
        drop(volume);
        let mut volume = open();
        assert_eq!((volume.level(), volume.is_muted(), volume.gain()), (0.5, true, 0.0));
        volume.set_level(7.0);
        assert_eq!((volume.level(), volume.is_muted()), (1.0, false), "turned up, it is heard");
        drop(volume);
        for damaged in [
            "",
            "{",
            "null",
            r#"{"version": 2, "level": 1, "is_muted": false}"#,
            r#"{"version": 1, "level": 1e9, "is_muted": false}"#,
        ] {
            std::fs::write(FILE.path(&folder.path().join("new")), damaged).unwrap();
            assert_eq!(open().level(), 1.0, "{damaged}");
        }
        assert_eq!(Volume::open(None).level(), 1.0);
    }
}
