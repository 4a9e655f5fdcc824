//! [`Buffers`]: the bytes that accessors read.

use std::borrow::Cow;
use std::path::{Component, Path};

use base64::Engine;
use base64::prelude::BASE64_STANDARD;

use crate::limits::ImportBudget;

use super::document::{Buffer, Document};

/// The buffers of a document, in its order.
pub(super) struct Buffers<'a>(Vec<Cow<'a, [u8]>>);

impl<'a> Buffers<'a> {
    /// Loads the buffers: the binary chunk of a `.glb`, texts in base64, and files in `folder`.
    ///
    /// # Errors
    /// One sentence with the number of the buffer: it is not there, not in the folder, or shorter than announced.
    pub(super) fn load(
        document: &Document,
        binary: Option<&'a [u8]>,
        folder: &Path,
        budget: &mut ImportBudget,
    ) -> Result<Buffers<'a>, String> {
        let mut buffers = Vec::new();
        for (number, buffer) in document.buffers.iter().enumerate() {
            let bytes =
                match &buffer.uri {
                    None => Cow::Borrowed(binary.filter(|_| number == 0).ok_or_else(|| {
                        format!("glTF: buffer {number} has neither a file nor a binary chunk")
                    })?),
                    Some(uri) => Cow::Owned(
                        fetch(uri, buffer, folder, budget)
                            .map_err(|what| format!("glTF: buffer {number}: {what}"))?,
                    ),
                };
            let (announced, present) = (buffer.byte_length, bytes.len());
            if announced > present as u64 {
                return Err(format!("glTF: buffer {number} announces {announced} bytes and has {present}"));
            }
            buffers.push(bytes);
        }
        Ok(Buffers(buffers))
    }

    /// The bytes of a buffer.
    pub(super) fn get(&self, number: usize) -> Option<&[u8]> {
        self.0.get(number).map(|bytes| &**bytes)
    }
}

fn fetch(uri: &str, buffer: &Buffer, folder: &Path, budget: &mut ImportBudget) -> Result<Vec<u8>, String> {
    if let Some(data) = uri.strip_prefix("data:") {
        let (_, text) =
            data.split_once(";base64,").ok_or("its text is not in base64; export it as a .glb")?;
        budget.spend(buffer.byte_length.min(text.len() as u64))?;
        return BASE64_STANDARD.decode(text).map_err(|error| error.to_string());
    }
    let path = path_of(uri).ok_or("it is no file beside the glTF; export it as a .glb")?;
    budget.read_file(&folder.join(&path)).map_err(|what| format!("{path}: {what}"))
}

/// The path of a relative URI, without its percent-encoding; `None` if it leads out of its folder or is none.
fn path_of(uri: &str) -> Option<String> {
    let mut bytes = Vec::new();
    let mut rest = uri.bytes();
    while let Some(byte) = rest.next() {
        bytes.push(match byte {
            b'%' => {
                let mut digit = || char::from(rest.next()?).to_digit(16);
                (16 * digit()? + digit()?) as u8
            }
            byte => byte,
        });
    }
    let path = String::from_utf8(bytes).ok()?;
    let is_inside = |part: Component| matches!(part, Component::Normal(_) | Component::CurDir);
    let has_name = Path::new(&path).file_name().is_some();
    (has_name && !uri.contains(':') && Path::new(&path).components().all(is_inside)).then_some(path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uris_are_decoded_and_stay_in_their_folder() {
        for (uri, path) in [
            ("a.bin", "a.bin"),
            ("./a.bin", "./a.bin"),
            ("parts/./a.bin", "parts/./a.bin"),
            ("two%20words%2Ebin", "two words.bin"),
            ("%C3%A9.bin", "é.bin"),
        ] {
            assert_eq!(path_of(uri).as_deref(), Some(path), "{uri}");
        }
        for uri in [
            "",
            ".",
            "..",
            "../a.bin",
            "%2e%2E/a.bin",
            "a/%2e%2e/../b.bin",
            "/a.bin",
            "%2Fa.bin",
            "http://a/b.bin",
            "a%",
            "a%2",
            "a%zz.bin",
            "a%ff.bin",
        ] {
            assert_eq!(path_of(uri), None, "{uri}");
        }
    }
}
