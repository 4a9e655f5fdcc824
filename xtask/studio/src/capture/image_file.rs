//! Files of a capture: photographs, masks and text, with errors that name the file.

use std::ffi::OsStr;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use codec::Camera;
use formats::is_lfs_pointer;
use image::{DynamicImage, ImageBuffer, ImageReader, Luma};
use program::Fault;
use refine::image::Image;

use crate::messages::unreadable;

/// File extensions of photographs.
const EXTENSIONS: [&str; 4] = ["png", "jpg", "jpeg", "webp"];

/// File extensions of pictures in other formats.
const UNREAD: [&str; 9] = ["tif", "tiff", "bmp", "exr", "heic", "heif", "avif", "jxl", "dng"];

/// Mask of a pixel up to which it is outside of the subject: lossy files have no exact 0.
const OUTSIDE_MAX: f64 = 0.02;

/// A mask: 0 outside of the subject.
pub(super) type Mask = ImageBuffer<Luma<u16>, Vec<u16>>;

/// Multiplies the alpha of a photograph with its mask; colours stay.
pub(super) fn multiply_alpha(image: &mut Image, mask: &Mask) {
    image.pixels.iter_mut().zip(mask.pixels()).for_each(|(pixel, mask)| pixel[3] *= unit_value(mask.0[0]));
}

/// Multiplies a photograph with its mask. The colours of one that is premultiplied stay, as far as such colours can go: a
/// second product would darken the rim of the subject.
pub(super) fn apply_mask(image: &mut Image, mask: &Mask, is_premultiplied: bool) {
    for (pixel, mask) in image.pixels.iter_mut().zip(mask.pixels()) {
        let [r, g, b, a] = *pixel;
        let m = unit_value(mask.0[0]);
        let color = [r, g, b].map(|c| if is_premultiplied { c.min(m) } else { c * m });
        *pixel = [color[0], color[1], color[2], a * m];
    }
}

/// The sum of the brightest channels of the pixels that are outside of the subject, and their number.
pub(super) fn brightness_outside(image: &Image, mask: &Mask) -> (f64, usize) {
    let pixels = image.pixels.iter().zip(mask.pixels());
    let outside = pixels.filter(|(_, mask)| unit_value(mask.0[0]) <= OUTSIDE_MAX);
    outside.fold((0.0, 0), |(sum, count), (&[r, g, b, _], _)| (sum + r.max(g).max(b), count + 1))
}

/// Reads a picture of the view of `camera`.
///
/// # Errors
/// [`Fault::Data`] that names the file, if it cannot be read or has another size.
pub fn read_picture(path: &Path, camera: &Camera) -> Result<Image, Fault> {
    let image = read_image(path)?;
    check_size(path, (image.width, image.height), camera)?;
    Ok(image)
}

/// Finds the photograph at `path`, which may lack its extension.
pub fn find_image(path: &Path) -> Option<PathBuf> {
    missing_ending(path).map(|ending| with_ending(path, &ending))
}

/// Finds the photograph at `path` in `folder`, which may lack its extension, and returns its path in `folder`.
pub(super) fn find_image_in(folder: &Path, path: &str) -> Option<String> {
    missing_ending(&folder.join(path)).map(|ending| format!("{path}{ending}"))
}

/// A path in a folder, as text, of a folder in it and a path in that, which may be absolute.
pub(super) fn joined(folder: &str, path: &str) -> String {
    Path::new(folder).join(path).to_str().expect("of two texts").to_owned()
}

/// The fault of the picture at `path`, which may lack its extension, if it is in a format that is not read.
pub(super) fn unread_picture(path: &Path) -> Option<Fault> {
    let path = with_ending(path, &missing_ending_of(path, &UNREAD)?);
    Some(bad(&path, "a picture in a format that is not read; convert it to PNG, JPEG or WebP"))
}

/// The fault of a mask that is not at `path`.
pub(super) fn no_mask(path: &Path) -> Fault {
    let missing = || bad(path, "this mask is missing; put it there, or remove the folder of masks");
    unread_picture(path).unwrap_or_else(missing)
}

/// What `path` lacks to be the path of a photograph: nothing, or a point and an extension.
fn missing_ending(path: &Path) -> Option<String> {
    missing_ending_of(path, &EXTENSIONS)
}

/// What `path` lacks to be the path of a file with one of these extensions, also in capitals: nothing, or a point and one.
fn missing_ending_of(path: &Path, extensions: &[&str]) -> Option<String> {
    let mut endings = extensions
        .iter()
        .flat_map(|extension| [extension.to_string(), extension.to_uppercase()])
        .map(|extension| format!(".{extension}"));
    let is_image = |path: &Path| {
        let extension = path.extension().and_then(OsStr::to_str).unwrap_or_default();
        extensions.contains(&extension.to_lowercase().as_str()) && path.is_file()
    };
    match is_image(path) {
        true => Some(String::new()),
        false => endings.find(|ending| with_ending(path, ending).is_file()),
    }
}

fn with_ending(path: &Path, ending: &str) -> PathBuf {
    let mut path = path.as_os_str().to_owned();
    path.push(ending);
    PathBuf::from(path)
}

pub(super) fn read_image(path: &Path) -> Result<Image, Fault> {
    let image = read(path)?.into_rgba16();
    let pixel = |p: &image::Rgba<u16>| {
        let [r, g, b, a] = p.0.map(unit_value);
        [r * a, g * a, b * a, a]
    };
    Ok(Image { width: image.width(), height: image.height(), pixels: image.pixels().map(pixel).collect() })
}

/// A 16-bit channel, which represents 8-bit ones exactly, as a number from 0 to 1.
fn unit_value(channel: u16) -> f64 {
    f64::from(channel) / f64::from(u16::MAX)
}

pub(crate) fn read(path: &Path) -> Result<DynamicImage, Fault> {
    let reader = ImageReader::open(path).map_err(|error| unreadable(path, &error))?;
    let reader = reader.with_guessed_format().map_err(|error| unreadable(path, &error))?;
    reader.decode().map_err(|error| unusable(path, &error))
}

/// Reads a mask: the alpha channel of a picture that is transparent anywhere, else its brightness.
///
/// # Errors
/// [`Fault::Data`] that names the file.
pub(super) fn read_mask(path: &Path) -> Result<Mask, Fault> {
    let picture = read(path)?;
    if picture.color().has_alpha() {
        let pixels = picture.to_rgba16();
        let alpha =
            Mask::from_fn(pixels.width(), pixels.height(), |x, y| Luma([pixels.get_pixel(x, y).0[3]]));
        if alpha.pixels().any(|alpha| alpha.0[0] < u16::MAX) {
            return Ok(alpha);
        }
    }
    Ok(picture.into_luma16())
}

/// Pixels of a photograph of size `actual` per pixel of its camera, which has `stated` ones, along both axes: photographs
/// may be smaller than their camera.
///
/// # Errors
/// If their proportions differ.
pub(super) fn scale_of_photograph(stated: [f64; 2], actual: (u32, u32)) -> Result<[f64; 2], String> {
    let ([w, h], [width, height]) = (stated, [actual.0, actual.1].map(f64::from));
    let [x, y] = [width / w, height / h];
    // Shrinking rounds sides to whole pixels.
    if (x / y - 1.0).abs() > 2.0 / width.min(height) {
        return Err(format!(
            "the photograph has {width}x{height} pixels, its camera {w}x{h}: not its proportions; use the photographs of its calibration"
        ));
    }
    Ok([x, y])
}

/// Width and height of the image at `path`.
pub(super) fn size_of(path: &Path) -> Result<(u32, u32), Fault> {
    image::image_dimensions(path).map_err(|error| unusable(path, &error))
}

pub(super) fn check_size(path: &Path, size: (u32, u32), camera: &Camera) -> Result<(), Fault> {
    if size == (camera.width, camera.height) {
        return Ok(());
    }
    let ((width, height), Camera { width: w, height: h, .. }) = (size, camera);
    Err(bad(
        path,
        format!("{width}x{height} pixels, but its camera has {w}x{h}; scale it, or correct the camera"),
    ))
}

pub(crate) fn bad(path: &Path, problem: impl std::fmt::Display) -> Fault {
    Fault::Data(format!("{}: {problem}", path.display()))
}

/// The fault of a photograph or a mask that cannot be decoded.
fn unusable(path: &Path, error: &image::ImageError) -> Fault {
    lfs_pointer(path).unwrap_or_else(|| bad(path, format!("{error}; save it again as PNG, JPEG or WebP")))
}

/// The fault of a calibration or a depth map that is not as `xtask/CAPTURE.md` describes it.
pub(crate) fn bad_layout(path: &Path, problem: impl std::fmt::Display) -> Fault {
    bad(path, format!("{problem}; xtask/CAPTURE.md describes the layout"))
}

/// Reads a text file, without its byte order mark.
///
/// # Errors
/// Those of [`read_bytes`], and [`Fault::Data`] if it is not in UTF-8.
pub(crate) fn read_text(path: &Path) -> Result<String, Fault> {
    let text =
        String::from_utf8(read_bytes(path)?).map_err(|_| bad(path, "not in UTF-8; save it as UTF-8"))?;
    Ok(match text.strip_prefix('\u{feff}') {
        Some(rest) => rest.to_owned(),
        None => text,
    })
}

/// Reads a file.
///
/// # Errors
/// [`Fault::Data`] that names the file, if it cannot be read or is a pointer of Git LFS.
pub(super) fn read_bytes(path: &Path) -> Result<Vec<u8>, Fault> {
    let bytes = std::fs::read(path).map_err(|error| unreadable(path, &error))?;
    match is_lfs_pointer(&bytes) {
        true => Err(not_fetched(path)),
        false => Ok(bytes),
    }
}

/// Most bytes of a pointer of Git LFS.
const POINTER_BYTES: u64 = 1024;

fn not_fetched(path: &Path) -> Fault {
    bad(path, "a pointer of Git LFS in place of the file; fetch it with `git lfs pull`")
}

/// The fault of a picture, a video or a calibration that Git LFS has not fetched; `None` of any other file.
pub(crate) fn lfs_pointer(path: &Path) -> Option<Fault> {
    let mut start = Vec::new();
    File::open(path).and_then(|file| file.take(POINTER_BYTES).read_to_end(&mut start)).ok()?;
    is_lfs_pointer(&start).then(|| not_fetched(path))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mask_is_alpha_or_brightness() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("mask.png");
        let mask_of = |pixels: [[u8; 4]; 2]| {
            image::RgbaImage::from_raw(2, 1, pixels.concat()).unwrap().save(&path).unwrap();
            read_mask(&path).unwrap().into_raw()
        };
        assert_eq!(mask_of([[255, 255, 255, 0], [255, 255, 255, 255]]), [0, u16::MAX], "white, cut out");
        assert_eq!(mask_of([[0, 0, 0, 0], [40, 0, 0, 255]]), [0, u16::MAX], "the subject itself, cut out");
        assert_eq!(mask_of([[0, 0, 0, 255], [255, 255, 255, 255]]), [0, u16::MAX], "opaque");
    }
}
