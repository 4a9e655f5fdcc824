//! [`Record`]: what is known of an output, in a small file beside it.
//!
//! It is written twice: before the work, with the key of what is to be made, and after it, with the
//! checksum of what was made. So whatever interrupts, an output counts as done only if it is the
//! one that its record speaks of, and half a work is gone on with only where its key is the same.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use program::{Fault, output};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::key::file_sum;

/// Most bytes of a record.
const RECORD_BYTES: u64 = 16 << 20;

/// What an output is, or is to become.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// Who makes it.
    command: String,
    /// What it follows from.
    key: String,
    /// SHA-256 of the output, once it is done.
    sha256: Option<String>,
    /// What the command has to say of it.
    report: Value,
}

/// How an output stands to what it should be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Standing {
    /// It is that.
    Done,
    /// Work on it began.
    Begun,
    /// The command made, or began, it from something else.
    Stale,
    /// The command has nothing to do with it.
    Unknown,
}

/// Where the record of an output is.
pub fn record_path(out: &Path) -> PathBuf {
    let mut name = out.file_name().unwrap_or_default().to_owned();
    name.push(".done.json");
    out.with_file_name(name)
}

impl Record {
    /// How the output `out` of `command` stands to `key`. A record that cannot be read is none.
    pub fn standing(out: &Path, command: &str, key: &str) -> Standing {
        match read(&record_path(out)) {
            Some(record) if record.command != command => Standing::Unknown,
            Some(record) if record.key != key => Standing::Stale,
            Some(Record { sha256: Some(sum), .. }) if file_sum(out).is_ok_and(|actual| actual == sum) => {
                Standing::Done
            }
            Some(_) => Standing::Begun,
            None => Standing::Unknown,
        }
    }

    /// Notes that work on `out` begins.
    ///
    /// # Errors
    /// [`Fault::Usage`] that names the record, if it cannot be written.
    pub fn begin(out: &Path, command: &str, key: &str) -> Result<(), Fault> {
        let (command, key) = (command.into(), key.into());
        Record { command, key, sha256: None, report: Value::Null }.write(out)
    }

    /// Notes that `out` is done.
    ///
    /// # Errors
    /// [`Fault::Usage`] that names the file, if `out` cannot be read or the record not be written.
    pub fn complete(out: &Path, command: &str, key: &str, report: Value) -> Result<(), Fault> {
        let sum = file_sum(out).map_err(|error| Fault::Usage(format!("{}: {error}", out.display())))?;
        Record { command: command.into(), key: key.into(), sha256: Some(sum), report }.write(out)
    }

    fn write(&self, out: &Path) -> Result<(), Fault> {
        let text = format!("{:#}\n", serde_json::json!(self));
        output::write(&record_path(out), text.as_bytes())
    }
}

fn read(path: &Path) -> Option<Record> {
    let mut bytes = Vec::new();
    File::open(path).ok()?.take(RECORD_BYTES).read_to_end(&mut bytes).ok()?;
    serde_json::from_slice(&bytes).ok()
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn an_output_is_done_if_it_is_the_one_of_its_record() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("walk.v2.aarc");
        let standing = |command: &str, key: &str| Record::standing(&out, command, key);
        assert_eq!(standing("package", "k"), Standing::Unknown);
        fs::write(&out, "someone's").unwrap();
        assert_eq!(standing("package", "k"), Standing::Unknown);
        Record::begin(&out, "package", "k").unwrap();
        assert!(folder.path().join("walk.v2.aarc.done.json").is_file());
        assert_eq!((standing("package", "k"), standing("package", "l")), (Standing::Begun, Standing::Stale));
        assert_eq!(standing("fit", "k"), Standing::Unknown);
        fs::write(&out, "whole").unwrap();
        assert_eq!(standing("package", "k"), Standing::Begun, "interrupted between output and record");
        Record::complete(&out, "package", "k", serde_json::json!({"bytes": 5})).unwrap();
        assert_eq!((standing("package", "k"), standing("package", "l")), (Standing::Done, Standing::Stale));
        fs::write(&out, "who1e").unwrap();
        assert_eq!(standing("package", "k"), Standing::Begun, "damaged");
        fs::remove_file(&out).unwrap();
        assert_eq!(standing("package", "k"), Standing::Begun, "gone");
        fs::write(record_path(&out), "{").unwrap();
        assert_eq!(standing("package", "k"), Standing::Unknown);
    }
}
