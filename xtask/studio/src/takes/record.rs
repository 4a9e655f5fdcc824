//! [`Record`]: what is known of an output, in a small file beside it.
//!
//! It is written twice: before the work, with the key of what is to be made, and after it, with the
//! checksum of what was made. After any interruption, a power loss included, an output counts as done only if
//! its checksum is the recorded one, and unfinished work is resumed only if its key is the same.

use std::fs::File;
use std::io::{ErrorKind, Read};
use std::path::{Path, PathBuf};

use program::{Fault, output};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::key::file_sum;

/// Maximum size of a record in bytes.
const RECORD_BYTES: u64 = 16 << 20;

/// The record of an output.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// The command that makes it.
    command: String,
    /// The hash of its inputs, see [`super::key()`].
    key: String,
    /// SHA-256 of the output, once it is done.
    sha256: Option<String>,
    /// The command's report.
    report: Value,
}

/// State of an output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OutputState {
    /// Complete, and made from the same inputs.
    Done,
    /// Begun from the same inputs.
    Begun,
    /// Made or begun by the same command from other inputs.
    Stale,
    /// Without a record of the command.
    Unknown,
}

/// Path of the record of an output.
pub fn record_path(out: &Path) -> PathBuf {
    let mut name = out.file_name().unwrap_or_default().to_owned();
    name.push(".done.json");
    out.with_file_name(name)
}

impl Record {
    /// State of the output `out` of `command` with `key`.
    ///
    /// # Errors
    /// [`Fault::Data`] that names the record, if there is one that cannot be read.
    pub fn state(out: &Path, command: &str, key: &str) -> Result<OutputState, Fault> {
        Ok(match read(&record_path(out))? {
            Some(record) if record.command != command => OutputState::Unknown,
            Some(record) if record.key != key => OutputState::Stale,
            Some(Record { sha256: Some(sum), .. }) if file_sum(out).is_ok_and(|actual| actual == sum) => {
                OutputState::Done
            }
            Some(_) => OutputState::Begun,
            None => OutputState::Unknown,
        })
    }

    /// The report on the output `out`, `None` unless it is [`OutputState::Done`].
    ///
    /// # Errors
    /// Those of [`Record::state`].
    pub fn report(out: &Path, command: &str, key: &str) -> Result<Option<Value>, Fault> {
        match Record::state(out, command, key)? {
            OutputState::Done => Ok(read(&record_path(out))?.map(|record| record.report)),
            _ => Ok(None),
        }
    }

    /// Records that work on `out` begins.
    ///
    /// # Errors
    /// [`Fault::Usage`] that names the record, if it cannot be written.
    pub fn begin(out: &Path, command: &str, key: &str) -> Result<(), Fault> {
        let (command, key) = (command.into(), key.into());
        Record { command, key, sha256: None, report: Value::Null }.write(out)
    }

    /// Records that `out` is complete.
    ///
    /// # Errors
    /// [`Fault::Usage`] that names the file, if `out` cannot be read or the record not be written.
    pub fn complete(out: &Path, command: &str, key: &str, report: Value) -> Result<(), Fault> {
        let unreadable = |error| Fault::Usage(format!("{}: {error}; name another --out", out.display()));
        let sum = file_sum(out).map_err(unreadable)?;
        Record { command: command.into(), key: key.into(), sha256: Some(sum), report }.write(out)
    }

    fn write(&self, out: &Path) -> Result<(), Fault> {
        let text = format!("{:#}\n", serde_json::json!(self));
        output::write_durable(&record_path(out), text.as_bytes())
    }
}

/// The record at `path`, `None` if there is no file.
fn read(path: &Path) -> Result<Option<Record>, Fault> {
    let bad =
        |what: String| Fault::Data(format!("{}: {what}; remove it to make its output again", path.display()));
    let mut bytes = Vec::new();
    match File::open(path).and_then(|file| file.take(RECORD_BYTES).read_to_end(&mut bytes)) {
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
        Err(error) => Err(bad(error.to_string())),
        Ok(_) => serde_json::from_slice(&bytes)
            .map(Some)
            .map_err(|error| bad(format!("this record is damaged ({error})"))),
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn an_output_is_done_if_it_is_the_one_of_its_record() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("walk.v2.aarc");
        let standing = |command: &str, key: &str| Record::state(&out, command, key).unwrap();
        assert_eq!(standing("package", "k"), OutputState::Unknown);
        fs::write(&out, "someone's").unwrap();
        assert_eq!(standing("package", "k"), OutputState::Unknown);
        Record::begin(&out, "package", "k").unwrap();
        assert!(folder.path().join("walk.v2.aarc.done.json").is_file());
        assert_eq!(
            (standing("package", "k"), standing("package", "l")),
            (OutputState::Begun, OutputState::Stale)
        );
        assert_eq!(standing("fit", "k"), OutputState::Unknown);
        fs::write(&out, "whole").unwrap();
        assert_eq!(standing("package", "k"), OutputState::Begun, "interrupted between output and record");
        Record::complete(&out, "package", "k", serde_json::json!({"bytes": 5})).unwrap();
        assert_eq!(
            (standing("package", "k"), standing("package", "l")),
            (OutputState::Done, OutputState::Stale)
        );
        let report = |key: &str| Record::report(&out, "package", key).unwrap();
        assert_eq!((report("k"), report("l")), (Some(serde_json::json!({"bytes": 5})), None));
        fs::write(&out, "who1e").unwrap();
        assert_eq!(standing("package", "k"), OutputState::Begun, "damaged");
        fs::remove_file(&out).unwrap();
        assert_eq!(standing("package", "k"), OutputState::Begun, "gone");
        fs::write(record_path(&out), "{").unwrap();
        let damaged = Record::state(&out, "package", "k").unwrap_err().to_string();
        assert!(damaged.contains("walk.v2.aarc.done.json: this record is damaged"), "{damaged}");
        assert!(damaged.contains("remove it to make its output again"), "{damaged}");
        // A record that cannot be opened is no absent one.
        fs::remove_file(record_path(&out)).unwrap();
        fs::create_dir(record_path(&out)).unwrap();
        assert_eq!(Record::state(&out, "package", "k").unwrap_err().exit_code(), 3);
    }
}
