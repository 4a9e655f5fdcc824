//! Running the host tool as a user does.
#![allow(dead_code, reason = "each test binary uses its own part")]

use std::path::Path;
use std::process::{Command, Stdio};

use serde_json::Value;

#[path = "../../../../tests/src/outcome.rs"]
#[allow(unreachable_pub, reason = "it is a module of the library of tests, too")]
pub(crate) mod outcome;

pub(crate) use outcome::Outcome;

/// Environment of a machine without a graphics device and ONNX Runtime: the loaders find no driver and no library.
pub(crate) const NO_DEVICE: [(&str, &str); 3] = [
    ("VK_DRIVER_FILES", "none.json"),
    ("VK_ICD_FILENAMES", "none.json"),
    ("ORT_DYLIB_PATH", "none/libonnxruntime.so"),
];

/// Runs the tool in `folder`.
pub(crate) fn aarc_studio(folder: &Path, args: &[&str]) -> Outcome {
    aarc_studio_with(folder, args, &[])
}

/// Runs the tool in `folder` with these variables in its environment.
pub(crate) fn aarc_studio_with(folder: &Path, args: &[&str], variables: &[(&str, &str)]) -> Outcome {
    let mut command = Command::new(env!("CARGO_BIN_EXE_aarc-studio"));
    command.current_dir(folder).args(args).envs(variables.iter().copied());
    command.output().expect("the tool starts").into()
}

/// Runs the tool in `folder` where no file may have more than `kilobytes`, as on a disk that is full.
#[cfg(target_os = "linux")]
pub(crate) fn with_small_disk(folder: &Path, kilobytes: usize, args: &[&str]) -> Outcome {
    let script = format!("trap '' XFSZ; ulimit -f {}; exec \"$0\" \"$@\"", 2 * kilobytes);
    let mut command = Command::new("sh");
    command.arg("-c").arg(script).arg(env!("CARGO_BIN_EXE_aarc-studio")).args(args);
    command.current_dir(folder).output().expect("the tool starts").into()
}

/// Whether there is an ffmpeg.
pub(crate) fn has_ffmpeg() -> bool {
    let output = Command::new("ffprobe").arg("-version").stdout(Stdio::null()).stderr(Stdio::null()).status();
    let has = output.is_ok_and(|status| status.success());
    if !has {
        println!("skipped: no ffmpeg; cargo xtask test installs it where it may");
    }
    has
}

/// Runs ffmpeg with a command line without spaces in its words.
pub(crate) fn ffmpeg(folder: &Path, line: &str) {
    let mut command = Command::new("ffmpeg");
    command.current_dir(folder).args(["-nostdin", "-v", "error", "-y"]).args(line.split_whitespace());
    let output = command.output().unwrap();
    assert!(output.status.success(), "{line}: {}", String::from_utf8_lossy(&output.stderr));
}

/// Makes the capture `studio` of the videos in `rig`.
pub(crate) fn ingest(folder: &Path, options: &str) -> Outcome {
    let line = format!("ingest rig -o studio {options}");
    aarc_studio(folder, &line.split_whitespace().collect::<Vec<_>>())
}

/// The only line on standard error of a run that ended with this exit code. Steps before may have said something on standard
/// output.
#[track_caller]
pub(crate) fn refused(outcome: Outcome, code: i32) -> String {
    assert_eq!(outcome.code, Some(code), "{outcome:?}");
    let lines: Vec<&str> = outcome.stderr.lines().collect();
    assert!(lines.len() == 1 && lines[0].starts_with("error: "), "{outcome:?}");
    lines[0].to_owned()
}

impl Outcome {
    /// What a successful run printed on standard output, as JSON.
    #[track_caller]
    pub(crate) fn json(self) -> Value {
        let stdout = self.success().stdout;
        serde_json::from_str(&stdout).unwrap_or_else(|error| panic!("{error}: {stdout}"))
    }

    /// The [`Outcome::refusal`] with this exit code.
    #[track_caller]
    pub(crate) fn error(self, code: i32) -> String {
        self.refusal(code).unwrap_or_else(|wrong| panic!("{wrong}")).to_owned()
    }
}
