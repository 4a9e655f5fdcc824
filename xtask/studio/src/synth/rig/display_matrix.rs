//! Turns the video of an MP4 file: players show it after a quarter turn clockwise, as of a phone held upright.
//!
//! The matrix is overwritten in the file, because the options of ffmpeg that set it differ between its versions.
//!
//! ```text
//! file:   ftyp ... moov            boxes of 32-bit size, type, content
//! moov:   trak (tkhd ...) ...      the video's track is the first one
//! tkhd:   version, 3 of flags, times and numbers, matrix (9 of 32 bits), width, height
//! ```

use std::fs::{File, OpenOptions};
use std::io::{self, Error, Read, Seek, SeekFrom, Write};
use std::ops::Range;
use std::path::Path;

/// Offsets of the matrix in the content of the box, by its version.
const MATRIX: [u64; 2] = [40, 52];

/// 1 as 16.16 and as 2.30 bits.
const ONE: i32 = 1 << 16;
const ONE_LAST: i32 = 1 << 30;

/// Has players turn the video of the MP4 file clockwise. Its pictures are `height` pixels high as they are stored.
///
/// # Errors
/// Those of the file; if it is no MP4 file.
pub(super) fn turn_clockwise(path: &Path, height: u32) -> io::Result<()> {
    let mut file = OpenOptions::new().read(true).write(true).open(path)?;
    let all = 0..file.metadata()?.len();
    let movie = find(&mut file, all, *b"moov")?;
    let track = find(&mut file, movie, *b"trak")?;
    let header = find(&mut file, track, *b"tkhd")?;
    file.seek(SeekFrom::Start(header.start))?;
    let mut version = [0];
    file.read_exact(&mut version)?;
    let offset =
        MATRIX.get(usize::from(version[0])).ok_or_else(|| Error::other("a track of another version"))?;
    file.seek(SeekFrom::Start(header.start + offset))?;
    // A point (x, y) is shown at (height - y, x).
    let matrix = [0, ONE, 0, -ONE, 0, 0, (height << 16) as i32, 0, ONE_LAST];
    matrix.iter().try_for_each(|number| file.write_all(&number.to_be_bytes()))
}

/// The content of the first box of this type among the boxes in a range of a file.
fn find(file: &mut File, range: Range<u64>, wanted: [u8; 4]) -> io::Result<Range<u64>> {
    let mut at = range.start;
    while at + 8 <= range.end {
        let mut head = [0; 16];
        file.seek(SeekFrom::Start(at))?;
        file.read_exact(&mut head[..8])?;
        let short = u32::from_be_bytes([head[0], head[1], head[2], head[3]]);
        let (head_length, length) = match short {
            // A 64-bit size follows.
            1 => {
                file.read_exact(&mut head[8..])?;
                (16, u64::from_be_bytes(std::array::from_fn(|i| head[8 + i])))
            }
            0 => (8, range.end - at),
            short => (8, u64::from(short)),
        };
        let end = at.saturating_add(length).min(range.end);
        if head[4..8] == wanted {
            return Ok(at + head_length..end);
        }
        at = end.max(at + head_length);
    }
    Err(Error::other("no video track in it"))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A box with this content.
    fn boxed(name: &[u8; 4], content: &[u8]) -> Vec<u8> {
        [&(8 + content.len() as u32).to_be_bytes(), &name[..], content].concat()
    }

    #[test]
    fn the_matrix_of_the_first_track_is_overwritten() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mp4");
        let long = [&1u32.to_be_bytes()[..], b"mdat", &24u64.to_be_bytes(), &[7; 8]].concat();
        for (version, matrix_at) in [(0, 40), (1, 52)] {
            let header = [&[version][..], &vec![9; matrix_at + 43]].concat();
            let track = boxed(b"trak", &[boxed(b"edts", b"abc"), boxed(b"tkhd", &header)].concat());
            let file =
                [boxed(b"ftyp", b"isom"), long.clone(), boxed(b"moov", &[track.clone(), track].concat())]
                    .concat();
            std::fs::write(&path, &file).unwrap();
            turn_clockwise(&path, 64).unwrap();
            let turned = std::fs::read(&path).unwrap();
            let changed: Vec<usize> = (0..file.len()).filter(|i| file[*i] != turned[*i]).collect();
            let first = file.windows(4).position(|name| name == b"tkhd").unwrap() + 4 + matrix_at;
            assert_eq!((turned.len(), changed[0], changed.len()), (file.len(), first, 36));
            assert_eq!(turned[first + 4..first + 8], [0, 1, 0, 0]);
            assert_eq!(turned[first + 24..first + 28], [0, 64, 0, 0]);
        }
        for wrong in [b"".to_vec(), boxed(b"moov", b""), vec![0xff; 40], vec![0; 40]] {
            std::fs::write(&path, wrong).unwrap();
            assert!(turn_clockwise(&path, 64).is_err());
        }
    }
}
