//! The clips to choose from in a window: those opened last, those of the folder, and pictures of them.
//!
//! ```text
//! recent.json -> recent ---> sections --> gallery --name--> the clip to open
//! folder ------------------------^          ^ |
//!                       aarc --headless --poster | clips in sight
//!                             thumbnails <----+
//! ```

mod choice;
mod gallery;
mod recent;
mod thumbnails;

use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use egui::Context;
use program::output::folder_of;

use choice::Section;
pub(super) use choice::{ListedClip, Opening, listed};
pub(super) use gallery::Gallery;
use recent::{RecentClips, absolute_name};
use thumbnails::Thumbnails;

use crate::clips::{clips_in, is_url};
use crate::folders;

/// Most clips opened last that menus list.
const LISTED: usize = 8;

/// The clips to choose from.
pub(super) struct Library {
    recent: RecentClips,
    /// Those of them that are there, as many as menus list.
    listed: Arc<[ListedClip]>,
    thumbnails: Thumbnails,
}

impl Library {
    /// Reads which clips were opened last, and starts the thread that makes thumbnails. It calls `wake` whenever
    /// [`Library::update`] has something to do.
    ///
    /// # Errors
    /// If the system refuses another thread.
    pub(super) fn open(wake: impl Fn() + Send + 'static) -> io::Result<Library> {
        let folder = folders::cache().map(|folder| folder.join("thumbnails"));
        let recent = RecentClips::open(folders::state());
        Ok(Library {
            listed: for_menu(&recent),
            recent,
            thumbnails: Thumbnails::start(std::env::current_exe()?, folder, wake)?,
        })
    }

    /// Remembers that a clip or a playlist was opened.
    pub(super) fn remember(&mut self, name: &str) {
        self.recent.add(name);
    }

    /// The clips and playlists opened last, the last one first, for a menu.
    pub(super) fn recent(&self) -> Arc<[ListedClip]> {
        self.listed.clone()
    }

    /// Opens the gallery. `current` is the clip on display.
    pub(super) fn show(&self, gallery: &mut Gallery, current: Option<&str>) {
        let current = current.map(absolute_name);
        let file = current.as_deref().filter(|name| !is_url(name));
        let folder = match file {
            Some(file) => folder_of(Path::new(file)).to_owned(),
            None => std::env::current_dir().unwrap_or_else(|_| PathBuf::from(".")),
        };
        let recent = self.recent.that_are_there();
        let inside = clips_in(&folder).iter().filter_map(|path| path.to_str().map(String::from)).collect();
        gallery.open(
            vec![
                Section { title: "Opened last".into(), clips: listed(recent) },
                Section { title: folder.display().to_string(), clips: listed(inside) },
            ],
            current,
        );
    }

    /// Takes in that another clip is on display.
    pub(super) fn mark(&self, gallery: &mut Gallery, current: Option<&str>) {
        gallery.mark(current.map(absolute_name));
    }

    /// Takes in thumbnails that are ready and clips that were opened, and asks for thumbnails of clips in sight.
    pub(super) fn update(&mut self, ctx: &Context, gallery: &mut Gallery) {
        if self.recent.take_changed() {
            self.listed = for_menu(&self.recent);
        }
        while let Some((name, picture)) = self.thumbnails.poll() {
            gallery.set_picture(ctx, name, picture);
        }
        if let Some(wanted) = gallery.take_wanted() {
            self.thumbnails.request(wanted);
        }
    }
}

/// The clips opened last that a menu lists.
fn for_menu(recent: &RecentClips) -> Arc<[ListedClip]> {
    let mut names = recent.that_are_there();
    names.truncate(LISTED);
    listed(names).into()
}
