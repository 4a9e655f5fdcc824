//! [`Cache`]: downloaded files on disk, which play again without the network.
//!
//! An entry is one file, named by the SHA-256 of its key, which begins with a URL: the SHA-256 of the layout's name and the rest, the
//! version (`ETag`) and the base URL, each after its length as a 16-bit number, and the downloaded bytes. It is
//! written under another name and renamed, so several players can share a folder. Reading an entry renews its
//! date; the entries with the oldest dates are removed when the folder exceeds its limit. A date in the
//! future, of a clock that was wrong, is set to the present. The folder is listed when what was written since the last
//! listing may exceed the limit, and after a minute, since other players write, too.

use std::fs::{self, File};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant, SystemTime};

use sha2::{Digest, Sha256};
use tempfile::Builder;

use crate::content::digest;

/// Size limit of the cache in bytes.
pub const CACHE_BYTES: u64 = 512 << 20;

/// Extensions of entries, and of files being written.
const ENTRY: &str = "clip";
const WRITING: &str = "part";

/// Bytes of a checksum.
const SUM_BYTES: usize = 32;

/// The name of the layout of entries. Entries of another layout count as damaged.
const LAYOUT: &[u8] = b"aarc cache 2";

/// Age at which a file being written counts as left behind by a player that ended.
const STALE_AFTER: Duration = Duration::from_secs(3600);

/// How long a listing of the folder counts, for what other players write.
const LISTED_FOR: Duration = Duration::from_secs(60);

/// Part of the limit that a listing makes free where it removes entries: a full folder of pieces is not listed for each.
const FREED_PART: u64 = 16;

/// A cached file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct CachedFile {
    /// The server's name of the version; empty if it has none.
    pub(super) etag: String,
    /// Its URL, where redirects led, without secrets: what it names is relative to that.
    pub(super) base: String,
    pub(super) bytes: Vec<u8>,
}

/// A folder of downloaded files.
#[derive(Clone, Debug)]
pub struct Cache {
    folder: PathBuf,
    max_bytes: u64,
    /// The latest listing of the folder, and the bytes that had room then and were not written since.
    listed: Arc<Mutex<Option<(Instant, u64)>>>,
}

impl Cache {
    /// A cache of at most `max_bytes` bytes in `folder`, which the first entry creates.
    pub fn new(folder: &Path, max_bytes: u64) -> Cache {
        Cache { folder: folder.into(), max_bytes, listed: Arc::default() }
    }

    /// The cached file of `key`. Removes a damaged entry.
    pub(super) fn get(&self, key: &str) -> Option<CachedFile> {
        let path = self.path(key);
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
            self.remove(key);
        }
        entry
    }

    /// Caches a file, unless it exceeds the limit of the whole cache. Logs a failure, with the `name` of the file: it is
    /// used without.
    pub(super) fn store(&self, key: &str, file: &CachedFile, name: &str) {
        if let Err(error) = self.put(key, file) {
            log::warn!("{name}: cannot be cached: {error}");
        }
    }

    fn put(&self, key: &str, file: &CachedFile) -> io::Result<()> {
        let length = |text: &str| u16::try_from(text.len()).map(u16::to_le_bytes);
        let (Ok(etag_length), Ok(base_length)) = (length(&file.etag), length(&file.base)) else {
            return Ok(());
        };
        let parts = [&etag_length[..], file.etag.as_bytes(), &base_length, file.base.as_bytes(), &file.bytes];
        let bytes = SUM_BYTES + parts.iter().map(|part| part.len()).sum::<usize>();
        if bytes as u64 > self.max_bytes {
            return Ok(());
        }
        fs::create_dir_all(&self.folder)?;
        let path = self.path(key);
        self.make_room(bytes as u64, &path)?;
        let mut file = Builder::new().suffix(&format!(".{WRITING}")).tempfile_in(&self.folder)?;
        file.write_all(&sum(&parts))?;
        for part in parts {
            file.write_all(part)?;
        }
        file.persist(path).map_err(|error| error.error)?;
        Ok(())
    }

    /// Removes the entry of `key`.
    pub(super) fn remove(&self, key: &str) {
        let path = self.path(key);
        match fs::remove_file(&path) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => {
                log::warn!("{}: {error}", path.display());
            }
            _ => {}
        }
    }

    /// The folder.
    pub(super) fn folder(&self) -> &Path {
        &self.folder
    }

    fn path(&self, key: &str) -> PathBuf {
        self.folder.join(digest(key)).with_extension(ENTRY)
    }

    /// Makes room for an entry of `bytes`. Does not count the entry `replaced` where it lists the folder.
    fn make_room(&self, bytes: u64, replaced: &Path) -> io::Result<()> {
        let mut listed = self.listed.lock().unwrap_or_else(PoisonError::into_inner);
        let (at, room) = match *listed {
            Some((at, room)) if at.elapsed() < LISTED_FOR && room >= bytes => (at, room),
            _ => (Instant::now(), self.free(bytes, replaced)?),
        };
        *listed = Some((at, room.saturating_sub(bytes)));
        Ok(())
    }

    /// Removes the entries read longest ago if `bytes` do not fit, until there is more room than that. Returns the bytes
    /// that fit. Does not count the entry `replaced`.
    fn free(&self, bytes: u64, replaced: &Path) -> io::Result<u64> {
        let now = SystemTime::now();
        let mut entries = Vec::new();
        for file in self.folder.read_dir()? {
            let path = file?.path();
            // Another player may have removed it.
            let Ok(metadata) = path.metadata() else { continue };
            let mut used = metadata.modified().unwrap_or(SystemTime::UNIX_EPOCH);
            let ends_in = |ending: &str| path.extension().is_some_and(|end| end == ending);
            if path == replaced || !(ends_in(ENTRY) || ends_in(WRITING)) {
                continue;
            }
            if used > now {
                // On disk, so that it ages from now on.
                set_date(&path, now);
                used = now;
            }
            if ends_in(ENTRY) {
                entries.push((used, metadata.len(), path));
            } else if now.duration_since(used).is_ok_and(|age| age > STALE_AFTER) {
                let _ = fs::remove_file(path);
            }
        }
        let mut total: u64 = entries.iter().map(|(_, bytes, _)| bytes).sum();
        if total + bytes > self.max_bytes {
            let most = self.max_bytes - self.max_bytes / FREED_PART;
            entries.sort();
            for (_, size, path) in entries {
                if total + bytes <= most {
                    break;
                }
                match fs::remove_file(path) {
                    Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
                    _ => total -= size,
                }
            }
        }
        Ok(self.max_bytes.saturating_sub(total))
    }
}

/// Reads the first `max_bytes` bytes of a file and renews its date.
fn read(path: &Path, max_bytes: u64) -> io::Result<Vec<u8>> {
    let mut file = File::open(path)?;
    let mut bytes = Vec::new();
    Read::by_ref(&mut file).take(max_bytes).read_to_end(&mut bytes)?;
    set_date(path, SystemTime::now());
    Ok(bytes)
}

/// Sets the date of a file. If that fails, it is removed earlier or later than it should be.
fn set_date(path: &Path, date: SystemTime) {
    let _ = File::options().append(true).open(path).and_then(|file| file.set_modified(date));
}

/// Parses an entry; `None` if its checksum differs.
fn parse(mut bytes: Vec<u8>) -> Option<CachedFile> {
    let (stored, rest) = bytes.split_at_checked(SUM_BYTES)?;
    if stored != sum(&[rest]) {
        return None;
    }
    let (etag, rest) = text(rest)?;
    let (base, rest) = text(rest)?;
    let at = bytes.len() - rest.len();
    Some(CachedFile { etag, base, bytes: bytes.split_off(at) })
}

/// A text after its length, and the rest.
fn text(bytes: &[u8]) -> Option<(String, &[u8])> {
    let (length, rest) = bytes.split_first_chunk()?;
    let (text, rest) = rest.split_at_checked(u16::from_le_bytes(*length).into())?;
    Some((String::from_utf8(text.to_vec()).ok()?, rest))
}

fn sum(parts: &[&[u8]]) -> [u8; SUM_BYTES] {
    let mut sum = Sha256::new_with_prefix(LAYOUT);
    parts.iter().for_each(|part| sum.update(part));
    sum.finalize().into()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A file of the version `etag`.
    fn file(etag: &str, bytes: &[u8]) -> CachedFile {
        CachedFile { etag: etag.into(), base: "http://h/a".into(), bytes: bytes.to_vec() }
    }

    fn cached(cache: &Cache, urls: &[&str]) -> Vec<bool> {
        urls.iter().map(|url| cache.path(url).exists()).collect()
    }

    #[test]
    fn a_new_entry_replaces_the_old_one() {
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::new(&folder.path().join("a/b"), 1000);
        assert_eq!(cache.get("u"), None);
        for (etag, bytes) in [("\"1\"", &b"old"[..]), ("", b""), ("\"2\"", b"new")] {
            cache.put("u", &file(etag, bytes)).unwrap();
            assert_eq!(cache.get("u"), Some(file(etag, bytes)));
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
        cache.put("u", &file("\"1\"", b"package")).unwrap();
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
            cache.put(url, &file("", &[0; 250])).unwrap();
            set_age(url, age);
        }
        assert!(cache.get("a").is_some());
        cache.put("d", &file("", &[0; 250])).unwrap();
        assert_eq!(cached(&cache, &["a", "b", "c", "d"]), [true, false, true, true]);
        cache.put("e", &file("", &[0; 1000])).unwrap();
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
    fn an_entry_may_be_as_large_as_the_limit() {
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::new(folder.path(), 1000);
        cache.put("empty", &file("", b"")).unwrap();
        let overhead = cache.path("empty").metadata().unwrap().len() as usize;
        for (bytes, is_cached) in [(1000, true), (1001, false)] {
            let file = file("", &vec![0; bytes - overhead]);
            cache.remove("u");
            cache.put("u", &file).unwrap();
            assert_eq!(cache.get("u"), is_cached.then_some(file), "{bytes} bytes");
        }
    }

    #[test]
    fn after_a_clock_was_set_the_entries_read_last_stay() {
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::new(folder.path(), 1000);
        let (now, year) = (SystemTime::now(), Duration::from_secs(365 * 24 * 3600));
        let put = |url: &str, date| {
            cache.put(url, &file("", &[0; 250])).unwrap();
            set_date(&cache.path(url), date);
        };
        put("past", SystemTime::UNIX_EPOCH);
        put("future", now + year);
        put("recent", now - Duration::from_secs(10));
        put("a", now);
        let all = ["past", "future", "recent", "a", "b"];
        assert_eq!(cached(&cache, &all), [false, true, true, true, false], "the oldest date goes");
        // What lay in the future was as if read at the first look, and ages since.
        let date = cache.path("future").metadata().unwrap().modified().unwrap();
        assert!(date >= now && date <= SystemTime::now(), "{date:?}");
        for url in ["recent", "a"] {
            assert!(cache.get(url).is_some());
        }
        put("b", now);
        assert_eq!(cached(&cache, &all), [false, false, true, true, true]);
    }

    #[test]
    fn files_left_behind_are_removed_and_other_files_stay() {
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::new(folder.path(), 1000);
        let write = |name: &str, age| {
            let file = File::create(folder.path().join(name)).unwrap();
            file.set_modified(SystemTime::now() - Duration::from_secs(age)).unwrap();
        };
        let path = |name: &str| folder.path().join(name);
        write("old.part", 2 * STALE_AFTER.as_secs());
        write("new.part", 1);
        write("someone.else", 2 * STALE_AFTER.as_secs());
        write("wrong.part", 1);
        set_date(&path("wrong.part"), SystemTime::now() + 2 * STALE_AFTER);
        cache.put("u", &file("", b"")).unwrap();
        let exists = ["old.part", "new.part", "someone.else", "wrong.part"].map(|name| path(name).exists());
        assert_eq!(exists, [false, true, true, true]);
        let date = path("wrong.part").metadata().unwrap().modified().unwrap();
        assert!(date <= SystemTime::now(), "another player may be writing it, but not for ever");
    }

    #[test]
    fn the_folder_is_listed_when_it_may_be_full_and_once_in_a_while() {
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::new(folder.path(), 10_000);
        let left_behind = folder.path().join("old.part");
        // A listing removes what was left behind.
        let lists = |bytes: usize| {
            File::create(&left_behind).unwrap().set_modified(SystemTime::UNIX_EPOCH).unwrap();
            cache.put(&bytes.to_string(), &file("", &vec![0; bytes])).unwrap();
            !left_behind.exists()
        };
        // Each takes 46 bytes more.
        assert_eq!([3000, 3001, 3002].map(lists), [true, false, false]);
        assert_eq!([900, 901, 500, 501].map(lists), [true, false, false, false], "one of 3000 bytes went");
        *cache.listed.lock().unwrap() = Instant::now().checked_sub(LISTED_FOR).map(|at| (at, 10_000));
        assert_eq!([1, 2].map(lists), [true, false], "another player may have written");
    }

    #[test]
    fn a_folder_that_cannot_be_created_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("file"), "").unwrap();
        let cache = Cache::new(&folder.path().join("file"), 1000);
        assert!(cache.put("u", &file("", b"")).is_err());
        assert_eq!(cache.get("u"), None);
    }
}
