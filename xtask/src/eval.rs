//! How well a field, a package or anybody's pictures show what a capture's cameras saw.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use anyhow::bail;
use refine::capture::{CaptureShot, Holdout, Split};
use refine::image::Image;
use refine::metrics::Measures;
use refine::reference::{self, Order};
use serde::Serialize;

use crate::capture::{Footage, find_image, read_picture};
use crate::fault::Fault;
use crate::input::Input;

/// What is compared with photographs.
#[derive(Debug)]
pub enum Subject {
    /// A field or a package, drawn by the reference renderer.
    Drawn(Box<Input>),
    /// A folder of pictures, named as the photographs are.
    Pictures(PathBuf),
}

impl Subject {
    /// A field file, a package, a folder that holds one, or else a folder of pictures of the shots
    /// of `footage`.
    ///
    /// # Errors
    /// [`Fault::Data`] that says what is there instead.
    pub fn load(path: &Path, footage: &Footage) -> anyhow::Result<Subject> {
        let has_picture = |shot: &CaptureShot| find_image(&path.join(footage.name(*shot))).is_some();
        match path.is_dir() && footage.capture.shots.iter().any(has_picture) {
            true => Ok(Subject::Pictures(path.to_owned())),
            false => Ok(Subject::Drawn(Box::new(Input::load(path)?))),
        }
    }

    /// Its picture of a shot; `None` if there is none.
    fn picture(&self, footage: &Footage, shot: CaptureShot) -> Result<Option<Image>, Fault> {
        let camera = &footage.capture.cameras[shot.camera].camera;
        match self {
            Subject::Drawn(input) => {
                let t = footage.capture.times[shot.frame];
                Ok(Some(reference::render(&input.to_reference(), camera, t, Order::Depth)))
            }
            Subject::Pictures(folder) => match find_image(&folder.join(footage.name(shot))) {
                Some(path) => read_picture(&path, camera).map(Some),
                None => Ok(None),
            },
        }
    }
}

/// Measures of one picture.
#[derive(Clone, Debug)]
pub struct Judged {
    /// Camera and frame.
    pub shot: CaptureShot,
    /// What the photograph is to a fit.
    pub split: Split,
    /// How alike both are.
    pub measures: Measures,
}

/// Compares pictures of `subject` with all photographs of `footage`. Pictures that a folder lacks are left out. `on_shot` is called for each shot.
///
/// # Errors
/// [`Fault::Data`] where a file cannot be read or nothing is left to compare.
pub fn judge(
    subject: &Subject,
    footage: &Footage,
    holdout: Holdout,
    mut on_shot: impl FnMut(),
) -> anyhow::Result<Vec<Judged>> {
    let splits = Split::assign(&footage.capture, holdout).map_err(|error| Fault::Data(error.to_string()))?;
    let mut judged = Vec::new();
    for (shot, split) in splits {
        if let Some(picture) = subject.picture(footage, shot)? {
            let measures = Measures::of(&picture, &footage.photo(shot)?);
            judged.push(Judged { shot, split, measures });
        }
        on_shot();
    }
    if judged.is_empty() {
        bail!(Fault::Data("there is no picture of any photograph".into()));
    }
    Ok(judged)
}

/// Mean measures of a split; the fields are keys of the JSON.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SplitMeasures {
    /// Name of the split.
    pub split: &'static str,
    /// PSNR in dB over the subject, mean over images that show it, and standard deviation.
    pub psnr_fg: Option<f64>,
    /// Standard deviation of `psnr_fg`.
    pub psnr_fg_deviation: Option<f64>,
    /// PSNR in dB over whole images, mean.
    pub psnr_full: f64,
    /// SSIM of whole images, mean.
    pub ssim: f64,
    /// Not measured: it takes the weights of a network.
    pub lpips: Option<f64>,
    /// Number of images.
    pub images: usize,
    /// Number of images that show no subject, and so count for nothing in `psnr_fg`.
    pub without_subject: usize,
}

/// Means of each split that has images.
pub fn means(judged: &[Judged]) -> Vec<SplitMeasures> {
    let of = |split: Split| {
        let measures: Vec<Measures> =
            judged.iter().filter(|one| one.split == split).map(|one| one.measures).collect();
        let mean = |numbers: &[f64]| numbers.iter().sum::<f64>() / numbers.len() as f64;
        let subject: Vec<f64> = measures.iter().filter_map(|m| m.psnr_fg).collect();
        let known = !subject.is_empty();
        let center = mean(&subject);
        let squares: Vec<f64> = subject.iter().map(|x| (x - center).powi(2)).collect();
        (!measures.is_empty()).then(|| SplitMeasures {
            split: split.name(),
            psnr_fg: known.then_some(center),
            psnr_fg_deviation: known.then(|| mean(&squares).sqrt()),
            psnr_full: mean(&measures.iter().map(|m| m.psnr_full).collect::<Vec<_>>()),
            ssim: mean(&measures.iter().map(|m| m.ssim).collect::<Vec<_>>()),
            lpips: None,
            images: measures.len(),
            without_subject: measures.len() - subject.len(),
        })
    };
    Split::ALL.into_iter().filter_map(of).collect()
}

/// The means as a table in Markdown.
pub fn table(means: &[SplitMeasures]) -> String {
    let mut text = String::from(
        "| split | images | PSNR of the subject, dB | whole frame, dB | SSIM | LPIPS |\n|---|---|---|---|---|---|\n",
    );
    for row in means {
        let subject = match (row.psnr_fg, row.psnr_fg_deviation) {
            (Some(psnr), Some(deviation)) => format!("{psnr:.2} ± {deviation:.2}"),
            _ => "–".into(),
        };
        let SplitMeasures { split, images, psnr_full, ssim, .. } = row;
        writeln!(text, "| {split} | {images} | {subject} | {psnr_full:.2} | {ssim:.4} | – |")
            .expect("text grows");
    }
    text
}

/// Every picture's measures as CSV.
pub fn csv(judged: &[Judged], footage: &Footage) -> String {
    let mut text = String::from("image,camera,frame,split,psnr_fg,psnr_full,ssim\n");
    for Judged { shot, split, measures } in judged {
        let camera = &footage.capture.cameras[shot.camera].name;
        let subject = measures.psnr_fg.map_or(String::new(), |psnr| format!("{psnr:.4}"));
        let (name, frame, split) = (footage.name(*shot), shot.frame, split.name());
        let Measures { psnr_full, ssim, .. } = measures;
        writeln!(text, "{name},{camera},{frame},{split},{subject},{psnr_full:.4},{ssim:.6}")
            .expect("text grows");
    }
    text
}

/// Shots to look at: of each split, the one with the lowest measure and the one in the middle.
pub fn telling(judged: &[Judged]) -> Vec<&Judged> {
    let mut telling = Vec::new();
    for split in Split::ALL {
        let mut of: Vec<&Judged> = judged.iter().filter(|one| one.split == split).collect();
        let psnr = |one: &Judged| one.measures.psnr_fg.unwrap_or(one.measures.psnr_full);
        of.sort_by(|a, b| psnr(a).total_cmp(&psnr(b)));
        let places = [0, of.len() / 2];
        telling.extend(places.iter().take(of.len()).filter_map(|place| of.get(*place)));
    }
    telling
}

/// The photograph, the picture and four times their difference, side by side.
///
/// # Errors
/// [`Fault::Data`] where a file cannot be read.
pub fn strip(subject: &Subject, footage: &Footage, shot: CaptureShot) -> Result<Image, Fault> {
    let taken = footage.photo(shot)?.image;
    let (width, height) = (taken.width, taken.height);
    let picture = subject.picture(footage, shot)?.unwrap_or_else(|| Image::new(width, height));
    let mut strip = Image::new(3 * width, height);
    for (i, (taken, drawn)) in taken.pixels.iter().zip(&picture.pixels).enumerate() {
        let (x, y) = (i % width as usize, i / width as usize);
        let difference = [0, 1, 2].map(|c| 4.0 * (taken[c] - drawn[c].clamp(0.0, 1.0)).abs());
        let [r, g, b] = difference;
        for (part, pixel) in [*taken, *drawn, [r, g, b, 1.0]].into_iter().enumerate() {
            strip.pixels[y * strip.width as usize + part * width as usize + x] = pixel;
        }
    }
    Ok(strip)
}
