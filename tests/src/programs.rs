//! Running the programs of the workspace as a user does.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::OnceLock;
use std::thread::sleep;
use std::time::{Duration, Instant};

use xtask::workspace;

/// Longest that a program may run, as long as it is not meant to run on.
const PATIENCE: Duration = Duration::from_secs(300);

/// The executable of the player, built if need be.
pub fn client() -> &'static Path {
    static PATH: OnceLock<PathBuf> = OnceLock::new();
    PATH.get_or_init(|| build("aarc"))
}

/// The executable of the host tool, built if need be.
pub fn studio() -> &'static Path {
    static PATH: OnceLock<PathBuf> = OnceLock::new();
    PATH.get_or_init(|| build("aarc-studio"))
}

/// The executable of an example program of the workspace, built if need be.
pub fn example(name: &str) -> PathBuf {
    workspace::build_example(name, PROFILE).unwrap_or_else(|fault| panic!("{fault}"))
}

fn build(program: &str) -> PathBuf {
    workspace::build(program, PROFILE).unwrap_or_else(|fault| panic!("{fault}"))
}

/// The profile that the tests themselves were built with.
const PROFILE: &str = if cfg!(debug_assertions) { "dev" } else { "release" };

/// What came of running a program.
#[derive(Debug)]
pub struct Outcome {
    /// The exit code; `None` where a signal ended the program.
    pub code: Option<i32>,
    /// What it printed on standard output.
    pub stdout: String,
    /// What it printed on standard error.
    pub stderr: String,
}

impl Outcome {
    /// The outcome itself, where the program succeeded.
    ///
    /// # Panics
    /// If it did not, with what it said.
    pub fn success(self) -> Outcome {
        assert_eq!(self.code, Some(0), "{}{}", self.stdout, self.stderr);
        self
    }
}

/// Runs a command to its end, without input.
///
/// # Panics
/// If it cannot be started, or does not end.
pub fn run(command: &mut Command) -> Outcome {
    let folder = tempfile::tempdir().expect("temporary files can be made");
    let [stdout, stderr] = ["stdout", "stderr"].map(|name| folder.path().join(name));
    let open = |path: &Path| fs::File::create(path).expect("temporary files can be made");
    let mut child = command
        .stdin(Stdio::null())
        .stdout(open(&stdout))
        .stderr(open(&stderr))
        .spawn()
        .unwrap_or_else(|error| panic!("{command:?}: {error}"));
    let start = Instant::now();
    let status = loop {
        if let Some(status) = child.try_wait().expect("a child can be waited for") {
            break status;
        }
        if start.elapsed() > PATIENCE {
            child.kill().expect("a child can be ended");
            panic!("{command:?} did not end within {} s", PATIENCE.as_secs());
        }
        sleep(Duration::from_millis(5));
    };
    let read = |path: &Path| String::from_utf8_lossy(&fs::read(path).expect("written above")).into_owned();
    Outcome { code: status.code(), stdout: read(&stdout), stderr: read(&stderr) }
}
