//! [`TakeFile`]: a package on disk, with one segment at a time in memory.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::num::NonZero;
use std::path::{Path, PathBuf};
use std::thread::available_parallelism;

use codec::{
    AttributeSize, Clip, Contents, Error, FormatError, Limits, Poster, SegmentLayer, Sound, Take, Viewpoint,
};
use program::Fault;

use super::folder::FieldFolder;
use crate::messages::{advice, bad_package, unreadable};

/// Length of the first read of a head. Most heads are shorter.
const HEAD_BYTES: usize = 64 << 10;

/// A package on disk: a take of one segment or of several.
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

    /// Gaussians, plates included, and bytes of the file that the first layers of all segments take, one entry for each
    /// number of layers. A segment of fewer layers counts as a whole.
    pub fn layers(&self) -> Vec<SegmentLayer> {
        let segments = &self.take.segments;
        let most = segments.iter().map(|segment| segment.layers.len()).max().unwrap_or(0);
        let sum = |k: usize| {
            let mut sum = SegmentLayer { bytes: self.take.head_bytes, gaussians: 0 };
            for layer in segments.iter().filter_map(|segment| segment.layers.get(k).or(segment.layers.last()))
            {
                sum.bytes += layer.bytes;
                sum.gaussians += layer.gaussians;
            }
            sum
        };
        (0..most).map(sum).collect()
    }

    /// Bytes of the first layer of a segment, without which nothing of the segment plays.
    pub fn first_layer_bytes(&self, index: usize) -> usize {
        self.take.segments[index].layers.first().map_or(0, |layer| layer.bytes)
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
        let first_layer = self.first_layer_bytes(index);
        self.check_present(index, first_layer)?;
        let bytes = self.read_prefix(index, first_layer)?;
        let contents = self.take.segment_contents(index, &bytes, &Limits::default());
        contents.map_err(|error| self.bad_segment(index, &error))
    }

    /// The sound of a segment; `contents` is its head.
    ///
    /// # Errors
    /// [`Fault::Data`] that names the segment if it is cut short or damaged.
    pub fn sound(&self, index: usize, contents: &Contents) -> Result<Option<Sound>, Fault> {
        let sound = contents.sound(&self.read(index)?, &Limits::default());
        sound.map_err(|error| self.bad_section(index, error))
    }

    /// The poster, which the first segment has; its time lies in the take.
    ///
    /// # Errors
    /// [`Fault::Data`] that names the segment if it is cut short or damaged.
    pub fn poster(&self) -> Result<Option<Poster>, Fault> {
        let poster = self.contents(0)?.poster(&self.read(0)?);
        let poster = poster.map_err(|error| self.bad_section(0, error))?;
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
        contents.check_sections(&bytes).map_err(|error| self.bad_section(index, error))?;
        Ok(bytes)
    }

    /// Decodes the complete layers of a segment.
    ///
    /// # Errors
    /// [`Fault::Data`] that names the segment: missing, cut short in its first layer, or damaged.
    pub fn decode(&self, index: usize) -> Result<Clip, Fault> {
        self.check_present(index, self.first_layer_bytes(index))?;
        let bytes = self.read(index)?;
        let threads = available_parallelism().unwrap_or(NonZero::<usize>::MIN);
        let clip = self.take.decode_segment(index, &bytes, &Limits::default(), threads);
        clip.map_err(|error| self.bad_segment(index, &error))
    }

    /// Bytes of each attribute of a segment, as [`codec::measure`] has them.
    ///
    /// # Errors
    /// Those of [`TakeFile::decode`].
    pub fn attributes(&self, index: usize) -> Result<Vec<AttributeSize>, Fault> {
        let sizes = codec::measure(&self.read(index)?, &Limits::default());
        sizes.map_err(|error| self.bad_section(index, error))
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
            available if available < length => Err(self.fault(
                index,
                &format!("cut short, {available} of {length} bytes are there; get the file again"),
            )),
            _ => Ok(()),
        }
    }

    /// The fault of a section of a segment. The offset in `error` counts from the start of the segment.
    fn bad_section(&self, index: usize, error: Error) -> Fault {
        let start = usize::try_from(self.take.segments[index].offset).unwrap_or(usize::MAX);
        self.bad_segment(index, &error.rebased(start))
    }

    /// The fault of a segment. The offset in `error` counts from the start of the file.
    fn bad_segment(&self, index: usize, error: &Error) -> Fault {
        let what = match error {
            // The number of the segment is said before.
            Error::Format { offset, error: FormatError::Segment { expected, found, .. } } => {
                format!("not the one in the table: {expected} expected, {found} found, at byte {offset}")
            }
            error => error.to_string(),
        };
        self.fault(index, &format!("{what}; {}", advice(error)))
    }

    /// A fault that names the file, and the segment if there are several.
    fn fault(&self, index: usize, what: &str) -> Fault {
        let (path, segments) = (self.path.display(), &self.take.segments);
        Fault::Data(match segments.len() {
            1 => format!("{path}: {what}"),
            _ => format!("{path}: segment {index}, from {} s: {what}", segments[index].start_s),
        })
    }
}
