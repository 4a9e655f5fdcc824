//! The container `.glb`: [`chunks`] reads its chunks, [`file()`] writes them.

/// The first bytes of a file.
pub(crate) const START: [u8; 4] = *b"glTF";

const VERSION: u32 = 2;

/// Bytes of the header: start, version, length of the file.
const HEADER: usize = 12;

/// Bytes before the content of a chunk: its length and its type.
const CHUNK_HEADER: usize = 8;

/// Types of chunks.
const JSON: u32 = u32::from_le_bytes(*b"JSON");
const BINARY: u32 = u32::from_le_bytes(*b"BIN\0");

/// The JSON of a `.glb`, and its binary chunk if there is one.
///
/// # Errors
/// One sentence: another version, a length beyond the end of the file, no JSON.
pub(super) fn chunks(bytes: &[u8]) -> Result<(&[u8], Option<&[u8]>), String> {
    let word =
        |at: usize| bytes.get(at..at + 4).map(|word| u32::from_le_bytes(std::array::from_fn(|k| word[k])));
    let (Some(version), Some(length)) = (word(4), word(8)) else {
        return Err(format!("GLB of {} bytes, and its header has {HEADER}", bytes.len()));
    };
    if version != VERSION {
        return Err(format!("GLB of version {version}, and {VERSION} is read; export it as that"));
    }
    let (length, present) = (length as usize, bytes.len());
    if length > present {
        return Err(format!("truncated GLB: the header announces {length} bytes and the file has {present}"));
    }
    let (mut json, mut binary) = (None, None);
    let mut at = HEADER;
    while at < length {
        let (Some(size), Some(kind)) = (word(at), word(at + 4)) else { break };
        let start = at + CHUNK_HEADER;
        let end = start.saturating_add(size as usize);
        let Some(content) = bytes.get(start..end).filter(|_| end <= length) else {
            let left = length.saturating_sub(start);
            return Err(format!("GLB: the chunk at byte {at} announces {size} bytes and {left} follow"));
        };
        match kind {
            JSON => _ = json.get_or_insert(content),
            BINARY => _ = binary.get_or_insert(content),
            // Readers skip chunks of other types.
            _ => {}
        }
        at = end;
    }
    let json = json.ok_or("GLB without a JSON chunk")?;
    Ok((json, binary))
}

/// A file of a JSON and a binary chunk, whose length is a multiple of 4; `None` beyond the 4 GiB of the format.
pub(super) fn file(mut json: Vec<u8>, binary: &[u8]) -> Option<Vec<u8>> {
    json.resize(json.len().next_multiple_of(4), b' ');
    let length = u32::try_from(HEADER + 2 * CHUNK_HEADER + json.len() + binary.len()).ok()?;
    let mut file = Vec::with_capacity(length as usize);
    file.extend(START);
    file.extend(VERSION.to_le_bytes());
    file.extend(length.to_le_bytes());
    for (kind, content) in [(JSON, &json[..]), (BINARY, binary)] {
        file.extend((content.len() as u32).to_le_bytes());
        file.extend(kind.to_le_bytes());
        file.extend(content);
    }
    Some(file)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lying_file(length: u32, chunks: &[(u32, &[u8; 4], &[u8])]) -> Vec<u8> {
        let mut bytes = [&START[..], &VERSION.to_le_bytes(), &length.to_le_bytes()].concat();
        for (size, kind, content) in chunks {
            bytes.extend([&size.to_le_bytes()[..], *kind, content].concat());
        }
        bytes
    }

    #[test]
    fn lengths_that_lie_are_refused() {
        let good = file(b"{}".to_vec(), &[1, 2, 3, 4]).unwrap();
        assert_eq!(chunks(&good).unwrap(), (&b"{}  "[..], Some(&[1, 2, 3, 4][..])));
        let error = |bytes: &[u8]| chunks(bytes).unwrap_err();
        assert!(error(&good[..10]).contains("header has 12"));
        assert!(error(&good[..30]).contains("announces 36 bytes and the file has 30"));
        let lies = lying_file(24, &[(u32::MAX, b"JSON", b"{}  ")]);
        assert_eq!(error(&lies), "GLB: the chunk at byte 12 announces 4294967295 bytes and 4 follow");
        assert!(error(&lying_file(24, &[(4, b"BIN\0", b"{}  ")])).contains("without a JSON chunk"));
        let mut first = good;
        first[4] = 1;
        assert!(error(&first).contains("version 1"));
    }
}
