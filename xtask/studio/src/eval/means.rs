//! Mean measures of each split, and their tables.

use std::collections::BTreeMap;
use std::fmt::Write;

use refine::capture::{Capture, PhotoId, Split};
use refine::metrics::ImageMetrics;
use serde::Serialize;

use super::{Baseline, Judged};
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
    /// The same after the affine transform of each picture's colours that fits its photograph best.
    pub psnr_fg_aligned: Option<f64>,
    /// PSNR in dB over whole images, mean over those that differ from their photographs; infinite if none does.
    pub psnr_full: f64,
    /// SSIM of whole images, mean.
    pub ssim: f64,
    /// LPIPS of whole images, mean; absent without the weights of a network.
    pub lpips: Option<f64>,
    /// Number of images.
    pub images: usize,
    /// Number of images that show no subject; `psnr_fg` excludes them.
    pub without_subject: usize,
    /// Number of images equal to their photographs; `psnr_full` excludes them.
    pub exact: usize,
}

/// Means of each split that has images.
pub fn means(judged: &[Judged]) -> Vec<SplitMeasures> {
    let of = |split: Split| {
        let measures: Vec<ImageMetrics> =
            judged.iter().filter(|one| one.split == split).map(|one| one.measures).collect();
        let subject: Vec<f64> = measures.iter().filter_map(|m| m.psnr_fg).collect();
        let aligned: Vec<f64> = measures.iter().filter_map(|m| m.psnr_fg_aligned).collect();
        let lpips: Vec<f64> = measures.iter().filter_map(|m| m.lpips).collect();
        let known = !subject.is_empty();
        let center = mean_psnr(&subject);
        let squares: Vec<f64> = differing(&subject).map(|x| (x - center).powi(2)).collect();
        let full: Vec<f64> = measures.iter().map(|m| m.psnr_full).collect();
        (!measures.is_empty()).then(|| SplitMeasures {
            split: split.name(),
            psnr_fg: known.then_some(center),
            psnr_fg_deviation: (!squares.is_empty()).then(|| mean(&squares).sqrt()),
            psnr_fg_aligned: known.then(|| mean_psnr(&aligned)),
            psnr_full: mean_psnr(&full),
            ssim: mean(&measures.iter().map(|m| m.ssim).collect::<Vec<_>>()),
            lpips: (!lpips.is_empty()).then(|| mean(&lpips)),
            images: measures.len(),
            without_subject: measures.len() - subject.len(),
            exact: full.len() - differing(&full).count(),
        })
    };
    Split::ALL.into_iter().filter_map(of).collect()
}

/// The PSNR of images that differ from their photographs: that of equal images, such as two black ones, is infinite.
fn differing(psnr: &[f64]) -> impl Iterator<Item = f64> {
    psnr.iter().copied().filter(|psnr| *psnr != f64::INFINITY)
}

/// Mean PSNR of the images that differ from their photographs; infinite if none does.
pub(super) fn mean_psnr(psnr: &[f64]) -> f64 {
    let differing: Vec<f64> = differing(psnr).collect();
    if differing.is_empty() { f64::INFINITY } else { mean(&differing) }
}

pub(super) fn mean(numbers: &[f64]) -> f64 {
    numbers.iter().sum::<f64>() / numbers.len() as f64
}

/// The means as a table in Markdown.
pub fn table(means: &[SplitMeasures]) -> String {
    let mut text = String::from(
        "| split | images | PSNR of the subject, dB | colours aligned, dB | whole frame, dB | SSIM | LPIPS |\n\
         |---|---|---|---|---|---|---|\n",
    );
    means.iter().for_each(|row| write_row(&mut text, row.split, row));
    text
}

/// Rows of a baseline for that table.
pub fn baseline_rows(baseline: Baseline, means: &[SplitMeasures]) -> String {
    let what = match baseline {
        Baseline::Nearest => "nearest fitted frame",
        Baseline::Blend => "blend of the two around",
    };
    let mut text = String::new();
    means.iter().for_each(|row| write_row(&mut text, &format!("{}, {what}", row.split), row));
    text
}

fn write_row(text: &mut String, name: &str, row: &SplitMeasures) {
    let subject = match (row.psnr_fg, row.psnr_fg_deviation) {
        (Some(psnr), Some(deviation)) => format!("{psnr:.2} ± {deviation:.2}"),
        (Some(psnr), None) => format!("{psnr:.2}"),
        (None, _) => "–".into(),
    };
    let SplitMeasures { images, psnr_full, ssim, .. } = row;
    let aligned = row.psnr_fg_aligned.map_or("–".into(), |psnr| format!("{psnr:.2}"));
    let lpips = row.lpips.map_or("–".into(), |lpips| format!("{lpips:.4}"));
    writeln!(text, "| {name} | {images} | {subject} | {aligned} | {psnr_full:.2} | {ssim:.4} | {lpips} |")
        .expect("text grows");
}

/// Every picture's measures as CSV.
pub fn csv(judged: &[Judged], capture_files: &CaptureFiles) -> String {
    let mut text = String::from("image,camera,frame,split,psnr_fg,psnr_fg_aligned,psnr_full,ssim,lpips\n");
    for Judged { photo_id, split, measures } in judged {
        let camera = &capture_files.capture.cameras[photo_id.camera].name;
        let [subject, aligned] = [measures.psnr_fg, measures.psnr_fg_aligned]
            .map(|psnr| psnr.map_or(String::new(), |psnr| format!("{psnr:.4}")));
        let (name, frame, split) = (capture_files.name(*photo_id), photo_id.frame, split.name());
        let ImageMetrics { psnr_full, ssim, .. } = measures;
        let lpips = measures.lpips.map_or(String::new(), |lpips| format!("{lpips:.6}"));
        writeln!(
            text,
            "{name},{camera},{frame},{split},{subject},{aligned},{psnr_full:.4},{ssim:.6},{lpips}"
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
        let mut cells = line.rsplitn(7, ',');
        let mut cell = || cells.next();
        let optional = |text: &str| if text.is_empty() { Some(None) } else { text.parse().ok().map(Some) };
        let lpips = optional(cell()?)?;
        let ssim = cell()?.parse().ok()?;
        let psnr_full = cell()?.parse().ok()?;
        let psnr_fg_aligned = optional(cell()?)?;
        let psnr_fg = optional(cell()?)?;
        let split = cell()?;
        let split = Split::ALL.into_iter().find(|known| known.name() == split)?;
        let photo_id = *named.get(cell()?)?;
        Some(Judged {
            photo_id,
            split,
            measures: ImageMetrics { psnr_fg, psnr_fg_aligned, psnr_full, ssim, lpips },
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
                psnr_fg_aligned: *psnr_fg,
                psnr_full: 30.0,
                ssim: 0.5,
                lpips: None,
            },
        };
        psnr_fg.iter().enumerate().map(one).collect()
    }

    #[test]
    fn means_and_deviations_are_of_pictures_with_a_subject() {
        let rows = means(&judged(&[Some(20.0), None, Some(26.0)]));
        assert_eq!((rows[0].psnr_fg, rows[0].psnr_fg_deviation), (Some(23.0), Some(3.0)));
        assert_eq!((rows[0].images, rows[0].without_subject, rows.len()), (3, 1, 1));
        assert!(
            table(&rows).contains("| train | 3 | 23.00 ± 3.00 | 23.00 | 30.00 | 0.5000 | – |"),
            "{}",
            table(&rows)
        );
    }

    #[test]
    fn exact_pictures_and_empty_ones_have_no_deviation() {
        let text = |psnr: &[Option<f64>]| table(&means(&judged(psnr)));
        assert!(text(&[Some(f64::INFINITY); 2]).contains("| 2 | inf | inf | 30.00 |"));
        assert!(text(&[None]).contains("| 1 | – | – | 30.00 |"));
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
