//! Parts of messages: unreadable files, damaged packages, numbers with their nouns.

use std::io::{self, ErrorKind};
use std::path::Path;

use codec::Error;
use program::Fault;

/// The fault of a file or folder that cannot be read.
pub(crate) fn unreadable(path: &Path, error: &io::Error) -> Fault {
    let path = path.display();
    Fault::Data(match error.kind() {
        ErrorKind::NotFound => format!("{path}: there is no such file or folder; check the path"),
        ErrorKind::PermissionDenied => format!("{path}: it may not be read; change its permissions"),
        _ => format!("{path}: it cannot be read ({error}); check the path"),
    })
}

/// The fault of a package that cannot be decoded.
pub(crate) fn bad_package(path: &Path, error: &Error) -> Fault {
    Fault::Data(format!("{}: {error}; {}", path.display(), advice(error)))
}

/// What to do about a package that cannot be decoded.
pub(crate) fn advice(error: &Error) -> &'static str {
    match error {
        Error::Format { .. } => "get the file again, or package its field again",
        Error::Version { .. } => "update this program, or package the field again",
        Error::Limits { .. } => "package its field with a smaller --budget",
    }
}

/// A number of things: `1 frame`, `2 frames`.
pub(crate) fn count(number: usize, noun: &str) -> String {
    format!("{number} {noun}{}", if number == 1 { "" } else { "s" })
}

/// A number with at most `digits` decimals, without zeros at the end.
pub(crate) fn decimal(number: f64, digits: usize) -> String {
    let text = format!("{number:.digits$}");
    match text.contains('.') {
        true => text.trim_end_matches('0').trim_end_matches('.').to_owned(),
        false => text,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_no_more_digits_and_letters_than_needed() {
        let duration = decimal(f64::from(8.0f32 / 30.0), 3);
        assert_eq!(
            (count(1, "frame"), count(0, "frame"), duration),
            ("1 frame".into(), "0 frames".into(), "0.267".into())
        );
        assert_eq!([63058.0, 1.5, 100.0, 0.0].map(|x| decimal(x, 3)), ["63058", "1.5", "100", "0"]);
        assert_eq!(decimal(100.0, 0), "100");
    }
}
