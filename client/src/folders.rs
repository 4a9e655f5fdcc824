//! The user's folders for files of this program, by the custom of the system: the XDG Base Directory Specification on
//! Linux, `~/Library` on macOS, `AppData` on Windows.

#[cfg(feature = "window")]
use std::path::Path;
use std::path::PathBuf;

use etcetera::base_strategy::{BaseStrategy, choose_native_strategy};

/// The folder for state that outlives a run; `None` if the user has no home folder.
#[cfg(any(feature = "window", feature = "xr"))]
pub(crate) fn state() -> Option<PathBuf> {
    choose_native_strategy().ok().map(|system| state_in(&system))
}

/// The folder for files that can be made again; `None` as for [`state()`].
pub(crate) fn cache() -> Option<PathBuf> {
    choose_native_strategy().ok().map(|system| cache_in(&system))
}

/// The folder for compiled pipelines; `None` as for [`state()`].
#[cfg(any(feature = "window", feature = "xr"))]
pub(crate) fn pipelines() -> Option<PathBuf> {
    cache().map(|folder| folder.join("pipelines"))
}

/// The folders for pictures, the best first: the user's folder for them, and home; the working directory if the user has
/// no home folder.
#[cfg(feature = "window")]
pub(crate) fn pictures() -> Vec<PathBuf> {
    choose_native_strategy().map_or_else(|_| vec![".".into()], |system| pictures_in(&system))
}

#[cfg(feature = "window")]
fn pictures_in(system: &impl BaseStrategy) -> Vec<PathBuf> {
    let home = system.home_dir();
    // Desktops of Linux name it in the user's language.
    let listed = std::fs::read_to_string(system.config_dir().join("user-dirs.dirs"));
    let named = listed.ok().and_then(|list| listed_pictures(&list, home));
    vec![named.unwrap_or_else(|| home.join("Pictures")), home.to_owned()]
}

/// The folder for pictures in a list by the rules of xdg-user-dirs.
#[cfg(feature = "window")]
fn listed_pictures(list: &str, home: &Path) -> Option<PathBuf> {
    let value = list.lines().find_map(|line| line.trim().strip_prefix("XDG_PICTURES_DIR="))?;
    let value = value.trim_matches('"');
    Some(home.join(value.strip_prefix("$HOME/").unwrap_or(value)))
}

/// The folder for state; for data, on systems without one for state.
#[cfg(any(feature = "window", feature = "xr"))]
fn state_in(system: &impl BaseStrategy) -> PathBuf {
    system.state_dir().unwrap_or_else(|| system.data_dir()).join("aarc")
}

fn cache_in(system: &impl BaseStrategy) -> PathBuf {
    system.cache_dir().join("aarc")
}

#[cfg(all(test, any(feature = "window", feature = "xr")))]
mod tests {
    use etcetera::base_strategy::{Apple, Windows, Xdg};

    use super::*;

    #[cfg(feature = "window")]
    #[test]
    fn pictures_are_where_the_desktop_says_or_in_pictures() {
        let home = Path::new("/home/ann");
        for (list, folder) in [
            (
                "# dirs\nXDG_MUSIC_DIR=\"$HOME/Musik\"\nXDG_PICTURES_DIR=\"$HOME/Bilder\"\n",
                "/home/ann/Bilder",
            ),
            ("XDG_PICTURES_DIR=\"/data/pictures\"", "/data/pictures"),
            ("XDG_PICTURES_DIR=\"$HOME/\"", "/home/ann"),
        ] {
            assert_eq!(listed_pictures(list, home).as_deref(), Some(Path::new(folder)));
        }
        assert_eq!(listed_pictures("XDG_MUSIC_DIR=\"$HOME/Music\"", home), None);
        let home = etcetera::home_dir().expect("a home folder");
        assert_eq!(pictures().last(), Some(&home));
    }

    #[test]
    fn every_system_has_folders_of_its_own() {
        let home = etcetera::home_dir().expect("a home folder");
        // The folders of a user who has set none of the variables.
        let is = |path: PathBuf, variable: &str, default: &str| {
            let set = std::env::var_os(variable).map(PathBuf::from).filter(|path| path.is_absolute());
            assert_eq!(path, set.unwrap_or_else(|| home.join(default)).join("aarc"));
        };
        let linux = Xdg::new().expect("a home folder");
        is(cache_in(&linux), "XDG_CACHE_HOME", ".cache");
        is(state_in(&linux), "XDG_STATE_HOME", ".local/state");
        let mac = Apple::new().expect("a home folder");
        is(cache_in(&mac), "", "Library/Caches");
        is(state_in(&mac), "", "Library/Application Support");
        let windows = Windows::new().expect("a home folder");
        is(cache_in(&windows), "LOCALAPPDATA", "AppData/Local");
        is(state_in(&windows), "APPDATA", "AppData/Roaming");
    }
}
