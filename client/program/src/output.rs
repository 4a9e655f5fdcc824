//! Output files, written completely or not at all.
//!
//! A file is written under a temporary name in its folder and then renamed. Its path never holds an
//! incomplete file, and a file that was there before stays until the new one is complete, which gets its permissions.
//! Links are followed. What is no regular file, such as a device or a pipe, is opened and written to instead.
//! What is complete and cannot be renamed stays under its temporary name, which the error states.

use std::ffi::OsStr;
use std::fs::{File, Metadata, OpenOptions};
use std::io::{self, Read, Seek, SeekFrom, Write};
#[cfg(unix)]
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use image::{ExtendedColorType, ImageEncoder, codecs::png::PngEncoder};
use tempfile::{Builder, NamedTempFile, PersistError, TempDir};

use crate::Fault;

/// Beginning of the names of what is not complete.
const TEMPORARY: &str = ".writing-";

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
    let target = end_of_links(path).map_err(|error| failed(path, error))?;
    match target.ancestors().find(|folder| folder.exists()) {
        Some(folder) if folder.is_dir() => temporary_in(folder, path, None).map(drop),
        Some(file) => Err(Fault::Usage(format!(
            "cannot write to the folder {}: {} is a file, name another folder",
            path.display(),
            file.display()
        ))),
        None => temporary_in(Path::new("."), path, None).map(drop),
    }
}

/// Creates the folder `path` and its parents where they do not exist.
///
/// # Errors
/// [`Fault::Usage`] with the path and the reason.
pub fn make_folder(path: &Path) -> Result<(), Fault> {
    end_of_links(path).and_then(std::fs::create_dir_all).map_err(|error| {
        Fault::Usage(format!("cannot make the folder {}: {error}; name another place", path.display()))
    })
}

/// Removes a file, and returns whether there was one.
///
/// # Errors
/// [`Fault::Usage`] that names the path, if it cannot be removed.
pub fn remove(path: &Path) -> Result<bool, Fault> {
    match std::fs::remove_file(path) {
        Ok(()) => Ok(true),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(false),
        Err(error) => Err(Fault::Usage(format!("cannot remove {}: {error}", path.display()))),
    }
}

/// Writes `bytes` to `path`.
///
/// # Errors
/// [`Fault::Usage`] with the path and the reason.
pub fn write(path: &Path, bytes: &[u8]) -> Result<(), Fault> {
    write_parts(path, |file| file.write(bytes))
}

/// Writes to `path` what `fill` writes, part by part; nothing if `fill` fails.
///
/// # Errors
/// [`Fault::Usage`] with the path and the reason; the error of `fill`.
pub fn write_parts<E: From<Fault>>(
    path: &Path,
    fill: impl FnOnce(&mut OutputFile) -> Result<(), E>,
) -> Result<(), E> {
    if is_special(path) {
        let open = OpenOptions::new().write(true).open(path);
        let file = &mut open.map_err(|error| failed(path, error))?;
        return fill(&mut OutputFile { file, path });
    }
    let (mut file, target) = temporary(path)?;
    // The file itself: errors of `NamedTempFile` name the temporary file.
    fill(&mut OutputFile { file: file.as_file_mut(), path })?;
    Ok(persist(file, &target, path)?)
}

/// A file that is being written.
#[derive(Debug)]
pub struct OutputFile<'a> {
    file: &'a mut File,
    path: &'a Path,
}

impl OutputFile<'_> {
    /// Appends `bytes`.
    ///
    /// # Errors
    /// [`Fault::Usage`] with the path and the reason.
    pub fn write(&mut self, bytes: &[u8]) -> Result<(), Fault> {
        self.file.write_all(bytes).map_err(|error| failed(self.path, error))
    }
}

/// A nameless file beside an output, for parts of it that cannot be written in their order. It disappears when it is
/// dropped, and when the program ends.
#[derive(Debug)]
pub struct Scratch {
    file: File,
    path: PathBuf,
}

impl Scratch {
    /// An empty file for the output at `path`.
    ///
    /// # Errors
    /// [`Fault::Usage`] with the path and the reason.
    pub fn beside(path: &Path) -> Result<Scratch, Fault> {
        let file = match is_special(path) {
            true => tempfile::tempfile().map_err(|error| failed(path, error))?,
            false => temporary(path)?.0.into_file(),
        };
        Ok(Scratch { file, path: path.to_owned() })
    }

    /// Appends `bytes`.
    ///
    /// # Errors
    /// [`Fault::Usage`] with the path of the output and the reason.
    pub fn write(&mut self, bytes: &[u8]) -> Result<(), Fault> {
        self.file.write_all(bytes).map_err(|error| failed(&self.path, error))
    }

    /// Reads `length` bytes from `offset` on.
    ///
    /// # Errors
    /// [`Fault::Usage`] with the path of the output and the reason.
    pub fn read(&mut self, offset: u64, length: usize) -> Result<Vec<u8>, Fault> {
        let mut bytes = vec![0; length];
        let read = self.file.seek(SeekFrom::Start(offset)).and_then(|_| self.file.read_exact(&mut bytes));
        read.map_err(|error| failed(&self.path, error))?;
        Ok(bytes)
    }
}

/// A folder that is written under a temporary name until it is complete: beside its own name, which it then gets, or
/// in the empty folder that is there, to which its files then move. So that folder may be `.`, a mount point, or the
/// target of a link.
#[derive(Debug)]
pub struct OutputFolder {
    folder: TempDir,
    path: PathBuf,
    /// The end of the links from `path`.
    target: PathBuf,
}

impl OutputFolder {
    /// Begins the folder `path`, at which there is nothing or an empty folder.
    ///
    /// # Errors
    /// [`Fault::Usage`] with the path and the reason.
    pub fn begin(path: &Path) -> Result<OutputFolder, Fault> {
        // Without a separator at the end, behind which a link is not seen.
        let target = end_of_links(&path.components().collect::<PathBuf>());
        let target = target.map_err(|error| failed(path, error))?;
        if !is_free(&target).map_err(|error| failed(path, error))? {
            return Err(cannot_write(path, "there is something already, name another folder"));
        }
        let around = if target.is_dir() { &target } else { folder_of(&target) };
        if !around.is_dir() {
            return Err(cannot_write(
                path,
                format!("there is no folder {}, make it first", around.display()),
            ));
        }
        let mut builder = Builder::new();
        #[cfg(unix)]
        builder.permissions(permissions(0o777));
        let folder = builder.prefix(TEMPORARY).tempdir_in(around);
        let folder = folder.map_err(|error| failed(path, without_name(&error)))?;
        Ok(OutputFolder { folder, path: path.to_owned(), target })
    }

    /// Writes a file of this name.
    ///
    /// # Errors
    /// [`Fault::Usage`] with the file's path and the reason.
    pub fn write(&self, name: &str, bytes: &[u8]) -> Result<(), Fault> {
        std::fs::write(self.folder.path().join(name), bytes)
            .map_err(|error| failed(&self.path.join(name), error))
    }

    /// Where the folder is until it is complete, for programs that write into it.
    pub fn path(&self) -> &Path {
        self.folder.path()
    }

    /// Gives the folder its name.
    ///
    /// # Errors
    /// [`Fault::Usage`] with the path, the reason, and where the complete folder is.
    pub fn finish(self) -> Result<(), Fault> {
        let OutputFolder { folder, path, target } = self;
        // From here on nothing deletes it.
        let folder = folder.keep();
        move_folder(&folder, &target).map_err(|error| complete_elsewhere(&path, error, &folder))
    }
}

/// Moves a complete folder to `target`, or its files if there is an empty folder.
fn move_folder(folder: &Path, target: &Path) -> io::Result<()> {
    if !is_free(target)? {
        return Err(io::Error::other("there is something by now"));
    }
    if !target.is_dir() {
        return std::fs::rename(folder, target);
    }
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        std::fs::rename(entry.path(), target.join(entry.file_name()))?;
    }
    std::fs::remove_dir(folder)
}

/// Whether there is nothing at `target`, or a folder without complete files.
fn is_free(target: &Path) -> io::Result<bool> {
    if !target.is_dir() {
        return Ok(!target.exists());
    }
    for entry in target.read_dir()? {
        if !is_unfinished(&entry?.file_name().to_string_lossy()) {
            return Ok(false);
        }
    }
    Ok(true)
}

/// Whether a file of this name is of an output that a killed process did not finish.
pub fn is_unfinished(name: &str) -> bool {
    name.starts_with(TEMPORARY)
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
    #[cfg(unix)]
    let folder = file.path().parent().unwrap_or(Path::new(".")).to_owned();
    file.as_file_mut()
        .write_all(bytes)
        .and_then(|()| sync(file.as_file()))
        .map_err(|error| failed(path, error))?;
    persist(file, &target, path)?;
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
    // A path that goes on behind its last name, as "a/" does, is of a folder.
    let ends_in_name =
        |name: &OsStr| target.as_os_str().as_encoded_bytes().ends_with(name.as_encoded_bytes());
    if target.is_dir() || !target.file_name().is_some_and(ends_in_name) {
        return Err(cannot_write(path, "it is a folder, name a file"));
    }
    let folder = folder_of(&target);
    if !folder.is_dir() {
        return Err(cannot_write(path, format!("there is no folder {}, make it first", folder.display())));
    }
    Ok((temporary_in(folder, path, target.metadata().ok())?, target))
}

/// Gives a complete file its name.
fn persist(file: NamedTempFile, target: &Path, path: &Path) -> Result<(), Fault> {
    let Err(PersistError { error, file }) = file.persist(target) else { return Ok(()) };
    let (_, place) = file.keep().map_err(|error| failed(path, error.error))?;
    Err(complete_elsewhere(path, error, &place))
}

/// The folder that holds the file at `path`.
pub fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// An empty file in the folder, for an output at `path`, with the permissions of the file that it replaces.
fn temporary_in(folder: &Path, path: &Path, replaced: Option<Metadata>) -> Result<NamedTempFile, Fault> {
    let mut builder = Builder::new();
    // Other systems have no modes.
    #[cfg(not(unix))]
    let _ = replaced;
    #[cfg(unix)]
    let replaced = replaced.map(|replaced| permissions(replaced.mode() & 0o777));
    #[cfg(unix)]
    // The mode that other programs give to a new file; the user's umask still applies.
    builder.permissions(replaced.clone().unwrap_or(permissions(0o666)));
    let file =
        builder.prefix(TEMPORARY).tempfile_in(folder).map_err(|error| failed(path, without_name(&error)))?;
    #[cfg(unix)]
    if let Some(replaced) = replaced {
        // Also those that the umask takes away.
        file.as_file().set_permissions(replaced).map_err(|error| failed(path, error))?;
    }
    Ok(file)
}

#[cfg(unix)]
fn permissions(mode: u32) -> std::fs::Permissions {
    std::os::unix::fs::PermissionsExt::from_mode(mode)
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

/// The fault of an output that is complete at `place` and cannot be renamed.
fn complete_elsewhere(path: &Path, error: impl std::fmt::Display, place: &Path) -> Fault {
    cannot_write(path, format!("{error}; it is complete at {}, move it from there", place.display()))
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
    fn a_new_file_has_the_permissions_of_the_one_that_it_replaces() {
        let folder = tempfile::tempdir().unwrap();
        let [path, link] = ["a", "link"].map(|name| folder.path().join(name));
        let mode = || path.metadata().unwrap().mode() & 0o777;
        write(&path, b"old").unwrap();
        assert_ne!(mode() & 0o600, 0);
        std::os::unix::fs::symlink("a", &link).unwrap();
        for kept in [0o600, 0o640, 0o666, 0o440] {
            std::fs::set_permissions(&path, permissions(kept)).unwrap();
            write(&path, b"new").unwrap();
            assert_eq!(mode(), kept, "{kept:o}");
            write_durable(&link, b"newer").unwrap();
            assert_eq!((mode(), std::fs::read(&path).unwrap()), (kept, b"newer".to_vec()), "{kept:o}");
        }
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
        ["absent/", "absent/.", "file/"].iter().for_each(|name| usage(check(&folder.path().join(name))));
        usage(check_folder(&file));
        usage(check_folder(&file.join("a/b")));
        usage(make_folder(&file.join("a")));
    }

    #[cfg(unix)]
    #[test]
    fn a_folder_is_made_where_a_link_leads() {
        let folder = tempfile::tempdir().unwrap();
        let [link, made] = ["link", "made"].map(|name| folder.path().join(name));
        std::os::unix::fs::symlink("made", &link).unwrap();
        check_folder(&link).unwrap();
        make_folder(&link).unwrap();
        assert!(link.is_symlink() && made.is_dir());
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
    fn parts_become_a_file_or_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        let mut scratch = Scratch::beside(&path).unwrap();
        scratch.write(b"later").unwrap();
        let fill = |file: &mut OutputFile, scratch: &mut Scratch| {
            file.write(b"first ")?;
            file.write(&scratch.read(1, 4)?)
        };
        write_parts(&path, |file| fill(file, &mut scratch)).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"first ater");
        let too_far = write_parts(&path, |file| {
            fill(file, &mut scratch)?;
            scratch.read(3, 3).map(drop)
        });
        assert!(matches!(too_far, Err(Fault::Usage(_))), "{too_far:?}");
        assert_eq!(std::fs::read(&path).unwrap(), b"first ater");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_folder_is_there_when_it_is_complete() {
        let parent = tempfile::tempdir().unwrap();
        let path = parent.path().join("a");
        let count = || std::fs::read_dir(parent.path()).unwrap().count();
        let begun = OutputFolder::begin(&path).unwrap();
        begun.write("b", b"1").unwrap();
        assert!(!path.exists());
        let error = begun.write("no/b", b"1").unwrap_err().to_string();
        assert!(error.contains("a/no/b") && !error.contains(TEMPORARY), "{error}");
        drop(begun);
        assert_eq!(count(), 0);
        // An empty folder is replaced, and nothing else.
        std::fs::create_dir(&path).unwrap();
        let begun = OutputFolder::begin(&path).unwrap();
        begun.write("b", b"2").unwrap();
        begun.finish().unwrap();
        assert_eq!((std::fs::read(path.join("b")).unwrap(), count()), (b"2".to_vec(), 1));
        for taken in [path.clone(), path.join("b"), parent.path().join("no/a")] {
            assert!(matches!(OutputFolder::begin(&taken), Err(Fault::Usage(_))), "{}", taken.display());
        }
        assert_eq!(count(), 1);
    }

    #[cfg(unix)]
    #[test]
    fn an_empty_folder_stays_the_one_it_was() {
        let parent = tempfile::tempdir().unwrap();
        let path = |name: &str| parent.path().join(name);
        ["a", "b", "c"].iter().for_each(|name| std::fs::create_dir(path(name)).unwrap());
        std::os::unix::fs::symlink("b", path("link")).unwrap();
        std::os::unix::fs::symlink("new", path("dangling")).unwrap();
        for (out, end) in [("a/.", "a"), ("link/", "b"), ("c/../c", "c"), ("dangling/", "new"), ("d/.", "d")]
        {
            let before = path(end).metadata().map(|folder| folder.ino());
            // What a killed process left does not count.
            let begun = OutputFolder::begin(&path(out)).unwrap();
            let killed = OutputFolder::begin(&path(out)).unwrap().folder.keep();
            begun.write("file", b"1").unwrap();
            std::fs::create_dir(begun.path().join("folder")).unwrap();
            begun.finish().unwrap();
            std::fs::remove_dir(killed).unwrap();
            let mut names: Vec<_> =
                path(end).read_dir().unwrap().map(|entry| entry.unwrap().file_name()).collect();
            names.sort();
            assert_eq!(names, ["file", "folder"], "{out}");
            // A mount point or a working directory is as little replaced.
            assert!(before.is_err() || before.unwrap() == path(end).metadata().unwrap().ino(), "{out}");
        }
        assert!(path("link").is_symlink() && path("dangling").is_symlink());
        assert_eq!(parent.path().read_dir().unwrap().count(), 7);
    }

    #[test]
    fn what_is_complete_is_never_deleted() {
        let parent = tempfile::tempdir().unwrap();
        // What is in the way by the end, which a check before the work cannot know.
        let path = parent.path().join("a");
        let occupy = || std::fs::create_dir_all(path.join("in the way")).unwrap();
        let place = |fault: Fault| {
            let text = fault.to_string();
            let place = text.rsplit_once("it is complete at ").and_then(|(_, rest)| rest.split_once(','));
            PathBuf::from(place.expect(&text).0)
        };
        let begun = OutputFolder::begin(&path).unwrap();
        begun.write("b", b"1").unwrap();
        occupy();
        let folder = place(begun.finish().unwrap_err());
        assert_eq!(std::fs::read(folder.join("b")).unwrap(), b"1");
        std::fs::remove_dir_all(&path).unwrap();
        let written = write_parts(&path, |file| {
            occupy();
            file.write(b"2")
        });
        assert_eq!(std::fs::read(place(written.unwrap_err())).unwrap(), b"2");
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
