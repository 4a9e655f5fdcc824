//! [`Notices`]: the line that the panel shows, and the fault that a run without any clip ends with.

use std::collections::HashSet;

use crate::content::Progress;
use crate::headset::notify;
use crate::headset::panel::Notice;
use program::Fault;

/// What the panel says.
pub(super) struct Notices {
    line: Option<Line>,
    /// Whether a viewer is there to read the panel; measured runs have none.
    attended: bool,
    /// Why no clip has been shown so far.
    unplayed: Option<Fault>,
    /// The remarks so far, which reach the terminal once.
    notes: HashSet<String>,
}

enum Line {
    Working { text: String, part: Option<f32> },
    Note(String),
    Error(String),
}

impl Notices {
    pub(super) fn new(attended: bool) -> Notices {
        Notices { line: None, attended, unplayed: None, notes: HashSet::new() }
    }

    /// Says that something takes a while.
    pub(super) fn work(&mut self, text: String) {
        self.line = Some(Line::Working { text, part: None });
    }

    /// Says how much of a clip has arrived.
    pub(super) fn progress(&mut self, progress: &Progress) {
        let text = format!("Loading: {}", progress.text());
        self.line = Some(Line::Working { text, part: progress.part() });
    }

    /// Shows a remark, such as that a clip was skipped.
    pub(super) fn note(&mut self, text: String) {
        if self.notes.insert(text.clone()) {
            notify(&text);
        }
        self.line = Some(Line::Note(text));
    }

    /// Says that a clip cannot be shown; `is_playing` is whether another one is.
    ///
    /// # Errors
    /// `fault`, if no clip plays and no viewer is there to read it.
    pub(super) fn fail(&mut self, fault: Fault, is_playing: bool) -> Result<(), Fault> {
        self.line = Some(Line::Error(fault.to_string()));
        if is_playing {
            notify(&fault.to_string());
        } else if self.attended {
            notify(&format!("{fault}; the headset shows this and waits for another clip, or the exit"));
            self.unplayed = Some(fault);
        } else {
            return Err(fault);
        }
        Ok(())
    }

    /// Takes in that a clip is shown, which settles what went wrong before.
    pub(super) fn on_clip(&mut self) {
        self.unplayed = None;
        self.line.take_if(|line| matches!(line, Line::Error(_)));
    }

    /// Removes the progress.
    pub(super) fn clear_progress(&mut self) {
        self.line.take_if(|line| matches!(line, Line::Working { .. }));
    }

    /// Removes the line.
    pub(super) fn dismiss(&mut self) {
        self.line = None;
    }

    /// The line for the panel.
    pub(super) fn line(&self) -> Option<Notice<'_>> {
        self.line.as_ref().map(|line| match line {
            Line::Working { text, part } => Notice::Working { text, part: *part },
            Line::Note(text) => Notice::Note(text),
            Line::Error(text) => Notice::Error(text),
        })
    }

    /// The outcome of the run.
    ///
    /// # Errors
    /// Why no clip was shown.
    pub(super) fn outcome(self) -> Result<(), Fault> {
        self.unplayed.map_or(Ok(()), Err)
    }
}
