//! Writes the stage as a capture folder with this project's manifest, see `xtask/CAPTURE.md`.

use std::io::{Cursor, Error};
use std::path::Path;
use std::{fs, io};

use codec::Camera;
use image::{ExtendedColorType, ImageEncoder, codecs::png::PngEncoder};
use program::Fault;
use program::output::OutputFolder;
use rayon::prelude::*;
use serde_json::json;

use super::motion::Motion;
use super::trace::trace;
use super::{FPS, StageSettings, is_held, rig, subject};

/// Path of an image in each of the folders `images`, `masks` and `depths`.
const PATTERN: &str = "{camera}/{frame:06}.png";

/// Writes the capture to `folder`, at which there is nothing or an empty folder; on an error nothing is written. Calls
/// `on_image` after each image, from any thread.
///
/// # Errors
/// [`Fault::Usage`] if the settings are out of range or `folder` cannot be written.
pub fn write(folder: &Path, settings: &StageSettings, on_image: impl Fn() + Sync) -> Result<(), Fault> {
    settings.check()?;
    let output = OutputFolder::begin(folder)?;
    fill(output.path(), settings, on_image)
        .map_err(|error| Fault::Usage(format!("cannot write {}: {error}", folder.display())))?;
    output.finish()
}

fn fill(folder: &Path, settings: &StageSettings, on_image: impl Fn() + Sync) -> io::Result<()> {
    let cameras = rig(settings);
    for kind in ["images", "masks", "depths"] {
        (0..cameras.len()).try_for_each(|camera| fs::create_dir_all(folder.join(kind).join(name(camera))))?;
    }
    let motion = Motion::new(settings.frames);
    (0..settings.images()).into_par_iter().try_for_each(|index| {
        let (camera, frame) = (index % cameras.len(), index / cameras.len());
        // The parts of all frames at once would take memory that grows with the capture.
        let image = trace(&subject(settings, &motion, frame as f64), &cameras[camera]);
        let path = |kind: &str| folder.join(kind).join(name(camera)).join(format!("{frame:06}.png"));
        let png = |kind: &str, bytes: &[u8], color| save(&path(kind), &cameras[camera], bytes, color);
        png("images", image.colors.as_flattened(), ExtendedColorType::Rgb8)?;
        mask_png(&path("masks"), &cameras[camera], &image.mask)?;
        // The encoder takes native byte order.
        png("depths", bytemuck::cast_slice(&image.depths), ExtendedColorType::L16)?;
        on_image();
        Ok::<_, Error>(())
    })?;
    fs::write(folder.join("capture.json"), manifest(settings, &cameras))
}

fn save(path: &Path, camera: &Camera, bytes: &[u8], color: ExtendedColorType) -> io::Result<()> {
    let mut png = Cursor::new(Vec::new());
    let encoded = PngEncoder::new(&mut png).write_image(bytes, camera.width, camera.height, color);
    encoded.map_err(Error::other)?;
    fs::write(path, png.get_ref())
}

/// Saves the mask of a camera's picture as a PNG.
pub(in crate::synth) fn mask_png(path: &Path, camera: &Camera, mask: &[u8]) -> io::Result<()> {
    save(path, camera, mask, ExtendedColorType::L8)
}

fn manifest(settings: &StageSettings, cameras: &[Camera]) -> String {
    let camera = |(number, camera): (usize, &Camera)| {
        json!({
            "id": name(number), "w": camera.width, "h": camera.height, "K": camera.k,
            "w2c": camera.camera_from_world, "held": is_held(number),
        })
    };
    let manifest = json!({
        "frames": settings.frames,
        "fps": FPS,
        "images": format!("images/{PATTERN}"),
        "masks": format!("masks/{PATTERN}"),
        "cameras": cameras.iter().enumerate().map(camera).collect::<Vec<_>>(),
    });
    format!("{manifest:#}\n")
}

/// Name of the camera with index `camera`.
pub(in crate::synth) fn name(camera: usize) -> String {
    format!("{camera:02}")
}
