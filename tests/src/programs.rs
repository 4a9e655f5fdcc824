//! Running the programs of the workspace as a user does.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::OnceLock;
use std::thread::sleep;
use std::time::{Duration, Instant};

use tempfile::TempDir;
use xtask::workspace;

use crate::outcome::Outcome;

/// Longest run of a program.
const PATIENCE: Duration = Duration::from_secs(300);

/// Path of the player's executable; the first call builds it.
pub fn client() -> &'static Path {
    static PATH: OnceLock<PathBuf> = OnceLock::new();
    PATH.get_or_init(|| build("aarc"))
}

/// Path of the host tool's executable; the first call builds it.
pub fn studio() -> &'static Path {
    static PATH: OnceLock<PathBuf> = OnceLock::new();
    PATH.get_or_init(|| build("aarc-studio"))
}

/// Path of an example program's executable, built by the call.
pub fn example(name: &str) -> PathBuf {
    workspace::build_example(name, PROFILE).unwrap_or_else(|fault| panic!("{fault}"))
}

fn build(program: &str) -> PathBuf {
    workspace::build(program, PROFILE).unwrap_or_else(|fault| panic!("{fault}"))
}

/// The profile of this build of the tests.
const PROFILE: &str = if cfg!(debug_assertions) { "dev" } else { "release" };

/// A temporary folder in which programs run.
pub struct Folder(TempDir);

impl Default for Folder {
    fn default() -> Folder {
        Folder(tempfile::tempdir().expect("temporary files can be made"))
    }
}

impl Folder {
    /// Path of a file in the folder; `""` for the folder itself.
    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Writes a file.
    ///
    /// # Panics
    /// If the system cannot write temporary files.
    pub fn write(&self, name: &str, bytes: &[u8]) {
        fs::write(self.path(name), bytes).expect("temporary files can be written");
    }

    /// Reads a file.
    ///
    /// # Errors
    /// If there is none.
    pub fn read(&self, name: &str) -> Result<Vec<u8>, String> {
        fs::read(self.path(name)).map_err(|error| format!("{name}: {error}"))
    }

    /// A command that runs `program` in the folder, with the words of `line` as arguments.
    pub fn command(&self, program: &Path, line: &str) -> Command {
        let mut command = Command::new(program);
        command.current_dir(&self.0).args(line.split_whitespace());
        command
    }
}

/// Runs a command to its end, without input.
///
/// # Panics
/// If it cannot be started, or runs longer than 300 s.
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
