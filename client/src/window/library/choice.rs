//! [`Opening`]: what the viewer chose, and what there is to choose from.

use crate::clips::{Direction, title};

/// What the viewer wants to see.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Opening {
    /// The clip or playlist of this name.
    Clip(String),
    /// The next clip of the playlist or the folder, or the one before.
    Beside(Direction),
    /// A file that is still to be chosen.
    Picker,
}

/// Clips of the gallery under a title.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Section {
    pub(super) title: String,
    pub(super) names: Vec<String>,
}

/// The name of a clip in menus and under its picture.
pub(crate) fn short_title(name: &str) -> String {
    const CHARS: usize = 30;
    let title = title(Some(name));
    match title.char_indices().nth(CHARS) {
        Some((end, _)) => format!("{}...", &title[..end]),
        None => title,
    }
}
