//! Splits the bytes of an input into a kind and parts.

/// Splits off the kind, below `kinds`.
pub(crate) fn split_kind(bytes: &[u8], kinds: u8) -> Option<(u8, &[u8])> {
    let (kind, rest) = bytes.split_first()?;
    Some((kind % kinds, rest))
}

/// Splits off a first part, whose length is the first two bytes.
pub(crate) fn split(bytes: &[u8]) -> (&[u8], &[u8]) {
    let Some((length, rest)) = bytes.split_first_chunk::<2>() else { return (bytes, &[]) };
    rest.split_at(usize::from(u16::from_le_bytes(*length)).min(rest.len()))
}

/// The inverse of [`split`].
pub(crate) fn join(first: &[u8], second: &[u8]) -> Vec<u8> {
    let length = u16::try_from(first.len()).expect("seeds are small");
    [&length.to_le_bytes()[..], first, second].concat()
}
