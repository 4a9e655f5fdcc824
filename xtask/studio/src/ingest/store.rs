//! [`Store`]: results of steps, kept in the output's folder so that another run can go on from them.
//!
//! A result is a JSON file with the key that it depends on. A result with another key, and one that cannot be read, is
//! forgotten, then made again: it may stand for files, which an interrupted run leaves half replaced.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;

use program::{Fault, output};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::messages::unreadable;

/// Version of all results: a change of what a step computes changes it.
const VERSION: u32 = 6;

/// A result in its file.
#[derive(Deserialize)]
struct Kept<T> {
    key: String,
    value: T,
}

/// The folder of results.
#[derive(Debug)]
pub(super) struct Store {
    folder: PathBuf,
}

impl Store {
    /// Makes the folder.
    ///
    /// # Errors
    /// [`Fault::Usage`] if it cannot be made.
    pub(super) fn open(folder: PathBuf) -> Result<Store, Fault> {
        output::make_folder(&folder)?;
        Ok(Store { folder })
    }

    /// Path of a file of this name.
    pub(super) fn path(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    /// The result of this name, and whether it was kept: the result of an earlier run with the same key, or what `make`
    /// returns.
    ///
    /// # Errors
    /// Those of `make`; [`Fault::Usage`] if the result cannot be written.
    pub(super) fn result<T: Serialize + DeserializeOwned>(
        &self,
        name: &str,
        key: &Value,
        make: impl FnOnce() -> Result<T, Fault>,
    ) -> Result<(T, bool), Fault> {
        match self.kept(name, key) {
            Some(value) => Ok((value, true)),
            None => {
                self.forget(name);
                Ok((self.keep(name, key, &make()?)?, false))
            }
        }
    }

    /// The result of this name that an earlier run kept, if it had the same key.
    pub(super) fn kept<T: DeserializeOwned>(&self, name: &str, key: &Value) -> Option<T> {
        let text = fs::read_to_string(self.path(&format!("{name}.json"))).ok()?;
        let kept: Kept<T> = serde_json::from_str(&text).ok()?;
        (kept.key == key_text(key)).then_some(kept.value)
    }

    /// Keeps a result, and returns it as it will be read: every run goes on from the same numbers.
    ///
    /// # Errors
    /// [`Fault::Usage`] if it cannot be written.
    pub(super) fn keep<T: Serialize + DeserializeOwned>(
        &self,
        name: &str,
        key: &Value,
        value: &T,
    ) -> Result<T, Fault> {
        let text = json!({ "key": key_text(key), "value": value }).to_string();
        let kept: Kept<T> = serde_json::from_str(&text)
            .map_err(|error| Fault::Defect(format!("the result {name} cannot be read again: {error}")))?;
        output::write(&self.path(&format!("{name}.json")), text.as_bytes())?;
        Ok(kept.value)
    }

    /// Whether an earlier run kept a result of this name, with any key.
    pub(super) fn has(&self, name: &str) -> bool {
        self.path(&format!("{name}.json")).is_file()
    }

    /// Drops a result, before the files that it stands for are replaced.
    pub(super) fn forget(&self, name: &str) {
        drop(fs::remove_file(self.path(&format!("{name}.json"))));
    }
}

/// A key as text: numbers that are read differ in their last bit.
fn key_text(key: &Value) -> String {
    json!([VERSION, env!("CARGO_PKG_VERSION"), key]).to_string()
}

/// What tells one state of a file from another: its path, length and time.
///
/// # Errors
/// [`Fault::Data`] if the file cannot be read.
pub(super) fn identity(path: &Path) -> Result<Value, Fault> {
    let metadata = fs::metadata(path).map_err(|error| unreadable(path, &error))?;
    let modified = metadata.modified().ok().and_then(|time| time.duration_since(UNIX_EPOCH).ok());
    let nanoseconds = modified.map_or(0, |time| time.as_nanos() as u64);
    let path = fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    Ok(json!([path.to_string_lossy(), metadata.len(), nanoseconds]))
}

/// A name as a part of a file name, which no other name becomes: characters that some file systems refuse, or that
/// separate folders, are percent-encoded.
pub(super) fn file_name(name: &str) -> String {
    let part = |c: char| match c.is_alphanumeric() || "-_.".contains(c) {
        true => c.to_string(),
        false => c.to_string().bytes().map(|byte| format!("%{byte:02x}")).collect(),
    };
    name.chars().map(part).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_name_has_a_file_name_of_its_own() {
        let names = ["cam 1.mp4", "cam_1.mp4", "cam%201.mp4", "cam/1.mp4", "Kamera-é.mp4", "c\u{2007}"];
        let file_names = names.map(file_name);
        assert_eq!(
            file_names,
            ["cam%201.mp4", "cam_1.mp4", "cam%25201.mp4", "cam%2f1.mp4", "Kamera-é.mp4", "c%e2%80%87"]
        );
    }

    #[test]
    fn a_result_is_kept_until_its_key_changes() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path().join("a/b")).unwrap();
        let made = |key: u32, value: u32| store.result("x", &json!([key]), || Ok(value)).unwrap();
        assert_eq!(
            [made(1, 10), made(1, 11), made(2, 12), made(1, 13)],
            [(10, false), (10, true), (12, false), (13, false)]
        );
        fs::write(store.path("x.json"), "{").unwrap();
        assert_eq!(made(1, 14), (14, false));
        store.forget("x");
        assert_eq!(made(1, 15), (15, false));
        let failed = store.result::<u32>("x", &json!([2]), || Err(Fault::Data("no".into())));
        assert!(failed.is_err() && !store.has("x"), "the files of key 1 may be gone");
        assert_eq!(made(1, 16), (16, false));
    }
}
