//! [`judge_held_cameras`]: how well a field shows what cameras saw that it was not fitted to, over a few frames of each.

use std::fmt::Write;

use refine::capture::{Capture, Holdout, PhotoId, Split};
use serde::Serialize;

use super::means::{known_psnr, mean_psnr, show_db};
use super::{Judged, Photographs, Subject, judge_photos, splits};
use crate::capture::CaptureFiles;
use crate::fit::evenly;

/// Most photographs of a camera, evenly spread.
const PHOTOS_MAX: usize = 8;

/// Mean PSNR in dB of a camera over its photographs, or of all cameras. The fields are keys of the JSON.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct HeldCamera {
    /// Name of the camera, or `mean`.
    pub camera: String,
    /// Number of images.
    pub images: usize,
    /// Over whole images.
    pub psnr_full: f64,
    /// The same after the transform of the camera's colours.
    pub psnr_full_aligned: f64,
    /// Over moving pixels; `None` if nothing moves.
    pub psnr_moving: Option<f64>,
    /// The same after the transform of the camera's colours.
    pub psnr_moving_aligned: Option<f64>,
}

/// The held cameras, and the mean of their rows.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct HeldCameras {
    /// A row for each camera.
    pub cameras: Vec<HeldCamera>,
    /// The mean of the rows; each row counts as much.
    pub mean: HeldCamera,
}

/// The photographs of held cameras that are judged: at most eight of each, evenly spread.
pub fn held_photos(capture: &Capture) -> Vec<PhotoId> {
    let held = (0..capture.cameras.len()).filter(|camera| capture.cameras[*camera].held);
    let of_camera = |camera: usize| {
        let photos: Vec<PhotoId> =
            capture.photos.iter().copied().filter(|photo_id| photo_id.camera == camera).collect();
        evenly(&photos, PHOTOS_MAX)
    };
    held.flat_map(of_camera).collect()
}

/// Compares `subject` with the [`held_photos`] of `capture_files`; `None` if there are none. Calls `on_photo` after each.
///
/// # Errors
/// A [fault of data](program::Fault::Data) where a file cannot be read.
pub fn judge_held_cameras(
    subject: &Subject,
    capture_files: &CaptureFiles,
    holdout: Holdout,
    mut on_photo: impl FnMut(),
) -> anyhow::Result<Option<HeldCameras>> {
    let chosen = held_photos(&capture_files.capture);
    let mut photos: Vec<(PhotoId, Split)> = splits(capture_files, holdout)?;
    photos.retain(|(photo_id, _)| chosen.contains(photo_id));
    if photos.is_empty() {
        return Ok(None);
    }
    let photographs = Photographs::new(capture_files, subject.has_plate());
    let judged = judge_photos(subject, &photographs, photos, None, |_| {
        on_photo();
        Ok(())
    })?;
    let cameras = capture_files.capture.cameras.iter().enumerate();
    let rows: Vec<HeldCamera> = cameras
        .filter_map(|(i, camera)| {
            let of_camera: Vec<&Judged> = judged.iter().filter(|one| one.photo_id.camera == i).collect();
            (!of_camera.is_empty()).then(|| row(&camera.name, &of_camera))
        })
        .collect();
    Ok(Some(HeldCameras { mean: mean_of(&rows), cameras: rows }))
}

fn row(camera: &str, judged: &[&Judged]) -> HeldCamera {
    let mean = |psnr: fn(&Judged) -> f64| mean_psnr(&judged.iter().map(|one| psnr(one)).collect::<Vec<_>>());
    let known = |psnr: fn(&Judged) -> Option<f64>| known_psnr(judged.iter().map(|one| psnr(one)));
    HeldCamera {
        camera: camera.to_owned(),
        images: judged.len(),
        psnr_full: mean(|one| one.measures.psnr_full),
        psnr_full_aligned: mean(|one| one.aligned.full),
        psnr_moving: known(|one| one.measures.psnr_moving),
        psnr_moving_aligned: known(|one| one.aligned.moving),
    }
}

fn mean_of(rows: &[HeldCamera]) -> HeldCamera {
    let mean = |psnr: fn(&HeldCamera) -> f64| mean_psnr(&rows.iter().map(psnr).collect::<Vec<_>>());
    let known = |psnr: fn(&HeldCamera) -> Option<f64>| known_psnr(rows.iter().map(psnr));
    HeldCamera {
        camera: "mean".into(),
        images: rows.iter().map(|row| row.images).sum(),
        psnr_full: mean(|row| row.psnr_full),
        psnr_full_aligned: mean(|row| row.psnr_full_aligned),
        psnr_moving: known(|row| row.psnr_moving),
        psnr_moving_aligned: known(|row| row.psnr_moving_aligned),
    }
}

impl HeldCameras {
    /// The rows as a table in Markdown, the mean last.
    pub fn table(&self) -> String {
        let mut text = String::from(
            "| held camera | images | whole, dB | aligned | moving, dB | aligned |\n|---|---|---|---|---|---|\n",
        );
        for row in self.cameras.iter().chain([&self.mean]) {
            let HeldCamera { camera, images, psnr_full, psnr_full_aligned, .. } = row;
            let [moving, aligned] = [row.psnr_moving, row.psnr_moving_aligned].map(show_db);
            writeln!(
                text,
                "| {camera} | {images} | {psnr_full:.2} | {psnr_full_aligned:.2} | {moving} | {aligned} |"
            )
            .expect("text grows");
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::eval::fixtures::camera;

    #[test]
    fn photographs_are_spread_over_the_frames_of_held_cameras() {
        let photos = |frames: usize| {
            let ids = (0..frames).flat_map(|frame| (0..3).map(move |camera| PhotoId { camera, frame }));
            let cameras = vec![camera(false), camera(true), camera(true)];
            let capture = Capture { cameras, photos: ids.collect(), ..Capture::default() };
            held_photos(&capture).into_iter().map(|photo| (photo.camera, photo.frame)).collect::<Vec<_>>()
        };
        assert_eq!(photos(1), [(1, 0), (2, 0)]);
        assert_eq!(photos(2), [(1, 0), (1, 1), (2, 0), (2, 1)]);
        let many = photos(150);
        assert_eq!((many.len(), many[0], many[7], many[8]), (16, (1, 0), (1, 149), (2, 0)));
        assert!(many[..8].windows(2).all(|pair| (21..=22).contains(&(pair[1].1 - pair[0].1))), "{many:?}");
    }

    #[test]
    fn every_camera_counts_as_much_as_any_other() {
        let row = |images, psnr_full, psnr_moving| HeldCamera {
            camera: "c".into(),
            images,
            psnr_full,
            psnr_full_aligned: psnr_full + 1.0,
            psnr_moving,
            psnr_moving_aligned: None,
        };
        let cameras = vec![row(8, 20.0, Some(10.0)), row(2, 30.0, None)];
        let held = HeldCameras { mean: mean_of(&cameras), cameras };
        let table = held.table();
        assert!(table.contains("| c | 8 | 20.00 | 21.00 | 10.00 | – |\n"), "{table}");
        assert!(table.ends_with("| mean | 10 | 25.00 | 26.00 | 10.00 | – |\n"), "{table}");
    }
}
