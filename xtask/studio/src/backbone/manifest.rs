//! [`Manifest`]: input size and normalisation of a backbone, and names of its input and output.

use std::path::Path;

use image::RgbImage;
use program::Fault;
use serde::Deserialize;

use crate::messages::unreadable;

/// Name of the file.
const FILE: &str = "backbone.json";

/// Largest side of a network's input in pixels.
const SIDE_MAX: u32 = 1 << 14;

/// See `xtask/CAPTURE.md`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Manifest {
    /// Name of the input: the photographs.
    #[serde(default = "image")]
    pub(super) input: String,
    /// Name of the output: the depths.
    #[serde(default = "depth")]
    pub(super) output: String,
    /// Pixels that photographs are scaled to.
    pub(super) width: u32,
    pub(super) height: u32,
    /// Whether the network takes all photographs of an instant at once.
    #[serde(default)]
    pub(super) together: bool,
    /// Normalisation of red, green and blue in `[0, 1]`: subtract `mean`, divide by `std`.
    #[serde(default)]
    mean: [f32; 3],
    #[serde(default = "one")]
    std: [f32; 3],
}

fn image() -> String {
    "image".into()
}

fn depth() -> String {
    "depth".into()
}

fn one() -> [f32; 3] {
    [1.0; 3]
}

impl Manifest {
    /// Reads the manifest of a folder.
    ///
    /// # Errors
    /// [`Fault::Data`] that names the file.
    pub(super) fn load(folder: &Path) -> Result<Manifest, Fault> {
        let path = folder.join(FILE);
        let bad =
            |what: String| Fault::Data(format!("{}: {what}; xtask/CAPTURE.md describes it", path.display()));
        let text = std::fs::read_to_string(&path).map_err(|error| unreadable(&path, &error))?;
        let manifest: Manifest = serde_json::from_str(&text).map_err(|error| bad(error.to_string()))?;
        let Manifest { width, height, mean, std, input, output, .. } = &manifest;
        if [width, height].iter().any(|side| !(1..=SIDE_MAX).contains(*side)) {
            return Err(bad(format!("{width}x{height} pixels: a side can have 1 to {SIDE_MAX}")));
        }
        if !mean.iter().all(|x| x.is_finite()) || !std.iter().all(|x| *x > 0.0 && x.is_finite()) {
            return Err(bad("mean must be three numbers and std three positive ones".into()));
        }
        if input.is_empty() || output.is_empty() {
            return Err(bad("input and output must be names of tensors".into()));
        }
        Ok(manifest)
    }

    /// Red, green and blue of an image one after the other, each row by row from the top left,
    /// normalised.
    pub(super) fn planes(&self, image: &RgbImage) -> Vec<f32> {
        let plane = |c: usize| {
            let level = move |pixel: &image::Rgb<u8>| f32::from(pixel.0[c]) / 255.0;
            image.pixels().map(move |pixel| (level(pixel) - self.mean[c]) / self.std[c])
        };
        (0..3).flat_map(plane).collect()
    }
}
