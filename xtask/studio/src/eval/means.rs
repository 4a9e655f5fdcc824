//! Mean measures of each split, and their tables.

use std::collections::BTreeMap;
use std::fmt::Write;

use refine::capture::{Capture, PhotoId, Split};
use refine::metrics::{AlignedPsnr, ImageMetrics, Overlap};
use serde::Serialize;

use super::Judged;
use crate::capture::CaptureFiles;

/// Mean measures of a split; the fields are keys of the JSON.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SplitMeasures {
    /// Name of the split.
    pub split: &'static str,
    /// PSNR in dB over the subject, mean over the images that show it and differ there; infinite if none differs.
    pub psnr_fg: Option<f64>,
    /// Standard deviation of `psnr_fg`; `None` if that is.
    pub psnr_fg_deviation: Option<f64>,
    /// The same after one affine transform of each camera's colours: the transform of the subject in all its
    /// photographs.
    pub psnr_fg_aligned: Option<f64>,
    /// PSNR in dB over whole images, mean over those that differ from their photographs; infinite if none does.
    pub psnr_full: f64,
    /// The same after one affine transform of each camera's colours: the transform of all its photographs.
    pub psnr_full_aligned: f64,
    /// PSNR in dB over the pixels that differ from the camera's median over time, mean over the images that have any;
    /// `None` if no image has.
    pub psnr_moving: Option<f64>,
    /// The same after the transform of `psnr_full_aligned`.
    pub psnr_moving_aligned: Option<f64>,
    /// SSIM of whole images, mean.
    pub ssim: f64,
    /// LPIPS of whole images, mean; absent without the weights of a network.
    pub lpips: Option<f64>,
    /// Intersection over union, from 0 to 1, of the masks and what is drawn before the plate, of all images together; `None`
    /// if none has both.
    pub subject_iou: Option<f64>,
    /// Number of images.
    pub images: usize,
    /// Number of images that show no subject; `psnr_fg` excludes them.
    pub without_subject: usize,
    /// Number of images equal to their photographs; `psnr_full` excludes them.
    pub exact: usize,
}

/// Means of each split that has images.
pub fn means(judged: &[Judged]) -> Vec<SplitMeasures> {
    let measures = |split: Split| {
        let of_split = || judged.iter().filter(|one| one.split == split);
        let (measures, aligned): (Vec<ImageMetrics>, Vec<AlignedPsnr>) =
            of_split().map(|one| (one.measures, one.aligned)).unzip();
        let mut overlap = Overlap::default();
        of_split().filter_map(|one| one.overlap).for_each(|one| overlap += one);
        let subject: Vec<f64> = measures.iter().filter_map(|m| m.psnr_fg).collect();
        let lpips: Vec<f64> = measures.iter().filter_map(|m| m.lpips).collect();
        let known = !subject.is_empty();
        let center = mean_psnr(&subject);
        let squares: Vec<f64> = differing(&subject).map(|x| (x - center).powi(2)).collect();
        let full: Vec<f64> = measures.iter().map(|m| m.psnr_full).collect();
        (!measures.is_empty()).then(|| SplitMeasures {
            split: split.name(),
            psnr_fg: known.then_some(center),
            psnr_fg_deviation: (!squares.is_empty()).then(|| mean(&squares).sqrt()),
            psnr_fg_aligned: known_psnr(aligned.iter().map(|aligned| aligned.fg)),
            psnr_full: mean_psnr(&full),
            psnr_full_aligned: mean_psnr(&aligned.iter().map(|aligned| aligned.full).collect::<Vec<_>>()),
            psnr_moving: known_psnr(measures.iter().map(|m| m.psnr_moving)),
            psnr_moving_aligned: known_psnr(aligned.iter().map(|aligned| aligned.moving)),
            ssim: mean(&measures.iter().map(|m| m.ssim).collect::<Vec<_>>()),
            lpips: (!lpips.is_empty()).then(|| mean(&lpips)),
            subject_iou: overlap.iou(),
            images: measures.len(),
            without_subject: measures.len() - subject.len(),
            exact: full.len() - differing(&full).count(),
        })
    };
    Split::ALL.into_iter().filter_map(measures).collect()
}

/// The PSNR of images that differ from their photographs: the PSNR of equal images, such as two black ones, is
/// infinite.
fn differing(psnr: &[f64]) -> impl Iterator<Item = f64> {
    psnr.iter().copied().filter(|psnr| *psnr != f64::INFINITY)
}

/// Mean PSNR of the images that differ from their photographs; infinite if none does.
pub(super) fn mean_psnr(psnr: &[f64]) -> f64 {
    let differing: Vec<f64> = differing(psnr).collect();
    if differing.is_empty() { f64::INFINITY } else { mean(&differing) }
}

/// Mean PSNR of the images that have one; `None` if none has.
pub(super) fn known_psnr(psnr: impl Iterator<Item = Option<f64>>) -> Option<f64> {
    let known: Vec<f64> = psnr.flatten().collect();
    (!known.is_empty()).then(|| mean_psnr(&known))
}

pub(super) fn mean(numbers: &[f64]) -> f64 {
    numbers.iter().sum::<f64>() / numbers.len() as f64
}

/// The means as a table in Markdown, then those of [`BlendedPhotographs`](super::BlendedPhotographs); with a column for the
/// subject's IoU if any has one.
pub fn table(means: &[SplitMeasures], blended: &[SplitMeasures]) -> String {
    let has_iou = means.iter().any(|row| row.subject_iou.is_some());
    let [iou, rule] = if has_iou { [" subject IoU |", "---|"] } else { [""; 2] };
    let mut text = format!(
        "| split | images | subject, dB | aligned | whole, dB | aligned | moving, dB | aligned | SSIM | LPIPS |{iou}\n\
         |---|---|---|---|---|---|---|---|---|---|{rule}\n",
    );
    let mut write = |name: &str, row: &SplitMeasures| {
        let iou = row.subject_iou.map_or("–".into(), |iou| format!("{iou:.4}"));
        let iou = if has_iou { format!(" {iou} |") } else { String::new() };
        writeln!(text, "{}{iou}", cells(name, row)).expect("text grows");
    };
    means.iter().for_each(|row| write(row.split, row));
    blended.iter().for_each(|row| write(&format!("{}, photographs blended", row.split), row));
    text
}

/// The cells of a row that every table has.
fn cells(name: &str, row: &SplitMeasures) -> String {
    let subject = match (row.psnr_fg, row.psnr_fg_deviation) {
        (Some(psnr), Some(deviation)) => format!("{psnr:.2} ± {deviation:.2}"),
        (Some(psnr), None) => format!("{psnr:.2}"),
        (None, _) => "–".into(),
    };
    let SplitMeasures { images, psnr_full, psnr_full_aligned, ssim, .. } = row;
    let [fg_aligned, moving, moving_aligned] =
        [row.psnr_fg_aligned, row.psnr_moving, row.psnr_moving_aligned].map(show_db);
    let lpips = row.lpips.map_or("–".into(), |lpips| format!("{lpips:.4}"));
    format!(
        "| {name} | {images} | {subject} | {fg_aligned} | {psnr_full:.2} | {psnr_full_aligned:.2} | {moving} | \
         {moving_aligned} | {ssim:.4} | {lpips} |"
    )
}

/// A cell of a table.
pub(super) fn show_db(psnr: Option<f64>) -> String {
    psnr.map_or("–".into(), |psnr| format!("{psnr:.2}"))
}

/// Every picture's measures as CSV.
pub fn csv(judged: &[Judged], capture_files: &CaptureFiles) -> String {
    let mut text = String::from(
        "image,camera,frame,split,psnr_fg,psnr_fg_aligned,psnr_full,psnr_full_aligned,psnr_moving,psnr_moving_aligned,ssim,\
         lpips,subject_intersection,subject_union\n",
    );
    for Judged { photo_id, split, measures, aligned, overlap } in judged {
        let camera = &capture_files.capture.cameras[photo_id.camera].name;
        let [fg, fg_aligned, moving, moving_aligned] =
            [measures.psnr_fg, aligned.fg, measures.psnr_moving, aligned.moving]
                .map(|psnr| psnr.map_or(String::new(), |psnr| format!("{psnr:.4}")));
        let (name, frame, split) = (capture_files.name(*photo_id), photo_id.frame, split.name());
        let (ImageMetrics { psnr_full, ssim, .. }, full_aligned) = (measures, aligned.full);
        let lpips = measures.lpips.map_or(String::new(), |lpips| format!("{lpips:.6}"));
        let pixels =
            |of: fn(&Overlap) -> usize| overlap.as_ref().map_or(String::new(), |one| of(one).to_string());
        let (both, either) = (pixels(|one| one.intersection), pixels(|one| one.union));
        writeln!(
            text,
            "{name},{camera},{frame},{split},{fg},{fg_aligned},{psnr_full:.4},{full_aligned:.4},{moving},{moving_aligned},\
             {ssim:.6},{lpips},{both},{either}"
        )
        .expect("text grows");
    }
    text
}

/// Parses the text of [`csv`] for the same capture.
///
/// # Errors
/// The problem, with its line number.
pub fn parse_csv(text: &str, capture_files: &CaptureFiles) -> Result<Vec<Judged>, String> {
    let Capture { photos, cameras, .. } = &capture_files.capture;
    let name = |photo_id: &PhotoId| {
        format!("{},{},{}", capture_files.name(*photo_id), cameras[photo_id.camera].name, photo_id.frame)
    };
    let named: BTreeMap<String, PhotoId> =
        photos.iter().map(|photo_id| (name(photo_id), *photo_id)).collect();
    let parse_line = |line: &str| {
        // From the end, as names may hold commas.
        let mut cells = line.rsplitn(12, ',');
        let mut cell = || cells.next();
        let optional = |text: &str| if text.is_empty() { Some(None) } else { text.parse().ok().map(Some) };
        let (union, intersection) = (cell()?, cell()?);
        let overlap = match union.is_empty() {
            true => None,
            false => Some(Overlap { intersection: intersection.parse().ok()?, union: union.parse().ok()? }),
        };
        let lpips = optional(cell()?)?;
        let ssim = cell()?.parse().ok()?;
        let moving = optional(cell()?)?;
        let psnr_moving = optional(cell()?)?;
        let full = cell()?.parse().ok()?;
        let psnr_full = cell()?.parse().ok()?;
        let fg = optional(cell()?)?;
        let psnr_fg = optional(cell()?)?;
        let split = cell()?;
        let split = Split::ALL.into_iter().find(|known| known.name() == split)?;
        let photo_id = *named.get(cell()?)?;
        Some(Judged {
            photo_id,
            split,
            measures: ImageMetrics { psnr_fg, psnr_full, psnr_moving, ssim, lpips },
            aligned: AlignedPsnr { fg, full, moving },
            overlap,
        })
    };
    let lines = (1..).zip(text.lines()).skip(1);
    lines
        .map(|(number, line)| parse_line(line).ok_or(format!("line {number} is not one of `eval`")))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn judged(psnr_fg: &[Option<f64>]) -> Vec<Judged> {
        let one = |(frame, psnr_fg): (usize, &Option<f64>)| Judged {
            photo_id: PhotoId { frame, camera: 0 },
            split: Split::Train,
            measures: ImageMetrics {
                psnr_fg: *psnr_fg,
                psnr_full: 30.0,
                psnr_moving: (frame == 1).then_some(10.0),
                ssim: 0.5,
                lpips: None,
            },
            aligned: AlignedPsnr {
                fg: psnr_fg.map(|psnr| psnr + 1.0),
                full: 32.0,
                moving: (frame == 1).then_some(15.0),
            },
            overlap: None,
        };
        psnr_fg.iter().enumerate().map(one).collect()
    }

    #[test]
    fn means_and_deviations_are_of_pictures_with_a_subject() {
        let rows = means(&judged(&[Some(20.0), None, Some(26.0)]));
        assert_eq!((rows[0].psnr_fg, rows[0].psnr_fg_deviation), (Some(23.0), Some(3.0)));
        assert_eq!((rows[0].images, rows[0].without_subject, rows.len()), (3, 1, 1));
        assert!(
            table(&rows, &[]).contains(
                "| train | 3 | 23.00 ± 3.00 | 24.00 | 30.00 | 32.00 | 10.00 | 15.00 | 0.5000 | – |"
            ),
            "{}",
            table(&rows, &[])
        );
    }

    #[test]
    fn exact_pictures_and_empty_ones_have_no_deviation() {
        let text = |psnr: &[Option<f64>]| table(&means(&judged(psnr)), &[]);
        assert!(text(&[Some(f64::INFINITY); 2]).contains("| 2 | inf | inf | 30.00 |"));
        assert!(text(&[None]).contains("| 1 | – | – | 30.00 | 32.00 | – | – |"));
    }

    #[test]
    fn the_table_has_a_column_for_the_overlap_if_any_is_known() {
        let mut judged = judged(&[Some(20.0); 3]);
        assert!(!table(&means(&judged), &[]).contains("IoU"));
        judged[0].overlap = Some(Overlap { intersection: 1, union: 1 });
        judged[1].overlap = Some(Overlap { intersection: 0, union: 7 });
        let (rows, blended) = (means(&judged), means(&judged[2..]));
        assert_eq!(rows[0].subject_iou, Some(0.125), "of all pixels, not the mean of images");
        let table = table(&rows, &blended);
        let columns: Vec<usize> = table.lines().map(|line| line.matches('|').count()).collect();
        assert_eq!(columns, [12; 4], "{table}");
        assert!(table.contains(" | – | 0.1250 |\n") && table.ends_with(" | – | – |\n"), "{table}");
    }

    #[test]
    fn exact_pictures_leave_the_means_of_the_others() {
        let mut judged = judged(&[Some(f64::INFINITY), Some(20.0), Some(24.0), None]);
        judged[3].measures.psnr_full = f64::INFINITY;
        let rows = means(&judged);
        assert_eq!((rows[0].psnr_fg, rows[0].psnr_fg_deviation), (Some(22.0), Some(2.0)));
        assert_eq!((rows[0].psnr_full, rows[0].exact, rows[0].without_subject), (30.0, 1, 1));
        judged[1].measures.psnr_fg = Some(f64::NAN);
        assert!(means(&judged)[0].psnr_fg.unwrap().is_nan(), "a defect is not hidden");
    }
}
