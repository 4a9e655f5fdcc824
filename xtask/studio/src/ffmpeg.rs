//! Runs `ffmpeg` and `ffprobe`, which decode and encode all videos. Both are found on the PATH.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, ErrorKind, PipeWriter, Read, Seek, Write};
use std::path::Path;
use std::process::{Child, ChildStdout, Command, Output, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};

use program::Fault;
use serde::Deserialize;

/// Runs `program` with the arguments that `set_up` gives it, to its end.
///
/// # Errors
/// [`Fault::Usage`] if it is not installed or cannot be run.
pub(crate) fn output(program: &str, set_up: impl FnOnce(&mut Command)) -> Result<Output, Fault> {
    let mut command = Command::new(program);
    set_up(&mut command);
    command.stdin(Stdio::null()).output().map_err(|error| not_run(program, &error))
}

/// What ffprobe says of a file, of what it is asked.
#[derive(Default, Deserialize)]
#[serde(default)]
pub(crate) struct Probed {
    pub(crate) streams: Vec<ProbedStream>,
    pub(crate) packets: Vec<ProbedPacket>,
    pub(crate) format: ProbedFormat,
    /// The last line that it says of errors, without the path of the file.
    #[serde(skip)]
    pub(crate) error: Option<String>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(crate) struct ProbedStream {
    pub(crate) codec_type: Option<String>,
    pub(crate) codec_name: Option<String>,
    pub(crate) codec_tag_string: Option<String>,
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) color_space: Option<String>,
    pub(crate) color_transfer: Option<String>,
    pub(crate) color_primaries: Option<String>,
    pub(crate) field_order: Option<String>,
    pub(crate) avg_frame_rate: Option<String>,
    pub(crate) nb_frames: Option<String>,
    pub(crate) nb_read_packets: Option<String>,
    pub(crate) channels: Option<u32>,
    pub(crate) tags: BTreeMap<String, String>,
    pub(crate) side_data_list: Vec<ProbedSideData>,
}

#[derive(Debug, Deserialize)]
pub(crate) struct ProbedSideData {
    pub(crate) rotation: Option<f64>,
}

#[derive(Deserialize)]
pub(crate) struct ProbedPacket {
    pub(crate) pts_time: Option<String>,
    #[serde(default)]
    pub(crate) flags: String,
}

#[derive(Default, Deserialize)]
#[serde(default)]
pub(crate) struct ProbedFormat {
    pub(crate) duration: Option<String>,
    pub(crate) start_time: Option<String>,
    pub(crate) tags: BTreeMap<String, String>,
}

/// Asks ffprobe about a file. Of one that it cannot read, it says an error alone.
///
/// # Errors
/// [`Fault::Usage`] if it is not installed or cannot be run.
pub(crate) fn probed(path: &Path, arguments: &[&str]) -> Result<Probed, Fault> {
    let output = output("ffprobe", |command| {
        command.args(["-v", "error"]).args(arguments).args(["-of", "json", "-i"]).arg(path);
    })?;
    let said = String::from_utf8_lossy(&output.stderr);
    let probed = serde_json::from_slice(&output.stdout).ok().filter(|_| output.status.success());
    let error = (!said.trim().is_empty()).then(|| last_line(&said, path));
    Ok(Probed { error, ..probed.unwrap_or_default() })
}

/// A run that has begun; it is killed when it is dropped.
#[derive(Debug)]
pub(crate) struct Running {
    child: Child,
    /// What it says of errors. A pipe that nothing reads would block it.
    said: File,
}

impl Running {
    /// Starts `program` with the arguments and pipes that `set_up` gives it.
    ///
    /// # Errors
    /// [`Fault::Usage`] if it is not installed or cannot be run.
    pub(crate) fn start(program: &str, set_up: impl FnOnce(&mut Command)) -> Result<Running, Fault> {
        let no_file = |error: io::Error| Fault::Usage(format!("no temporary file: {error}"));
        let said = tempfile::tempfile().map_err(no_file)?;
        let mut command = Command::new(program);
        command.stdin(Stdio::null()).stderr(said.try_clone().map_err(no_file)?);
        set_up(&mut command);
        let child = command.spawn().map_err(|error| not_run(program, &error))?;
        Ok(Running { child, said })
    }

    /// The pipe that it writes to.
    ///
    /// # Panics
    /// If it was not set up, or taken before.
    pub(crate) fn take_stdout(&mut self) -> ChildStdout {
        self.child.stdout.take().expect("it is piped")
    }

    /// Waits for its end.
    ///
    /// # Errors
    /// The last line that it said of errors, without the path of the file, or its status.
    pub(crate) fn finish(&mut self, path: &Path) -> Result<(), String> {
        let otherwise = match self.child.wait() {
            Ok(status) if status.success() => return Ok(()),
            Ok(status) => status.to_string(),
            Err(error) => error.to_string(),
        };
        Err(self.last_error(path).unwrap_or(otherwise))
    }

    /// The last line that it said of errors, without the path of the file; `None` if it said nothing.
    pub(crate) fn last_error(&mut self, path: &Path) -> Option<String> {
        let mut said = String::new();
        self.said.rewind().and_then(|()| self.said.read_to_string(&mut said)).ok()?;
        (!said.trim().is_empty()).then(|| last_line(&said, path))
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        // It may have ended already.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A run that reads what this program writes.
///
/// Its pipe never breaks: a broken one would end this program at once, as
/// [`exit_on_closed_pipe`](program::exit_on_closed_pipe) has it, and leave unfinished files. Once the run has ended, a
/// thread reads what is still written.
#[derive(Debug)]
pub(crate) struct Feeding {
    pipe: Option<PipeWriter>,
    has_ended: Arc<AtomicBool>,
    run: Option<JoinHandle<Running>>,
}

impl Feeding {
    /// Starts `program` with the arguments that `set_up` gives it.
    ///
    /// # Errors
    /// [`Fault::Usage`] if it is not installed or cannot be run.
    pub(crate) fn start(program: &str, set_up: impl FnOnce(&mut Command)) -> Result<Feeding, Fault> {
        let no_pipe = |error: io::Error| Fault::Usage(format!("no pipe to {program}: {error}"));
        let (mut reader, pipe) = io::pipe().map_err(no_pipe)?;
        let stdin = reader.try_clone().map_err(no_pipe)?;
        let mut running = Running::start(program, |command| {
            set_up(command);
            command.stdin(stdin);
        })?;
        let has_ended = Arc::new(AtomicBool::new(false));
        let flag = has_ended.clone();
        let run = thread::spawn(move || {
            // `finish` asks again, and says what failed.
            let _ = running.child.wait();
            flag.store(true, Ordering::Relaxed);
            // Errors of a pipe that nothing needs any more.
            let _ = io::copy(&mut reader, &mut io::sink());
            running
        });
        Ok(Feeding { pipe: Some(pipe), has_ended, run: Some(run) })
    }

    /// Whether the run has ended before its input did, so that it is of no use to write more.
    pub(crate) fn has_ended(&self) -> bool {
        self.has_ended.load(Ordering::Relaxed)
    }

    /// Writes `bytes` to the run.
    ///
    /// # Errors
    /// Those of the system.
    pub(crate) fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.pipe.as_mut().expect("it is open until the end").write_all(bytes)
    }

    /// Ends its input and waits for its end.
    ///
    /// # Errors
    /// The last line that it said of errors, without the path of the file, or its status.
    pub(crate) fn finish(mut self, path: &Path) -> Result<(), String> {
        drop(self.pipe.take());
        let run = self.run.take().expect("it is there until the end");
        run.join().expect("the thread does not panic").finish(path)
    }
}

impl Drop for Feeding {
    fn drop(&mut self) {
        // At the end of its input it ends, too, and has no file open when this returns.
        drop(self.pipe.take());
        if let Some(run) = self.run.take() {
            let _ = run.join();
        }
    }
}

/// The last line that ffmpeg or ffprobe says, without the path of the file.
fn last_line(said: &str, path: &Path) -> String {
    let line = said.lines().rev().find(|line| !line.trim().is_empty()).unwrap_or("it says nothing");
    line.replace(&format!("{}: ", path.display()), "").trim().to_owned()
}

fn not_run(program: &str, error: &io::Error) -> Fault {
    Fault::Usage(match error.kind() {
        ErrorKind::NotFound => format!("videos need {program}, version 5.1 or newer; install ffmpeg"),
        _ => format!("cannot run {program}: {error}"),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_line_names_no_file() {
        let said = "[mov @ 0x1] moov atom not found\nrig/a.mp4: Invalid data found\n\n";
        assert_eq!(last_line(said, Path::new("rig/a.mp4")), "Invalid data found");
    }

    #[cfg(unix)]
    #[test]
    fn a_run_that_ends_early_does_not_break_the_pipe() {
        let script = |script: &'static str| {
            Feeding::start("sh", move |command| {
                command.args(["-c", script]);
            })
            .unwrap()
        };
        let mut failing = script("echo a.mp4: no space >&2; exit 3");
        // More than a pipe holds.
        (0..100).for_each(|_| failing.write(&[0; 10_000]).unwrap());
        assert!(failing.has_ended());
        assert_eq!(failing.finish(Path::new("a.mp4")), Err("no space".into()));
        let mut reading = script("test $(wc -c) = 200000");
        (0..2).for_each(|_| reading.write(&[0; 100_000]).unwrap());
        assert_eq!(reading.finish(Path::new("a.mp4")), Ok(()));
        drop(script("cat > /dev/null"));
    }

    #[test]
    fn what_is_not_installed_is_named() {
        for fault in [
            output("no-such-ffmpeg", |_| ()).unwrap_err(),
            Running::start("no-such-ffmpeg", |_| ()).unwrap_err(),
        ] {
            assert_eq!(fault.exit_code(), 2);
            assert_eq!(fault.to_string(), "videos need no-such-ffmpeg, version 5.1 or newer; install ffmpeg");
        }
    }
}
