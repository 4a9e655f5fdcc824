//! [`eval_prefixes`]: the first layers of a package against photographs (the paper's appendix
//! "Degradation Along the Budget Ladder").

use std::fmt::Write;

use codec::SegmentLayer;
use refine::capture::{Holdout, PhotoId, Split};
use refine::image::Image;
use refine::metrics::ImageMetrics;
use refine::reference::{self, Order};
use serde::Serialize;

use super::means::{mean, mean_psnr};
use super::sheet::{Crop, sheet};
use super::{Photographs, splits};
use crate::segments::DecodedTake;

/// Maximum number of photographs that each prefix is compared with.
const PHOTOS_MAX: usize = 16;

/// Splits, the hardest to predict first.
const SPLITS: [Split; 4] = [Split::InterpA, Split::InterpB, Split::Recon, Split::Train];

/// Quality of each prefix of the layers.
#[derive(Clone, Debug, Serialize)]
pub struct PrefixEval {
    /// Name of the photographs' split.
    pub split: &'static str,
    /// Number of photographs, taken evenly from the split.
    pub images: usize,
    /// One step per prefix, the shortest first.
    #[serde(rename = "rungs")]
    pub steps: Vec<PrefixEvalStep>,
    /// A photograph, then the picture of each prefix, the longest first.
    #[serde(skip)]
    pub picture: Image,
}

/// Mean measures of a prefix against the photographs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PrefixEvalStep {
    /// Number of Gaussians in the prefix, without the plates.
    pub gaussians: usize,
    /// Bytes of the package up to the end of the prefix.
    pub bytes: usize,
    /// PSNR in dB over the subject, of the photographs that show it.
    pub psnr_fg: Option<f64>,
    /// PSNR in dB over whole images.
    pub psnr_full: f64,
    /// SSIM of whole images.
    pub ssim: f64,
}

/// Compares each prefix of the layers of `take` with photographs of the first non-empty split of `SPLITS`; where what is
/// drawn tells their subject, that is of all layers. `None` if its segments have one layer, or none.
///
/// # Errors
/// [`Fault::Data`](program::Fault::Data) where a file cannot be read or no photograph is left for fitting.
pub fn eval_prefixes(
    take: &DecodedTake,
    photographs: &Photographs,
    holdout: Holdout,
) -> anyhow::Result<Option<PrefixEval>> {
    let layers = take.layers.len();
    if layers < 2 {
        return Ok(None);
    }
    let capture_files = &photographs.files;
    let splits = splits(capture_files, holdout)?;
    let photos_in = |target: Split| -> Vec<PhotoId> {
        splits.iter().filter(|(_, split)| *split == target).map(|(photo_id, _)| *photo_id).collect()
    };
    let (split, photo_ids) = SPLITS
        .map(|split| (split, photos_in(split)))
        .into_iter()
        .find(|(_, photo_ids)| !photo_ids.is_empty())
        .expect("a photograph is left for fitting");
    let count = photo_ids.len().min(PHOTOS_MAX);
    // Evenly spaced, so that not all are of the first camera.
    let photo_ids: Vec<PhotoId> =
        (0..count).map(|i| photo_ids[(2 * i + 1) * photo_ids.len() / (2 * count)]).collect();
    let mut measures = vec![Vec::new(); layers];
    let mut row = Vec::new();
    for (i, photo_id) in photo_ids.iter().enumerate() {
        let camera = &capture_files.capture.cameras[photo_id.camera].camera;
        let (mut photo, t) = (photographs.read(*photo_id)?, capture_files.capture.clip_time(*photo_id));
        let draw = |layers: usize| reference::render(&take.to_reference(layers), camera, t, Order::Depth);
        let (whole, subject) =
            reference::render_with_subject(&take.to_reference(layers), camera, t, Order::Depth);
        photographs.tell(*photo_id, &mut photo, &subject);
        let pictures: Vec<Image> = (1..layers).map(draw).chain([whole]).collect();
        for (measures, picture) in measures.iter_mut().zip(&pictures) {
            measures.push(ImageMetrics::measure(picture, &photo, None));
        }
        if i == count / 2 {
            let crop = Crop::around(&[&photo]);
            row = std::iter::once(&photo.image)
                .chain(pictures.iter().rev())
                .map(|image| crop.apply(image))
                .collect();
        }
    }
    let step = |(&SegmentLayer { gaussians, bytes }, measures): (&SegmentLayer, &Vec<ImageMetrics>)| {
        let subject: Vec<f64> = measures.iter().filter_map(|m| m.psnr_fg).collect();
        PrefixEvalStep {
            gaussians,
            bytes,
            psnr_fg: (!subject.is_empty()).then(|| mean_psnr(&subject)),
            psnr_full: mean_psnr(&measures.iter().map(|m| m.psnr_full).collect::<Vec<_>>()),
            ssim: mean(&measures.iter().map(|m| m.ssim).collect::<Vec<_>>()),
        }
    };
    let steps = take.layers.iter().zip(&measures).map(step).collect();
    Ok(Some(PrefixEval { split: split.name(), images: count, steps, picture: sheet(&[row]) }))
}

impl PrefixEval {
    /// The steps as a table in Markdown.
    pub fn table(&self) -> String {
        let mut text = format!(
            "\nThe first layers of the package, against {} photographs of {}:\n\n\
             | Gaussians | bytes | PSNR of the subject, dB | whole frame, dB | SSIM |\n|---|---|---|---|---|\n",
            self.images, self.split
        );
        for PrefixEvalStep { gaussians, bytes, psnr_fg, psnr_full, ssim } in &self.steps {
            let subject = psnr_fg.map_or("–".into(), |psnr| format!("{psnr:.2}"));
            writeln!(text, "| {gaussians} | {bytes} | {subject} | {psnr_full:.2} | {ssim:.4} |")
                .expect("text grows");
        }
        text
    }
}
