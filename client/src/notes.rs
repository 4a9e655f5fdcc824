//! [`below`]: a note under those that are still shown.

/// Most notes that are shown at once.
const NOTES_MAX: usize = 4;

/// The notes `shown`, one a line, with `note` as the last; the oldest are dropped.
pub(crate) fn below(shown: &str, note: &str) -> String {
    let mut lines: Vec<&str> = shown.lines().filter(|line| *line != note).collect();
    lines.push(note);
    lines[lines.len().saturating_sub(NOTES_MAX)..].join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_latest_notes_are_shown_each_once() {
        assert_eq!(below("", "a"), "a");
        assert_eq!(below("a\nb", "a"), "b\na");
        assert_eq!(below("a\nb\nc\nd", "e"), "b\nc\nd\ne");
    }
}
