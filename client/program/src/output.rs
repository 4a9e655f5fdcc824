//! Output files, written completely or not at all.
//!
//! A file is written under a temporary name in its folder and then renamed. Its path never holds an
//! incomplete file, and a file that was there before stays until the new one is complete. Links are
//! followed. What is no regular file, such as a device or a pipe, is opened and written to instead.

use std::fs::{File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use image::{ExtendedColorType, ImageEncoder, codecs::png::PngEncoder};
use tempfile::{Builder, NamedTempFile};

use crate::Fault;

/// Checks before any work is done that a file can be written to `path`.
///
/// # Errors
/// [`Fault::Usage`] with the path and the reason.
pub fn check(path: &Path) -> Result<(), Fault> {
    // Opening a pipe would wait for its reader.
    if is_special(path) { Ok(()) } else { temporary(path).map(drop) }
}

/// Checks before any work is done that [`make_folder`] can create the folder `path` and that files can be
/// written there.
///
/// # Errors
/// [`Fault::Usage`] with the path and the reason.
pub fn check_folder(path: &Path) -> Result<(), Fault> {
    match path.ancestors().find(|folder| folder.exists()) {
        Some(folder) if folder.is_dir() => temporary_in(folder, path).map(drop),
        Some(file) => Err(Fault::Usage(format!(
            "cannot write to the folder {}: {} is a file, name another folder",
            path.display(),
            file.display()
        ))),
        None => temporary_in(Path::new("."), path).map(drop),
    }
}

/// Creates the folder `path` and its parents where they do not exist.
///
/// # Errors
/// [`Fault::Usage`] with the path and the reason.
pub fn make_folder(path: &Path) -> Result<(), Fault> {
    std::fs::create_dir_all(path).map_err(|error| {
        Fault::Usage(format!("cannot make the folder {}: {error}; name another place", path.display()))
    })
}

/// Writes `bytes` to `path`.
///
/// # Errors
/// [`Fault::Usage`] with the path and the reason.
pub fn write(path: &Path, bytes: &[u8]) -> Result<(), Fault> {
    if is_special(path) {
        let open = OpenOptions::new().write(true).open(path);
        return open.and_then(|mut file| file.write_all(bytes)).map_err(|error| failed(path, error));
    }
    let (mut file, target) = temporary(path)?;
    // The file itself: errors of `NamedTempFile` name the temporary file.
    file.as_file_mut().write_all(bytes).map_err(|error| failed(path, error))?;
    file.persist(target).map_err(|error| failed(path, error.error))?;
    Ok(())
}

/// Writes `bytes` to `path` as [`write()`] does, so that a power loss right after leaves the whole file there.
///
/// # Errors
/// [`Fault::Usage`] with the path and the reason.
pub fn write_durable(path: &Path, bytes: &[u8]) -> Result<(), Fault> {
    write_synced(path, bytes, |file| file.sync_all())
}

/// Writes `bytes` to a temporary file and syncs it before it gets its name, so that the name never stands for
/// less; then syncs the folder, which holds the name.
fn write_synced(path: &Path, bytes: &[u8], sync: impl Fn(&File) -> io::Result<()>) -> Result<(), Fault> {
    if is_special(path) {
        return write(path, bytes);
    }
    let (mut file, target) = temporary(path)?;
    let folder = file.path().parent().unwrap_or(Path::new(".")).to_owned();
    file.as_file_mut()
        .write_all(bytes)
        .and_then(|()| sync(file.as_file()))
        .map_err(|error| failed(path, error))?;
    file.persist(target).map_err(|error| failed(path, error.error))?;
    // Other systems cannot open a folder, and write names through.
    #[cfg(unix)]
    File::open(folder).and_then(|folder| sync(&folder)).map_err(|error| failed(path, error))?;
    Ok(())
}

/// Writes a PNG to `path`. `rgb` holds 3 bytes for each of `width * height` pixels.
///
/// # Errors
/// [`Fault::Usage`] with the path and the reason.
pub fn write_png(path: &Path, rgb: &[u8], (width, height): (u32, u32)) -> Result<(), Fault> {
    let mut png = Vec::new();
    PngEncoder::new(&mut png)
        .write_image(rgb, width, height, ExtendedColorType::Rgb8)
        .map_err(|error| failed(path, error))?;
    write(path, &png)
}

/// Whether `path` leads to something that is neither a file nor a folder: a device, a pipe, a socket.
fn is_special(path: &Path) -> bool {
    path.metadata().is_ok_and(|about| !about.is_file() && !about.is_dir())
}

/// An empty file, and the path at the end of the links from `path`, in whose folder it is. Dropping the file
/// removes it.
fn temporary(path: &Path) -> Result<(NamedTempFile, PathBuf), Fault> {
    let target = end_of_links(path).map_err(|error| failed(path, error))?;
    if target.is_dir() || target.file_name().is_none() {
        return Err(cannot_write(path, "it is a folder, name a file"));
    }
    let folder = target.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    if !folder.is_dir() {
        return Err(cannot_write(path, format!("there is no folder {}, make it first", folder.display())));
    }
    Ok((temporary_in(folder, path)?, target))
}

/// An empty file in the folder, for an output at `path`.
fn temporary_in(folder: &Path, path: &Path) -> Result<NamedTempFile, Fault> {
    let mut builder = Builder::new();
    #[cfg(unix)]
    {
        // The mode that other programs give to a new file; the user's umask still applies.
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    builder.prefix(".writing-").tempfile_in(folder).map_err(|error| failed(path, without_name(&error)))
}

/// The reason of an error of `tempfile`, which adds the name of its file to the text; no user knows that file.
fn without_name(error: &io::Error) -> String {
    let text = error.to_string();
    text.rsplit_once(" at path ").map_or(text.as_str(), |(reason, _)| reason).to_owned()
}

/// The path that `path` leads to by links, whether or not there is something.
fn end_of_links(path: &Path) -> io::Result<PathBuf> {
    // As many as Linux follows.
    const LINKS_MAX: usize = 40;
    let mut end = path.to_owned();
    for _ in 0..LINKS_MAX {
        match end.read_link() {
            Ok(target) => end = end.parent().unwrap_or(Path::new("")).join(target),
            Err(_) => return Ok(end),
        }
    }
    Err(io::Error::other("its links go round in a circle"))
}

/// The fault of a place that cannot be written to.
fn failed(path: &Path, error: impl std::fmt::Display) -> Fault {
    cannot_write(path, format!("{error}; name another place"))
}

fn cannot_write(path: &Path, reason: impl std::fmt::Display) -> Fault {
    Fault::Usage(format!("cannot write {}: {reason}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_replaced_and_nothing_else_is_left() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        write(&path, b"old").unwrap();
        check(&path).unwrap();
        write(&path, b"new").unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"new");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[cfg(unix)]
    #[test]
    fn links_are_followed_and_stay() {
        use std::os::unix::fs::symlink;
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        std::fs::create_dir(path("elsewhere")).unwrap();
        write(&path("elsewhere/old"), b"old").unwrap();
        symlink("elsewhere/old", path("direct")).unwrap();
        symlink("direct", path("indirect")).unwrap();
        symlink(path("elsewhere/absent"), path("dangling")).unwrap();
        for (link, file) in [("indirect", "elsewhere/old"), ("dangling", "elsewhere/absent")] {
            check(&path(link)).unwrap();
            write(&path(link), b"new").unwrap();
            assert!(path(link).is_symlink() && path("direct").is_symlink(), "{link}");
            assert_eq!(std::fs::read(path(file)).unwrap(), b"new");
            assert!(!path(file).is_symlink());
        }
        assert_eq!(std::fs::read_dir(path("elsewhere")).unwrap().count(), 2);
        symlink("circle", path("circle")).unwrap();
        assert!(matches!(write(&path("circle"), b""), Err(Fault::Usage(_))));
    }

    #[cfg(unix)]
    #[test]
    fn a_pipe_is_written_to_and_stays() {
        use std::os::unix::fs::{FileTypeExt, symlink};
        let folder = tempfile::tempdir().unwrap();
        let [pipe, link] = ["pipe", "link"].map(|name| folder.path().join(name));
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        symlink(&pipe, &link).unwrap();
        for path in [&pipe, &link] {
            check(path).unwrap();
            let reader = std::thread::spawn({
                let pipe = pipe.clone();
                move || std::fs::read(pipe)
            });
            write(path, b"numbers").unwrap();
            assert!(pipe.symlink_metadata().unwrap().file_type().is_fifo());
            assert_eq!(reader.join().unwrap().unwrap(), b"numbers");
        }
        assert!(link.is_symlink());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2);
    }

    #[cfg(unix)]
    #[test]
    fn a_durable_file_is_synced_before_its_name_and_its_folder_after() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        write_durable(&path, b"old").unwrap();
        let synced = std::cell::RefCell::new(Vec::new());
        let sync = |file: &File| {
            let visible = std::fs::read(&path).unwrap();
            synced.borrow_mut().push((file.metadata()?.is_dir(), file.metadata()?.len(), visible));
            Ok(())
        };
        write_synced(&path, b"newer", sync).unwrap();
        let synced = synced.into_inner();
        assert_eq!(synced.len(), 2, "{synced:?}");
        assert_eq!(synced[0], (false, 5, b"old".to_vec()));
        assert_eq!((synced[1].0, &synced[1].2), (true, &b"newer".to_vec()));
        // A file that cannot be synced does not replace the old one.
        let full = |_: &File| Err(std::io::Error::other("no space"));
        assert!(write_synced(&path, b"newest", full).unwrap_err().to_string().contains("no space"));
        assert_eq!(std::fs::read(&path).unwrap(), b"newer");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn paths_that_cannot_be_written_are_usage_errors() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        write(&file, b"").unwrap();
        let usage = |result: Result<(), Fault>| assert!(matches!(result, Err(Fault::Usage(_))), "{result:?}");
        usage(check(folder.path()));
        usage(check(&folder.path().join("absent/a")));
        usage(check(&file.join("a")));
        usage(check_folder(&file));
        usage(check_folder(&file.join("a/b")));
        usage(make_folder(&file.join("a")));
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn errors_do_not_name_the_temporary_file() {
        // Not even root makes files there.
        let error = check(Path::new("/proc/a")).unwrap_err().to_string();
        assert!(
            error.starts_with("cannot write /proc/a: ") && error.ends_with("; name another place"),
            "{error}"
        );
        assert!(!error.contains(".writing-"), "{error}");
    }

    #[test]
    fn folders_are_made_when_asked_and_not_before() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a/b");
        check_folder(&path).unwrap();
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
        make_folder(&path).unwrap();
        check_folder(&path).unwrap();
        assert!(path.is_dir());
    }

    #[test]
    fn png_holds_the_pixels() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        let rgb = [1, 2, 3, 250, 251, 252];
        write_png(&path, &rgb, (2, 1)).unwrap();
        let read = image::open(&path).unwrap().to_rgb8();
        assert_eq!((read.dimensions(), read.as_raw().as_slice()), ((2, 1), &rgb[..]));
    }
}
