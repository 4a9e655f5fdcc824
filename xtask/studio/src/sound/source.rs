//! [`SoundSource`]: where the sound of a package comes from.

use std::path::PathBuf;

/// Where the sound of a package comes from.
#[derive(Clone, Debug, PartialEq)]
pub struct SoundSource {
    /// A file that ffmpeg reads. Its first sound track counts.
    pub path: PathBuf,
    /// Second of the clip at which the file begins; below 0 for a file that begins before the clip.
    pub start_s: f64,
    /// Point of the scene from which the sound comes, in its axes and units; `None` for a stereo bed.
    pub position: Option<[f32; 3]>,
}
