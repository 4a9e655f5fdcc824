//! Where this user's programs keep files of their own, by the XDG Base Directory Specification.

use std::ffi::OsString;
use std::path::PathBuf;

/// For what is remembered between runs; `None` where there is no place for it.
#[cfg(feature = "xr")]
pub(crate) fn state() -> Option<PathBuf> {
    folder(|name| std::env::var_os(name), "XDG_STATE_HOME", ".local/state")
}

/// For what can be fetched again; `None` where there is no place for it.
#[cfg(feature = "net")]
pub(crate) fn cache() -> Option<PathBuf> {
    folder(|name| std::env::var_os(name), "XDG_CACHE_HOME", ".cache")
}

/// This program's folder in that which the variable `name` names, else in `usual` of the home.
fn folder(variable: impl Fn(&str) -> Option<OsString>, name: &str, usual: &str) -> Option<PathBuf> {
    let path = |name: &str| variable(name).map(PathBuf::from).filter(|path| path.is_absolute());
    Some(path(name).or_else(|| Some(path("HOME")?.join(usual)))?.join("aarc"))
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
