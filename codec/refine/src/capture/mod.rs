//! [`Capture`]: calibrated cameras and the index of their photographs.
//!
//! A capture names its cameras and photographs, but contains no pixels. Each photograph has a time of its
//! own: the time of its frame, later by its camera's offset and by a deviation of its own. [`Photo`] is a photograph in
//! memory, free of lens distortion and multiplied by its mask.

mod focus;
mod lens;
mod response;
mod split;

use codec::Camera;

use crate::image::Image;
pub(crate) use focus::{Axis, nearest_to_axes};
pub use focus::{Focus, common_point};
pub use lens::Lens;
pub use response::Response;
pub use split::{Holdout, Split, SplitError};

/// Alpha, of a mask or of what is drawn, above which a pixel belongs to the subject.
pub(crate) const SUBJECT: f64 = 127.5 / 255.0;

/// Cameras, frames and photographs of a scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Capture {
    /// The cameras, as calibrated.
    pub cameras: Vec<CalibratedCamera>,
    /// Time of each frame in seconds, ascending from 0; a static scene has one frame.
    pub frame_times_s: Vec<f64>,
    /// Photographs in ascending order: each camera at most once per frame.
    pub photos: Vec<PhotoId>,
    /// Seconds by which each of them is later than its frame and its camera's offset say, negative if earlier; empty if
    /// all are on time.
    pub deviations_s: Vec<f64>,
}

/// A camera of a capture.
#[derive(Clone, Debug, PartialEq)]
pub struct CalibratedCamera {
    /// Name in the capture.
    pub name: String,
    /// The camera without its lens distortion.
    pub camera: Camera,
    /// Lens distortion.
    pub lens: Lens,
    /// Seconds by which the camera takes its photographs later than their frames; negative if earlier.
    pub time_offset_s: f64,
    /// How it shows colours.
    pub response: Response,
    /// Whether the capture marks the camera as held out.
    pub held: bool,
    /// Number of the device that the layout states, where one that is carried around has a camera here for each of its
    /// photographs; `None` of a camera that is a device of its own, or where the layout does not tell.
    pub device: Option<u32>,
}

/// Identifies a photograph of a capture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct PhotoId {
    /// Number of the frame, from 0.
    pub frame: usize,
    /// Number of the camera.
    pub camera: usize,
}

/// Times in seconds of `frames` frames at `fps` frames per second.
pub fn even_times_s(frames: usize, fps: f64) -> Vec<f64> {
    (0..frames).map(|frame| frame as f64 / fps).collect()
}

impl Capture {
    /// Number of frames.
    pub fn frames(&self) -> usize {
        self.frame_times_s.len()
    }

    /// Seconds from the first frame to the last; 0 for a static scene.
    pub fn duration_s(&self) -> f64 {
        self.frame_times_s.last().copied().unwrap_or(0.0)
    }

    /// Time of a frame in the clip, from 0 at the first to 1 at the last.
    ///
    /// # Panics
    /// If the capture has no such frame.
    pub fn frame_clip_time(&self, frame: usize) -> f64 {
        self.to_clip_time(self.frame_times_s[frame])
    }

    /// Time of a photograph in seconds since the first frame. It is negative if the camera takes the first
    /// frame earlier.
    ///
    /// # Panics
    /// If the capture has no such camera or frame.
    pub fn time_s(&self, photo_id: PhotoId) -> f64 {
        let own_s = match self.deviations_s.is_empty() {
            true => 0.0,
            false => self.photos.binary_search(&photo_id).map_or(0.0, |i| self.deviations_s[i]),
        };
        self.frame_times_s[photo_id.frame] + self.cameras[photo_id.camera].time_offset_s + own_s
    }

    /// Time of a photograph in the clip, which lasts from 0 at the first frame to 1 at the last; an offset
    /// of its camera can place it outside. 0 in a static scene.
    ///
    /// # Panics
    /// If the capture has no such camera or frame.
    pub fn clip_time(&self, photo_id: PhotoId) -> f64 {
        self.to_clip_time(self.time_s(photo_id))
    }

    fn to_clip_time(&self, time_s: f64) -> f64 {
        let duration_s = self.duration_s();
        if duration_s > 0.0 { time_s / duration_s } else { 0.0 }
    }
}

/// An undistorted photograph.
#[derive(Clone, Debug, PartialEq)]
pub struct Photo {
    /// Colours multiplied by the mask; alpha is the mask, or 1 without one.
    pub image: Image,
    /// Whether each pixel is valid. Pixels outside the distorted photograph or beyond the lens are not.
    pub seen: Vec<bool>,
}

impl Photo {
    /// Undistorts a photograph that was taken through `lens`.
    pub fn undistorted(taken: Image, camera: &Camera, lens: &Lens) -> Photo {
        if lens.is_none() {
            let seen = vec![true; taken.pixels.len()];
            return Photo { image: taken, seen };
        }
        let mut image = Image::new(taken.width, taken.height);
        let mut seen = Vec::with_capacity(image.pixels.len());
        for source in lens.sources(camera, [taken.width, taken.height]) {
            let found = source.and_then(|at| sample(&taken, at.map(|x| x - 0.5)));
            if let Some(pixel) = found {
                image.pixels[seen.len()] = pixel;
            }
            seen.push(found.is_some());
        }
        Photo { image, seen }
    }
}

impl Photo {
    /// Whether a pixel is valid and shows the subject.
    pub fn is_subject(&self, pixel: usize) -> bool {
        self.seen[pixel] && self.image.pixels[pixel][3] > SUBJECT
    }

    /// Shrinks the photograph by area averaging. A pixel is valid if all pixels that it covers are.
    ///
    /// # Panics
    /// If a side is 0 or would grow.
    pub fn shrunk(&self, width: u32, height: u32) -> Photo {
        let Image { width: from_width, height: from_height, pixels } = &self.image;
        assert!((1..=*from_width).contains(&width) && (1..=*from_height).contains(&height), "fewer pixels");
        let (columns, rows) = (covered(*from_width, width), covered(*from_height, height));
        let mut photo =
            Photo { image: Image::new(width, height), seen: vec![true; (width * height) as usize] };
        for (i, pixel) in photo.image.pixels.iter_mut().enumerate() {
            for (y, by_row) in &rows[i / width as usize] {
                for (x, by_column) in &columns[i % width as usize] {
                    let from = y * *from_width as usize + x;
                    photo.seen[i] &= self.seen[from];
                    (0..4).for_each(|c| pixel[c] += by_row * by_column * pixels[from][c]);
                }
            }
        }
        photo
    }
}

/// For each of `to` pixels along an axis, the source pixels that it covers out of `from`, and their weights.
fn covered(from: u32, to: u32) -> Vec<Vec<(usize, f64)>> {
    let ratio = f64::from(from) / f64::from(to);
    let parts_of_pixel = |pixel: u32| {
        let (start, end) = (f64::from(pixel) * ratio, f64::from(pixel + 1) * ratio);
        let part = |i: u32| (f64::from(i + 1).min(end) - f64::from(i).max(start)) / ratio;
        // Rounding can leave a sliver of a pixel at either end.
        (start as u32..from).map(|i| (i as usize, part(i))).take_while(|(_, part)| *part > 1e-9).collect()
    };
    (0..to).map(parts_of_pixel).collect()
}

/// Bilinear sample at a point, in pixels from the centre of the first one; `None` outside the image.
fn sample(image: &Image, [x, y]: [f64; 2]) -> Option<[f64; 4]> {
    let (last_x, last_y) = (image.width - 1, image.height - 1);
    // The outer half of the outermost pixels has no neighbours, but is inside the image.
    let near = |at: f64, last: u32| (-0.5..=f64::from(last) + 0.5).contains(&at);
    if !near(x, last_x) || !near(y, last_y) {
        return None;
    }
    let (x, y) = (x.clamp(0.0, f64::from(last_x)), y.clamp(0.0, f64::from(last_y)));
    let (left, top) = (x as u32, y as u32);
    let (u, v) = (x - f64::from(left), y - f64::from(top));
    let (right, bottom) = ((left + 1).min(last_x), (top + 1).min(last_y));
    let corners =
        [(left, top), (right, top), (left, bottom), (right, bottom)].map(|(x, y)| image.pixel(x, y));
    let weights = [(1.0 - u) * (1.0 - v), u * (1.0 - v), (1.0 - u) * v, u * v];
    Some(std::array::from_fn(|c| corners.iter().zip(weights).map(|(corner, w)| w * corner[c]).sum()))
}

#[cfg(test)]
pub(crate) mod fixtures {
    use super::*;

    /// A camera in the origin without a lens, in time with its frames.
    pub(crate) fn calibrated() -> CalibratedCamera {
        CalibratedCamera {
            name: String::new(),
            camera: Camera::look_at([0.0; 3], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0], 1.0, 32, 24),
            lens: Lens::default(),
            time_offset_s: 0.0,
            response: Response::NEUTRAL,
            held: false,
            device: None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::fixtures::calibrated;
    use super::*;

    fn camera() -> Camera {
        calibrated().camera
    }

    /// Pixels that encode their coordinates.
    fn ramp() -> Image {
        let mut image = Image::new(32, 24);
        for (i, pixel) in image.pixels.iter_mut().enumerate() {
            *pixel = [(i % 32) as f64, (i / 32) as f64, 0.0, 1.0];
        }
        image
    }

    #[test]
    fn without_a_lens_nothing_changes() {
        let photo = Photo::undistorted(ramp(), &camera(), &Lens::default());
        assert_eq!(photo.image, ramp());
        assert!(photo.seen.iter().all(|seen| *seen));
    }

    #[test]
    fn a_pixel_is_sampled_at_its_distorted_position() {
        let (camera, lens) = (camera(), Lens::rational(&[-0.1]).unwrap());
        let photo = Photo::undistorted(ramp(), &camera, &lens);
        let (f, cx, cy) = (camera.k[0][0], camera.k[0][2], camera.k[1][2]);
        let (x, y) = ((25.5 - cx) / f, (6.5 - cy) / f);
        let shrink = 1.0 - 0.1 * (x * x + y * y);
        let [u, v, _, alpha] = photo.image.pixel(25, 6);
        assert!(
            (u - (x * shrink * f + cx - 0.5)).abs() < 1e-9 && (v - (y * shrink * f + cy - 0.5)).abs() < 1e-9
        );
        assert!(
            photo.seen.iter().all(|seen| *seen) && alpha == 1.0,
            "barrel distortion shows more than the pinhole"
        );
    }

    #[test]
    fn pixels_outside_the_photograph_are_invalid() {
        let photo = Photo::undistorted(ramp(), &camera(), &Lens::rational(&[0.5]).unwrap());
        assert!(!photo.seen[0] && photo.seen[12 * 32 + 16]);
        assert_eq!(photo.image.pixels[0], [0.0; 4]);
    }

    #[test]
    fn a_shrunk_pixel_is_the_mean_of_its_area() {
        let mut photo = Photo { image: ramp(), seen: vec![true; 32 * 24] };
        photo.seen[31] = false;
        let small = photo.shrunk(8, 10);
        // Four columns from 8, and 2.4 rows from 4.8: a fifth of row 4, rows 5 and 6, a fifth of row 7.
        let [x, y, _, alpha] = small.image.pixel(2, 2);
        assert!((x - 9.5).abs() < 1e-12 && (alpha - 1.0).abs() < 1e-12, "{x} {alpha}");
        assert!((y - (0.2 * 4.0 + 5.0 + 6.0 + 0.2 * 7.0) / 2.4).abs() < 1e-12, "{y}");
        let unseen: Vec<usize> = (0..80).filter(|i| !small.seen[*i]).collect();
        assert_eq!(unseen, [7]);
        assert_eq!(photo.shrunk(32, 24).image, photo.image);
    }

    #[test]
    fn a_photograph_is_later_than_its_frame_by_the_offset_of_its_camera() {
        let cameras =
            [0.0, 0.02, -0.01].map(|time_offset_s| CalibratedCamera { time_offset_s, ..calibrated() });
        let cameras = cameras.to_vec();
        let capture = Capture { cameras, frame_times_s: even_times_s(5, 25.0), ..Capture::default() };
        let time = |camera: usize, frame: usize| capture.clip_time(PhotoId { frame, camera });
        assert_eq!((capture.frames(), capture.duration_s()), (5, 0.16));
        assert_eq!([time(0, 0), time(0, 2), time(0, 4)], [0.0, 0.5, 1.0]);
        assert!((time(1, 2) - 0.625).abs() < 1e-12 && (time(2, 0) + 0.0625).abs() < 1e-12);
        let one_frame = Capture { frame_times_s: even_times_s(1, 25.0), ..capture.clone() };
        assert_eq!(one_frame.clip_time(PhotoId { frame: 0, camera: 0 }), 0.0);
        let photos = vec![PhotoId { frame: 1, camera: 1 }, PhotoId { frame: 2, camera: 1 }];
        let late = Capture { photos, deviations_s: vec![0.0, 0.004], ..capture };
        let time_s = |frame: usize| late.time_s(PhotoId { frame, camera: 1 });
        assert!((time_s(1) - 0.06).abs() < 1e-12 && (time_s(2) - 0.104).abs() < 1e-12);
    }
}
