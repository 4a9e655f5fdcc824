//! [`Strips`]: photographs, pictures and their differences side by side.

use program::Fault;
use refine::capture::{Holdout, PhotoId, Split};
use refine::image::Image;

use super::sheet::sheet;
use super::{Comparison, Subject, splits};
use crate::capture::CaptureFiles;

/// Gain of the displayed differences.
const DIFFERENCE_GAIN: f64 = 4.0;

/// A photograph, the picture and their amplified difference, side by side.
#[derive(Clone, Debug)]
pub struct Strip {
    /// Camera and frame.
    pub photo_id: PhotoId,
    /// The split of the photograph.
    pub split: Split,
    /// The strip.
    pub image: Image,
}

/// Collects strips while pictures are compared, so that none is drawn twice: the central photograph of each
/// split, the same for every field, and the photograph with the lowest PSNR.
#[derive(Clone, Debug)]
pub struct Strips {
    central: Vec<PhotoId>,
    strips: Vec<Strip>,
    /// The lowest PSNR of each split so far, and its strip.
    worst: Vec<(f64, Strip)>,
}

impl Strips {
    /// Selects the central photographs that `subject` shows.
    ///
    /// # Errors
    /// [`Fault::Data`] if no photograph is left for fitting.
    pub fn new(subject: &Subject, capture_files: &CaptureFiles, holdout: Holdout) -> Result<Strips, Fault> {
        let mut photo_ids = splits(capture_files, holdout)?;
        photo_ids.retain(|(photo_id, _)| subject.shows(capture_files, *photo_id));
        let central_photo = |split: Split| {
            let photos: Vec<PhotoId> = photo_ids
                .iter()
                .filter(|(_, photos)| *photos == split)
                .map(|(photo_id, _)| *photo_id)
                .collect();
            photos.get(photos.len() / 2).copied()
        };
        let central = Split::ALL.into_iter().filter_map(central_photo).collect();
        Ok(Strips { central, strips: Vec::new(), worst: Vec::new() })
    }

    /// Adds the strip of a picture if it is central or the worst so far.
    pub fn add(&mut self, comparison: Comparison) {
        let Comparison { photo_id, split, measures, .. } = comparison;
        let psnr = measures.psnr_fg.unwrap_or(measures.psnr_full);
        let strip = || Strip { photo_id, split, image: strip(comparison.picture, &comparison.photo.image) };
        if self.central.contains(&photo_id) {
            self.strips.push(strip());
        }
        match self.worst.iter_mut().find(|(_, worst)| worst.split == split) {
            Some((lowest, _)) if psnr >= *lowest => {}
            Some(worst) => *worst = (psnr, strip()),
            None => self.worst.push((psnr, strip())),
        }
    }

    /// The strips: one or two of each split.
    pub fn into_strips(mut self) -> Vec<Strip> {
        let is_new = |(_, worst): &(f64, Strip)| !self.central.contains(&worst.photo_id);
        self.strips.extend(self.worst.into_iter().filter(is_new).map(|(_, strip)| strip));
        self.strips
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
