//! [`Ablation`]: the measurements that the report shows.

use std::collections::BTreeMap;

use refine::capture::Split;
use serde::{Deserialize, Serialize, Serializer};

use crate::eval::SplitMeasures;
use crate::fit::log::LogEntry;

/// The ablation of a capture.
#[derive(Clone, Debug, Serialize)]
pub struct Ablation {
    /// Name of the capture.
    pub capture: String,
    /// Processor and system.
    pub machine: String,
    /// Numbers of cameras, frames and photographs of each split, in a sentence.
    pub photographs: String,
    /// Width and height in pixels of the photographs of the first camera, as fitted.
    pub size: [u32; 2],
    /// Steps of each fit.
    pub steps: u64,
    /// Gaussians that each fit is asked for.
    pub gaussians: usize,
    /// LPIPS network of the measures, if there is one.
    pub lpips: Option<String>,
    /// Fits, then other methods.
    pub methods: Vec<Method>,
    /// Packages of the fits; the packages of a fit follow each other.
    pub packages: Vec<PackageFigures>,
    /// What is not in the tables.
    pub left_out: Vec<LeftOut>,
    /// Held photographs and the methods' pictures of them.
    #[serde(skip)]
    pub views: Vec<PicturedView>,
}

/// A fit or another method, and how close its pictures are to the photographs.
#[derive(Clone, Debug, Serialize)]
pub struct Method {
    /// Its name.
    pub name: String,
    /// What it is.
    pub about: String,
    /// The fit; `None` for another method.
    pub fit: Option<FieldFigures>,
    /// Fragments per lit pixel; `None` for a folder of pictures.
    pub fragments_per_lit_pixel: Option<f64>,
    /// Means of each split that has pictures, by its name.
    #[serde(serialize_with = "by_split")]
    pub splits: Vec<SplitMeasures>,
    /// The table of the fit.
    #[serde(skip)]
    pub entries: Vec<LogEntry>,
}

/// Figures of a fit; the fields are keys of the JSON of `fit`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct FieldFigures {
    /// Number of Gaussians at the start.
    pub gaussians_at_start: usize,
    /// Number of Gaussians at the end.
    pub gaussians: usize,
    /// Seconds of fitting.
    pub seconds: f64,
    /// Mean time of a step in milliseconds.
    pub ms_per_step: f64,
    /// Back end and device.
    pub backend: String,
    /// Peak device memory in bytes; `None` on the CPU.
    pub peak_device_bytes: Option<u64>,
}

/// Figures of a package.
#[derive(Clone, Debug, Serialize)]
pub struct PackageFigures {
    /// Name of the fit.
    pub method: String,
    /// Most Gaussians that it may keep.
    pub budget: usize,
    /// Number of Gaussians that it keeps.
    pub gaussians: usize,
    /// Size of the file.
    pub bytes: usize,
    /// Bit rate in Mbit/s of streaming it in the duration of the clip.
    pub mbps: f64,
    /// Fraction of the persistent features of the field that it preserves: the paper's Topo.
    pub topology: f64,
    /// Means of each split of the decoded package, by its name.
    #[serde(serialize_with = "by_split")]
    pub splits: Vec<SplitMeasures>,
}

/// A row that the tables lack.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct LeftOut {
    /// Its name.
    pub name: String,
    /// Why it is not there.
    pub why: String,
}

/// A held photograph and the pictures of it.
#[derive(Clone, Debug)]
pub struct PicturedView {
    /// Name and split of the photograph.
    pub name: String,
    /// The photograph, then a picture of each method that has one.
    pub pictures: Vec<Picture>,
}

/// A picture, cropped to the subject of its photograph.
#[derive(Clone, Debug)]
pub struct Picture {
    /// Name of the method, or `photograph`.
    pub method: String,
    /// The PNG.
    pub png: Vec<u8>,
}

/// Splits in the order of the tables: held cameras in held frames first.
const SPLITS: [Split; 4] = [Split::InterpA, Split::InterpB, Split::Recon, Split::Train];

impl Ablation {
    /// The splits with pictures of any method.
    pub(super) fn splits(&self) -> Vec<Split> {
        let has =
            |split: &Split| self.methods.iter().any(|method| measures_in(&method.splits, *split).is_some());
        SPLITS.into_iter().filter(has).collect()
    }
}

/// The measures of a split.
pub(super) fn measures_in(splits: &[SplitMeasures], split: Split) -> Option<&SplitMeasures> {
    splits.iter().find(|measures| measures.split == split.name())
}

fn by_split<S: Serializer>(splits: &[SplitMeasures], serializer: S) -> Result<S::Ok, S::Error> {
    let by_name: BTreeMap<&str, &SplitMeasures> = splits.iter().map(|row| (row.split, row)).collect();
    by_name.serialize(serializer)
}
