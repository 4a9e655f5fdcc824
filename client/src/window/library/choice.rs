//! [`Opening`]: what the viewer chose, and what there is to choose from.

use std::collections::HashMap;
use std::path::is_separator;

use crate::clips::Direction;
use crate::content::{redacted, title};

/// What the viewer wants to see.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Opening {
    /// The clip or playlist of this name.
    Clip(String),
    /// The next or the previous clip of the playlist or the folder.
    Beside(Direction),
    /// A file that is still to be chosen.
    Picker,
}

/// A clip or a playlist to choose.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct ListedClip {
    /// A path or URL.
    pub(crate) name: String,
    /// Title in menus.
    pub(crate) title: String,
}

/// Most characters of a title, and of the folder in it where its file needs the rest. Dots in place of others come on
/// top.
const TITLE_CHARS: usize = 30;
const FOLDER_CHARS: usize = 14;

/// The clips of a list with their titles: their file names, and before equal ones as many folders as tell them apart.
pub(crate) fn listed(names: Vec<String>) -> Vec<ListedClip> {
    let files: Vec<String> = names.iter().map(|name| title(Some(name))).collect();
    let mut by_file: HashMap<&str, Vec<usize>> = HashMap::new();
    for (i, file) in files.iter().enumerate() {
        by_file.entry(file).or_default().push(i);
    }
    let titled = |(i, name): (usize, &String)| {
        let alike: Vec<Vec<String>> =
            by_file[&*files[i]].iter().filter(|&&j| j != i).map(|&j| folders(&names[j])).collect();
        let folders = folders(name);
        let is_distinct =
            |&count: &usize| alike.iter().all(|other| last(other, count) != last(&folders, count));
        match (0..=folders.len()).find(is_distinct) {
            Some(count) if count > 0 => with_folder(&last(&folders, count).join("/"), &files[i]),
            _ => beginning(&files[i], TITLE_CHARS),
        }
    };
    let titles: Vec<String> = names.iter().enumerate().map(titled).collect();
    names.into_iter().zip(titles).map(|(name, title)| ListedClip { name, title }).collect()
}

/// The folders of a path or URL from the root, which is empty.
fn folders(name: &str) -> Vec<String> {
    let mut parts: Vec<String> = redacted(name).split(is_separator).map(String::from).collect();
    parts.pop();
    parts
}

/// The last `count` folders, or all where there are fewer.
fn last(folders: &[String], count: usize) -> &[String] {
    &folders[folders.len().saturating_sub(count)..]
}

/// The title of a file in a folder. A long file name is cut at its end, a long folder in its centre.
fn with_folder(folder: &str, file: &str) -> String {
    let rest = (TITLE_CHARS - 1).saturating_sub(file.chars().count());
    let folder = ends(folder, rest.max(FOLDER_CHARS));
    let rest = TITLE_CHARS - 1 - folder.chars().count().min(rest.max(FOLDER_CHARS));
    format!("{folder}/{}", beginning(file, rest))
}

/// The first `chars` characters, and dots in place of others.
fn beginning(text: &str, chars: usize) -> String {
    match text.char_indices().nth(chars) {
        Some((end, _)) => format!("{}...", &text[..end]),
        None => text.into(),
    }
}

/// The first and the last characters, `chars` of them, and dots in place of others.
fn ends(text: &str, chars: usize) -> String {
    let all: Vec<char> = text.chars().collect();
    if all.len() <= chars {
        return text.into();
    }
    let (first, last) = (&all[..chars / 2], &all[all.len() - (chars - chars / 2)..]);
    first.iter().chain(&['.'; 3]).chain(last).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn titles<const N: usize>(names: [&str; N]) -> Vec<String> {
        listed(names.map(String::from).to_vec()).into_iter().map(|clip| clip.title).collect()
    }

    #[test]
    fn clips_of_the_same_file_name_have_the_folders_that_tell_them_apart() {
        assert_eq!(titles(["/clips/a.aarc", "/clips/b.aarc"]), ["a.aarc", "b.aarc"]);
        assert_eq!(
            titles(["/x/monday/a.aarc", "/x/friday/a.aarc", "/x/friday/b.aarc"]),
            ["monday/a.aarc", "friday/a.aarc", "b.aarc"]
        );
        assert_eq!(
            titles(["/1/x/a.aarc", "/2/x/a.aarc", "/1/y/a.aarc", "/2/y/a.aarc", "/z/a.aarc"]),
            ["1/x/a.aarc", "2/x/a.aarc", "1/y/a.aarc", "2/y/a.aarc", "z/a.aarc"]
        );
        // At a root, in a folder of it, and on hosts.
        assert_eq!(
            titles(["/a.aarc", "/x/a.aarc", "https://one/a.aarc?key=1", "https://two/a.aarc"]),
            ["/a.aarc", "x/a.aarc", "one/a.aarc", "two/a.aarc"]
        );
        assert_eq!(titles(["/x/a.aarc", "/a/x/a.aarc"]), ["/x/a.aarc", "a/x/a.aarc"]);
        assert_eq!(titles(["/x/a.aarc", "/x/a.aarc"]), ["a.aarc", "a.aarc"], "the same one");
    }

    #[test]
    fn a_long_title_leaves_out_what_differs_least() {
        let long = "x".repeat(40);
        assert_eq!(titles([&format!("/{long}")]), [format!("{}...", &long[..30])]);
        let monday = format!("/capture-2026-11-23-monday/{long}.aarc");
        let friday = format!("/capture-2026-11-27-friday/{long}.aarc");
        let file = format!("{}...", &long[..15]);
        assert_eq!(
            titles([&monday, &friday]),
            [format!("capture...-monday/{file}"), format!("capture...-friday/{file}")]
        );
        assert_eq!(
            titles(["/a folder of 24 letters/a.aarc", "/b/a.aarc"]),
            ["a folder of 24 letters/a.aarc", "b/a.aarc"],
            "a short file leaves the room to the folder"
        );
    }
}
