//! [`TakeWriter`]: writes a take whose segments come one after another.
//!
//! The head has the lengths of all segments and comes first in the file, so the packages of the segments wait in a
//! scratch file beside the output until the last one is there.

use std::path::{Path, PathBuf};

use anyhow::anyhow;
use codec::{ClipInfo, Contents, EncodeError, Limits, SegmentPackage, encode_take_head};
use program::{Fault, output};

use super::span::Span;

/// Length of the pieces in which packages are copied.
const PIECE_BYTES: u64 = 1 << 20;

/// A take that is being written.
pub(crate) struct TakeWriter {
    path: PathBuf,
    scratch: output::Scratch,
    bytes: u64,
    segments: Vec<(Span, Contents)>,
}

impl TakeWriter {
    /// Begins the take at `path`.
    ///
    /// # Errors
    /// [`Fault::Usage`] with the path and the reason.
    pub(crate) fn begin(path: &Path) -> Result<TakeWriter, Fault> {
        let scratch = output::Scratch::beside(path)?;
        Ok(TakeWriter { path: path.to_owned(), scratch, bytes: 0, segments: Vec::new() })
    }

    /// Appends a segment; segments come in the order of the take.
    ///
    /// # Errors
    /// [`Fault::Usage`] if it cannot be written.
    pub(crate) fn add(&mut self, span: Span, package: &[u8]) -> anyhow::Result<()> {
        let contents = codec::contents(package, &Limits::default())?;
        self.scratch.write(package)?;
        self.bytes += package.len() as u64;
        self.segments.push((span, contents));
        Ok(())
    }

    /// Writes the head and then the segments. Returns the size of the file in bytes.
    ///
    /// # Errors
    /// [`Fault::Usage`] if it cannot be written; [`Fault::Data`] if the segments make no take.
    pub(crate) fn finish(mut self, info: &ClipInfo, duration_s: f64) -> anyhow::Result<u64> {
        let head = head(&self.path, info, duration_s, &self.segments)?;
        let (path, scratch, bytes) = (&self.path, &mut self.scratch, self.bytes);
        output::write_parts(path, |file| {
            file.write(&head)?;
            let mut offset = 0;
            while offset < bytes {
                let length = PIECE_BYTES.min(bytes - offset);
                file.write(&scratch.read(offset, length as usize)?)?;
                offset += length;
            }
            Ok::<(), Fault>(())
        })?;
        Ok(head.len() as u64 + bytes)
    }
}

/// The head of a take of these segments.
///
/// # Errors
/// [`Fault::Data`] if they make no take.
pub(crate) fn head(
    path: &Path,
    info: &ClipInfo,
    duration_s: f64,
    segments: &[(Span, Contents)],
) -> anyhow::Result<Vec<u8>> {
    let entries: Vec<SegmentPackage> = segments
        .iter()
        .map(|(span, contents)| SegmentPackage {
            start_s: span.start_s,
            duration_s: span.duration_s,
            level: span.level,
            contents,
        })
        .collect();
    encode_take_head(info, duration_s, &entries).map_err(|error| match error {
        EncodeError::Take { reason } => {
            Fault::Data(format!("{}: no take: {reason}; join other fields", path.display())).into()
        }
        error => anyhow!(error),
    })
}
