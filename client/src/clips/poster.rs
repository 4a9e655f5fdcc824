//! [`poster_of`]: the poster of a file, the time and view that stand for it, without reading all of it.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use codec::{Error, FormatError, Limits, Poster};

/// Length of the first read. Most heads are shorter.
const FIRST_READ_BYTES: usize = 64 << 10;

/// The poster of a package on disk. `None` where it has none, or it is damaged: the first viewpoint at time 0 then
/// stands for the clip.
pub(crate) fn poster_of(path: &Path, limits: &Limits) -> Option<Poster> {
    let mut file = File::open(path).ok()?;
    let mut start = Vec::new();
    let mut wanted = FIRST_READ_BYTES;
    loop {
        let more = (wanted - start.len()) as u64;
        let read = (&mut file).take(more).read_to_end(&mut start).ok()?;
        match codec::poster(&start, limits) {
            Ok(poster) => return poster,
            // The file has more than was read.
            Err(Error::Format { error: FormatError::Truncated { needed, .. }, .. })
                if read as u64 == more && wanted < limits.max_bytes =>
            {
                wanted = needed.max(2 * wanted).min(limits.max_bytes);
            }
            Err(_) => return None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DEMO: &[u8] = include_bytes!("../../../assets/demo.aarc");

    #[test]
    fn the_poster_of_a_file_is_found_and_what_is_no_package_has_none() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.aarc");
        let limits = Limits::default();
        assert_eq!(poster_of(&path, &limits), None);
        for bytes in [&b"nothing"[..], DEMO, &DEMO[..100]] {
            std::fs::write(&path, bytes).unwrap();
            assert_eq!(poster_of(&path, &limits), None);
        }
        let poster = Poster { time_s: 1.5, position: [0.0, 1.0, 3.0], target: [0.0, 1.0, 0.0], fov_y: 0.7 };
        std::fs::write(&path, codec::with_poster(DEMO, Some(&poster), &limits).unwrap()).unwrap();
        assert_eq!(poster_of(&path, &limits), Some(poster));
        let few = Limits { max_bytes: 100, ..limits };
        assert_eq!(poster_of(&path, &few), None, "reading is bounded");
    }
}
