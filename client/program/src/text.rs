//! Words of messages.

use std::io;

/// A number of things: `1 layer`, `2 layers`.
pub fn counted(count: usize, thing: &str) -> String {
    let ending = if count == 1 { "" } else { "s" };
    format!("{count} {thing}{ending}")
}

/// Why a file cannot be read, and what to do.
pub fn read_error(error: &io::Error) -> String {
    match error.kind() {
        io::ErrorKind::NotFound => "there is no such file: check the path".into(),
        io::ErrorKind::PermissionDenied => "it may not be read: change its permissions".into(),
        io::ErrorKind::IsADirectory => "it is a folder: name a file in it".into(),
        _ => format!("it cannot be read ({error}): check the path"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_file_has_a_next_step() {
        let error = std::fs::read("/nowhere/at/all").unwrap_err();
        assert_eq!(read_error(&error), "there is no such file: check the path");
    }

    #[test]
    fn one_thing_is_singular() {
        assert_eq!([0, 1, 2].map(|count| counted(count, "layer")), ["0 layers", "1 layer", "2 layers"]);
    }
}
