//! Files that are text where a binary field is expected: pointers of Git LFS, error pages, byte order marks.

/// The byte order mark that some editors put before UTF-8.
pub(crate) const MARK: &[u8] = b"\xef\xbb\xbf";

/// The first bytes of a text that Git LFS leaves in place of a file.
const POINTER: &[u8] = b"version https://git-lfs.github.com/spec/";

/// Bytes that are looked at.
const START_BYTES: usize = 512;

/// Characters of a message.
const SHOWN: usize = 60;

/// Whether a text begins with a byte order mark.
pub(crate) fn has_mark(bytes: &[u8]) -> bool {
    bytes.starts_with(MARK)
}

/// Whether a file that begins so is a pointer of Git LFS.
pub fn is_lfs_pointer(bytes: &[u8]) -> bool {
    bytes.starts_with(POINTER)
}

/// The sentence on a pointer of Git LFS; `None` for another file.
pub(crate) fn large_file(bytes: &[u8]) -> Option<String> {
    let what = "a pointer of Git LFS and not the file itself; fetch it with `git lfs pull`, or download it by its raw link";
    is_lfs_pointer(bytes).then(|| what.into())
}

/// Whether a file begins as a text.
pub(crate) fn is_text(bytes: &[u8]) -> bool {
    bytes.len() > MARK.len() && start_of_text(bytes).is_some()
}

/// The beginning of a text.
pub(crate) fn start(bytes: &[u8]) -> String {
    start_of_text(bytes).unwrap_or_default().trim().chars().take(SHOWN).collect()
}

fn start_of_text(bytes: &[u8]) -> Option<&str> {
    let bytes = &bytes[..bytes.len().min(START_BYTES)];
    let text = match std::str::from_utf8(bytes) {
        Ok(text) => text,
        // A character may be cut.
        Err(error) if bytes.len() - error.valid_up_to() < 4 => {
            std::str::from_utf8(&bytes[..error.valid_up_to()]).ok()?
        }
        Err(_) => return None,
    };
    let is_of_text = |c: char| !c.is_control() || c.is_ascii_whitespace();
    text.chars().all(is_of_text).then_some(text)
}
