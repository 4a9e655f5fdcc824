//! [`Strips`]: photographs, pictures and their differences side by side.

use program::Fault;
use refine::capture::{Holdout, PhotoId, Split};
use refine::image::Image;

use super::sheet::sheet;
use super::{Look, Subject, splits};
use crate::capture::CaptureFiles;

/// How much brighter the differences are than they are.
const DIFFERENCE_GAIN: f64 = 4.0;

/// A photograph, the picture and four times their difference, side by side.
#[derive(Clone, Debug)]
pub struct Strip {
    /// Camera and frame.
    pub shot: PhotoId,
    /// What the photograph is to a fit.
    pub split: Split,
    /// The three in a row.
    pub image: Image,
}

/// Keeps what is worth a look while pictures are judged, so that none is drawn twice: of each split
/// the picture in the middle, which is the same for every field, and the one with the lowest PSNR.
#[derive(Clone, Debug)]
pub struct Strips {
    middles: Vec<PhotoId>,
    kept: Vec<Strip>,
    /// Of each split, the lowest PSNR so far.
    worst: Vec<(f64, Strip)>,
}

impl Strips {
    /// Before the pictures of `subject` are judged.
    ///
    /// # Errors
    /// [`Fault::Data`] if nothing is left to fit to.
    pub fn new(subject: &Subject, capture_files: &CaptureFiles, holdout: Holdout) -> Result<Strips, Fault> {
        let mut shots = splits(capture_files, holdout)?;
        shots.retain(|(shot, _)| subject.shows(capture_files, *shot));
        let middle = |split: Split| {
            let of: Vec<PhotoId> =
                shots.iter().filter(|(_, of)| *of == split).map(|(shot, _)| *shot).collect();
            of.get(of.len() / 2).copied()
        };
        let middles = Split::ALL.into_iter().filter_map(middle).collect();
        Ok(Strips { middles, kept: Vec::new(), worst: Vec::new() })
    }

    /// Looks at a picture.
    pub fn look(&mut self, look: Look) {
        let (shot, split) = (look.judged.shot, look.judged.split);
        let measures = &look.judged.measures;
        let psnr = measures.psnr_fg.unwrap_or(measures.psnr_full);
        let strip = || Strip { shot, split, image: strip(look.picture, &look.photo.image) };
        if self.middles.contains(&shot) {
            self.kept.push(strip());
        }
        match self.worst.iter_mut().find(|(_, worst)| worst.split == split) {
            Some((lowest, _)) if psnr >= *lowest => {}
            Some(worst) => *worst = (psnr, strip()),
            None => self.worst.push((psnr, strip())),
        }
    }

    /// One or two of each split.
    pub fn into_strips(mut self) -> Vec<Strip> {
        let is_new = |(_, worst): &(f64, Strip)| !self.middles.contains(&worst.shot);
        self.kept.extend(self.worst.into_iter().filter(is_new).map(|(_, strip)| strip));
        self.kept
    }
}

fn strip(picture: &Image, taken: &Image) -> Image {
    let mut difference = Image::new(taken.width, taken.height);
    for (pixel, (taken, drawn)) in difference.pixels.iter_mut().zip(taken.pixels.iter().zip(&picture.pixels))
    {
        let [r, g, b] = [0, 1, 2].map(|c| DIFFERENCE_GAIN * (taken[c] - drawn[c].clamp(0.0, 1.0)).abs());
        *pixel = [r, g, b, 1.0];
    }
    sheet(&[vec![taken.clone(), picture.clone(), difference]])
}
