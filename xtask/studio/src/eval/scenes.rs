//! [`over_scenes`]: the measures of several scenes in one table, as in the paper.

use std::fmt::Write;

use refine::capture::Split;
use serde::Serialize;

use super::means::{SplitMeasures, mean};

/// Mean and population standard deviation of a measure over scenes. The fields are keys of the JSON.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Spread {
    /// Mean of the scenes' means.
    pub mean: f64,
    /// Standard deviation of the scenes' means.
    pub deviation: f64,
}

/// Measures of a split over scenes; the fields are keys of the JSON.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SceneMeasures {
    /// Name of the split.
    pub split: &'static str,
    /// PSNR in dB over the subject, of the scenes that show it.
    pub psnr_fg: Option<Spread>,
    /// The same after one transform of each camera's colours.
    pub psnr_fg_aligned: Option<Spread>,
    /// PSNR in dB over whole images.
    pub psnr_full: Spread,
    /// The same after one transform of each camera's colours.
    pub psnr_full_aligned: Spread,
    /// PSNR in dB over moving pixels, of the scenes that have any.
    pub psnr_moving: Option<Spread>,
    /// The same after one transform of each camera's colours.
    pub psnr_moving_aligned: Option<Spread>,
    /// SSIM of whole images.
    pub ssim: Spread,
    /// LPIPS of whole images; absent without the weights of a network.
    pub lpips: Option<Spread>,
    /// IoU of the masks and what is drawn before the plate, of the scenes that have both.
    pub subject_iou: Option<Spread>,
    /// Number of scenes with this split.
    pub scenes: usize,
    /// Number of images in all of them.
    pub images: usize,
}

/// Means and deviations of each split over `scenes`, equally weighted.
pub fn over_scenes(scenes: &[Vec<SplitMeasures>]) -> Vec<SceneMeasures> {
    let measures = |split: Split| {
        let rows: Vec<&SplitMeasures> =
            scenes.iter().flatten().filter(|row| row.split == split.name()).collect();
        let known = |measure: fn(&SplitMeasures) -> Option<f64>| -> Option<Spread> {
            spread(&rows.iter().filter_map(|row| measure(row)).collect::<Vec<_>>())
        };
        Some(SceneMeasures {
            split: split.name(),
            psnr_fg: known(|row| row.psnr_fg),
            psnr_fg_aligned: known(|row| row.psnr_fg_aligned),
            psnr_full: known(|row| Some(row.psnr_full))?,
            psnr_full_aligned: known(|row| Some(row.psnr_full_aligned))?,
            psnr_moving: known(|row| row.psnr_moving),
            psnr_moving_aligned: known(|row| row.psnr_moving_aligned),
            ssim: known(|row| Some(row.ssim))?,
            lpips: known(|row| row.lpips),
            subject_iou: known(|row| row.subject_iou),
            scenes: rows.len(),
            images: rows.iter().map(|row| row.images).sum(),
        })
    };
    Split::ALL.into_iter().filter_map(measures).collect()
}

/// `None` if `numbers` is empty.
fn spread(numbers: &[f64]) -> Option<Spread> {
    let center = mean(numbers);
    let squares: Vec<f64> = numbers.iter().map(|x| (x - center).powi(2)).collect();
    (!numbers.is_empty()).then(|| Spread { mean: center, deviation: mean(&squares).sqrt() })
}

/// The rows as a table in Markdown.
pub fn scenes_table(rows: &[SceneMeasures]) -> String {
    let has_iou = rows.iter().any(|row| row.subject_iou.is_some());
    let [iou, rule] = if has_iou { [" subject IoU |", "---|"] } else { [""; 2] };
    let mut text = format!(
        "| split | scenes | images | subject, dB | aligned | whole, dB | aligned | moving, dB | aligned | SSIM | LPIPS |{iou}\n\
         |---|---|---|---|---|---|---|---|---|---|---|{rule}\n",
    );
    for row in rows {
        let cell =
            |spread: &Option<Spread>, digits| spread.map_or("–".into(), |spread| show(&spread, digits));
        let psnr = [
            row.psnr_fg,
            row.psnr_fg_aligned,
            Some(row.psnr_full),
            Some(row.psnr_full_aligned),
            row.psnr_moving,
            row.psnr_moving_aligned,
        ];
        let psnr = psnr.map(|spread| cell(&spread, 2)).join(" | ");
        let (ssim, lpips) = (show(&row.ssim, 4), cell(&row.lpips, 4));
        let iou = if has_iou { format!(" {} |", cell(&row.subject_iou, 4)) } else { String::new() };
        let SceneMeasures { split, scenes, images, .. } = row;
        writeln!(text, "| {split} | {scenes} | {images} | {psnr} | {ssim} | {lpips} |{iou}")
            .expect("text grows");
    }
    text
}

/// Without a deviation if the mean is infinite, as it is for exact pictures.
fn show(Spread { mean, deviation }: &Spread, digits: usize) -> String {
    match mean.is_finite() {
        true => format!("{mean:.digits$} ± {deviation:.digits$}"),
        false => format!("{mean:.digits$}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scene(split: &'static str, psnr_fg: Option<f64>, psnr_full: f64) -> SplitMeasures {
        SplitMeasures {
            split,
            psnr_fg,
            psnr_fg_deviation: psnr_fg.map(|_| 9.0),
            psnr_fg_aligned: psnr_fg,
            psnr_full,
            psnr_full_aligned: psnr_full,
            psnr_moving: psnr_fg.map(|psnr| psnr - 5.0),
            psnr_moving_aligned: None,
            ssim: 0.5,
            lpips: None,
            subject_iou: None,
            images: 10,
            without_subject: 0,
            exact: 0,
        }
    }

    #[test]
    fn every_scene_counts_as_much_as_any_other() {
        let one = vec![scene("train", Some(20.0), 30.0), scene("interp_b", None, 28.0)];
        let other = vec![SplitMeasures { images: 90, ..scene("train", Some(26.0), f64::INFINITY) }];
        let rows = over_scenes(&[one, other]);
        assert_eq!(rows[0].psnr_fg, Some(Spread { mean: 23.0, deviation: 3.0 }));
        assert_eq!((rows[0].scenes, rows[0].images, rows[0].lpips), (2, 100, None));
        assert_eq!((rows[1].split, rows[1].scenes, rows[1].psnr_fg), ("interp_b", 1, None));
        let table = scenes_table(&rows);
        let train = "| train | 2 | 100 | 23.00 ± 3.00 | 23.00 ± 3.00 | inf | inf | 18.00 ± 3.00 | – | 0.5000 ± 0.0000 | – |";
        assert!(table.contains(train), "{table}");
        let held = "| interp_b | 1 | 10 | – | – | 28.00 ± 0.00 | 28.00 ± 0.00 | – | – |";
        assert!(table.contains(held), "{table}");
        assert!(over_scenes(&[]).is_empty());
        let masked = SplitMeasures { subject_iou: Some(0.75), ..scene("train", None, 30.0) };
        let table = scenes_table(&over_scenes(&[vec![masked], vec![scene("train", None, 30.0)]]));
        assert!(table.ends_with(" | – | 0.7500 ± 0.0000 |\n"), "{table}");
    }
}
