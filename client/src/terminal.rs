//! [`Reporter`]: prints load events on standard error.
//!
//! On a terminal, progress is one line that is overwritten. In a file, only failures and notes are lines. A note
//! on a clip that is loaded again, as in a playlist that loops, is printed once.

use std::collections::HashSet;
use std::io::{IsTerminal, Write, stderr};

use crate::content::OpenEvent;

/// Clears the line and returns to its start.
const CLEAR_LINE: &str = "\r\x1b[K";

/// The state of the output.
pub(crate) struct Reporter {
    is_terminal: bool,
    /// Whether a line of progress is on the terminal.
    has_line: bool,
    /// The failure printed last.
    trouble: Option<String>,
    /// The notes printed so far.
    notes: HashSet<String>,
}

impl Reporter {
    pub(crate) fn new() -> Reporter {
        Reporter {
            is_terminal: stderr().is_terminal(),
            has_line: false,
            trouble: None,
            notes: HashSet::new(),
        }
    }

    /// Prints an event.
    pub(crate) fn print(&mut self, event: &OpenEvent) {
        let text = self.text(event);
        // Nothing can be reported if standard error is closed.
        let _ = stderr().write_all(text.as_bytes());
    }

    fn text(&mut self, event: &OpenEvent) -> String {
        match event {
            OpenEvent::Progress(progress) if self.is_terminal => {
                self.has_line = true;
                format!("{CLEAR_LINE}{}", progress.text())
            }
            OpenEvent::Progress(progress) => {
                let is_new = progress.trouble.is_some() && progress.trouble != self.trouble;
                self.trouble.clone_from(&progress.trouble);
                if is_new { format!("{}\n", progress.text()) } else { String::new() }
            }
            OpenEvent::Note(note) if self.notes.insert(note.clone()) => format!("{}{note}\n", self.clear()),
            _ => String::new(),
        }
    }

    /// Removes the line of progress.
    pub(crate) fn end_progress(&mut self) {
        let _ = stderr().write_all(self.clear().as_bytes());
    }

    fn clear(&mut self) -> &'static str {
        if std::mem::take(&mut self.has_line) { CLEAR_LINE } else { "" }
    }
}

impl Drop for Reporter {
    fn drop(&mut self) {
        self.end_progress();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::content::Progress;

    fn progress(trouble: Option<&str>) -> OpenEvent {
        let trouble = trouble.map(String::from);
        OpenEvent::Progress(Progress { received: 1_000_000, trouble, ..Progress::default() })
    }

    fn reporter(is_terminal: bool) -> Reporter {
        let mut reporter = Reporter::new();
        reporter.is_terminal = is_terminal;
        reporter
    }

    #[test]
    fn a_file_has_a_line_for_each_failure_and_note() {
        let mut reporter = reporter(false);
        let troubles = [None, Some("a"), Some("a"), None, Some("a"), Some("b")];
        let text: String = troubles.map(|trouble| reporter.text(&progress(trouble))).concat();
        assert_eq!(text, "1.0 MB: a\n1.0 MB: a\n1.0 MB: b\n");
        let notes = ["c", "d", "c"].map(|note| reporter.text(&OpenEvent::Note(note.into())));
        assert_eq!(notes, ["c\n", "d\n", ""], "once");
    }

    #[test]
    fn progress_on_a_terminal_is_one_line() {
        let mut reporter = reporter(true);
        assert_eq!(reporter.text(&progress(None)), format!("{CLEAR_LINE}1.0 MB"));
        assert_eq!(reporter.text(&progress(Some("a"))), format!("{CLEAR_LINE}1.0 MB: a"));
        assert_eq!(reporter.text(&OpenEvent::Note("c".into())), format!("{CLEAR_LINE}c\n"));
        assert_eq!(reporter.clear(), "");
    }
}
