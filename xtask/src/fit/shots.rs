//! The photographs that a fit looks at.

use codec::Camera;
use rayon::prelude::*;
use refine::capture::{CaptureShot, Holdout, Split};
use refine::fit::{Clock, Photograph, Shot};

use crate::capture::Footage;
use crate::fault::Fault;

/// Most held photographs that a fit is measured by as it goes.
const CHECKED: usize = 8;

/// Photographs to fit to, and a few that are held.
#[derive(Debug)]
pub struct Shots {
    /// What the fit sees.
    pub train: Vec<(CaptureShot, Shot)>,
    /// What it is measured by as it goes, from all splits that are held; empty where nothing is.
    pub held: Vec<Shot>,
    /// Number of frames.
    pub clock: Clock,
}

impl Shots {
    /// Reads the photographs of `footage`.
    ///
    /// # Errors
    /// [`Fault::Data`] that names the file, or says that nothing is left to fit to.
    pub fn load(footage: &Footage, holdout: Holdout, on_photo: impl Fn() + Sync) -> Result<Shots, Fault> {
        let clock = Clock { frames: footage.capture.times.len() };
        let splits =
            Split::assign(&footage.capture, holdout).map_err(|error| Fault::Data(error.to_string()))?;
        let load = |shot: &CaptureShot| {
            let photograph = Photograph::from(&footage.photo(*shot)?);
            on_photo();
            Ok((*shot, shot_of(footage, *shot, clock, photograph)))
        };
        let named = |wanted: &dyn Fn(Split) -> bool| -> Vec<CaptureShot> {
            splits.iter().filter(|(_, split)| wanted(*split)).map(|(shot, _)| *shot).collect()
        };
        let held = named(&|split| split != Split::Train);
        let held = evenly(&held, CHECKED).par_iter().map(load).collect::<Result<Vec<_>, Fault>>()?;
        let train = named(&|split| split == Split::Train);
        let train = train.par_iter().map(load).collect::<Result<Vec<_>, Fault>>()?;
        Ok(Shots { train, held: held.into_iter().map(|(_, shot)| shot).collect(), clock })
    }

    /// Numbers of the frames that there are photographs of to fit to, rising.
    pub fn frames(&self) -> Vec<usize> {
        let mut frames: Vec<usize> = self.train.iter().map(|(shot, _)| shot.frame).collect();
        frames.sort_unstable();
        frames.dedup();
        frames
    }
}

fn shot_of(footage: &Footage, shot: CaptureShot, clock: Clock, photograph: Photograph) -> Shot {
    let camera: Camera = footage.capture.cameras[shot.camera].camera.clone();
    Shot { camera, frame: footage.capture.times[shot.frame] * clock.frames_per_clip(), photograph }
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
