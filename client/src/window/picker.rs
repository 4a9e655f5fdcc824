//! The desktop's dialog that chooses a file.

use std::path::{Path, PathBuf, absolute};
use std::thread;
use std::time::{Duration, Instant};

use winit::window::Window;

/// A dialog that ends sooner than this was never seen.
const SHORTEST: Duration = Duration::from_millis(150);

/// Extensions of clips and playlists.
const CLIPS: [&str; 2] = ["aarc", "json"];

/// How a dialog ended.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Picked {
    File(PathBuf),
    /// The viewer closed it.
    Nothing,
    /// There was no dialog.
    NoDialog,
}

/// Extensions of what this program plays.
fn extensions() -> Vec<&'static str> {
    let extensions = CLIPS.into_iter();
    #[cfg(feature = "formats")]
    let extensions = extensions.chain(formats::extensions());
    extensions.collect()
}

/// Opens the dialog in `folder`. It runs beside the window, and `done` is called from another thread when it ends.
pub(super) fn open(window: &Window, folder: Option<&Path>, done: impl FnOnce(Picked) + Send + 'static) {
    let mut dialog = rfd::AsyncFileDialog::new()
        .set_title("Open a clip")
        .set_parent(window)
        .add_filter("Clips, playlists and fields", &extensions())
        .add_filter("All files", &["*"]);
    if let Some(folder) = folder.and_then(|folder| absolute(folder).ok()) {
        // zenity takes the folder from the name.
        #[cfg(target_os = "linux")]
        {
            dialog = dialog.set_file_name(format!("{}/", folder.display()));
        }
        dialog = dialog.set_directory(folder);
    }
    // macOS wants the dialog to be made on this thread; waiting for it here would stop the window.
    let start = Instant::now();
    let chosen = dialog.pick_file();
    thread::spawn(move || {
        done(match pollster::block_on(chosen) {
            Some(file) => Picked::File(file.path().to_owned()),
            None if start.elapsed() < SHORTEST => Picked::NoDialog,
            None => Picked::Nothing,
        });
    });
}
