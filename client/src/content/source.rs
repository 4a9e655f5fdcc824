//! [`TakeSource`]: the bytes of a take, read in parts.

use std::borrow::Cow;
use std::fs::{File, Metadata};
use std::io::{self, Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError, Weak};
use std::time::{Duration, Instant};

use codec::FormatError;
use program::{Fault, read_error};

use super::progress::Traffic;
#[cfg(feature = "net")]
use super::transfer::{RemoteFile, WEB_PAGE, is_web_page};

/// How long a file that takes the place of another must stay as it is to be opened: it may be a copy under way.
const SETTLED: Duration = Duration::from_secs(1);

/// Interval between looks whether it stays.
const LOOK_INTERVAL: Duration = Duration::from_millis(250);

/// Where the bytes of a take come from.
#[derive(Debug)]
pub(crate) enum TakeSource {
    /// All of it is in memory, under this name.
    Memory(String, Cow<'static, [u8]>),
    /// A file.
    File(Box<LocalFile>),
    /// A file on a server.
    #[cfg(feature = "net")]
    Remote(Arc<RemoteFile>),
}

/// The text that Git LFS leaves in place of a file, as far as files are read first.
const LFS_POINTER: &[u8] = b"version https://";

/// What such a text is, and what to do.
const LFS: &str =
    "a pointer of Git LFS and not the file itself: fetch it with `git lfs pull`, or download its raw file";

/// A file of this machine. It stays open: after a file that takes its place by renaming, it can still be read.
#[derive(Debug)]
pub(crate) struct LocalFile {
    path: PathBuf,
    file: Mutex<File>,
    opened: Version,
    /// Whether a replacement stays as it is. A thread that [`watch`]es keeps it up to date, from the first replacement on:
    /// no frame waits for the disk.
    has_settled: OnceLock<Arc<AtomicBool>>,
}

/// What tells versions of a file apart.
#[derive(Clone, Debug)]
struct Version(Metadata);

impl PartialEq for Version {
    /// Length and time of writing are the same, and so is the number of the file on systems that have one.
    fn eq(&self, other: &Version) -> bool {
        let (a, b) = (&self.0, &other.0);
        #[cfg(unix)]
        let same_file = std::os::unix::fs::MetadataExt::ino(a) == std::os::unix::fs::MetadataExt::ino(b);
        #[cfg(not(unix))]
        let same_file = true;
        same_file && a.len() == b.len() && a.modified().ok() == b.modified().ok()
    }
}

impl LocalFile {
    /// Looks whether another version is at the path.
    fn is_replaced(&self) -> bool {
        let is_replaced = replacement(&self.path, &self.opened).is_some();
        if is_replaced {
            self.has_settled.get_or_init(|| {
                let has_settled = Arc::new(AtomicBool::new(false));
                let (path, opened, told) =
                    (self.path.clone(), self.opened.clone(), Arc::downgrade(&has_settled));
                let watch = move || watch(&path, &opened, &told);
                if let Err(error) = std::thread::Builder::new().name("replacement".into()).spawn(watch) {
                    log::warn!("{}: was replaced: {error}: it plays on", self.path.display());
                }
                has_settled
            });
        }
        is_replaced
    }
}

/// The version at `path`, if it differs from the `opened` one. A deleted or renamed file has no replacement.
fn replacement(path: &Path, opened: &Version) -> Option<Version> {
    std::fs::metadata(path).ok().map(Version).filter(|now| now != opened)
}

/// Looks at `path` again and again, and tells whether a replacement stays as it is, until the file is closed.
fn watch(path: &Path, opened: &Version, told: &Weak<AtomicBool>) {
    let mut seen = Settling::default();
    while let Some(has_settled) = told.upgrade() {
        has_settled.store(seen.look(replacement(path, opened), Instant::now()), Ordering::Relaxed);
        drop(has_settled);
        std::thread::sleep(LOOK_INTERVAL);
    }
}

/// A replacement, and since when it is as it is.
#[derive(Default)]
struct Settling(Option<(Version, Instant)>);

impl Settling {
    /// Takes in what is at the path `now`; whether it has stayed for [`SETTLED`].
    fn look(&mut self, there: Option<Version>, now: Instant) -> bool {
        if self.0.as_ref().map(|(version, _)| version) != there.as_ref() {
            self.0 = there.map(|version| (version, now));
        }
        self.0.as_ref().is_some_and(|(_, since)| now - *since >= SETTLED)
    }
}

impl TakeSource {
    /// Opens a file.
    ///
    /// # Errors
    /// [`Fault::Data`] if it cannot be opened.
    pub(crate) fn open(path: &Path) -> Result<TakeSource, Fault> {
        let file = File::open(path).map_err(|error| unreadable(path, &error))?;
        let metadata = file.metadata().map_err(|error| unreadable(path, &error))?;
        Ok(TakeSource::File(Box::new(LocalFile {
            path: path.to_owned(),
            file: Mutex::new(file),
            opened: Version(metadata),
            has_settled: OnceLock::new(),
        })))
    }

    /// Name of the source for messages.
    pub(crate) fn name(&self) -> String {
        match self {
            TakeSource::Memory(name, _) => name.clone(),
            TakeSource::File(file) => file.path.display().to_string(),
            #[cfg(feature = "net")]
            TakeSource::Remote(file) => file.name(),
        }
    }

    /// Length in bytes; `None` if a server does not say, or was not asked.
    ///
    /// # Errors
    /// [`Fault::Data`] if it cannot be read.
    pub(crate) fn length(&self) -> Result<Option<u64>, Fault> {
        match self {
            TakeSource::Memory(_, bytes) => Ok(Some(bytes.len() as u64)),
            TakeSource::File(local) => {
                let LocalFile { path, file, .. } = &**local;
                let file = file.lock().unwrap_or_else(PoisonError::into_inner);
                file.metadata().map(|metadata| Some(metadata.len())).map_err(|error| unreadable(path, &error))
            }
            #[cfg(feature = "net")]
            TakeSource::Remote(file) => Ok(file.total()),
        }
    }

    /// Reads `range`; less at the end of the file.
    ///
    /// # Errors
    /// [`Fault::Data`] if it cannot be read; [`Fault::Network`] if it does not arrive.
    pub(crate) fn read(&self, range: Range<u64>) -> Result<Vec<u8>, Fault> {
        match self {
            TakeSource::Memory(_, bytes) => Ok(part(bytes, range)),
            TakeSource::File(local) => {
                let LocalFile { path, file, .. } = &**local;
                let mut file = file.lock().unwrap_or_else(PoisonError::into_inner);
                let mut bytes = Vec::new();
                file.seek(SeekFrom::Start(range.start))
                    .and_then(|_| (&mut *file).take(range.end - range.start).read_to_end(&mut bytes))
                    .map_err(|error| unreadable(path, &error))?;
                Ok(bytes)
            }
            #[cfg(feature = "net")]
            TakeSource::Remote(_) => self.read_parts(range.start, &[range.end]),
        }
    }

    /// Reads the parts that follow each other from `start` on, each up to one of `ends`; less at the end of the file.
    ///
    /// # Errors
    /// As [`TakeSource::read`].
    pub(crate) fn read_parts(&self, start: u64, ends: &[u64]) -> Result<Vec<u8>, Fault> {
        match self {
            #[cfg(feature = "net")]
            TakeSource::Remote(file) => file.read(start, ends).map_err(|fault| fault.about(&file.name())),
            _ => self.read(start..ends.last().copied().unwrap_or(start)),
        }
    }

    /// What came from a server so far.
    pub(crate) fn traffic(&self) -> Traffic {
        match self {
            #[cfg(feature = "net")]
            TakeSource::Remote(file) => file.traffic(),
            _ => Traffic::default(),
        }
    }

    /// Whether another version has replaced the file since it was opened. Asks the disk, but no server.
    pub(crate) fn is_replaced(&self) -> bool {
        match self {
            TakeSource::File(file) => file.is_replaced(),
            #[cfg(feature = "net")]
            TakeSource::Remote(file) => file.is_replaced(),
            _ => false,
        }
    }

    /// Whether the version that [`TakeSource::is_replaced`] found is complete, as far as can be told. Asks neither the disk
    /// nor a server.
    pub(crate) fn has_settled(&self) -> bool {
        match self {
            TakeSource::File(file) => {
                file.has_settled.get().is_some_and(|has_settled| has_settled.load(Ordering::Relaxed))
            }
            #[cfg(feature = "net")]
            TakeSource::Remote(file) => file.is_replaced(),
            _ => false,
        }
    }

    /// Whether it comes from a server.
    pub(crate) fn is_remote(&self) -> bool {
        match self {
            #[cfg(feature = "net")]
            TakeSource::Remote(_) => true,
            _ => false,
        }
    }

    /// Whether it comes from a server, part by part.
    pub(crate) fn has_ranges(&self) -> bool {
        match self {
            #[cfg(feature = "net")]
            TakeSource::Remote(file) => file.has_ranges(),
            _ => false,
        }
    }

    /// What to do about a damaged file.
    pub(crate) fn remedy(&self) -> &'static str {
        match self {
            TakeSource::Memory(..) | TakeSource::File(_) => "copy it again",
            #[cfg(feature = "net")]
            TakeSource::Remote(_) => "upload it again",
        }
    }

    /// Ends a read that waits for a server, and those that follow, until [`TakeSource::resume`].
    pub(crate) fn cancel(&self) {
        match self {
            #[cfg(feature = "net")]
            TakeSource::Remote(file) => file.cancel(),
            _ => {}
        }
    }

    /// Ends a read that waits for a server for good.
    pub(crate) fn close(&self) {
        match self {
            #[cfg(feature = "net")]
            TakeSource::Remote(file) => file.close(),
            _ => {}
        }
    }

    /// Takes back [`TakeSource::cancel`].
    pub(crate) fn resume(&self) {
        match self {
            #[cfg(feature = "net")]
            TakeSource::Remote(file) => file.resume(),
            _ => {}
        }
    }
}

/// What the player tells a source about the bytes that it read. Only a file on a server uses it.
#[cfg_attr(not(feature = "net"), allow(unused_variables, reason = "without servers, nothing is cached"))]
impl TakeSource {
    /// Takes in the head of the package. `is_read_on` is whether what follows it is read next.
    pub(crate) fn set_head(&self, head: &[u8], is_read_on: bool) {
        #[cfg(feature = "net")]
        if let TakeSource::Remote(file) = self {
            file.set_head(head, is_read_on);
        }
    }

    /// Takes in that the package was opened, whole or cut short.
    pub(crate) fn on_opened(&self, is_whole: bool) {
        #[cfg(feature = "net")]
        if let TakeSource::Remote(file) = self
            && is_whole
        {
            file.keep_head();
        }
    }

    /// Takes in that the parts from number `first` on were decoded, and so are right. `is_last` is whether none will
    /// follow them.
    pub(crate) fn on_decoded(&self, start: u64, ends: &[u64], first: usize, is_last: bool) {
        #[cfg(feature = "net")]
        if let TakeSource::Remote(file) = self {
            file.keep(start, ends, first, is_last);
        }
    }

    /// Takes in that parts cannot be decoded: they may be of another version, or were damaged on their way. Returns
    /// whether to read them again, once at most.
    pub(crate) fn on_undecodable(&self, start: u64, ends: &[u64]) -> bool {
        match self {
            #[cfg(feature = "net")]
            TakeSource::Remote(file) => file.on_undecodable(start, ends),
            _ => false,
        }
    }

    /// What to say of a file that begins with `head`, and is no package.
    pub(crate) fn format_reason(&self, head: &[u8]) -> String {
        if head.starts_with(LFS_POINTER) {
            return LFS.into();
        }
        let remedy = match self {
            #[cfg(feature = "net")]
            TakeSource::Remote(_) if is_web_page(head) => return WEB_PAGE.into(),
            #[cfg(feature = "net")]
            TakeSource::Remote(file) if !head.is_empty() => match is_named_as_field(file.name().as_ref()) {
                true => "URLs name packages; download a field of another program, and play the file",
                false => "name the URL of a file that aarc-studio package made, or upload it again",
            },
            TakeSource::File(file) => match is_named_as_field(&file.path) {
                true => "make one of this field with aarc-studio package",
                false => "name a file that aarc-studio package made",
            },
            _ => self.remedy(),
        };
        format!("{}: {remedy}", FormatError::Magic)
    }
}

/// Whether a file has the extension of a field of another program, in a player that may read none.
fn is_named_as_field(path: &Path) -> bool {
    const FIELDS: [&str; 8] = ["ply", "splatv", "spz", "splat", "ksplat", "sog", "glb", "gltf"];
    let extension = path.extension().and_then(|extension| extension.to_str());
    extension.is_some_and(|extension| FIELDS.iter().any(|field| extension.eq_ignore_ascii_case(field)))
}

/// The bytes of a file in `range`; fewer at its end.
fn part(bytes: &[u8], range: Range<u64>) -> Vec<u8> {
    let [start, end] = [range.start, range.end].map(|at| at.min(bytes.len() as u64) as usize);
    bytes[start..end.max(start)].to_vec()
}

fn unreadable(path: &Path, error: &io::Error) -> Fault {
    Fault::Data(format!("{}: {}", path.display(), read_error(error)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[cfg(feature = "formats")]
    fn fields_and_pointers_are_told_as_by_their_readers() {
        for extension in formats::extensions().chain(["aarc", "json", ""]) {
            let is_field = formats::extensions().any(|known| known == extension);
            assert_eq!(
                is_named_as_field(format!("https://h/a.{extension}").as_ref()),
                is_field,
                "{extension}"
            );
        }
        let source = TakeSource::Memory("a".into(), Cow::default());
        let pointer = b"version https://git-lfs.github.com/spec/v1\noid";
        assert!(formats::is_lfs_pointer(pointer) && source.format_reason(pointer) == LFS);
        assert_ne!(source.format_reason(b"version"), LFS);
    }

    #[test]
    fn parts_are_read_and_the_end_is_short() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        std::fs::write(&path, b"0123456789").unwrap();
        let source = TakeSource::open(&path).unwrap();
        assert_eq!(source.length().unwrap(), Some(10));
        for (range, bytes) in
            [(0..4, &b"0123"[..]), (7..9, b"78"), (8..20, b"89"), (30..40, b""), (3..3, b"")]
        {
            assert_eq!(source.read(range).unwrap(), bytes);
        }
        assert!(!source.is_replaced() && !source.has_settled());
        // A file that takes its place is another one.
        std::fs::write(folder.path().join("b"), b"abcdefghijk").unwrap();
        std::fs::rename(folder.path().join("b"), &path).unwrap();
        assert_eq!((source.read(0..2).unwrap(), source.length().unwrap()), (b"01".to_vec(), Some(10)));
        assert!(source.is_replaced());
        let eventually = |expected: bool| {
            let start = Instant::now();
            while source.has_settled() != expected {
                assert!(start.elapsed().as_secs() < 60, "{expected} never comes");
                std::thread::sleep(Duration::from_millis(10));
            }
            start.elapsed()
        };
        assert!(eventually(true) > SETTLED / 2, "it may be a copy under way");
        std::fs::remove_file(&path).unwrap();
        assert!(!source.is_replaced(), "what was deleted plays on");
        eventually(false);
        let missing = TakeSource::open(&folder.path().join("c")).unwrap_err();
        assert!(missing.to_string().contains("c: "), "{missing}");
    }

    #[test]
    fn a_copy_under_way_has_not_settled() {
        let folder = tempfile::tempdir().unwrap();
        let version = |bytes: &[u8]| {
            let path = folder.path().join("a");
            std::fs::write(&path, bytes).unwrap();
            Some(Version(std::fs::metadata(path).unwrap()))
        };
        let (short, long) = (version(b"a"), version(b"ab"));
        let mut settling = Settling::default();
        let start = Instant::now();
        let mut look =
            |there: &Option<Version>, at: f32| settling.look(there.clone(), start + SETTLED.mul_f32(at));
        assert_eq!([look(&short, 0.0), look(&short, 0.9), look(&long, 1.1), look(&long, 2.0)], [false; 4]);
        assert!(look(&long, 2.2));
        assert!(!look(&None, 2.3) && !look(&long, 9.0), "another one begins anew");
    }
}
