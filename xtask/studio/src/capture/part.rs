//! Selects cameras and frames of a capture, and shrinks its photographs.

use std::collections::BTreeSet;
use std::ops::Range;

use codec::Camera;
use program::Fault;
use refine::capture::{CalibratedCamera, PhotoId};

use super::camera_plate::CameraPlate;
use super::capture_files::CaptureFiles;

/// Maximum number of cameras that an error lists.
const LISTED_MAX: usize = 12;

impl CaptureFiles {
    /// The index of the camera with this name.
    ///
    /// # Errors
    /// [`Fault::Usage`] that lists the cameras, if there is none.
    pub fn camera(&self, name: &str) -> Result<usize, Fault> {
        let cameras = &self.capture.cameras;
        cameras.iter().position(|camera| camera.name == name).ok_or_else(|| {
            let names: Vec<&str> =
                cameras.iter().take(LISTED_MAX).map(|camera| camera.name.as_str()).collect();
            let more = if cameras.len() > LISTED_MAX { ", ..." } else { "" };
            let names = names.join(", ");
            Fault::Usage(format!("the capture has no camera \"{name}\"; it has {names}{more}"))
        })
    }

    /// Keeps the cameras with these names.
    ///
    /// # Errors
    /// [`Fault::Usage`] if the capture has no such camera.
    pub fn keep_cameras(&mut self, names: &[String]) -> Result<(), Fault> {
        for name in names {
            self.camera(name)?;
        }
        let names: BTreeSet<&str> = names.iter().map(String::as_str).collect();
        let is_named = |camera: &CalibratedCamera| names.contains(camera.name.as_str());
        let is_selected: Vec<bool> = self.capture.cameras.iter().map(is_named).collect();
        self.select_cameras(&is_selected);
        Ok(())
    }

    /// Keeps the cameras for which `is_selected` is set, one flag a camera.
    fn select_cameras(&mut self, is_selected: &[bool]) {
        fn select<T>(of_cameras: &mut Vec<T>, is_selected: &[bool]) {
            let mut selected = is_selected.iter();
            of_cameras.retain(|_| *selected.next().expect("one for each camera"));
        }
        select(&mut self.capture.cameras, is_selected);
        select(&mut self.file_cameras, is_selected);
        select(&mut self.videos, is_selected);
        select(&mut self.plates, is_selected);
        select(&mut self.is_premultiplied, is_selected);
        let mut numbers = 0..;
        let numbers: Vec<Option<usize>> =
            is_selected.iter().map(|selected| if *selected { numbers.next() } else { None }).collect();
        self.keep_photos(|PhotoId { frame, camera }| Some(PhotoId { frame, camera: numbers[camera]? }));
    }

    /// Keeps the photographs for which `kept` gives new frames and cameras, which are in the same order.
    fn keep_photos(&mut self, kept: impl Fn(PhotoId) -> Option<PhotoId>) {
        let photos = &self.capture.photos;
        let is_kept = |i: &usize| kept(photos[*i]).is_some();
        self.paths = self.paths.select((0..photos.len()).filter(is_kept));
        let late = photos.iter().zip(&self.capture.deviations_s);
        self.capture.deviations_s =
            late.filter(|(photo_id, _)| kept(**photo_id).is_some()).map(|(_, late_s)| *late_s).collect();
        self.capture.photos = photos.iter().filter_map(|photo_id| kept(*photo_id)).collect();
        self.capture.photos.shrink_to_fit();
    }

    /// Keeps the frames in `frames`: the first becomes the start of the clip, the last its end.
    ///
    /// # Errors
    /// [`Fault::Usage`] if the capture lacks some of them.
    pub fn keep_frames(&mut self, frames: Range<usize>) -> Result<(), Fault> {
        if frames.is_empty() || frames.end > self.capture.frames() {
            let (Range { start, end }, has) = (frames, self.capture.frames());
            return Err(Fault::Usage(format!(
                "--frames {start}..{end}: the capture has 0..{has}; choose frames of those"
            )));
        }
        self.keep_photos(|PhotoId { frame, camera }| {
            frames.contains(&frame).then(|| PhotoId { frame: frame - frames.start, camera })
        });
        let capture = &mut self.capture;
        let first_s = capture.frame_times_s[frames.start];
        self.start_s += first_s;
        self.selected = self.selected.start + frames.start..self.selected.start + frames.end;
        capture.frame_times_s = capture.frame_times_s[frames].iter().map(|time_s| time_s - first_s).collect();
        // Drops cameras without photographs: in some captures each photograph has a camera of its own.
        let mut is_used = vec![false; capture.cameras.len()];
        capture.photos.iter().for_each(|photo_id| is_used[photo_id.camera] = true);
        self.select_cameras(&is_used);
        Ok(())
    }

    /// Shrinks all photographs to `width` x `height` pixels; the fields of view stay.
    ///
    /// # Errors
    /// [`Fault::Usage`] if a camera has fewer pixels.
    pub fn shrink(&mut self, width: u32, height: u32) -> Result<(), Fault> {
        for camera in &mut self.capture.cameras {
            let Camera { width: was_width, height: was_height, .. } = camera.camera;
            if width == 0 || height == 0 || width > was_width || height > was_height {
                return Err(Fault::Usage(format!(
                    "--size {width}x{height}: camera {} has {was_width}x{was_height}; choose a smaller size",
                    camera.name
                )));
            }
            camera.camera = scaled(&camera.camera, width, height);
        }
        self.plates.iter_mut().for_each(CameraPlate::forget_shrunk);
        Ok(())
    }

    /// The capture with photographs whose pixels are `factor` times as large.
    pub fn coarser(&self, factor: u32) -> CaptureFiles {
        let mut coarser = self.clone();
        for camera in &mut coarser.capture.cameras {
            let Camera { width, height, .. } = camera.camera;
            camera.camera = scaled(&camera.camera, (width / factor).max(1), (height / factor).max(1));
        }
        coarser.plates.iter_mut().for_each(CameraPlate::forget_shrunk);
        coarser
    }
}

/// The camera with an image of this size; pixels need not stay square.
pub(super) fn scaled(camera: &Camera, width: u32, height: u32) -> Camera {
    let mut scaled = Camera { width, height, ..camera.clone() };
    let factors = [f64::from(width) / f64::from(camera.width), f64::from(height) / f64::from(camera.height)];
    for (row, factor) in scaled.k.iter_mut().zip(factors) {
        row.iter_mut().for_each(|k| *k *= factor);
    }
    scaled
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use refine::capture::{Capture, Lens};

    use super::super::capture_files::CaptureBuilder;
    use super::super::photo_paths::PhotoPath;
    use super::*;

    /// Two cameras of 40x30 pixels and five frames.
    fn capture_files() -> CaptureFiles {
        let mut builder = CaptureBuilder::new(Path::new("capture"));
        for name in ["a", "b"] {
            let camera = Camera::look_at([0.0; 3], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0], 1.0, 40, 30);
            let index = builder.camera(name, camera, Lens::default(), false);
            for frame in 0..5 {
                let name = format!("{name}/{frame}");
                let image = format!("images/{name}.png");
                builder.photo(index, frame, PhotoPath { image: &image, name: &name, mask: None }).unwrap();
            }
        }
        builder.build(refine::capture::even_times_s(5, 32.0), Some(32.0))
    }

    #[test]
    fn selected_frames_span_the_clip() {
        let mut capture_files = capture_files();
        capture_files.keep_frames(1..4).unwrap();
        let Capture { frame_times_s, photos, .. } = &capture_files.capture;
        assert_eq!(frame_times_s, &[0.0, 1.0 / 32.0, 2.0 / 32.0]);
        assert_eq!(photos.len(), 6);
        assert_eq!(capture_files.name(PhotoId { frame: 2, camera: 1 }), "b/3");
        let files: Vec<_> = capture_files.files().collect();
        assert_eq!(files[..2], ["a/1.png", "b/1.png"].map(|name| Path::new("capture/images").join(name)));
        capture_files.keep_frames(1..2).unwrap();
        assert_eq!(capture_files.capture.frame_times_s, [0.0]);
        for wrong in [0..2, 1..1] {
            assert!(matches!(capture_files.keep_frames(wrong), Err(Fault::Usage(_))));
        }
    }

    #[test]
    fn cameras_are_selected_by_name() {
        let mut capture_files = capture_files();
        capture_files.keep_cameras(&["b".into()]).unwrap();
        assert_eq!(capture_files.capture.cameras.len(), 1);
        assert_eq!(capture_files.name(PhotoId { frame: 4, camera: 0 }), "b/4");
        assert_eq!(capture_files.capture.photos.len(), 5);
        assert!(matches!(capture_files.keep_cameras(&["a".into()]), Err(Fault::Usage(_))));
    }

    #[test]
    fn shrinking_scales_the_intrinsics() {
        let mut capture_files = capture_files();
        let before = capture_files.capture.cameras[0].camera.clone();
        capture_files.shrink(20, 10).unwrap();
        let after = &capture_files.capture.cameras[0].camera;
        assert_eq!((after.width, after.height), (20, 10));
        for i in 0..2 {
            let factor = [0.5, 1.0 / 3.0][i];
            assert!((after.k[i][i] - before.k[i][i] * factor).abs() < 1e-12);
            assert!((after.k[i][2] - before.k[i][2] * factor).abs() < 1e-12);
        }
        assert!(matches!(capture_files.shrink(21, 10), Err(Fault::Usage(_))));
    }
}
