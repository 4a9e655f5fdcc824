//! [`Reporter`]: tells on standard error how a clip arrives.
//!
//! On a terminal the progress is one line that changes; in a file, only what goes wrong is told.

use std::io::{IsTerminal, Write, stderr};

use crate::clips::LoadEvent;

/// Clears the line, and goes to its start.
const CLEAR_LINE: &str = "\r\x1b[K";

/// What was told so far.
pub(crate) struct Reporter {
    is_terminal: bool,
    /// Whether there is a line to clear.
    open: bool,
    trouble: Option<String>,
}

impl Reporter {
    pub(crate) fn new() -> Reporter {
        Reporter { is_terminal: stderr().is_terminal(), open: false, trouble: None }
    }

    /// Tells the news.
    pub(crate) fn tell(&mut self, news: &LoadEvent) {
        let text = self.text(news);
        // Nobody is left to tell where standard error is closed.
        let _ = stderr().write_all(text.as_bytes());
    }

    /// What is to be written.
    fn text(&mut self, news: &LoadEvent) -> String {
        match news {
            LoadEvent::Progress(progress) if self.is_terminal => {
                self.open = true;
                format!("{CLEAR_LINE}{}", progress.text())
            }
            LoadEvent::Progress(progress) => {
                let is_new = progress.trouble.is_some() && progress.trouble != self.trouble;
                self.trouble.clone_from(&progress.trouble);
                if is_new { format!("{}\n", progress.text()) } else { String::new() }
            }
            LoadEvent::Note(note) => format!("{}{note}\n", self.clear()),
            _ => String::new(),
        }
    }

    fn clear(&mut self) -> &'static str {
        if std::mem::take(&mut self.open) { CLEAR_LINE } else { "" }
    }
}

impl Drop for Reporter {
    fn drop(&mut self) {
        let _ = stderr().write_all(self.clear().as_bytes());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clips::Progress;

    fn progress(trouble: Option<&str>) -> LoadEvent {
        let trouble = trouble.map(String::from);
        LoadEvent::Progress(Progress { received: 1_000_000, trouble, ..Progress::default() })
    }

    #[test]
    fn a_file_gets_a_line_for_each_trouble_and_nothing_else() {
        let mut reporter = Reporter { is_terminal: false, open: false, trouble: None };
        let troubles = [None, Some("a"), Some("a"), None, Some("a"), Some("b")];
        let text: String = troubles.map(|trouble| reporter.text(&progress(trouble))).concat();
        assert_eq!(text, "1.0 MB: a\n1.0 MB: a\n1.0 MB: b\n");
        assert_eq!(reporter.text(&LoadEvent::Note("c".into())), "c\n");
    }

    #[test]
    fn a_terminal_gets_one_line_that_changes() {
        let mut reporter = Reporter { is_terminal: true, open: false, trouble: None };
        assert_eq!(reporter.text(&progress(None)), format!("{CLEAR_LINE}1.0 MB"));
        assert_eq!(reporter.text(&progress(Some("a"))), format!("{CLEAR_LINE}1.0 MB: a"));
        assert_eq!(reporter.text(&LoadEvent::Note("c".into())), format!("{CLEAR_LINE}c\n"));
        assert_eq!(reporter.clear(), "");
    }
}
