//! The clips to choose from in a window: what the viewer may open, and what was opened last.
//!
//! ```text
//! recent.json -> recent -> Library -> the menu "Clips" --Opening--> the clip to open
//! ```

mod choice;
mod recent;

use std::sync::Arc;

pub(super) use choice::{ListedClip, Opening, listed};
use recent::RecentClips;

use crate::folders;

/// Most clips opened last that menus list.
const LISTED: usize = 8;

/// The clips to choose from.
pub(super) struct Library {
    recent: RecentClips,
    /// Those of them that are there, as many as menus list.
    listed: Arc<[ListedClip]>,
}

impl Library {
    /// Reads which clips were opened last.
    pub(super) fn open() -> Library {
        let recent = RecentClips::open(folders::state());
        Library { listed: for_menu(&recent), recent }
    }

    /// Remembers that a clip or a playlist was opened.
    pub(super) fn remember(&mut self, name: &str) {
        self.recent.add(name);
    }

    /// The clips and playlists opened last, the last one first, for a menu.
    pub(super) fn recent(&self) -> Arc<[ListedClip]> {
        self.listed.clone()
    }

    /// Takes in which clips were opened since.
    pub(super) fn update(&mut self) {
        if self.recent.take_changed() {
            self.listed = for_menu(&self.recent);
        }
    }
}

/// The clips opened last that a menu lists.
fn for_menu(recent: &RecentClips) -> Arc<[ListedClip]> {
    let mut names = recent.that_are_there();
    names.truncate(LISTED);
    listed(names).into()
}
