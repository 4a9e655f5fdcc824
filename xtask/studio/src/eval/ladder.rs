//! [`ladder`]: what the first layers of a package show of the photographs (the paper's appendix
//! "Degradation Along the Budget Ladder").

use std::fmt::Write;
use std::path::Path;

use codec::{Clip, Limits};
use program::Fault;
use refine::capture::{Holdout, PhotoId, Split};
use refine::image::Image;
use refine::metrics::ImageMetrics;
use refine::reference::{self, Order, RenderScene};
use serde::Serialize;

use super::means::mean;
use super::sheet::{Crop, sheet};
use super::splits;
use crate::capture::CaptureFiles;
use crate::input::{prefix_bytes, read_package};

/// Most photographs that each layer is compared with.
const PHOTOS_MAX: usize = 16;

/// Splits by how telling they are.
const SPLITS: [Split; 4] = [Split::InterpA, Split::InterpB, Split::Recon, Split::Train];

/// How good each prefix of the layers is.
#[derive(Clone, Debug, Serialize)]
pub struct Ladder {
    /// Name of the split that the photographs are of.
    pub split: &'static str,
    /// Number of photographs, evenly taken from the split.
    pub images: usize,
    /// The least budget first.
    pub rungs: Vec<Rung>,
    /// A photograph, and what the layers show of it: all of them first.
    #[serde(skip)]
    pub picture: Image,
}

/// The first layers of a package against photographs: means.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Rung {
    /// Gaussians in these layers.
    pub gaussians: usize,
    /// Bytes of the package up to their end.
    pub bytes: usize,
    /// PSNR in dB over the subject, of the photographs that show it.
    pub psnr_fg: Option<f64>,
    /// PSNR in dB over whole images.
    pub psnr_full: f64,
    /// SSIM of whole images.
    pub ssim: f64,
}

/// Compares what the first layers of `clip` show with photographs of its most held split; `path` is
/// the package that it was read from. `None` where it has but one layer.
///
/// # Errors
/// [`Fault::Data`] where a file cannot be read or nothing is left to fit to.
pub fn ladder(
    clip: &Clip,
    path: &Path,
    capture_files: &CaptureFiles,
    holdout: Holdout,
) -> anyhow::Result<Option<Ladder>> {
    let layers = clip.layers.len();
    if layers < 2 {
        return Ok(None);
    }
    let contents = codec::contents(&read_package(path)?, &Limits::default())
        .map_err(|error| Fault::Data(format!("{}: {error}", path.display())))?;
    let splits = splits(capture_files, holdout)?;
    let of = |wanted: Split| -> Vec<PhotoId> {
        splits.iter().filter(|(_, split)| *split == wanted).map(|(shot, _)| *shot).collect()
    };
    let (split, shots) = SPLITS
        .map(|split| (split, of(split)))
        .into_iter()
        .find(|(_, shots)| !shots.is_empty())
        .expect("there is something to fit to");
    let count = shots.len().min(PHOTOS_MAX);
    // In the middles of equal parts: not all of the first camera.
    let shots: Vec<PhotoId> = (0..count).map(|i| shots[(2 * i + 1) * shots.len() / (2 * count)]).collect();
    let mut measures = vec![Vec::new(); layers];
    let mut row = Vec::new();
    for (i, shot) in shots.iter().enumerate() {
        let camera = &capture_files.capture.cameras[shot.camera].camera;
        let (photo, t) = (capture_files.photo(*shot)?, capture_files.capture.times[shot.frame]);
        let draw = |layer: usize| {
            reference::render(&RenderScene::from_layers(clip, layer + 1), camera, t, Order::Depth)
        };
        let pictures: Vec<Image> = (0..layers).map(draw).collect();
        for (measures, picture) in measures.iter_mut().zip(&pictures) {
            measures.push(ImageMetrics::of(picture, &photo, None));
        }
        if i == count / 2 {
            let crop = Crop::around(&[&photo]);
            row = std::iter::once(&photo.image)
                .chain(pictures.iter().rev())
                .map(|image| crop.of(image))
                .collect();
        }
    }
    let rung = |(layer, measures): (usize, &Vec<ImageMetrics>)| {
        let subject: Vec<f64> = measures.iter().filter_map(|m| m.psnr_fg).collect();
        Rung {
            gaussians: clip.layers[layer].total(),
            bytes: prefix_bytes(&contents, layer),
            psnr_fg: (!subject.is_empty()).then(|| mean(&subject)),
            psnr_full: mean(&measures.iter().map(|m| m.psnr_full).collect::<Vec<_>>()),
            ssim: mean(&measures.iter().map(|m| m.ssim).collect::<Vec<_>>()),
        }
    };
    let rungs = measures.iter().enumerate().map(rung).collect();
    Ok(Some(Ladder { split: split.name(), images: count, rungs, picture: sheet(&[row]) }))
}

impl Ladder {
    /// The rungs as a table in Markdown.
    pub fn table(&self) -> String {
        let mut text = format!(
            "\nThe first layers of the package, against {} photographs of {}:\n\n\
             | Gaussians | bytes | PSNR of the subject, dB | whole frame, dB | SSIM |\n|---|---|---|---|---|\n",
            self.images, self.split
        );
        for Rung { gaussians, bytes, psnr_fg, psnr_full, ssim } in &self.rungs {
            let subject = psnr_fg.map_or("–".into(), |psnr| format!("{psnr:.2}"));
            writeln!(text, "| {gaussians} | {bytes} | {subject} | {psnr_full:.2} | {ssim:.4} |")
                .expect("text grows");
        }
        text
    }
}
