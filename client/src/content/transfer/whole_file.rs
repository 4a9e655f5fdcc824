//! [`WholeFile`]: a file that its server sends whole only, on disk as it arrives.
//!
//! After a broken connection it comes from its start again: its head tells whether it is the same version, and what is
//! there is skipped.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::Path;

use program::Fault;

use super::exchange::{Answer, BUFFER_BYTES, Exchange, Stream, Trouble};
use super::state::Transfer;

/// A file that arrives from its start.
#[derive(Debug)]
pub(super) struct WholeFile {
    disk: File,
    written: u64,
    /// `None` after the connection was lost.
    stream: Option<Stream>,
    transfer: Transfer,
}

impl WholeFile {
    /// The file that `stream`, the first answer of `transfer`, sends from its start, in a temporary file of `folder`.
    ///
    /// # Errors
    /// [`Fault::Usage`] if the disk takes no file.
    pub(super) fn new(folder: Option<&Path>, stream: Stream, transfer: Transfer) -> Result<WholeFile, Fault> {
        let disk = match folder {
            Some(folder) => std::fs::create_dir_all(folder).and_then(|()| tempfile::tempfile_in(folder)),
            None => tempfile::tempfile(),
        };
        let disk = disk.map_err(|error| disk_fault(&error))?;
        Ok(WholeFile { disk, written: 0, stream: Some(stream), transfer })
    }

    /// Reads the bytes from `start` to `end`, once they are there; fewer at the end of the file. `head` is how the file
    /// begins.
    ///
    /// # Errors
    /// [`Fault::Network`] if they do not come, or the file begins in another way; [`Fault::Usage`] if the disk is full.
    pub(super) fn read(
        &mut self,
        exchange: &Exchange,
        head: &[u8],
        start: u64,
        end: u64,
    ) -> Result<Vec<u8>, Fault> {
        let mut buffer = vec![0; BUFFER_BYTES];
        while self.written < end.min(self.transfer.total().unwrap_or(end)) {
            if let Err(trouble) = self.receive(exchange, head, &mut buffer) {
                self.stream = None;
                exchange.wait(trouble)?;
            }
        }
        let mut bytes = Vec::new();
        let disk = &mut self.disk;
        let length = end.min(self.written).saturating_sub(start);
        let read = disk.seek(SeekFrom::Start(start)).and_then(|_| disk.take(length).read_to_end(&mut bytes));
        read.map_err(|error| disk_fault(&error))?;
        Ok(bytes)
    }

    /// Writes the next bytes to disk.
    fn receive(&mut self, exchange: &Exchange, head: &[u8], buffer: &mut [u8]) -> Result<(), Trouble> {
        let WholeFile { disk, written, stream, transfer } = self;
        let stream = match stream {
            Some(stream) => stream,
            None => {
                transfer.start_over();
                match exchange.open(transfer, None, None)? {
                    Answer::Rest(next) | Answer::Whole(next) => stream.insert(next),
                    Answer::Unchanged => return Err(exchange.on_end(transfer)),
                }
            }
        };
        let at = stream.at;
        let count = exchange.receive_piece(transfer, stream, buffer)?;
        if count == 0 {
            return Err(exchange.on_end(transfer));
        }
        let piece = &buffer[..count];
        if head.iter().skip(at as usize).zip(piece).any(|(expected, byte)| expected != byte) {
            return Err(Trouble::Replaced);
        }
        let known = written.saturating_sub(at).min(count as u64);
        let rest = &piece[known as usize..];
        let end = disk.seek(SeekFrom::Start(*written)).and_then(|_| disk.write_all(rest));
        end.map_err(|error| Trouble::Failed(disk_fault(&error)))?;
        *written += rest.len() as u64;
        Ok(())
    }
}

fn disk_fault(error: &io::Error) -> Fault {
    Fault::Usage(format!("the part that plays cannot be written to disk: {error}: free some space"))
}
