//! [`TakeFile`]: a package on disk, a take or an ordinary clip, with one segment at a time in memory.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::num::NonZero;
use std::path::{Path, PathBuf};
use std::thread::available_parallelism;

use codec::{Clip, Contents, Error, FormatError, Limits, Poster, Sound, Take, Viewpoint};
use program::Fault;

use super::folder::FieldFolder;
use crate::messages::{bad_package, unreadable};

/// Length of the first read of a head. Most heads are shorter.
const HEAD_BYTES: usize = 64 << 10;

/// A package on disk. An ordinary clip is a take of one segment.
#[derive(Debug)]
pub struct TakeFile {
    path: PathBuf,
    file: File,
    bytes: u64,
    take: Take,
}

impl TakeFile {
    /// Opens a package and reads its head.
    ///
    /// # Errors
    /// [`Fault::Data`] that names the file: missing, not a file, or with a damaged head.
    pub fn open(path: &Path) -> Result<TakeFile, Fault> {
        let cannot_read = |error| unreadable(path, &error);
        let mut file = File::open(path).map_err(cannot_read)?;
        let metadata = file.metadata().map_err(cannot_read)?;
        if !metadata.is_file() {
            let what = match FieldFolder::is_one(path) {
                true => "a field folder, and no package yet; package it first",
                false => "not a file; name a package (.aarc)",
            };
            return Err(Fault::Data(format!("{}: {what}", path.display())));
        }
        let mut head = Vec::new();
        let mut needed = HEAD_BYTES;
        let take = loop {
            let more = (needed - head.len()) as u64;
            let read = (&mut file).take(more).read_to_end(&mut head).map_err(cannot_read)?;
            match codec::package(&head, &Limits::default()) {
                // The file has more than was read.
                Err(Error::Format { error: FormatError::Truncated { needed: next, .. }, .. })
                    if read as u64 == more && next > head.len() =>
                {
                    needed = next;
                }
                result => break result.map_err(|error| bad_package(path, &error))?,
            }
        };
        let bytes = metadata.len();
        if bytes > take.package_bytes() {
            let offset = usize::try_from(take.package_bytes()).unwrap_or(usize::MAX);
            let count = usize::try_from(bytes - take.package_bytes()).unwrap_or(usize::MAX);
            let error = Error::Format { offset, error: FormatError::Extra { count, part: "the package" } };
            return Err(bad_package(path, &error));
        }
        Ok(TakeFile { path: path.to_owned(), file, bytes, take })
    }

    /// The head and the table of segments.
    pub fn take(&self) -> &Take {
        &self.take
    }

    /// Path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Size of the file in bytes.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Whether it is an ordinary clip, without a table of segments.
    pub fn is_clip(&self) -> bool {
        self.take.head_bytes == 0
    }

    /// Number of bytes of a segment that the file holds: all, unless it was cut short.
    pub fn available(&self, index: usize) -> usize {
        let segment = &self.take.segments[index];
        let present = self.bytes.saturating_sub(segment.offset).min(segment.bytes() as u64);
        usize::try_from(present).unwrap_or(usize::MAX)
    }

    /// The bytes of a segment that the file holds.
    ///
    /// # Errors
    /// [`Fault::Data`] if the file cannot be read.
    pub fn read(&self, index: usize) -> Result<Vec<u8>, Fault> {
        self.read_prefix(index, self.available(index))
    }

    fn read_prefix(&self, index: usize, length: usize) -> Result<Vec<u8>, Fault> {
        let mut bytes = Vec::new();
        let mut file = &self.file;
        let read = file.seek(SeekFrom::Start(self.take.segments[index].offset));
        let read = read.and_then(|_| file.take(length as u64).read_to_end(&mut bytes));
        match read {
            Ok(count) if count == length => Ok(bytes),
            Ok(_) => {
                Err(Fault::Data(format!("{}: it became shorter; get the file again", self.path.display())))
            }
            Err(error) => Err(unreadable(&self.path, &error)),
        }
    }

    /// The head of a segment, which is checked against the table.
    ///
    /// # Errors
    /// [`Fault::Data`] that names the segment if it is missing or its head is damaged.
    pub fn contents(&self, index: usize) -> Result<Contents, Fault> {
        let segment = &self.take.segments[index];
        let first_layer = segment.layers.first().map_or(0, |layer| layer.bytes);
        self.check_present(index, first_layer)?;
        let bytes = self.read_prefix(index, first_layer)?;
        let contents = self.take.segment_contents(index, &bytes, &Limits::default());
        contents.map_err(|error| self.damaged(index, &without_number(&error)))
    }

    /// The sound of a segment; `contents` is its head.
    ///
    /// # Errors
    /// [`Fault::Data`] that names the segment if it is cut short or damaged.
    pub fn sound(&self, index: usize, contents: &Contents) -> Result<Option<Sound>, Fault> {
        let sound = contents.sound(&self.read(index)?, &Limits::default());
        // The offset of an error counts from the start of the segment.
        sound.map_err(|error| self.damaged(index, &format!("{error} of the segment")))
    }

    /// The poster, which the first segment has; its time lies in the clip or take.
    ///
    /// # Errors
    /// [`Fault::Data`] that names the segment if it is cut short or damaged.
    pub fn poster(&self) -> Result<Option<Poster>, Fault> {
        let poster = self.contents(0)?.poster(&self.read(0)?);
        let poster = poster.map_err(|error| self.damaged(0, &format!("{error} of the segment")))?;
        let start_s = self.take.segments[0].start_s;
        let placed = |poster: Poster| (poster.time_s + start_s).clamp(0.0, self.take.duration_s);
        Ok(poster.map(|poster| Poster { time_s: placed(poster), ..poster }))
    }

    /// The bytes of a whole segment. The checksums of all its sections are right. `contents` is its head.
    ///
    /// # Errors
    /// [`Fault::Data`] that names the segment if it is missing or damaged.
    pub(super) fn read_checked(&self, index: usize, contents: &Contents) -> Result<Vec<u8>, Fault> {
        self.check_present(index, self.take.segments[index].bytes())?;
        let bytes = self.read(index)?;
        // The offset of an error counts from the start of the segment.
        let damaged = |error: Error| self.damaged(index, &format!("{error} of the segment"));
        contents.check_sections(&bytes).map_err(damaged)?;
        Ok(bytes)
    }

    /// Decodes the complete layers of a segment.
    ///
    /// # Errors
    /// [`Fault::Data`] that names the segment: missing, cut short in its first layer, or damaged.
    pub fn decode(&self, index: usize) -> Result<Clip, Fault> {
        if !self.is_clip() {
            self.check_present(
                index,
                self.take.segments[index].layers.first().map_or(0, |layer| layer.bytes),
            )?;
        }
        let bytes = self.read(index)?;
        let threads = available_parallelism().unwrap_or(NonZero::<usize>::MIN);
        let clip = self.take.decode_segment(index, &bytes, &Limits::default(), threads);
        clip.map_err(|error| match self.is_clip() {
            true => bad_package(&self.path, &error),
            false => self.damaged(index, &without_number(&error)),
        })
    }

    /// The viewpoints, or the opening at the start if there are none, by the segments there that can be decoded. Never
    /// empty.
    pub fn viewpoints(&self) -> Vec<Viewpoint> {
        if !self.take.info.viewpoints.is_empty() {
            return self.take.info.viewpoints.clone();
        }
        let decoded = |index: usize| Some((index, self.decode(index).ok()?));
        let clips: Vec<(usize, Clip)> = self.take.at(0.0).filter_map(decoded).collect();
        vec![self.take.surroundings(&clips).opening()]
    }

    /// Checks that the first `length` bytes of a segment are in the file.
    ///
    /// # Errors
    /// [`Fault::Data`] that names the segment.
    pub(super) fn check_present(&self, index: usize, length: usize) -> Result<(), Fault> {
        match self.available(index) {
            available if available < length => {
                Err(self.damaged(index, &format!("cut short, {available} of {length} bytes are there")))
            }
            _ => Ok(()),
        }
    }

    fn damaged(&self, index: usize, what: &str) -> Fault {
        let segment = &self.take.segments[index];
        Fault::Data(format!(
            "{}: segment {index}, from {} s: {what}; get the file again",
            self.path.display(),
            segment.start_s
        ))
    }
}

/// The message of an error of a segment, which the fault names before it.
fn without_number(error: &Error) -> String {
    match error {
        Error::Format { offset, error: FormatError::Segment { expected, found, .. } } => {
            format!("not the one in the table: {expected} expected, {found} found, at byte {offset}")
        }
        error => error.to_string(),
    }
}
