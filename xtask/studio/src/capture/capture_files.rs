//! [`CaptureFiles`]: the cameras of a capture and the files of its photographs, pictures or videos; [`CaptureBuilder`]
//! collects them.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use codec::Camera;
use formats::list_of;
use program::Fault;
use refine::capture::{CalibratedCamera, Capture, Lens, Photo, PhotoId, Response};
use refine::fit::Learned;
use refine::image::Image;
use refine::matte::Plate;

use super::camera_plate::{Background, CameraPlate, colors_of, matte, take_out};
use super::color_profile::foreign_profile;
#[cfg(feature = "onnx")]
use super::image_file::read;
use super::image_file::{
    Mask, apply_mask, bad, brightness_outside, check_size, multiply_alpha, read_image, read_mask,
};
use super::photo_paths::{PhotoPath, PhotoPaths};
use super::video::{Video, picture_notes};
use crate::scene::DEFAULT_FPS;

/// Largest number of bytes in memory of the numbers, times and paths of a capture's photographs: 25 million photographs.
const BYTES_MAX: u64 = 8 << 30;

/// Bytes in memory of a photograph beside its paths, and of a byte of its paths, while they are collected and sorted.
const PHOTO_BYTES: u64 = 128;
const PATH_BYTES: u64 = 3;

/// Photographs whose colour profiles are looked at.
const PROFILES_MAX: usize = 64;

/// Photographs of a camera by which its background is judged, and the mean brightness up to which it counts as black.
const JUDGED: usize = 4;
const BLACK_MAX: f64 = 3.0 / 255.0;

/// A capture and the paths of its photographs.
#[derive(Clone, Debug)]
pub struct CaptureFiles {
    /// Cameras, times and photographs; these in ascending order.
    pub capture: Capture,
    /// Frames per second that the capture states; `None` if [`DEFAULT_FPS`] are assumed.
    pub stated_fps: Option<f64>,
    /// Up direction of the world that the capture states, of length 1.
    pub stated_up: Option<[f64; 3]>,
    /// Metres per unit of length that the capture states.
    pub metres_per_unit: Option<f64>,
    /// What a fit learns of its cameras if nothing else is named.
    pub learned: Learned,
    /// The sound of the capture.
    pub sound: Option<CaptureSound>,
    /// The point of the capture's world that is the origin of the cameras' and the field's: not 0 if the cameras are so far
    /// from the origin of the capture that 32-bit positions of Gaussians would be too coarse there.
    pub origin: [f64; 3],
    /// What the capture says that is not as its user may expect: one line each.
    pub notes: Vec<String>,
    /// Numbers of the selected frames in the capture.
    pub(super) selected: Range<usize>,
    /// Time of the first of them in the capture, in seconds.
    pub(super) start_s: f64,
    /// Time offsets in seconds of all cameras of the capture that have one, selected or not, by name.
    pub(super) time_offsets_s: BTreeMap<String, f64>,
    /// The cameras at the resolution of the files.
    pub(super) file_cameras: Vec<Camera>,
    /// The folder of the capture.
    pub(super) folder: PathBuf,
    /// Paths of the photographs and masks, in the order of the capture's photographs; of a video's photograph, the path
    /// of the mask.
    pub(super) paths: PhotoPaths,
    /// The video of each camera that has one.
    pub(super) videos: Vec<Option<CameraVideo>>,
    /// The plate of each camera.
    pub(super) plates: Vec<CameraPlate>,
    /// What photographs keep of the background.
    pub(super) background: Background,
    /// Whether the cameras are other ones than the capture states.
    pub(super) is_corrected: bool,
    /// Whether the photographs of each camera are multiplied with their masks already; known from its first use on.
    pub(super) is_premultiplied: Vec<Arc<OnceLock<bool>>>,
}

/// The sound of a capture.
#[derive(Clone, Debug, PartialEq)]
pub struct CaptureSound {
    /// A sound file, or a video with sound.
    pub path: PathBuf,
    /// Second of the capture at which the file begins.
    pub start_s: f64,
}

/// The video of a camera.
#[derive(Clone, Debug)]
pub(super) struct CameraVideo {
    pub(super) video: Arc<Video>,
    /// The video's frame at each frame of the capture, selected or not.
    pub(super) frames: Arc<[Option<u32>]>,
}

impl CaptureFiles {
    /// Second of the capture at which frame `frame` of those selected is.
    pub fn second_of(&self, frame: usize) -> f64 {
        self.start_s + self.capture.frame_times_s.get(frame).copied().unwrap_or(0.0)
    }

    /// Number of pairs of a camera and a frame without a photograph; 0 if each photograph has a camera of
    /// its own.
    pub fn missing_count(&self) -> usize {
        let Capture { cameras, photos, .. } = &self.capture;
        let frames = self.capture.frames();
        match photos.len() == cameras.len() && frames > 1 {
            true => 0,
            false => cameras.len() * frames - photos.len(),
        }
    }

    /// Numbers of the selected frames in the capture.
    pub fn selected_frames(&self) -> Range<usize> {
        self.selected.clone()
    }

    /// Frames per second, stated or assumed.
    pub fn fps(&self) -> f64 {
        self.stated_fps.unwrap_or(f64::from(DEFAULT_FPS))
    }

    /// States the frames per second of a capture that does not.
    ///
    /// # Errors
    /// [`Fault::Usage`] if the capture states another number.
    pub fn state_fps(&mut self, fps: f64) -> Result<(), Fault> {
        if let Some(stated) = self.stated_fps.filter(|stated| *stated != fps) {
            return Err(Fault::Usage(format!(
                "--set fps={fps}: the capture states {stated} frames per second; leave it out, or correct the capture"
            )));
        }
        let factor = self.fps() / fps;
        self.capture.frame_times_s.iter_mut().for_each(|time_s| *time_s *= factor);
        self.start_s *= factor;
        self.stated_fps = Some(fps);
        Ok(())
    }

    /// Sentences about videos and photographs that are not shown as they are to be seen.
    pub fn picture_notes(&self) -> Vec<String> {
        let names = self.capture.cameras.iter().map(|camera| camera.name.as_str());
        let of_videos =
            names.zip(&self.videos).filter_map(|(name, video)| Some((name, &video.as_ref()?.video.unusual)));
        picture_notes(of_videos).into_iter().chain(self.profile_notes()).collect()
    }

    /// Sentences about colour profiles of photographs, of the first one of each of some cameras.
    fn profile_notes(&self) -> Vec<String> {
        let mut first: BTreeMap<usize, PhotoId> = BTreeMap::new();
        for photo_id in self.capture.photos.iter().filter(|photo_id| self.videos[photo_id.camera].is_none()) {
            first.entry(photo_id.camera).or_insert(*photo_id);
        }
        let step = first.len().div_ceil(PROFILES_MAX).max(1);
        let mut photographs: BTreeMap<String, Vec<String>> = BTreeMap::new();
        for photo_id in first.into_values().step_by(step) {
            if let Some(profile) = foreign_profile(&self.path(photo_id)) {
                photographs.entry(profile).or_default().push(self.name(photo_id));
            }
        }
        let note = |(profile, names): (String, Vec<String>)| {
            let names = list_of(names.iter().map(String::as_str))?;
            Some(format!(
                "{names}: the colour profile {profile} is not read, so colours are taken for those of sRGB; convert the \
                 photographs to sRGB"
            ))
        };
        photographs.into_iter().filter_map(note).collect()
    }

    /// Paths of all photographs and masks, of stated plates, and of the sound.
    pub fn files(&self) -> impl Iterator<Item = PathBuf> {
        let photos = self.capture.photos.iter().flat_map(|photo_id| self.files_of(*photo_id));
        let plates = self.stated_plates().map(Path::to_owned);
        photos.chain(plates).chain(self.sound.iter().map(|sound| sound.path.clone()))
    }

    /// Paths of a photograph or its video and, if it has one, of its mask.
    fn files_of(&self, photo_id: PhotoId) -> impl Iterator<Item = PathBuf> {
        [Some(self.path(photo_id)), self.mask_path(self.index(photo_id))].into_iter().flatten()
    }

    /// Reads the files of a photograph and drops them, so that the system has them in memory. A file that cannot be read
    /// is left to decoding, and so are videos.
    ///
    /// # Panics
    /// If the capture has no such photograph.
    pub fn read_ahead(&self, photo_id: PhotoId) {
        let videos = usize::from(self.videos[photo_id.camera].is_some());
        self.files_of(photo_id).skip(videos).for_each(|path| drop(std::fs::read(path)));
    }

    /// Rows of numbers of `photo_ids` to decode one after another, while others are decoded beside them: the photographs
    /// of a video in the order of time, and each other one by itself.
    pub fn decoding_rows(&self, photo_ids: &[PhotoId]) -> Vec<Vec<usize>> {
        let mut rows: Vec<Vec<usize>> = Vec::new();
        let mut of_video: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        for (i, PhotoId { camera, .. }) in photo_ids.iter().enumerate() {
            match self.videos[*camera].is_some() {
                true => of_video.entry(*camera).or_default().push(i),
                false => rows.push(vec![i]),
            }
        }
        rows.extend(of_video.into_values().map(|mut row| {
            row.sort_by_key(|i| photo_ids[*i]);
            row
        }));
        rows
    }

    /// Number of pixels of the largest photograph on disk.
    pub fn pixels_max(&self) -> usize {
        let pixels = |camera: &Camera| camera.width as usize * camera.height as usize;
        self.file_cameras.iter().map(pixels).max().unwrap_or(1)
    }

    /// Path of a photograph within the capture, without extension; of a video's, the name of its camera and the number of
    /// its frame.
    ///
    /// # Panics
    /// If the capture has no such photograph.
    pub fn name(&self, photo_id: PhotoId) -> String {
        match self.videos[photo_id.camera].is_some() {
            true => {
                let camera = &self.capture.cameras[photo_id.camera].name;
                format!("{camera}/{:06}", self.selected.start + photo_id.frame)
            }
            false => self.paths.name(self.index(photo_id)).to_owned(),
        }
    }

    /// The number of a photograph among the capture's.
    fn index(&self, photo_id: PhotoId) -> usize {
        self.capture.photos.binary_search(&photo_id).expect("a photograph of the capture")
    }

    /// Path of a photograph, or of the video that it is in.
    ///
    /// # Panics
    /// If the capture has no such photograph.
    pub fn path(&self, photo_id: PhotoId) -> PathBuf {
        match &self.videos[photo_id.camera] {
            Some(CameraVideo { video, .. }) => video.path().to_owned(),
            None => self.folder.join(self.paths.image(self.index(photo_id))),
        }
    }

    /// The picture of a photograph that is in a video.
    fn video_picture(&self, photo_id: PhotoId) -> Option<Result<image::RgbImage, Fault>> {
        let CameraVideo { video, frames } = self.videos[photo_id.camera].as_ref()?;
        let frame = frames[self.selected.start + photo_id.frame].expect("a photograph of the capture");
        Some(video.frame(frame as usize))
    }

    /// Path of the mask of the photograph with this number, if it has one.
    pub(super) fn mask_path(&self, i: usize) -> Option<PathBuf> {
        self.paths.mask(i).map(|mask| self.folder.join(mask))
    }

    /// Reads a photograph as it is on disk, with lens distortion and background; transparent pixels are
    /// blended with black.
    ///
    /// # Errors
    /// [`Fault::Data`] that names the file.
    ///
    /// # Panics
    /// If the capture has no such photograph.
    #[cfg(feature = "onnx")]
    pub fn unprocessed_photo(&self, photo_id: PhotoId) -> Result<image::RgbImage, Fault> {
        if let Some(picture) = self.video_picture(photo_id) {
            return picture;
        }
        let path = self.path(photo_id);
        let photo = read(&path)?.into_rgba8();
        check_size(&path, photo.dimensions(), &self.file_cameras[photo_id.camera])?;
        let over_black = |c: u8, alpha: u8| ((u16::from(c) * u16::from(alpha) + 127) / 255) as u8;
        Ok(image::RgbImage::from_fn(photo.width(), photo.height(), |x, y| {
            let [r, g, b, a] = photo.get_pixel(x, y).0;
            image::Rgb([r, g, b].map(|c| over_black(c, a)))
        }))
    }

    /// Reads a photograph, multiplies it with its mask or matte, removes the lens distortion, and shrinks it to the
    /// resolution of its camera. Where there is a plate, the background is not only made transparent but taken out; see also
    /// [`CaptureFiles::keep_background`].
    ///
    /// # Errors
    /// [`Fault::Data`] that names the file.
    ///
    /// # Panics
    /// If the capture has no such photograph.
    pub fn photo(&self, photo_id: PhotoId) -> Result<Photo, Fault> {
        let mut image = self.taken(photo_id)?;
        if self.background.is_whole {
            return Ok(self.seen(photo_id.camera, image));
        }
        let plate = self.plates[photo_id.camera].plate(&self.file_cameras[photo_id.camera])?;
        let has_mask = self.mask_path(self.index(photo_id)).is_some();
        if let Some(plate) =
            plate.filter(|_| self.background.is_matted && !has_mask && self.is_small(photo_id.camera))
        {
            return Ok(self.small_matted(photo_id, image, plate));
        }
        let mask = match self.mask_path(self.index(photo_id)) {
            Some(path) => Some(self.mask(&path, photo_id.camera)?),
            None => plate.filter(|_| self.background.is_matted).map(|plate| matte(plate, &image)),
        };
        if let Some(mask) = mask {
            self.mask_out(&mut image, &mask, plate, photo_id);
        }
        Ok(self.seen(photo_id.camera, image))
    }

    /// Whether a photograph, which is read, has a mask of its own, in a file or as transparency, and no matte.
    ///
    /// # Panics
    /// If the capture has no such photograph.
    pub(crate) fn has_mask(&self, photo_id: PhotoId, photo: &Photo) -> bool {
        let is_transparent = |(pixel, seen): (&[f64; 4], &bool)| *seen && pixel[3] < 0.5;
        self.mask_path(self.index(photo_id)).is_some()
            || (!self.background.is_matted && photo.image.pixels.iter().zip(&photo.seen).any(is_transparent))
    }

    /// Makes what is outside of `mask` transparent, and takes the background out where there is a plate and it is not kept.
    fn mask_out(&self, image: &mut Image, mask: &Mask, plate: Option<&Plate>, photo_id: PhotoId) {
        match (self.background.is_kept, plate) {
            (true, _) => multiply_alpha(image, mask),
            (false, Some(plate)) => {
                multiply_alpha(image, mask);
                take_out(image, plate);
            }
            (false, None) => {
                let is_premultiplied = self.is_premultiplied(photo_id, image, mask);
                apply_mask(image, mask, is_premultiplied);
            }
        }
    }

    /// Whether the photographs of the camera of this one, which is read, are multiplied with their masks already, so that what
    /// is outside of the subject is black: on average over some of them, as lossy files and noise leave no exact black.
    pub(super) fn is_premultiplied(
        &self,
        PhotoId { camera, frame }: PhotoId,
        image: &Image,
        mask: &Mask,
    ) -> bool {
        *self.is_premultiplied[camera].get_or_init(|| {
            let photos = &self.capture.photos;
            let is_masked = |i: &usize| photos[*i].camera == camera && self.mask_path(*i).is_some();
            let masked: Vec<usize> = (0..photos.len()).filter(is_masked).collect();
            let step = masked.len().div_ceil(JUDGED).max(1);
            let outside = masked.into_iter().step_by(step).filter_map(|i| {
                if photos[i].frame == frame {
                    return Some(brightness_outside(image, mask));
                }
                // One that cannot be read is named when it is needed.
                let image = self.taken(photos[i]).ok()?;
                Some(brightness_outside(&image, &self.mask(&self.mask_path(i)?, camera).ok()?))
            });
            let (sum, count) = outside.fold((0.0, 0), |(sum, count), (s, c)| (sum + s, count + c));
            count > 0 && sum <= BLACK_MAX * count as f64
        })
    }

    /// Whether the photographs of a camera have at most half of the pixels of their files.
    fn is_small(&self, camera: usize) -> bool {
        let pixels = |camera: &Camera| u64::from(camera.width) * u64::from(camera.height);
        2 * pixels(&self.capture.cameras[camera].camera) <= pixels(&self.file_cameras[camera])
    }

    /// A photograph that is shrunk first and gets its matte then: a matte takes time for each pixel.
    fn small_matted(&self, photo_id: PhotoId, taken: Image, plate: &Plate) -> Photo {
        let camera = photo_id.camera;
        let mut photo = self.seen(camera, taken);
        let plate = self.plates[camera].shrunk(|| {
            let Camera { width, height, .. } = self.file_cameras[camera];
            let pixels = plate.spread().iter().map(|spread| [f64::from(*spread), 0.0, 0.0, 1.0]).collect();
            let spread = self.seen(camera, Image { width, height, pixels }).image;
            let spread_of = spread.pixels.iter().map(|pixel| pixel[0] as f32).collect();
            Plate::with_spread(
                spread.width as usize,
                colors_of(&self.seen_plate(camera, plate).image),
                spread_of,
            )
        });
        let mask = matte(plate, &photo.image);
        self.mask_out(&mut photo.image, &mask, Some(plate), photo_id);
        photo
    }

    /// The picture of a photograph as it was taken, with lens distortion and background.
    pub(super) fn taken(&self, photo_id: PhotoId) -> Result<Image, Fault> {
        let path = self.path(photo_id);
        let image = match self.video_picture(photo_id) {
            Some(picture) => opaque(&picture?),
            None => read_image(&path)?,
        };
        check_size(&path, (image.width, image.height), &self.file_cameras[photo_id.camera])?;
        Ok(image)
    }

    /// Reads the mask of a photograph.
    pub(super) fn mask(&self, path: &Path, camera: usize) -> Result<Mask, Fault> {
        let mask = read_mask(path)?;
        let Camera { width: w, height: h, .. } = self.file_cameras[camera];
        let (width, height) = mask.dimensions();
        if (width, height) != (w, h) {
            return Err(bad(
                path,
                format!("{width}x{height} pixels, but its photograph has {w}x{h}; scale it"),
            ));
        }
        Ok(mask)
    }

    /// What was taken by a camera, without lens distortion, at the resolution of the camera.
    pub(super) fn seen(&self, camera: usize, taken: Image) -> Photo {
        let CalibratedCamera { camera: target, lens, .. } = &self.capture.cameras[camera];
        let photo = Photo::undistorted(taken, &self.file_cameras[camera], lens);
        let is_whole = (target.width, target.height) == (photo.image.width, photo.image.height);
        if is_whole { photo } else { photo.shrunk(target.width, target.height) }
    }
}

/// Collects cameras and photographs while a layout is read.
pub(super) struct CaptureBuilder {
    folder: PathBuf,
    /// What is left of [`BYTES_MAX`]. A few files may stand for any number of photographs: many names lead to one folder,
    /// and many cameras may name one video.
    bytes_left: u64,
    cameras: Vec<CalibratedCamera>,
    /// The photographs in the order in which they were added, and their paths.
    photos: Vec<PhotoId>,
    paths: PhotoPaths,
    videos: Vec<Option<CameraVideo>>,
    plates: Vec<CameraPlate>,
    /// Deviations in seconds of photographs that are not on time.
    deviations_s: BTreeMap<PhotoId, f64>,
    notes: Vec<String>,
}

impl CaptureBuilder {
    pub(super) fn new(folder: &Path) -> CaptureBuilder {
        CaptureBuilder {
            folder: folder.to_owned(),
            bytes_left: BYTES_MAX,
            cameras: Vec::new(),
            photos: Vec::new(),
            paths: PhotoPaths::default(),
            videos: Vec::new(),
            plates: Vec::new(),
            deviations_s: BTreeMap::new(),
            notes: Vec::new(),
        }
    }

    /// Counts bytes in memory.
    ///
    /// # Errors
    /// [`Fault::Data`] that names the folder, if they are more than [`BYTES_MAX`] with those before.
    pub(super) fn spend(&mut self, bytes: u64) -> Result<(), Fault> {
        self.bytes_left = self.bytes_left.checked_sub(bytes).ok_or_else(|| {
            let most = BYTES_MAX / 1_000_000;
            bad(
                &self.folder,
                format!(
                    "the numbers and paths of its photographs take more than {most} MB of memory; make several captures \
                     of it"
                ),
            )
        })?;
        Ok(())
    }

    /// Adds a camera and returns its index.
    pub(super) fn camera(&mut self, name: &str, camera: Camera, lens: Lens, held: bool) -> usize {
        self.cameras.push(CalibratedCamera { held, ..calibrated(name.into(), camera, lens) });
        self.videos.push(None);
        self.plates.push(CameraPlate::default());
        self.cameras.len() - 1
    }

    /// Sets the video of a camera, and adds the photographs in it: the video's frame at each frame of the capture, with
    /// the seconds by which it is later than that; `mask` gives the path of the mask of a frame.
    ///
    /// # Errors
    /// Those of `mask` and [`CaptureBuilder::spend`].
    pub(super) fn video(
        &mut self,
        camera: usize,
        video: Video,
        frames: &[Option<(u32, f64)>],
        mask: impl Fn(usize) -> Result<Option<String>, Fault>,
    ) -> Result<(), Fault> {
        self.spend(size_of_val(frames) as u64)?;
        for (frame, (_, late_s)) in frames.iter().enumerate().filter_map(|(k, at)| Some((k, (*at)?))) {
            self.photo(camera, frame, PhotoPath { image: "", name: "", mask: mask(frame)?.as_deref() })?;
            if late_s != 0.0 {
                self.deviations_s.insert(PhotoId { frame, camera }, late_s);
            }
        }
        let frames = frames.iter().map(|at| at.map(|(frame, _)| frame)).collect();
        self.videos[camera] = Some(CameraVideo { video: Arc::new(video), frames });
        Ok(())
    }

    /// Adds one of [`CaptureFiles::notes`].
    pub(super) fn note(&mut self, note: String) {
        self.notes.push(note);
    }

    /// States the picture of a camera without the subject.
    pub(super) fn plate(&mut self, camera: usize, plate: CameraPlate) {
        self.plates[camera] = plate;
    }

    /// Sets the [device](CalibratedCamera::device) of a camera.
    pub(super) fn device(&mut self, camera: usize, device: u32) {
        self.cameras[camera].device = Some(device);
    }

    /// Sets the [time offset](CalibratedCamera::time_offset_s) of a camera.
    pub(super) fn offset_s(&mut self, camera: usize, time_offset_s: f64) {
        self.cameras[camera].time_offset_s = time_offset_s;
    }

    /// Adds a photograph; each camera has at most one of a frame.
    ///
    /// # Errors
    /// Those of [`CaptureBuilder::spend`].
    pub(super) fn photo(&mut self, camera: usize, frame: usize, path: PhotoPath) -> Result<(), Fault> {
        let text = path.image.len() + path.mask.map_or(0, str::len);
        self.spend(PHOTO_BYTES + PATH_BYTES * text as u64)?;
        self.photos.push(PhotoId { frame, camera });
        self.paths.push(path);
        Ok(())
    }

    /// Gives the frame of each photograph another number.
    pub(super) fn renumber(&mut self, number: impl Fn(usize) -> usize) {
        self.photos.iter_mut().for_each(|photo_id| photo_id.frame = number(photo_id.frame));
    }

    /// The capture, with frames at these times in seconds.
    pub(super) fn build(mut self, frame_times_s: Vec<f64>, stated_fps: Option<f64>) -> CaptureFiles {
        let mut is_used = vec![false; self.cameras.len()];
        self.photos.iter().for_each(|photo_id| is_used[photo_id.camera] = true);
        let unused = self.cameras.iter().zip(is_used).filter(|(_, is_used)| !is_used);
        self.notes.extend(unused.map(|(camera, _)| format!("camera {} has no photograph", camera.name)));
        let mut order: Vec<usize> = (0..self.photos.len()).collect();
        order.sort_unstable_by_key(|i| self.photos[*i]);
        let paths = self.paths.select(order.iter().copied());
        let photos: Vec<PhotoId> = order.iter().map(|i| self.photos[*i]).collect();
        let deviations_s = match self.deviations_s.is_empty() {
            true => Vec::new(),
            false => {
                let deviation_s = |photo_id| self.deviations_s.get(photo_id).copied().unwrap_or(0.0);
                photos.iter().map(deviation_s).collect()
            }
        };
        let file_cameras = self.cameras.iter().map(|camera| camera.camera.clone()).collect();
        let is_premultiplied = self.cameras.iter().map(|_| Arc::default()).collect();
        let offsets = self.cameras.iter().map(|camera| (camera.name.clone(), camera.time_offset_s));
        let time_offsets_s = offsets.filter(|(_, offset_s)| *offset_s != 0.0).collect();
        let selected = 0..frame_times_s.len();
        let capture = Capture { cameras: self.cameras, frame_times_s, photos, deviations_s };
        let CaptureBuilder { folder, videos, plates, notes, .. } = self;
        CaptureFiles {
            capture,
            stated_fps,
            stated_up: None,
            metres_per_unit: None,
            learned: Learned::default(),
            sound: None,
            origin: [0.0; 3],
            notes,
            selected,
            start_s: 0.0,
            time_offsets_s,
            file_cameras,
            folder,
            paths,
            videos,
            plates,
            background: Background::default(),
            is_corrected: false,
            is_premultiplied,
        }
    }
}

/// A picture without transparency.
fn opaque(picture: &image::RgbImage) -> Image {
    let pixel = |p: &image::Rgb<u8>| {
        let [r, g, b] = p.0.map(|c| f64::from(c) / 255.0);
        [r, g, b, 1.0]
    };
    Image { width: picture.width(), height: picture.height(), pixels: picture.pixels().map(pixel).collect() }
}

/// A camera in time with its frames that shows colours as they are.
pub(super) fn calibrated(name: String, camera: Camera, lens: Lens) -> CalibratedCamera {
    CalibratedCamera {
        name,
        camera,
        lens,
        time_offset_s: 0.0,
        response: Response::NEUTRAL,
        held: false,
        device: None,
    }
}

/// Skew in pixels up to which it counts as rounding.
const SKEW_MAX: f64 = 1e-6;

/// Focal lengths and principal point, fx, fy, cx, cy, of a matrix of intrinsics, row by row.
///
/// # Errors
/// A sentence if it has a skew.
pub(crate) fn intrinsics(k: &[f64]) -> Result<[f64; 4], String> {
    match k[1].abs() <= SKEW_MAX {
        true => Ok([k[0], k[4], k[2], k[5]]),
        false => Err(format!("K has a skew of {}, which is not supported; calibrate without skew", k[1])),
    }
}

/// A camera with these intrinsics and this rigid transform.
pub(crate) fn pinhole(
    size: (u32, u32),
    [fx, fy, cx, cy]: [f64; 4],
    camera_from_world: [[f64; 4]; 4],
) -> Camera {
    let k = [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]];
    Camera { width: size.0, height: size.1, k, camera_from_world }
}

/// A rigid transform of a rotation, row by row, and a translation.
pub(crate) fn rigid(rotation: [[f64; 3]; 3], [x, y, z]: [f64; 3]) -> [[f64; 4]; 4] {
    let row = |i: usize, last: f64| [rotation[i][0], rotation[i][1], rotation[i][2], last];
    [row(0, x), row(1, y), row(2, z), [0.0, 0.0, 0.0, 1.0]]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn photographs_are_counted_before_they_are_added() {
        let mut builder = CaptureBuilder::new(Path::new("capture"));
        builder.bytes_left = 10 * (PHOTO_BYTES + 7 * PATH_BYTES);
        let photo = PhotoPath { image: "a.png", name: "a", mask: Some("ab") };
        (0..10).for_each(|frame| builder.photo(0, frame, photo).unwrap());
        let error = builder.photo(0, 10, photo).unwrap_err().to_string();
        assert!(error.starts_with("capture: ") && error.contains("8589 MB of memory"), "{error}");
        assert_eq!(builder.photos.len(), 10);
    }
}
