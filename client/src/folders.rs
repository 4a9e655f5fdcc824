//! The user's folders for files of this program, after the XDG Base Directory Specification.

use std::ffi::OsString;
use std::path::PathBuf;

/// The folder for state that outlives a run; `None` if neither variable nor home is set.
#[cfg(any(feature = "window", feature = "xr"))]
pub(crate) fn state() -> Option<PathBuf> {
    folder(|name| std::env::var_os(name), "XDG_STATE_HOME", ".local/state")
}

/// The folder for files that can be made again; `None` if neither variable nor home is set.
pub(crate) fn cache() -> Option<PathBuf> {
    folder(|name| std::env::var_os(name), "XDG_CACHE_HOME", ".cache")
}

/// The folder for compiled pipelines; `None` as for [`cache`].
#[cfg(any(feature = "window", feature = "xr"))]
pub(crate) fn pipelines() -> Option<PathBuf> {
    cache().map(|folder| folder.join("pipelines"))
}

/// `aarc` in the folder that the variable `name` holds, or else in `default` in the home folder.
fn folder(variable: impl Fn(&str) -> Option<OsString>, name: &str, default: &str) -> Option<PathBuf> {
    let path = |name: &str| variable(name).map(PathBuf::from).filter(|path| path.is_absolute());
    Some(path(name).or_else(|| Some(path("HOME")?.join(default)))?.join("aarc"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_folder_follows_the_specification() {
        let with = |variables: &[(&str, &str)]| {
            let value =
                |name: &str| variables.iter().find(|(key, _)| *key == name).map(|(_, value)| value.into());
            folder(value, "XDG_STATE_HOME", ".local/state")
        };
        assert_eq!(with(&[("HOME", "/home/ann")]), Some("/home/ann/.local/state/aarc".into()));
        let both = [("HOME", "/home/ann"), ("XDG_STATE_HOME", "/state")];
        assert_eq!(with(&both), Some("/state/aarc".into()));
        let relative = [("HOME", "/home/ann"), ("XDG_STATE_HOME", "state")];
        assert_eq!(with(&relative), Some("/home/ann/.local/state/aarc".into()));
        assert_eq!(with(&[]), None);
    }
}
