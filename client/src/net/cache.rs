//! [`Cache`]: downloaded files on disk, which play again without the network.
//!
//! An entry is one file, named by the SHA-256 of its URL: the SHA-256 of the rest, the length of the
//! version as a 16-bit number, the version (`ETag`), and the downloaded bytes. It is written under another
//! name and renamed, so several players can share a folder. Reading an entry renews its date; the entries
//! with the oldest dates are removed when the folder exceeds its limit.

use std::fs::{self, File};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use sha2::{Digest, Sha256};
use tempfile::Builder;

/// Size limit of the cache in bytes.
pub const CACHE_BYTES: u64 = 512 << 20;

/// Extensions of entries, and of files being written.
const ENTRY: &str = "clip";
const WRITING: &str = "part";

/// Bytes of a checksum, and of the part before the version: checksum and length of the version.
const SUM_BYTES: usize = 32;
const PREFIX_BYTES: usize = SUM_BYTES + 2;

/// Age at which a file being written counts as left behind by a player that ended.
const STALE_AFTER: Duration = Duration::from_secs(3600);

/// A cached file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct CachedFile {
    /// The server's name of the version; empty if it has none.
    pub(super) etag: String,
    pub(super) bytes: Vec<u8>,
}

/// A folder of downloaded files.
#[derive(Clone, Debug)]
pub struct Cache {
    folder: PathBuf,
    max_bytes: u64,
}

impl Cache {
    /// A cache of at most `max_bytes` bytes in `folder`, which the first entry creates.
    pub fn new(folder: &Path, max_bytes: u64) -> Cache {
        Cache { folder: folder.into(), max_bytes }
    }

    /// The cached file of `url`. Removes a damaged entry.
    pub(super) fn get(&self, url: &str) -> Option<CachedFile> {
        let path = self.path(url);
        let bytes = match read(&path, self.max_bytes) {
            Ok(bytes) => bytes,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return None,
            Err(error) => {
                log::warn!("{}: {error}", path.display());
                return None;
            }
        };
        let entry = parse(bytes);
        if entry.is_none() {
            log::warn!("{}: damaged: the file is fetched again", path.display());
            self.remove(url);
        }
        entry
    }

    /// Caches the file at `url`, unless it exceeds the limit of the whole cache.
    ///
    /// # Errors
    /// If it cannot be written.
    pub(super) fn put(&self, url: &str, etag: &str, file: &[u8]) -> io::Result<()> {
        let version = etag.as_bytes();
        let bytes = (PREFIX_BYTES + version.len() + file.len()) as u64;
        let Ok(length) = u16::try_from(version.len()) else { return Ok(()) };
        if bytes > self.max_bytes {
            return Ok(());
        }
        let parts = [&length.to_le_bytes()[..], version, file];
        fs::create_dir_all(&self.folder)?;
        let path = self.path(url);
        self.make_room(bytes, &path)?;
        let mut file = Builder::new().suffix(&format!(".{WRITING}")).tempfile_in(&self.folder)?;
        file.write_all(&sum(&parts))?;
        for part in parts {
            file.write_all(part)?;
        }
        file.persist(path).map_err(|error| error.error)?;
        Ok(())
    }

    /// Removes the entry of `url`.
    pub(super) fn remove(&self, url: &str) {
        let path = self.path(url);
        match fs::remove_file(&path) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => {
                log::warn!("{}: {error}", path.display());
            }
            _ => {}
        }
    }

    fn path(&self, url: &str) -> PathBuf {
        let name: String = Sha256::digest(url).iter().map(|byte| format!("{byte:02x}")).collect();
        self.folder.join(name).with_extension(ENTRY)
    }

    /// Removes the entries read longest ago until `bytes` fit. Does not count the entry `replaced`.
    fn make_room(&self, bytes: u64, replaced: &Path) -> io::Result<()> {
        let now = SystemTime::now();
        let mut entries = Vec::new();
        for file in self.folder.read_dir()? {
            let path = file?.path();
            // Another player may have removed it.
            let Ok(metadata) = path.metadata() else { continue };
            let used = metadata.modified().unwrap_or(SystemTime::UNIX_EPOCH);
            let ends_in = |ending: &str| path.extension().is_some_and(|end| end == ending);
            if path == replaced {
                continue;
            }
            if ends_in(ENTRY) {
                entries.push((used, metadata.len(), path));
            } else if ends_in(WRITING) && now.duration_since(used).is_ok_and(|age| age > STALE_AFTER) {
                let _ = fs::remove_file(path);
            }
        }
        entries.sort();
        let mut total: u64 = entries.iter().map(|(_, bytes, _)| bytes).sum();
        for (_, size, path) in entries {
            if total + bytes <= self.max_bytes {
                break;
            }
            match fs::remove_file(path) {
                Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
                _ => total -= size,
            }
        }
        Ok(())
    }
}

/// Reads the first `max_bytes` bytes of a file and renews its date.
fn read(path: &Path, max_bytes: u64) -> io::Result<Vec<u8>> {
    let mut file = File::open(path)?;
    let mut bytes = Vec::new();
    Read::by_ref(&mut file).take(max_bytes).read_to_end(&mut bytes)?;
    // On failure the entry is removed earlier than it should be.
    let _ = File::options().append(true).open(path).and_then(|file| file.set_modified(SystemTime::now()));
    Ok(bytes)
}

/// Parses an entry; `None` if its checksum differs.
fn parse(mut bytes: Vec<u8>) -> Option<CachedFile> {
    let (stored, rest) = bytes.split_at_checked(SUM_BYTES)?;
    if stored != sum(&[rest]) {
        return None;
    }
    let (length, rest) = rest.split_at_checked(PREFIX_BYTES - SUM_BYTES)?;
    let length = usize::from(u16::from_le_bytes(length.try_into().ok()?));
    let etag = String::from_utf8(rest.get(..length)?.to_vec()).ok()?;
    Some(CachedFile { etag, bytes: bytes.split_off(PREFIX_BYTES + length) })
}

fn sum(parts: &[&[u8]]) -> [u8; SUM_BYTES] {
    let mut sum = Sha256::new();
    parts.iter().for_each(|part| sum.update(part));
    sum.finalize().into()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cached(cache: &Cache, urls: &[&str]) -> Vec<bool> {
        urls.iter().map(|url| cache.path(url).exists()).collect()
    }

    #[test]
    fn a_new_entry_replaces_the_old_one() {
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::new(&folder.path().join("a/b"), 1000);
        assert_eq!(cache.get("u"), None);
        for (etag, bytes) in [("\"1\"", &b"old"[..]), ("", b""), ("\"2\"", b"new")] {
            cache.put("u", etag, bytes).unwrap();
            assert_eq!(cache.get("u"), Some(CachedFile { etag: etag.into(), bytes: bytes.to_vec() }));
        }
        assert_eq!(cache.get("v"), None);
        assert_eq!(cache.folder.read_dir().unwrap().count(), 1, "nothing else is left");
        cache.remove("u");
        cache.remove("u");
        assert_eq!(cache.get("u"), None);
    }

    #[test]
    fn flipped_bits_and_truncations_are_detected_and_remove_the_entry() {
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::new(folder.path(), 1000);
        cache.put("u", "\"1\"", b"package").unwrap();
        let path = cache.path("u");
        let whole = fs::read(&path).unwrap();
        let flipped = (0..whole.len() * 8).map(|bit| {
            let mut bytes = whole.clone();
            bytes[bit / 8] ^= 1 << (bit % 8);
            bytes
        });
        let truncated = (0..whole.len()).map(|length| whole[..length].to_vec());
        for bytes in flipped.chain(truncated) {
            fs::write(&path, &bytes).unwrap();
            assert_eq!(cache.get("u"), None);
            assert!(!path.exists());
        }
    }

    #[test]
    fn the_limit_holds_and_entries_read_last_stay() {
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::new(folder.path(), 1000);
        let set_age = |url: &str, seconds| {
            let file = File::options().append(true).open(cache.path(url)).unwrap();
            file.set_modified(SystemTime::now() - Duration::from_secs(seconds)).unwrap();
        };
        for (age, url) in [(30, "a"), (20, "b"), (10, "c")] {
            cache.put(url, "", &[0; 250]).unwrap();
            set_age(url, age);
        }
        assert!(cache.get("a").is_some());
        cache.put("d", "", &[0; 250]).unwrap();
        assert_eq!(cached(&cache, &["a", "b", "c", "d"]), [true, false, true, true]);
        cache.put("e", "", &[0; 1000]).unwrap();
        assert_eq!(
            cached(&cache, &["a", "c", "d", "e"]),
            [true, true, true, false],
            "larger than the folder"
        );
        let bytes: u64 =
            folder.path().read_dir().unwrap().map(|file| file.unwrap().metadata().unwrap().len()).sum();
        assert!(bytes <= 1000, "{bytes}");
    }

    #[test]
    fn a_clock_set_to_another_year_removes_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::new(folder.path(), 1000);
        let year = Duration::from_secs(365 * 24 * 3600);
        let times = [SystemTime::UNIX_EPOCH, SystemTime::now() - year, SystemTime::now() + year];
        for (i, time) in times.into_iter().enumerate() {
            let url = i.to_string();
            cache.put(&url, "", &[i as u8; 200]).unwrap();
            File::options().append(true).open(cache.path(&url)).unwrap().set_modified(time).unwrap();
        }
        File::create(folder.path().join("new.part")).unwrap().set_modified(times[2]).unwrap();
        cache.put("another", "", &[9; 200]).unwrap();
        assert_eq!(cached(&cache, &["0", "1", "2", "another"]), [true; 4]);
        for i in 0..times.len() {
            assert_eq!(cache.get(&i.to_string()).unwrap().bytes, [i as u8; 200]);
        }
        assert!(folder.path().join("new.part").exists(), "another player may be writing it");
    }

    #[test]
    fn files_left_behind_are_removed_and_other_files_stay() {
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::new(folder.path(), 1000);
        let file = |name: &str, age| {
            let file = File::create(folder.path().join(name)).unwrap();
            file.set_modified(SystemTime::now() - Duration::from_secs(age)).unwrap();
        };
        file("old.part", 2 * STALE_AFTER.as_secs());
        file("new.part", 1);
        file("someone.else", 2 * STALE_AFTER.as_secs());
        cache.put("u", "", b"").unwrap();
        let exists = ["old.part", "new.part", "someone.else"].map(|name| folder.path().join(name).exists());
        assert_eq!(exists, [false, true, true]);
    }

    #[test]
    fn a_folder_that_cannot_be_created_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("file"), "").unwrap();
        let cache = Cache::new(&folder.path().join("file"), 1000);
        assert!(cache.put("u", "", b"").is_err());
        assert_eq!(cache.get("u"), None);
    }
}
