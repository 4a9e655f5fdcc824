//! PhotoFiles of a capture: photographs, masks and text, with errors that name the file.

use std::path::{Path, PathBuf};

use codec::Camera;
use image::{DynamicImage, ImageBuffer, ImageReader, Luma};
use program::Fault;
use refine::image::Image;

/// Endings of the files that photographs are read from.
const ENDINGS: [&str; 4] = ["png", "jpg", "jpeg", "webp"];

/// Multiplies a photograph with its mask. One that is black wherever the mask is 0 stands before
/// black already: its colours stay, or the rim of the subject would be darkened twice.
pub(super) fn cut_out(taken: &mut Image, mask: &ImageBuffer<Luma<u16>, Vec<u16>>) {
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

pub(super) fn read_image(path: &Path) -> Result<Image, Fault> {
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

pub(super) fn read(path: &Path) -> Result<DynamicImage, Fault> {
    let reader = ImageReader::open(path).map_err(|error| bad(path, error))?;
    reader.with_guessed_format().map_err(|error| bad(path, error))?.decode().map_err(|error| bad(path, error))
}

/// Width and height of the image at `path`.
pub(super) fn size_of(path: &Path) -> Result<(u32, u32), Fault> {
    image::image_dimensions(path).map_err(|error| bad(path, error))
}

pub(super) fn check_size(path: &Path, size: (u32, u32), camera: &Camera) -> Result<(), Fault> {
    if size == (camera.width, camera.height) {
        return Ok(());
    }
    let is = format!("{}x{} pixels", size.0, size.1);
    Err(bad(path, format!("{is} where its camera has {}x{}", camera.width, camera.height)))
}

pub(super) fn bad(path: &Path, what: impl std::fmt::Display) -> Fault {
    Fault::Data(format!("{}: {what}", path.display()))
}

/// Text of a file.
pub(super) fn read_text(path: &Path) -> Result<String, Fault> {
    std::fs::read_to_string(path).map_err(|error| bad(path, error))
}
