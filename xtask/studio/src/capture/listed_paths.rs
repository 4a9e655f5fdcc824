//! [`ListedPaths`]: finds the files that a capture lists, also where it was made on another machine or another system.

use std::collections::BTreeMap;
use std::path::Path;

use program::Fault;

use super::image_file::bad;

/// Files of a capture by their listed paths.
pub(super) struct ListedPaths<'a> {
    folder: &'a Path,
    /// By their paths in the folder, the listed paths of the files that are found by the ends of these.
    moved: BTreeMap<String, String>,
}

impl<'a> ListedPaths<'a> {
    /// Paths that are listed in the capture in `folder`.
    pub(super) fn new(folder: &'a Path) -> ListedPaths<'a> {
        ListedPaths { folder, moved: BTreeMap::new() }
    }

    /// The path that `find` makes of `listed`: as it is, with slashes for backslashes, or, if it is an absolute path of
    /// another machine, of its longest end for which there is a file.
    ///
    /// # Errors
    /// [`Fault::Data`] if the ends of two listed paths are one file.
    pub(super) fn find(
        &mut self,
        listed: &str,
        find: impl Fn(&str) -> Option<String>,
    ) -> Result<Option<String>, Fault> {
        let slashed = listed.replace('\\', "/");
        if let Some(found) = find(listed).or_else(|| find(&slashed)) {
            return Ok(Some(found));
        }
        let ends = slashed.match_indices('/').map(|(at, _)| &slashed[at + 1..]);
        let is_relative = |end: &&str| !end.is_empty() && !end.starts_with('/');
        let Some(found) = ends.filter(|_| is_absolute(&slashed)).filter(is_relative).find_map(find) else {
            return Ok(None);
        };
        match self.moved.insert(found.clone(), listed.to_owned()) {
            Some(other) if other != listed => Err(bad(
                &self.folder.join(&found),
                format!("{other} and {listed} end like this file; list paths in the capture's folder"),
            )),
            _ => Ok(Some(found)),
        }
    }

    /// Says that files were found by the ends of their paths, if any was.
    pub(super) fn note(&self) -> Option<String> {
        let (found, listed) = self.moved.first_key_value()?;
        Some(format!("files are found by the ends of their paths: {found} for {listed}"))
    }
}

/// Whether a path with slashes starts at a root, of Windows or another system.
fn is_absolute(path: &str) -> bool {
    path.starts_with('/') || path.as_bytes().get(1) == Some(&b':')
}

/// The end of a sentence about a listed photograph that is missing in `folder`: what to do.
pub(super) fn advice(folder: &Path, listed: &str) -> String {
    match is_absolute(&listed.replace('\\', "/")) {
        true => {
            format!(", and so is any file below {} whose path ends like it; put it there", folder.display())
        }
        false => "; put it there".into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_of_other_machines_are_found_by_their_ends() {
        let files = ["images/a/0.png", "images/b/0.png", "0.png"];
        let find = |path: &str| files.contains(&path).then(|| path.to_owned());
        for (listed, expected) in [
            ("images/a/0.png", Some("images/a/0.png")),
            (r"images\b\0.png", Some("images/b/0.png")),
            ("/home/somebody/take/images/a/0.png", Some("images/a/0.png")),
            (r"C:\takes\1\images\b\0.png", Some("images/b/0.png")),
            (r"\\server\takes\images\b\0.png", Some("images/b/0.png")),
            ("/elsewhere//0.png", Some("0.png")),
            ("/home/somebody/1.png", None),
            // A relative path says where the file is.
            ("other/images/a/0.png", None),
        ] {
            let found = ListedPaths::new(Path::new("capture")).find(listed, find).unwrap();
            assert_eq!(found.as_deref(), expected, "{listed}");
        }
    }

    #[test]
    fn two_paths_are_not_one_file() {
        let mut paths = ListedPaths::new(Path::new("capture"));
        let mut find = |listed: &str| paths.find(listed, |path| (path == "0.png").then(|| path.to_owned()));
        assert_eq!(find("/data/a/0.png").unwrap().as_deref(), Some("0.png"));
        assert_eq!(find("/data/a/0.png").unwrap().as_deref(), Some("0.png"), "many frames may name one mask");
        let error = find("/data/b/0.png").unwrap_err().to_string();
        assert!(error.contains("capture/0.png: /data/a/0.png and /data/b/0.png end like"), "{error}");
    }
}
