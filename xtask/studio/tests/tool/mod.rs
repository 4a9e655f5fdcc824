//! Running the host tool as a user does.
#![allow(dead_code, reason = "each test binary uses its own part")]

use std::path::Path;
use std::process::Command;

use serde_json::Value;

/// What came of running the tool.
pub(crate) struct Outcome {
    pub(crate) code: Option<i32>,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
}

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
    let output = command.output().expect("the tool starts");
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).expect("text");
    Outcome { code: output.status.code(), stdout: text(output.stdout), stderr: text(output.stderr) }
}

impl Outcome {
    /// What a successful run printed on standard output, as JSON.
    #[track_caller]
    pub(crate) fn json(self) -> Value {
        assert_eq!(self.code, Some(0), "{}", self.stderr);
        serde_json::from_str(&self.stdout).unwrap_or_else(|error| panic!("{error}: {}", self.stdout))
    }

    /// The error of a run that failed with this exit code: one line on standard error, after any notes.
    #[track_caller]
    pub(crate) fn error(self, code: i32) -> String {
        assert_eq!(self.code, Some(code), "{}{}", self.stdout, self.stderr);
        let lines: Vec<&str> = self.stderr.lines().filter(|line| !line.starts_with("note: ")).collect();
        let [error] = lines[..] else { panic!("{}", self.stderr) };
        assert!(error.starts_with("error: ") && self.stdout.is_empty(), "{}{}", self.stdout, self.stderr);
        error.to_owned()
    }
}
