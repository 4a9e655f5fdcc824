//! [`Volume`]: how loud sound is, remembered in a small file.
//!
//! The file is a convenience: if it is missing or damaged, sound is as loud as it was recorded.

use std::io;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::state_file::StateFile;

/// The file.
const FILE: StateFile = StateFile { name: "sound.json", version: 1, max_bytes: 4096 };

/// How loud sound is. The part that is remembered is written when it is dropped.
#[derive(Debug)]
pub(crate) struct Volume {
    folder: Option<PathBuf>,
    remembered: Loudness,
    written: Loudness,
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
        Volume { folder, remembered, written: remembered }
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
        }
    }

    pub(crate) fn is_muted(&self) -> bool {
        self.remembered.is_muted
    }

    pub(crate) fn toggle_muted(&mut self) {
        self.remembered.is_muted = !self.remembered.is_muted;
    }

    /// The factor of all samples: the square of the level, which sounds even from 0 to 1.
    #[cfg_attr(not(feature = "audio"), allow(dead_code, reason = "there is nothing to multiply"))]
    pub(crate) fn gain(&self) -> f32 {
        if self.is_muted() { 0.0 } else { self.level() * self.level() }
    }

    /// Writes the file, whole or not at all, if something changed. A failure goes to the log.
    pub(crate) fn save(&mut self) {
        let Some(folder) = self.folder.as_deref().filter(|_| self.remembered != self.written) else { return };
        self.written = self.remembered;
        if let Err(error) = FILE.write(folder, &FILE.encode(&self.remembered)) {
            log::warn!("cannot remember how loud sound is: {}: {error}", FILE.path(folder).display());
        }
    }
}

impl Drop for Volume {
    fn drop(&mut self) {
        self.save();
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
    use super::*;

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
