//! [`Outcome`] of a program, and tables of failures: command lines that it must refuse. The host tool's own tests
//! include this file as a module, so it uses nothing but the standard library.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Output;

/// Exit code of a failed check.
pub const CHECK: i32 = 1;
/// Exit code of a command line that asks for something impossible.
pub const USAGE: i32 = 2;
/// Exit code of bad data.
pub const DATA: i32 = 3;
/// Exit code of a failed download.
pub const NETWORK: i32 = 4;
/// Exit code of a missing device.
pub const DEVICE: i32 = 5;

/// Arguments, exit code, what is wrong and where, and the next step.
pub type Failure = (&'static str, i32, &'static str, &'static str);

/// Result of a program.
#[derive(Debug)]
pub struct Outcome {
    /// Exit code; `None` after a signal.
    pub code: Option<i32>,
    /// Standard output.
    pub stdout: String,
    /// Standard error.
    pub stderr: String,
}

impl From<Output> for Outcome {
    fn from(output: Output) -> Outcome {
        let text = |bytes: Vec<u8>| String::from_utf8_lossy(&bytes).into_owned();
        Outcome { code: output.status.code(), stdout: text(output.stdout), stderr: text(output.stderr) }
    }
}

impl Outcome {
    /// Returns the outcome of a program that succeeded.
    ///
    /// # Panics
    /// If it failed, with its output.
    #[track_caller]
    pub fn success(self) -> Outcome {
        assert_eq!(self.code, Some(0), "{}{}", self.stdout, self.stderr);
        self
    }

    /// The error of a program that ended with this exit code: one line on standard error, after any notes and lines
    /// about another try of a download, and nothing on standard output.
    ///
    /// # Errors
    /// What was expected, with the outcome.
    pub fn refusal(&self, code: i32) -> Result<&str, String> {
        let is_note = |line: &&str| line.starts_with("note: ") || line.contains(", trying again (");
        let lines: Vec<&str> = self.stderr.lines().filter(|line| !is_note(line)).collect();
        match lines[..] {
            _ if self.code != Some(code) => Err(format!("exit code {code} was expected: {self:#?}")),
            [error] if error.starts_with("error: ") && self.stdout.is_empty() => Ok(error),
            _ => Err(format!("one error and nothing else was expected: {self:#?}")),
        }
    }

    /// Checks that the [`Outcome::refusal`] says `what` and then the next `step`.
    ///
    /// # Errors
    /// As above, or that it does not say so.
    pub fn refuses(&self, code: i32, what: &str, step: &str) -> Result<(), String> {
        let error = self.refusal(code)?;
        // An output is named as the user named it, not by the temporary file beside it.
        match error.find(what).is_some_and(|at| error[at..].contains(step)) && !error.contains(".writing-") {
            true => Ok(()),
            false => Err(format!("{what:?} and then {step:?} were expected: {self:#?}")),
        }
    }
}

/// Every path below a folder with its file's bytes; empty for folders.
///
/// # Panics
/// If the folder cannot be read.
pub fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).expect("a folder of this test") {
            let path = entry.expect("a folder of this test").path();
            let bytes =
                if path.is_dir() { Vec::new() } else { fs::read(&path).expect("a file of this test") };
            folders.extend(Some(path.clone()).filter(|path| path.is_dir()));
            found.insert(path, bytes);
        }
    }
    found
}

/// Checks that a program refuses every command line of a table and changes nothing in `folder`.
///
/// # Errors
/// All command lines that fail otherwise, with their outcomes.
pub fn check_failures(
    failures: &[Failure],
    folder: &Path,
    run: impl Fn(&str) -> Outcome,
) -> Result<(), String> {
    let before = contents(folder);
    let mut wrong = Vec::new();
    for &(line, code, what, step) in failures {
        if let Err(why) = run(line).refuses(code, what, step) {
            wrong.push(format!("{line}\n  {why}"));
        }
        if contents(folder) != before {
            return Err(format!("{line}\n  changes something"));
        }
    }
    match wrong.is_empty() {
        true => Ok(()),
        false => Err(format!("{} of {}:\n{}", wrong.len(), failures.len(), wrong.join("\n"))),
    }
}
