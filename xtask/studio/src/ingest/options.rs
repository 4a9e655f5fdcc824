//! [`IngestOptions`]: what a rig and its user state, rather than the steps find.

use std::path::PathBuf;

use clap::ValueEnum;

/// Options of [`ingest`](super::ingest).
#[derive(Clone, Debug, Default)]
pub struct IngestOptions {
    /// The calibration; by default the calibration in the rig's folder that fits the videos.
    pub calibration: Option<PathBuf>,
    /// When the videos start.
    pub offsets: Offsets,
    /// Frames per second of the capture; by default the commonest of the videos.
    pub fps: Option<f64>,
    /// Which way is up; by default as the calibration says, or else the cameras.
    pub up: Option<UpSource>,
    /// The point of the calibration's world that becomes the origin.
    pub origin: Option<[f64; 3]>,
    /// Metres per unit of the calibration; by default as it says.
    pub metres_per_unit: Option<f64>,
    /// Height in metres of the subject, who stands upright at the start: it tells the metres per unit.
    pub height_m: Option<f64>,
    /// What to do where a video has another size than its calibration; by default it is refused.
    pub resize: Option<ResizePolicy>,
    /// Whether pictures are written instead of references to the videos.
    pub extract: Option<ExtractFormat>,
    /// A folder of pictures or videos without the subject, one for each camera; by default plates are the medians of
    /// the videos.
    pub plates: Option<PathBuf>,
    /// Whether mattes are made.
    pub mattes: MattePolicy,
}

/// Whether mattes are made. The variants' docs are help texts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum MattePolicy {
    /// By difference from plates
    #[default]
    On,
    /// Plates only
    Off,
}

/// What says when videos start.
#[derive(Clone, Debug, Default)]
pub enum Offsets {
    /// Timecodes or sound.
    #[default]
    Found,
    /// They start together.
    Together,
    /// A file of names and seconds.
    File(PathBuf),
}

/// What says which way is up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum UpSource {
    /// This direction of the calibration's world, of length 1.
    Stated([f64; 3]),
    /// The calibration's layout.
    Calibration,
    /// The mean of the cameras.
    Cameras,
}

/// How a camera follows a video of another size. The variants' docs are help texts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ResizePolicy {
    /// Pictures were scaled, each side by itself
    Scale,
    /// As much was cut off, or added, on both sides
    Crop,
}

/// Format of extracted pictures. The variants' docs are help texts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ExtractFormat {
    /// With small losses, at quality 95
    Jpeg,
    /// Without loss
    Png,
}

impl ExtractFormat {
    pub(super) fn extension(self) -> &'static str {
        match self {
            ExtractFormat::Jpeg => "jpg",
            ExtractFormat::Png => "png",
        }
    }
}
