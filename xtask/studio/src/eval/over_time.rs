//! [`over_time`]: how far the pictures of a take are from photographs, frame by frame, and how much more they flicker.

use std::collections::{BTreeMap, HashSet};

use codec::Camera;
use refine::capture::{Photo, PhotoId};
use refine::image::Image;
use refine::metrics::ImageMetrics;
use serde::Serialize;

use super::Photographs;
use super::means::mean;

/// Errors at a frame of a capture, over its cameras.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct FrameErrors {
    /// Second of the take.
    pub t_s: f64,
    /// Mean PSNR of the subject in dB; `None` where no photograph shows it, or all pictures equal theirs.
    pub psnr_db: Option<f64>,
    /// Flicker since the frame before, of 255: the root of the mean square, over the pixels that show the subject, of the
    /// change of the picture minus the change of the photograph. `None` for the first frame, and where no camera has both.
    pub flicker: Option<f64>,
}

/// A photograph, and the picture of its view.
struct Compared {
    photo: Photo,
    picture: Image,
}

/// Compares pictures of the views of `cameras`, indices of the capture, with their photographs, in the order of time.
/// `draw` renders a view at a second of the take, and the alpha of what is before the plate; `on_frame` is called after each
/// frame. Memory holds two frames.
///
/// # Errors
/// A [fault of data](program::Fault::Data) if a photograph cannot be read; the errors of `draw`.
pub fn over_time(
    photographs: &Photographs,
    cameras: &[usize],
    mut draw: impl FnMut(&Camera, f64) -> anyhow::Result<(Image, Vec<f64>)>,
    mut on_frame: impl FnMut(),
) -> anyhow::Result<Vec<FrameErrors>> {
    let capture = &photographs.files.capture;
    let photos: HashSet<PhotoId> = capture.photos.iter().copied().collect();
    let mut before: BTreeMap<usize, Compared> = BTreeMap::new();
    let mut errors = Vec::new();
    for (frame, &t_s) in capture.frame_times_s.iter().enumerate() {
        let mut now = BTreeMap::new();
        for &camera in cameras {
            let photo_id = PhotoId { camera, frame };
            if photos.contains(&photo_id) {
                let mut photo = photographs.read(photo_id)?;
                let at_s = capture.time_s(photo_id).clamp(0.0, capture.duration_s());
                let (picture, subject) = draw(&capture.cameras[camera].camera, at_s)?;
                photographs.tell(photo_id, &mut photo, &subject);
                now.insert(camera, Compared { photo, picture });
            }
        }
        errors.push(FrameErrors { t_s, psnr_db: mean_psnr(&now), flicker: flicker(&before, &now) });
        before = now;
        on_frame();
    }
    Ok(errors)
}

fn mean_psnr(now: &BTreeMap<usize, Compared>) -> Option<f64> {
    let psnr = |one: &Compared| ImageMetrics::measure(&one.picture, &one.photo, None).psnr_fg;
    let known: Vec<f64> = now.values().filter_map(psnr).filter(|db| db.is_finite()).collect();
    (!known.is_empty()).then(|| mean(&known))
}

fn flicker(before: &BTreeMap<usize, Compared>, now: &BTreeMap<usize, Compared>) -> Option<f64> {
    let (mut squares, mut count) = (0.0, 0);
    for (camera, now) in now {
        let Some(before) = before.get(camera) else { continue };
        for i in 0..now.picture.pixels.len() {
            if !(now.photo.is_subject(i) && before.photo.is_subject(i)) {
                continue;
            }
            for c in 0..3 {
                let change = |now: &Image, before: &Image| {
                    now.pixels[i][c].clamp(0.0, 1.0) - before.pixels[i][c].clamp(0.0, 1.0)
                };
                let of_picture = change(&now.picture, &before.picture);
                squares += (of_picture - change(&now.photo.image, &before.photo.image)).powi(2);
                count += 1;
            }
        }
    }
    (count > 0).then(|| 255.0 * (squares / f64::from(count)).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn compared(picture: [f64; 2], photo: [f64; 2]) -> BTreeMap<usize, Compared> {
        let image =
            |colors: [f64; 2]| Image { width: 2, height: 1, pixels: colors.map(|c| [c, c, c, 1.0]).to_vec() };
        let photo = Photo { image: image(photo), seen: vec![true; 2] };
        BTreeMap::from([(3, Compared { photo, picture: image(picture) })])
    }

    #[test]
    fn only_a_change_that_the_photographs_lack_is_flicker() {
        let before = compared([0.2, 0.5], [0.1, 0.5]);
        // Both change alike, however far they are apart.
        assert!(flicker(&before, &compared([0.4, 0.6], [0.3, 0.6])).unwrap() < 1e-9);
        let one = flicker(&before, &compared([0.2, 0.7], [0.1, 0.5])).unwrap();
        assert!((one - 255.0 * 0.2 / 2.0f64.sqrt()).abs() < 1e-9, "{one}");
        assert_eq!(flicker(&BTreeMap::new(), &before), None);
    }

    #[test]
    fn pixels_without_a_subject_do_not_flicker() {
        let before = compared([0.2, 0.5], [0.1, 0.5]);
        let mut now = compared([0.9, 0.5], [0.1, 0.5]);
        now.get_mut(&3).unwrap().photo.image.pixels[0][3] = 0.0;
        assert_eq!(flicker(&before, &now), Some(0.0));
    }
}
