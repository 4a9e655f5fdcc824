//! [`Local`]: the player on this machine's OpenXR runtime.

use std::fs;
use std::path::PathBuf;
use std::process::Command;

use program::Fault;

use super::adb::output;
use super::target::{Played, Run, Target};

/// This machine, which logs no clocks.
pub(super) struct Local {
    pub(super) player: PathBuf,
}

impl Target for Local {
    fn play(&self, run: &Run<'_>) -> Result<Played, Fault> {
        let folder =
            tempfile::tempdir().map_err(|error| Fault::Usage(format!("temporary files: {error}")))?;
        let stats = folder.path().join("stats.json");
        let mut player = Command::new(&self.player);
        player.arg("--xr").arg(run.clip).arg(format!("--{}", run.distance));
        player.args(["--seconds", &run.seconds.to_string(), "--stats"]).arg(&stats);
        output(&mut player)
            .map_err(|line| Fault::Device(format!("{} failed: {line}", self.player.display())))?;
        let stats = fs::read(&stats).map_err(|error| {
            Fault::Device(format!("{} wrote no statistics: {error}", self.player.display()))
        })?;
        Ok(Played { stats, clocks: None })
    }
}
