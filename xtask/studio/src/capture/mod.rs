//! [`Footage`]: a capture on disk. Layouts that the field uses are read, see `xtask/CAPTURE.md`:
//! one file each.

mod colmap;
mod depth;
mod easyvolcap;
mod manifest;
mod part;
mod transforms;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::bail;
use codec::Camera;
use image::{DynamicImage, ImageBuffer, ImageReader, Luma};
use program::Fault;
use refine::capture::{CalibratedCamera, Capture, Lens, Photo, PhotoId};
use refine::image::Image;

#[cfg(feature = "onnx")]
pub use depth::pfm_file;

/// Endings of the files that photographs are read from.
const ENDINGS: [&str; 4] = ["png", "jpg", "jpeg", "webp"];

/// Largest side of a photograph in pixels.
const SIDE_MAX: u32 = 1 << 15;

/// A capture, and where its photographs are.
#[derive(Clone, Debug)]
pub struct Footage {
    /// The cameras and shots.
    pub capture: Capture,
    /// The cameras in the pixels of the files.
    taken_by: Vec<Camera>,
    files: BTreeMap<PhotoId, Files>,
}

/// The files of one photograph.
#[derive(Clone, Debug)]
struct Files {
    /// Path of the photograph within the capture, without its ending.
    name: String,
    image: PathBuf,
    mask: Option<PathBuf>,
}

impl Footage {
    /// Finds out what layout a folder has and reads its cameras; photographs stay on disk.
    ///
    /// # Errors
    /// [`Fault::Data`] that names the file and what is wrong with it.
    pub fn open(folder: &Path) -> anyhow::Result<Footage> {
        let footage = if folder.join(manifest::FILE).is_file() {
            manifest::open(folder)?
        } else if folder.join(easyvolcap::INTRINSICS).is_file() {
            easyvolcap::open(folder)?
        } else if let Some(files) = transforms::files(folder) {
            transforms::open(folder, &files)?
        } else if let Some(model) = colmap::model(folder) {
            colmap::open(folder, &model)?
        } else {
            bail!(Fault::Data(format!(
                "{}: no capture: none of {}, {}, transforms.json or a COLMAP model is there",
                folder.display(),
                manifest::FILE,
                easyvolcap::INTRINSICS
            )));
        };
        for CalibratedCamera { name, camera, .. } in &footage.capture.cameras {
            camera.check().map_err(|what| bad(folder, format!("camera {name}: {what}")))?;
            if camera.width.max(camera.height) > SIDE_MAX {
                let size = format!("{}x{}", camera.width, camera.height);
                return Err(bad(folder, format!("camera {name}: image size {size} is too large")).into());
            }
        }
        match footage.files.is_empty() {
            true => Err(bad(folder, "not one photograph of its cameras is there").into()),
            false => Ok(footage),
        }
    }

    /// Number of photographs that some cameras lack in frames that others have. None where each
    /// photograph has a camera of its own.
    pub fn missing(&self) -> usize {
        let Capture { cameras, times, photos } = &self.capture;
        match photos.len() == cameras.len() && times.len() > 1 {
            true => 0,
            false => cameras.len() * times.len() - photos.len(),
        }
    }

    /// The files of photographs and masks.
    pub fn files(&self) -> impl Iterator<Item = &Path> {
        self.files
            .values()
            .flat_map(|files| [Some(&files.image), files.mask.as_ref()])
            .flatten()
            .map(PathBuf::as_path)
    }

    /// Pixels of the largest photograph, as it was taken.
    pub fn most_pixels(&self) -> usize {
        let pixels = |camera: &Camera| camera.width as usize * camera.height as usize;
        self.taken_by.iter().map(pixels).max().unwrap_or(1)
    }

    /// Path of a photograph within the capture, without its ending.
    ///
    /// # Panics
    /// If `shot` is not of this capture.
    pub fn name(&self, shot: PhotoId) -> &str {
        &self.files[&shot].name
    }

    /// A photograph through its lens, with everything around the subject; over black where it is
    /// transparent.
    ///
    /// # Errors
    /// [`Fault::Data`] that names the file.
    ///
    /// # Panics
    /// If `shot` is not of this capture.
    #[cfg(feature = "onnx")]
    pub fn as_taken(&self, shot: PhotoId) -> Result<image::RgbImage, Fault> {
        let path = &self.files[&shot].image;
        let taken = read(path)?.into_rgba8();
        check_size(path, taken.dimensions(), &self.taken_by[shot.camera])?;
        let over_black = |c: u8, alpha: u8| ((u16::from(c) * u16::from(alpha) + 127) / 255) as u8;
        Ok(image::RgbImage::from_fn(taken.width(), taken.height(), |x, y| {
            let [r, g, b, a] = taken.get_pixel(x, y).0;
            image::Rgb([r, g, b].map(|c| over_black(c, a)))
        }))
    }

    /// Reads a photograph, cuts it out, takes the distortion of the lens away, and shrinks it to the
    /// pixels of its camera.
    ///
    /// # Errors
    /// [`Fault::Data`] that names the file.
    ///
    /// # Panics
    /// If `shot` is not of this capture.
    pub fn photo(&self, shot: PhotoId) -> Result<Photo, Fault> {
        let Files { image, mask, .. } = &self.files[&shot];
        let CalibratedCamera { camera: wanted, lens, .. } = &self.capture.cameras[shot.camera];
        let camera = &self.taken_by[shot.camera];
        let mut taken = read_image(image)?;
        check_size(image, (taken.width, taken.height), camera)?;
        if let Some(path) = mask {
            let cut = read(path)?.into_luma16();
            if cut.dimensions() != (camera.width, camera.height) {
                let ((width, height), Camera { width: w, height: h, .. }) = (cut.dimensions(), camera);
                return Err(bad(path, format!("{width}x{height} pixels where its photograph has {w}x{h}")));
            }
            cut_out(&mut taken, &cut);
        }
        let photo = Photo::undistorted(taken, camera, lens);
        Ok(if wanted == camera { photo } else { photo.shrunk(wanted.width, wanted.height) })
    }
}

/// Multiplies a photograph with its mask. One that is black wherever the mask is 0 stands before
/// black already: its colours stay, or the rim of the subject would be darkened twice.
fn cut_out(taken: &mut Image, mask: &ImageBuffer<Luma<u16>, Vec<u16>>) {
    let mut outside = taken.pixels.iter().zip(mask.pixels()).filter(|(_, mask)| mask.0[0] == 0).peekable();
    let is_cut = outside.peek().is_some() && outside.all(|(pixel, _)| pixel[..3] == [0.0; 3]);
    for (pixel, mask) in taken.pixels.iter_mut().zip(mask.pixels()) {
        let [r, g, b, a] = *pixel;
        let m = level(mask.0[0]);
        *pixel = if is_cut { [r, g, b, a * m] } else { [r * m, g * m, b * m, a * m] };
    }
}

/// A picture of what `camera` saw, made by anybody.
///
/// # Errors
/// [`Fault::Data`] that names the file, where it cannot be read or has another size.
pub fn read_picture(path: &Path, camera: &Camera) -> Result<Image, Fault> {
    let image = read_image(path)?;
    check_size(path, (image.width, image.height), camera)?;
    Ok(image)
}

/// The photograph at `path`, which may lack its ending.
pub fn find_image(path: &Path) -> Option<PathBuf> {
    let with_ending = |ending: String| {
        let mut name = path.as_os_str().to_owned();
        name.push(".");
        name.push(ending);
        PathBuf::from(name)
    };
    let endings = ENDINGS.iter().flat_map(|ending| [ending.to_string(), ending.to_uppercase()]);
    let is_image = |path: &Path| {
        let ending = path.extension().and_then(|ending| ending.to_str()).unwrap_or_default();
        ENDINGS.contains(&ending.to_lowercase().as_str()) && path.is_file()
    };
    match is_image(path) {
        true => Some(path.to_owned()),
        false => endings.map(with_ending).find(|path| path.is_file()),
    }
}

fn read_image(path: &Path) -> Result<Image, Fault> {
    let taken = read(path)?.into_rgba16();
    let pixel = |p: &image::Rgba<u16>| {
        let [r, g, b, a] = p.0.map(level);
        [r * a, g * a, b * a, a]
    };
    Ok(Image { width: taken.width(), height: taken.height(), pixels: taken.pixels().map(pixel).collect() })
}

/// A channel of 16 bits, which 8 bits fit into exactly, as a number from 0 to 1.
fn level(channel: u16) -> f64 {
    f64::from(channel) / f64::from(u16::MAX)
}

fn read(path: &Path) -> Result<DynamicImage, Fault> {
    let reader = ImageReader::open(path).map_err(|error| bad(path, error))?;
    reader.with_guessed_format().map_err(|error| bad(path, error))?.decode().map_err(|error| bad(path, error))
}

/// Width and height of the image at `path`.
fn size_of(path: &Path) -> Result<(u32, u32), Fault> {
    image::image_dimensions(path).map_err(|error| bad(path, error))
}

fn check_size(path: &Path, size: (u32, u32), camera: &Camera) -> Result<(), Fault> {
    if size == (camera.width, camera.height) {
        return Ok(());
    }
    let is = format!("{}x{} pixels", size.0, size.1);
    Err(bad(path, format!("{is} where its camera has {}x{}", camera.width, camera.height)))
}

fn bad(path: &Path, what: impl std::fmt::Display) -> Fault {
    Fault::Data(format!("{}: {what}", path.display()))
}

/// Text of a file.
fn read_text(path: &Path) -> Result<String, Fault> {
    std::fs::read_to_string(path).map_err(|error| bad(path, error))
}

/// What readers fill in.
#[derive(Default)]
struct Builder {
    cameras: Vec<CalibratedCamera>,
    files: BTreeMap<PhotoId, Files>,
}

impl Builder {
    /// Adds a camera; its number.
    fn camera(&mut self, name: &str, camera: Camera, lens: Lens, held: bool) -> usize {
        self.cameras.push(CalibratedCamera { name: name.into(), camera, lens, held });
        self.cameras.len() - 1
    }

    fn shot(&mut self, camera: usize, frame: usize, files: Files) {
        self.files.insert(PhotoId { frame, camera }, files);
    }

    fn footage(self, times: Vec<f64>) -> Footage {
        let photos = self.files.keys().copied().collect();
        let taken_by = self.cameras.iter().map(|camera| camera.camera.clone()).collect();
        let capture = Capture { cameras: self.cameras, times, photos };
        Footage { capture, taken_by, files: self.files }
    }
}

/// A camera with these intrinsics and this rigid transform.
fn pinhole(size: (u32, u32), [fx, fy, cx, cy]: [f64; 4], camera_from_world: [[f64; 4]; 4]) -> Camera {
    let k = [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]];
    Camera { width: size.0, height: size.1, k, camera_from_world }
}

/// A rigid transform of a rotation, row by row, and a translation.
fn rigid(rotation: [[f64; 3]; 3], [x, y, z]: [f64; 3]) -> [[f64; 4]; 4] {
    let row = |i: usize, last: f64| [rotation[i][0], rotation[i][1], rotation[i][2], last];
    [row(0, x), row(1, y), row(2, z), [0.0, 0.0, 0.0, 1.0]]
}
