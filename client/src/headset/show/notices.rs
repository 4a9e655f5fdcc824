//! [`Notices`]: the notice that the panel shows, and the fault that a run without any clip ends with.

use std::collections::HashSet;

use crate::content::Progress;
use crate::headset::notify;
use crate::headset::panel::Notice;
use crate::notes::below;
use program::Fault;

/// What the panel says.
pub(super) struct Notices {
    /// What was said, until the viewer dismisses it.
    said: Option<Said>,
    /// What takes a while, which is shown where nothing was said.
    work: Option<Work>,
    /// Whether a viewer is there to read the panel; measured runs have none.
    attended: bool,
    /// Why no clip has been shown so far.
    unplayed: Option<Fault>,
    /// The remarks so far, which reach the terminal once.
    notes: HashSet<String>,
}

/// Notes and errors, one a line.
struct Said {
    text: String,
    is_error: bool,
}

/// Work that takes a while, and the part of it that is done.
struct Work {
    text: String,
    part: Option<f32>,
}

impl Notices {
    pub(super) fn new(attended: bool) -> Notices {
        Notices { said: None, work: None, attended, unplayed: None, notes: HashSet::new() }
    }

    /// Says that something takes a while.
    pub(super) fn work(&mut self, text: String) {
        self.work = Some(Work { text, part: None });
    }

    /// Says how much of a clip has arrived.
    pub(super) fn progress(&mut self, progress: &Progress) {
        let text = format!("Loading: {}", progress.text());
        self.work = Some(Work { text, part: progress.part() });
    }

    /// Shows a remark, such as that a clip was skipped.
    pub(super) fn note(&mut self, text: String) {
        if self.notes.insert(text.clone()) {
            notify(&text);
        }
        self.say(&text, false);
    }

    /// Says something below what was said, in place of the progress.
    fn say(&mut self, text: &str, is_error: bool) {
        self.work = None;
        self.said = Some(match self.said.take() {
            Some(shown) => Said { text: below(&shown.text, text), is_error: shown.is_error || is_error },
            None => Said { text: text.into(), is_error },
        });
    }

    /// Says that a clip cannot be shown; `is_playing` is whether another one is.
    ///
    /// # Errors
    /// `fault`, if no clip plays and no viewer is there to read it.
    pub(super) fn fail(&mut self, fault: Fault, is_playing: bool) -> Result<(), Fault> {
        self.say(&fault.to_string(), true);
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

    /// Takes in that a clip is shown.
    pub(super) fn on_clip(&mut self) {
        self.unplayed = None;
    }

    /// Removes the progress.
    pub(super) fn clear_progress(&mut self) {
        self.work = None;
    }

    /// Removes what was said.
    pub(super) fn dismiss(&mut self) {
        self.said = None;
    }

    /// The notice for the panel.
    pub(super) fn shown(&self) -> Option<Notice<'_>> {
        let said = self.said.as_ref().map(|Said { text, is_error }| match is_error {
            true => Notice::Error(text),
            false => Notice::Note(text),
        });
        said.or(self.work.as_ref().map(|Work { text, part }| Notice::Working { text, part: *part }))
    }

    /// The outcome of the run.
    ///
    /// # Errors
    /// Why no clip was shown.
    pub(super) fn outcome(self) -> Result<(), Fault> {
        self.unplayed.map_or(Ok(()), Err)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The text of the notice, after `!` for an error and `~` for work.
    fn shown(notices: &Notices) -> String {
        match notices.shown() {
            None => String::new(),
            Some(Notice::Working { text, .. }) => format!("~{text}"),
            Some(Notice::Note(text)) => text.into(),
            Some(Notice::Error(text)) => format!("!{text}"),
        }
    }

    #[test]
    fn what_was_said_stays_until_it_is_dismissed() {
        let mut notices = Notices::new(true);
        notices.work("Opening a".into());
        assert_eq!(shown(&notices), "~Opening a");
        notices.note("no sound".into());
        notices.work("Loading b".into());
        notices.progress(&Progress::default());
        assert_eq!(shown(&notices), "no sound");
        notices.fail(Fault::Data("b is damaged".into()), true).unwrap();
        notices.on_clip();
        notices.clear_progress();
        assert_eq!(shown(&notices), "!no sound\nb is damaged");
        notices.work("Loading c".into());
        notices.dismiss();
        assert_eq!(shown(&notices), "~Loading c", "it is still loaded");
        notices.clear_progress();
        assert_eq!(shown(&notices), "");
    }
}
