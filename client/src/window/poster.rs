//! [`PosterChange`]: makes what the window shows the poster of its clip, by `aarc-studio poster`.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use codec::Viewpoint;
use program::Fault;

/// The host tool, which writes packages.
const STUDIO: &str = "aarc-studio";

/// The frame that a poster is to show.
pub(super) struct PosterChange {
    /// The package.
    pub(super) clip: PathBuf,
    /// Seconds from the start of the clip.
    pub(super) time_s: f64,
    /// Where the camera stands and what it looks at.
    pub(super) viewpoint: Viewpoint,
}

impl PosterChange {
    /// Writes the poster into the package, whose place the new one takes when it is complete.
    ///
    /// # Errors
    /// [`Fault::Usage`] if the host tool cannot be run, or with its own error.
    pub(super) fn write(&self) -> Result<(), Fault> {
        self.write_by(&studio())
    }

    fn write_by(&self, studio: &Path) -> Result<(), Fault> {
        let Viewpoint { position, target, fov_y, .. } = &self.viewpoint;
        let point = |[x, y, z]: &[f32; 3]| format!("{x},{y},{z}");
        let mut command = Command::new(studio);
        command.arg("poster").arg(format!("--time={}", self.time_s));
        command.arg(format!("--view={}:{}:{}", point(position), point(target), fov_y.to_degrees()));
        command.arg("--").arg(&self.clip);
        let output = command.stdin(Stdio::null()).output().map_err(|error| {
            Fault::Usage(format!(
                "{STUDIO} writes posters and cannot be run: {error}: install it beside the player"
            ))
        })?;
        if output.status.success() {
            return Ok(());
        }
        let errors = String::from_utf8_lossy(&output.stderr);
        let last = errors.lines().last().unwrap_or_default();
        Err(Fault::Usage(format!("no poster was written: {}", last.trim_start_matches("error: "))))
    }
}

/// Path of the host tool: beside this program, else as the system finds it.
fn studio() -> PathBuf {
    let name = format!("{STUDIO}{}", std::env::consts::EXE_SUFFIX);
    let player = std::env::current_exe().ok();
    let beside = player.as_deref().and_then(Path::parent).map(|folder| folder.join(&name));
    beside.filter(|path| path.is_file()).unwrap_or_else(|| name.into())
}

#[cfg(all(test, unix))]
mod tests {
    use std::fs;
    use std::os::unix::fs::PermissionsExt;

    use super::*;

    fn change() -> PosterChange {
        let viewpoint = Viewpoint {
            name: String::new(),
            position: [-0.1, 1.5, 3.0],
            target: [0.0, 1e-7, -2.0],
            fov_y: 1.0,
        };
        PosterChange { clip: "/clips/a b.aarc".into(), time_s: 0.1 + 0.2, viewpoint }
    }

    /// A host tool that runs a script.
    fn studio(folder: &Path, script: &str) -> PathBuf {
        let path = folder.join(STUDIO);
        fs::write(&path, format!("#!/bin/sh\n{script}\n")).unwrap();
        fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).unwrap();
        path
    }

    #[test]
    fn the_host_tool_gets_time_and_view_to_the_last_digit() {
        let folder = tempfile::tempdir().unwrap();
        let studio = studio(folder.path(), r#"printf '%s\n' "$@" > "$(dirname "$0")/arguments""#);
        change().write_by(&studio).unwrap();
        let arguments = fs::read_to_string(folder.path().join("arguments")).unwrap();
        let arguments: Vec<&str> = arguments.lines().collect();
        let expected = [
            "poster",
            "--time=0.30000000000000004",
            "--view=-0.1,1.5,3:0,0.0000001,-2:57.29578",
            "--",
            "/clips/a b.aarc",
        ];
        assert_eq!(arguments, expected);
    }

    #[test]
    fn what_went_wrong_is_said_in_a_line() {
        let folder = tempfile::tempdir().unwrap();
        let broken = studio(folder.path(), "echo progress >&2; echo 'error: a.aarc: read-only' >&2; exit 2");
        let message = change().write_by(&broken).unwrap_err().to_string();
        assert_eq!(message, "no poster was written: a.aarc: read-only");
        let message = change().write_by(Path::new("/nowhere/aarc-studio")).unwrap_err().to_string();
        assert!(message.starts_with("aarc-studio writes posters and cannot be run: "), "{message}");
    }
}
