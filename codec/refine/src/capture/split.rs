//! [`Split`]: training and evaluation photographs of a capture.

use std::fmt;

use serde::{Deserialize, Serialize};

use super::{Capture, PhotoId};

/// Held-out frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Holdout {
    /// Frames with odd numbers, counted from 0, as in the paper.
    Odd,
    /// None.
    None,
}

impl Holdout {
    /// Name on command lines and in field files.
    pub fn name(self) -> &'static str {
        match self {
            Holdout::Odd => "odd",
            Holdout::None => "none",
        }
    }

    /// The holdout of this [`Holdout::name`].
    pub fn named(name: &str) -> Option<Holdout> {
        [Holdout::Odd, Holdout::None].into_iter().find(|holdout| holdout.name() == name)
    }

    /// Whether `frame` is held out.
    pub fn holds(self, frame: usize) -> bool {
        self == Holdout::Odd && frame % 2 == 1
    }
}

/// A subset of the photographs of a capture, named as in the paper's tables.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Split {
    /// Training cameras in training frames.
    Train,
    /// Training cameras in held-out frames.
    InterpB,
    /// Held-out cameras in training frames.
    Recon,
    /// Held-out cameras in held-out frames.
    InterpA,
}

impl Split {
    /// All splits.
    pub const ALL: [Split; 4] = [Split::Train, Split::InterpB, Split::Recon, Split::InterpA];

    /// Name in tables and files.
    pub fn name(self) -> &'static str {
        match self {
            Split::Train => "train",
            Split::InterpB => "interp_b",
            Split::Recon => "recon",
            Split::InterpA => "interp_a",
        }
    }

    fn new(held_camera: bool, held_frame: bool) -> Split {
        match (held_camera, held_frame) {
            (false, false) => Split::Train,
            (false, true) => Split::InterpB,
            (true, false) => Split::Recon,
            (true, true) => Split::InterpA,
        }
    }

    /// Assigns each photograph of `capture` to a split, by [`CalibratedCamera::held`](super::CalibratedCamera)
    /// and `holdout`.
    ///
    /// # Errors
    /// [`SplitError`] if no training photograph is left.
    pub fn assign(capture: &Capture, holdout: Holdout) -> Result<Vec<(PhotoId, Split)>, SplitError> {
        let split = |photo: &PhotoId| {
            (*photo, Split::new(capture.cameras[photo.camera].held, holdout.holds(photo.frame)))
        };
        let splits: Vec<_> = capture.photos.iter().map(split).collect();
        match splits.iter().any(|(_, split)| *split == Split::Train) {
            true => Ok(splits),
            false => Err(SplitError),
        }
    }
}

/// Error of [`Split::assign`]: all photographs are held out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SplitError;

impl fmt::Display for SplitError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(
            "all photographs are held out, and none is left to fit to; hold out fewer cameras or frames",
        )
    }
}

impl std::error::Error for SplitError {}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::fixtures::calibrated;
    use crate::capture::{CalibratedCamera, even_times_s};

    fn capture(held: &[bool]) -> Capture {
        let cameras = held.iter().map(|&held| CalibratedCamera { held, ..calibrated() });
        let photos = (0..held.len()).flat_map(|camera| (0..3).map(move |frame| PhotoId { camera, frame }));
        let photos = photos.collect();
        Capture {
            cameras: cameras.collect(),
            frame_times_s: even_times_s(3, 30.0),
            photos,
            ..Capture::default()
        }
    }

    #[test]
    fn cameras_and_frames_are_held_out_independently() {
        let count = |held: &[bool], holdout| {
            let splits = Split::assign(&capture(held), holdout).unwrap();
            Split::ALL.map(|split| splits.iter().filter(|(_, of)| *of == split).count())
        };
        assert_eq!(count(&[false, true, false], Holdout::Odd), [4, 2, 2, 1]);
        assert_eq!(count(&[false, false], Holdout::None), [6, 0, 0, 0]);
    }

    #[test]
    fn a_training_photograph_must_remain() {
        assert_eq!(Split::assign(&capture(&[true, true]), Holdout::None), Err(SplitError));
    }
}
