//! [`Device`]: the player's app on a headset, driven through adb.

use std::fs;
use std::path::Path;
use std::thread::sleep;
use std::time::{Duration, Instant};

use program::Fault;

use super::adb::Adb;
use super::clocks::Clocks;
use super::target::{Played, Run, Target};

const APP: &str = "org.aarc.client";
const ACTIVITY: &str = "org.aarc.client/android.app.NativeActivity";

/// The app's folder, which the system makes when the app first starts.
const FOLDER: &str = "/sdcard/Android/data/org.aarc.client/files";

/// Names of the clip and the statistics in that folder.
const CLIP: &str = "measured.aarc";
const STATS: &str = "measured.json";

/// Longest wait for the app's folder, and beyond the length of a run for its statistics: the clip loads, and the viewer
/// puts the headset on.
const PATIENCE: Duration = Duration::from_secs(60);

/// Delay between two looks.
const POLL: Duration = Duration::from_millis(500);

/// A headset.
pub(super) struct Device {
    adb: Adb,
}

impl Device {
    /// Finds the headset with `adb`.
    ///
    /// # Errors
    /// Those of [`Adb::find`].
    pub(super) fn find() -> Result<Device, Fault> {
        Ok(Device { adb: Adb::find()? })
    }

    /// Installs the app, and starts it once if its folder does not exist.
    ///
    /// # Errors
    /// [`Fault::Device`] if adb refuses, or the app makes no folder.
    pub(super) fn install(&self, apk: &Path) -> Result<(), Fault> {
        self.adb.run(&["install".as_ref(), "-r".as_ref(), apk.as_os_str()])?;
        if self.exists(FOLDER)? {
            return Ok(());
        }
        self.start("")?;
        let start = Instant::now();
        while !self.exists(FOLDER)? {
            if start.elapsed() > PATIENCE {
                return Err(Fault::Device(format!("the app made no folder {FOLDER}: start it by hand once")));
            }
            sleep(POLL);
        }
        self.adb.shell(&format!("am force-stop {APP}")).map(drop)
    }

    /// Ends the app and removes what was measured with, as far as the headset is there.
    pub(super) fn clean(&self) {
        let line = format!("am force-stop {APP}; rm -f {FOLDER}/{CLIP} {FOLDER}/{STATS}");
        let _ = self.adb.shell(&line);
    }

    fn exists(&self, path: &str) -> Result<bool, Fault> {
        Ok(self.adb.shell(&format!("[ -e {path} ] && echo yes || echo no"))?.trim() == "yes")
    }

    /// Starts the app anew with these extras.
    fn start(&self, extras: &str) -> Result<(), Fault> {
        let text = self.adb.shell(&format!("am start -S -n {ACTIVITY}{extras}"))?;
        // `am` succeeds in any case.
        match text.lines().find(|line| line.starts_with("Error")) {
            Some(error) => Err(Fault::Device(format!("the app does not start: {error}: check the APK"))),
            None => Ok(()),
        }
    }

    /// Lines of the log with this tag since `since`, in seconds of the headset's clock.
    fn log(&self, filter: &str, since: &str) -> Result<String, Fault> {
        self.adb.shell(&format!("logcat -d -v raw -T {since} -s {filter}"))
    }
}

impl Target for Device {
    fn play(&self, run: &Run<'_>) -> Result<Played, Fault> {
        let Run { clip, distance, seconds } = run;
        let remote = |name: &str| format!("{FOLDER}/{name}");
        self.adb.shell(&format!("rm -f {}", remote(STATS)))?;
        self.adb.run(&["push".as_ref(), clip.as_os_str(), remote(CLIP).as_ref()])?;
        let since = format!("{}.000", self.adb.shell("date +%s")?.trim());
        let args = format!("--{distance} --seconds {seconds} --stats {STATS}");
        self.start(&format!(" --es clip {CLIP} --es args '{args}'"))?;

        let (start, longest) = (Instant::now(), PATIENCE + Duration::from_secs_f64(*seconds));
        // The player writes the file at the end of the run, completely or not at all.
        while !self.exists(&remote(STATS))? {
            let errors = self.log("aarc:E", &since)?;
            // The log has lines of its own between the messages.
            if let Some(error) =
                errors.lines().find(|line| !line.is_empty() && !line.starts_with("---------"))
            {
                return Err(Fault::Device(format!("the player ended: {error}")));
            }
            if start.elapsed() > longest {
                return Err(Fault::Device(format!(
                    "no statistics after {:.0} s: put the headset on, keep it on, and start over",
                    longest.as_secs_f64()
                )));
            }
            sleep(POLL);
        }
        let clocks = Clocks::parse(&self.log("VrApi", &since)?, *seconds);
        let folder =
            tempfile::tempdir().map_err(|error| Fault::Usage(format!("temporary files: {error}")))?;
        let pulled = folder.path().join(STATS);
        self.adb.run(&["pull".as_ref(), remote(STATS).as_ref(), pulled.as_os_str()])?;
        let stats =
            fs::read(&pulled).map_err(|error| Fault::Device(format!("adb pulled no statistics: {error}")))?;
        Ok(Played { stats, clocks })
    }
}
