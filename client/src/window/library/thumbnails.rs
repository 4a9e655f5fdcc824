//! [`Thumbnails`]: small pictures of clips, each rendered once and kept in a folder.
//!
//! A picture is the poster of a clip. Another process of this program renders it, `aarc --headless --poster`, as for
//! file managers: a damaged or an enormous clip cannot harm the window. One that has no picture is not rendered again
//! while the window is open, unless its file changes.

use std::cell::RefCell;
use std::collections::HashMap;
use std::fs::{self, File};
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::sleep;
use std::time::{Duration, Instant, SystemTime};

use egui::ColorImage;
use program::read_error;
use sha2::{Digest, Sha256};

use crate::clips::playlist::is_playlist;
use crate::clips::{Report, Worker, is_url};

/// Size of a picture in pixels.
pub(super) const SIZE: [u32; 2] = [320, 180];

/// Most pictures in the folder, of which the ones made longest ago are removed first, and most failures in memory.
const MAX_CACHED: usize = 1000;

/// Exit codes of the other process that can have another cause than the clip: the picture cannot be written, and there is
/// no graphics device, or the clip does not fit it.
const OTHER_CAUSES: [i32; 2] = [2, 5];

/// Most bytes of an error of the other process that are read.
const ERROR_BYTES: u64 = 4096;

/// Longest time for a picture, and the interval between looks whether it is there.
const PATIENCE: Duration = Duration::from_secs(60);
const INTERVAL: Duration = Duration::from_millis(20);

/// The picture of a clip, or why there is none.
pub(super) type Picture = Result<ColorImage, String>;

/// A thread that makes pictures of clips, one at a time.
pub(super) struct Thumbnails {
    worker: Worker<Vec<String>, (String, Picture)>,
    is_over: Arc<AtomicBool>,
}

impl Thumbnails {
    /// Starts the thread. `program` renders the pictures, and `folder` keeps them; without a folder there are none. The
    /// thread calls `wake` for every picture.
    ///
    /// # Errors
    /// If the system refuses another thread.
    pub(super) fn start(
        program: PathBuf,
        folder: Option<PathBuf>,
        wake: impl Fn() + Send + 'static,
    ) -> io::Result<Thumbnails> {
        let is_over = Arc::new(AtomicBool::new(false));
        let maker = Maker { program, folder, is_over: is_over.clone(), failures: RefCell::default() };
        let work = move |names: Vec<String>, report: Report<'_, (String, Picture)>| {
            for name in names {
                let picture = maker.picture(&name);
                if report((name, picture)).is_break() {
                    return;
                }
            }
        };
        Ok(Thumbnails { worker: Worker::new(work, wake)?, is_over })
    }

    /// Asks for the pictures of these clips, paths and URLs, in this order, instead of those asked for before.
    pub(super) fn request(&mut self, names: Vec<String>) {
        self.worker.request(names);
    }

    /// The next picture, if there is one.
    pub(super) fn poll(&self) -> Option<(String, Picture)> {
        self.worker.poll().ok().flatten()
    }
}

impl Drop for Thumbnails {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
    }
}

/// Makes pictures.
struct Maker {
    program: PathBuf,
    folder: Option<PathBuf>,
    /// Whether nothing is wanted any more.
    is_over: Arc<AtomicBool>,
    /// Why clips have no pictures, by the names of the files that would hold these.
    failures: RefCell<HashMap<String, String>>,
}

/// Why a picture could not be made.
struct Failure {
    why: String,
    /// Whether it would fail again.
    is_lasting: bool,
}

impl Maker {
    /// The picture of the clip `name`, from the folder if it is there.
    fn picture(&self, name: &str) -> Picture {
        if is_url(name) || is_playlist(name) {
            return Err(String::new());
        }
        let folder = self.folder.as_deref().ok_or("there is no folder for pictures: set HOME")?;
        let file = file_name(Path::new(name)).map_err(|error| read_error(&error))?;
        let path = folder.join(&file);
        if let Ok(picture) = read(&path) {
            return Ok(picture);
        }
        if let Some(why) = self.failures.borrow().get(&file) {
            return Err(why.clone());
        }
        fs::create_dir_all(folder)
            .map_err(|error| format!("{}: no folder can be made there ({error})", folder.display()))?;
        if let Err(Failure { why, is_lasting }) = self.render(name, &path) {
            if is_lasting {
                self.remember(file, why.clone());
            }
            return Err(why);
        }
        remove_oldest(folder, MAX_CACHED);
        read(&path)
    }

    fn remember(&self, file: String, why: String) {
        let mut failures = self.failures.borrow_mut();
        if failures.len() >= MAX_CACHED {
            failures.clear();
        }
        failures.insert(file, why);
    }

    /// Renders the picture of a clip into the file `path`.
    ///
    /// # Errors
    /// The error of the program, or that it took too long.
    fn render(&self, name: &str, path: &Path) -> Result<(), Failure> {
        let [width, height] = SIZE;
        let mut command = Command::new(&self.program);
        command.args(["--headless", "--poster", "--size", &format!("{width}x{height}"), "--out"]);
        command.arg(path).arg("--").arg(name);
        // The pipe of its errors is read at the end, and must not fill.
        command.env_remove("RUST_LOG").stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped());
        let mut child = command.spawn().map_err(|error| {
            let why = format!("{}: {error}", self.program.display());
            Failure { why, is_lasting: false }
        })?;
        let status = self.wait(&mut child).map_err(|why| {
            let _ = (child.kill(), child.wait());
            Failure { why, is_lasting: true }
        })?;
        if status.success() {
            return Ok(());
        }
        let mut error = Vec::new();
        if let Some(stderr) = child.stderr.take() {
            let _ = stderr.take(ERROR_BYTES).read_to_end(&mut error);
        }
        let error = String::from_utf8_lossy(&error);
        let why = error.lines().last().unwrap_or("it cannot be rendered").to_owned();
        Err(Failure { why, is_lasting: status.code().is_none_or(|code| !OTHER_CAUSES.contains(&code)) })
    }

    /// Waits for the program to end.
    ///
    /// # Errors
    /// That it takes too long, or that nothing is wanted any more.
    fn wait(&self, child: &mut Child) -> Result<ExitStatus, String> {
        let start = Instant::now();
        loop {
            if let Some(status) = child.try_wait().map_err(|error| error.to_string())? {
                return Ok(status);
            }
            if self.is_over.load(Ordering::Relaxed) || start.elapsed() > PATIENCE {
                return Err(format!("no picture within {} s", PATIENCE.as_secs()));
            }
            sleep(INTERVAL);
        }
    }
}

/// Name of the file with the picture of a clip: another one for each path, time of change and length.
fn file_name(clip: &Path) -> io::Result<String> {
    let about = fs::metadata(clip)?;
    let changed = about.modified()?.duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
    let mut hash = Sha256::new();
    hash.update(clip.as_os_str().as_encoded_bytes());
    hash.update([0]);
    hash.update(changed.as_nanos().to_le_bytes());
    hash.update(about.len().to_le_bytes());
    Ok(hash.finalize().iter().take(16).map(|byte| format!("{byte:02x}")).chain([".png".into()]).collect())
}

/// Reads a picture of [`SIZE`].
fn read(path: &Path) -> Picture {
    let fault = |error: String| format!("{}: {error}", path.display());
    let file = File::open(path).map_err(|error| fault(read_error(&error)))?;
    let mut reader = image::ImageReader::with_format(io::BufReader::new(file), image::ImageFormat::Png);
    let [width, height] = SIZE;
    let mut limits = image::Limits::default();
    (limits.max_image_width, limits.max_image_height) = (Some(width), Some(height));
    reader.limits(limits);
    let image = reader.decode().map_err(|error| fault(error.to_string()))?.into_rgb8();
    Ok(ColorImage::from_rgb([image.width() as usize, image.height() as usize], &image))
}

/// Removes all but `max` pictures of the folder, the ones made longest ago.
fn remove_oldest(folder: &Path, max: usize) {
    let entries = folder.read_dir().into_iter().flatten().flatten();
    let mut pictures: Vec<(SystemTime, PathBuf)> = entries
        .filter(|entry| entry.path().extension().is_some_and(|extension| extension == "png"))
        .filter_map(|entry| Some((entry.metadata().ok()?.modified().ok()?, entry.path())))
        .collect();
    pictures.sort();
    let excess = pictures.len().saturating_sub(max);
    for (_, path) in &pictures[..excess] {
        let _ = fs::remove_file(path);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn maker(program: &str, folder: &Path) -> Maker {
        let (is_over, failures) = (Arc::default(), RefCell::default());
        Maker { program: program.into(), folder: Some(folder.into()), is_over, failures }
    }

    /// Writes a program that runs a script.
    #[cfg(unix)]
    fn write_program(path: &Path, script: &str) {
        fs::write(path, format!("#!/bin/sh\n{script}\n")).unwrap();
        fs::set_permissions(path, std::os::unix::fs::PermissionsExt::from_mode(0o755)).unwrap();
    }

    #[test]
    fn a_picture_is_read_from_the_folder_until_its_clip_changes() {
        let folder = tempfile::tempdir().unwrap();
        let clip = folder.path().join("a.aarc");
        fs::write(&clip, "a clip").unwrap();
        let name = clip.to_str().unwrap();
        let picture = image::RgbImage::from_pixel(SIZE[0], SIZE[1], image::Rgb([9, 8, 7]));
        picture.save(folder.path().join(file_name(&clip).unwrap())).unwrap();
        // A program that is not there: nothing is rendered.
        let maker = maker("/nowhere/aarc", folder.path());
        let found = maker.picture(name).unwrap();
        assert_eq!((found.size, found.pixels[0]), ([320, 180], egui::Color32::from_rgb(9, 8, 7)));
        fs::write(&clip, "another clip").unwrap();
        assert!(maker.picture(name).unwrap_err().starts_with("/nowhere/aarc: "));
    }

    #[test]
    fn the_error_of_the_program_is_reported_and_what_has_no_picture_says_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let maker = maker("/nowhere/aarc", folder.path());
        assert!(maker.picture("/nowhere/a.aarc").unwrap_err().contains("no such file"));
        for name in ["https://host/a.aarc", "/clips/list.json"] {
            assert_eq!(maker.picture(name), Err(String::new()));
        }
        let homeless = Maker { folder: None, ..maker };
        assert!(homeless.picture("/nowhere/a.aarc").unwrap_err().contains("set HOME"));
    }

    #[cfg(unix)]
    #[test]
    fn a_damaged_clip_is_rendered_once_until_its_file_changes() {
        let folder = tempfile::tempdir().unwrap();
        let [clip, program, runs] = ["a.aarc", "program", "runs"].map(|name| folder.path().join(name));
        let maker = maker(program.to_str().unwrap(), folder.path());
        let picture = || maker.picture(clip.to_str().unwrap()).unwrap_err();
        let count = || fs::read_to_string(&runs).unwrap().lines().count();
        let fails_with = |code: u8| {
            let script =
                format!("echo >> '{}'\necho 'error: a.aarc: damaged' >&2\nexit {code}", runs.display());
            write_program(&program, &script);
        };
        fs::write(&clip, "damaged").unwrap();
        fails_with(5);
        picture();
        picture();
        assert_eq!(count(), 2, "without a graphics device it is tried again");
        fails_with(3);
        for _ in 0..3 {
            assert_eq!(picture(), "error: a.aarc: damaged");
        }
        assert_eq!(count(), 3);
        fs::write(&clip, "damaged in another way").unwrap();
        picture();
        picture();
        assert_eq!(count(), 4);
        (0..2 * MAX_CACHED).for_each(|i| maker.remember(i.to_string(), String::new()));
        assert!(maker.failures.borrow().len() <= MAX_CACHED, "memory is bounded");
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_program_that_does_not_end_is_stopped_with_the_window() {
        let folder = tempfile::tempdir().unwrap();
        let clip = folder.path().join("a.aarc");
        fs::write(&clip, "a clip").unwrap();
        let program = folder.path().join("program");
        write_program(&program, "echo $$ > \"$(dirname \"$0\")/pid\"\nexec sleep 1000");
        let start = Instant::now();
        let mut thumbnails = Thumbnails::start(program, Some(folder.path().join("new")), || ()).unwrap();
        thumbnails.request(vec![clip.to_str().unwrap().into()]);
        let pid = loop {
            match fs::read_to_string(folder.path().join("pid")) {
                Ok(pid) if pid.ends_with('\n') => break pid,
                _ => assert!(start.elapsed() < PATIENCE, "it was never started"),
            }
            sleep(INTERVAL);
        };
        drop(thumbnails);
        assert!(start.elapsed() < PATIENCE, "it was waited for");
        assert!(!Path::new("/proc").join(pid.trim()).exists(), "it still runs");
    }

    #[test]
    fn the_oldest_pictures_are_removed() {
        let folder = tempfile::tempdir().unwrap();
        for (i, name) in ["b.png", "a.png", "c.png", "other.txt"].iter().enumerate() {
            let file = File::create(folder.path().join(name)).unwrap();
            file.set_modified(SystemTime::UNIX_EPOCH + Duration::from_secs(i as u64)).unwrap();
        }
        remove_oldest(folder.path(), 2);
        let there = |name: &str| folder.path().join(name).exists();
        assert!(!there("b.png") && there("a.png") && there("c.png") && there("other.txt"));
    }
}
