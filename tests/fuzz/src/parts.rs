//! Inputs that are made of a kind and several parts, as bytes.

/// The kind, below `kinds`, and the rest.
pub(crate) fn kind(bytes: &[u8], kinds: u8) -> Option<(u8, &[u8])> {
    let (kind, rest) = bytes.split_first()?;
    Some((kind % kinds, rest))
}

/// Two parts: two bytes say how long the first one is.
pub(crate) fn two(bytes: &[u8]) -> (&[u8], &[u8]) {
    let Some((length, rest)) = bytes.split_first_chunk::<2>() else { return (bytes, &[]) };
    rest.split_at(usize::from(u16::from_le_bytes(*length)).min(rest.len()))
}

/// The bytes that [`two`] takes apart.
pub(crate) fn join(first: &[u8], second: &[u8]) -> Vec<u8> {
    let length = u16::try_from(first.len()).expect("seeds are small");
    [&length.to_le_bytes()[..], first, second].concat()
}
