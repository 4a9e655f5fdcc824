//! Where the placements of clips are remembered.

use std::ffi::OsString;
use std::path::PathBuf;

use super::interaction::PlacementStore;

/// The store of this user; `None` where there is no place for one.
pub(super) fn open() -> Option<PlacementStore> {
    folder(|name| std::env::var_os(name)).map(|folder| PlacementStore::open(&folder))
}

/// The folder for what programs remember between runs, by the XDG Base Directory Specification.
fn folder(variable: impl Fn(&str) -> Option<OsString>) -> Option<PathBuf> {
    let path = |name: &str| variable(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let state = path("XDG_STATE_HOME").or_else(|| Some(path("HOME")?.join(".local/state")))?;
    Some(state.join("aarc"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_folder_follows_the_specification() {
        let with = |variables: &[(&str, &str)]| {
            folder(|name| variables.iter().find(|(key, _)| *key == name).map(|(_, value)| value.into()))
        };
        assert_eq!(with(&[("HOME", "/home/ann")]), Some("/home/ann/.local/state/aarc".into()));
        let both = [("HOME", "/home/ann"), ("XDG_STATE_HOME", "/state")];
        assert_eq!(with(&both), Some("/state/aarc".into()));
        let relative = [("HOME", "/home/ann"), ("XDG_STATE_HOME", "state")];
        assert_eq!(with(&relative), Some("/home/ann/.local/state/aarc".into()));
        assert_eq!(with(&[]), None);
    }
}
