//! The clips to choose from in a window: what the viewer may open, and what was opened last.
//!
//! ```text
//! recent.json -> recent -> Library -> the menu "Clips" --Opening--> the clip to open
//! ```
//!
//! A thread looks which of them are there: a disk that does not answer keeps neither a frame nor the end of the program
//! waiting.

mod choice;
mod recent;

use std::path::Path;
use std::sync::Arc;

pub(super) use choice::{ListedClip, Opening, listed};
use recent::RecentClips;

use crate::content::is_url;
use crate::folders;
use crate::worker::{Report, Worker};

/// Most clips opened last that menus list.
const LISTED: usize = 8;

/// The clips to choose from.
pub(super) struct Library {
    recent: RecentClips,
    /// Those of them that are there, as many as menus list.
    listed: Arc<[ListedClip]>,
    /// Turns names into such a list; `None` if the system refused a thread.
    looker: Option<Worker<Vec<String>, Arc<[ListedClip]>>>,
}

impl Library {
    /// Reads which clips were opened last. `wake` is called from another thread when the list of those that are there has
    /// changed.
    pub(super) fn open(wake: impl Fn() + Send + 'static) -> Library {
        let look = |names, report: &Report<'_, _>| {
            let _ = (report.send)(for_menu(names));
        };
        let looker = Worker::new(look, wake);
        let looker = looker.inspect_err(|error| log::warn!("no list of clips: {error}")).ok();
        let mut library =
            Library { recent: RecentClips::open(folders::state()), listed: Arc::default(), looker };
        library.look();
        library
    }

    fn look(&mut self) {
        if let Some(looker) = &mut self.looker {
            looker.request(self.recent.names());
        }
    }

    /// Remembers that a clip or a playlist was opened.
    pub(super) fn remember(&mut self, name: &str) {
        self.recent.add(name);
    }

    /// The clips and playlists opened last, the last one first, for a menu.
    pub(super) fn recent(&self) -> Arc<[ListedClip]> {
        self.listed.clone()
    }

    /// Takes in which clips were opened since. Does not block.
    pub(super) fn update(&mut self) {
        if self.recent.take_changed() {
            self.look();
        }
        if let Some(Ok(Some(listed))) = self.looker.as_ref().map(Worker::poll) {
            self.listed = listed;
        }
    }
}

impl Drop for Library {
    fn drop(&mut self) {
        if let Some(looker) = &mut self.looker {
            looker.leave_behind();
        }
    }
}

/// The clips opened last that a menu lists: those that can be opened, as far as is known without the network.
fn for_menu(mut names: Vec<String>) -> Arc<[ListedClip]> {
    names.retain(|name| is_url(name) || Path::new(name).exists());
    names.truncate(LISTED);
    listed(names).into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn menus_list_what_is_there() {
        let folder = tempfile::tempdir().unwrap();
        let path = |i: usize| folder.path().join(format!("{i}.aarc")).to_str().unwrap().to_owned();
        std::fs::write(path(1), "").unwrap();
        let names = vec![path(0), "https://host/b.aarc".into(), path(1)];
        let listed: Vec<String> = for_menu(names).iter().map(|clip| clip.title.clone()).collect();
        assert_eq!(listed, ["b.aarc", "1.aarc"]);
        (0..2 * LISTED).for_each(|i| std::fs::write(path(i), "").unwrap());
        assert_eq!(for_menu((0..2 * LISTED).map(path).collect()).len(), LISTED);
    }
}
