//! The photographs that a fit looks at.

use std::collections::BTreeSet;

use codec::Camera;
use program::Fault;
use rayon::prelude::*;
use refine::capture::{Holdout, PhotoId, Split};
use refine::fit::{Photograph, Timeline, TrainingView};

use crate::capture::Footage;

/// Most held photographs that a fit is measured by as it goes.
const CHECKED: usize = 8;

/// Memory that photographs may take together while they are decoded, and what each of their pixels
/// takes then: the file's, 16 bits per channel, doubles as taken, and doubles without the lens.
/// Afterwards a pixel takes 4 bytes.
const DECODING_BYTES: usize = 2 << 30;
const BYTES_PER_PIXEL: usize = 8 + 8 + 32 + 32;

/// Photographs to fit to, and a few that are held.
#[derive(Debug)]
pub struct Shots {
    /// What the fit sees.
    pub train: Vec<(PhotoId, TrainingView)>,
    /// What it is measured by as it goes, from all splits that are held; empty where nothing is.
    pub held: Vec<TrainingView>,
    /// Number of frames.
    pub timeline: Timeline,
}

impl Shots {
    /// Reads the photographs of `footage`.
    ///
    /// # Errors
    /// [`Fault::Data`] that names the file, or says that nothing is left to fit to.
    pub fn load(footage: &Footage, holdout: Holdout, on_photo: impl Fn() + Sync) -> Result<Shots, Fault> {
        let timeline = Timeline { frames: footage.capture.times.len() };
        let splits = splits(footage, holdout)?;
        let load = |shot: &PhotoId| {
            let photograph = Photograph::from(&footage.photo(*shot)?);
            on_photo();
            Ok((*shot, shot_of(footage, *shot, timeline, photograph)))
        };
        let at_once = (DECODING_BYTES / (BYTES_PER_PIXEL * footage.most_pixels())).max(1);
        let load_all = |shots: &[PhotoId]| -> Result<Vec<(PhotoId, TrainingView)>, Fault> {
            let mut loaded = Vec::with_capacity(shots.len());
            for shots in shots.chunks(at_once) {
                loaded.extend(shots.par_iter().map(load).collect::<Result<Vec<_>, Fault>>()?);
            }
            Ok(loaded)
        };
        let named = |wanted: &dyn Fn(Split) -> bool| -> Vec<PhotoId> {
            splits.iter().filter(|(_, split)| wanted(*split)).map(|(shot, _)| *shot).collect()
        };
        let held = load_all(&evenly(&named(&|split| split != Split::Train), CHECKED))?;
        let train = load_all(&named(&|split| split == Split::Train))?;
        Ok(Shots { train, held: held.into_iter().map(|(_, shot)| shot).collect(), timeline })
    }
}

fn splits(footage: &Footage, holdout: Holdout) -> Result<Vec<(PhotoId, Split)>, Fault> {
    Split::assign(&footage.capture, holdout).map_err(|error| Fault::Data(error.to_string()))
}

/// Numbers of the frames that there are photographs of to fit to.
///
/// # Errors
/// [`Fault::Data`] where there are none.
pub(super) fn train_frames(footage: &Footage, holdout: Holdout) -> Result<BTreeSet<usize>, Fault> {
    let train = splits(footage, holdout)?.into_iter().filter(|(_, split)| *split == Split::Train);
    Ok(train.map(|(shot, _)| shot.frame).collect())
}

fn shot_of(footage: &Footage, shot: PhotoId, timeline: Timeline, photograph: Photograph) -> TrainingView {
    let camera: Camera = footage.capture.cameras[shot.camera].camera.clone();
    TrainingView { camera, frame: footage.capture.times[shot.frame] * timeline.frames_per_clip(), photograph }
}

/// At most `count` of `all`, from its first to its last.
fn evenly<T: Copy>(all: &[T], count: usize) -> Vec<T> {
    let count = count.min(all.len());
    (0..count).map(|i| all[if count == 1 { 0 } else { i * (all.len() - 1) / (count - 1) }]).collect()
}

#[cfg(test)]
mod tests {
    use super::evenly;

    #[test]
    fn a_few_are_picked_from_the_first_to_the_last() {
        let all: Vec<u32> = (0..100).collect();
        assert_eq!(evenly(&all, 4), [0, 33, 66, 99]);
        assert_eq!(evenly(&all[..3], 8), [0, 1, 2]);
        assert_eq!(evenly(&all, 1), [0]);
        assert!(evenly(&all[..0], 8).is_empty());
    }
}
