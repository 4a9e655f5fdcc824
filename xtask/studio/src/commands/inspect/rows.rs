//! Parts of the JSON.

use codec::{
    AttributeSize, Clip, Field, Poster, Region, SOUND_RATE_HZ, Section, SectionKind, SegmentLayer, Sound,
    Viewpoint,
};
use serde::Serialize;

use crate::messages::decimal;
use crate::segments::TakeFile;

#[derive(Serialize)]
pub(super) struct ViewpointRow {
    pub(super) name: String,
    pub(super) position: [f32; 3],
    pub(super) target: [f32; 3],
    pub(super) fov_y_deg: f32,
}

#[derive(Serialize)]
pub(super) struct Plate {
    pub(super) gaussians: usize,
    pub(super) sh_degree: u8,
    pub(super) filter: &'static str,
}

/// The sound of all segments.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(super) struct Audio {
    codec: &'static str,
    channels: u8,
    rate_hz: u32,
    /// Seconds that are heard within the take.
    pub(super) duration_s: f64,
    /// Seconds of all packets: segments of a take that was trimmed reach beyond it.
    #[serde(skip)]
    packets_s: f64,
    /// Bytes of packets.
    pub(super) bytes: usize,
    /// Point of the scene from which it comes.
    position: Option<[f32; 3]>,
}

impl Audio {
    /// Adds the sound of a segment that starts at `start_s` in a take of `take_s` seconds to the sound of the segments
    /// before it.
    pub(super) fn add(all: &mut Option<Audio>, sound: &Sound, start_s: f64, take_s: f64) {
        let mut other = Audio::from(sound);
        let from_s = start_s + f64::from(sound.info().start) / f64::from(SOUND_RATE_HZ);
        other.duration_s = ((from_s + other.packets_s).min(take_s) - from_s.max(0.0)).max(0.0);
        let Some(audio) = all else {
            *all = Some(other);
            return;
        };
        audio.duration_s += other.duration_s;
        audio.packets_s += other.packets_s;
        audio.bytes += other.bytes;
        audio.channels = audio.channels.max(other.channels);
        // One that stands elsewhere later has no one position.
        audio.position = audio.position.filter(|position| other.position == Some(*position));
    }

    /// The line of the terminal.
    pub(super) fn describe(&self) -> String {
        let from = match self.position {
            Some(position) => format!("mono from {position:?}"),
            None if self.channels == 1 => "mono".into(),
            None => "stereo".into(),
        };
        let kbps = self.bytes as f64 * 8e-3 / self.packets_s;
        let (duration_s, bytes) = (decimal(self.duration_s, 3), self.bytes);
        format!("{duration_s} s of Opus, {from}, {bytes} bytes, {kbps:.0} kbps")
    }
}

impl From<&Sound> for Audio {
    fn from(sound: &Sound) -> Audio {
        let info = sound.info();
        let duration_s = f64::from(info.length) / f64::from(SOUND_RATE_HZ);
        Audio {
            codec: "opus",
            channels: info.channels,
            rate_hz: SOUND_RATE_HZ,
            duration_s,
            packets_s: duration_s,
            bytes: sound.packet_bytes(),
            position: info.position,
        }
    }
}

/// The time and view that stand for a package.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(super) struct PosterRow {
    time_s: f64,
    position: [f32; 3],
    target: [f32; 3],
    fov_y_deg: f32,
}

impl PosterRow {
    /// The line of the terminal.
    pub(super) fn describe(&self) -> String {
        let PosterRow { time_s, position, target, fov_y_deg } = self;
        let time_s = decimal(*time_s, 3);
        format!("at {time_s} s, from {position:?}, looks at {target:?}, {fov_y_deg:.1} degrees high")
    }
}

impl From<Poster> for PosterRow {
    fn from(poster: Poster) -> PosterRow {
        let Poster { time_s, position, target, fov_y } = poster;
        PosterRow { time_s, position, target, fov_y_deg: fov_y.to_degrees() }
    }
}

/// A part of a segment that is damaged.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(super) struct Damage {
    pub(super) segment: usize,
    /// `gaussians`, without which the segment does not play; `sound` or `poster`, without which it does.
    pub(super) section: &'static str,
    pub(super) problem: String,
}

impl Damage {
    /// The line of the terminal for a section that has `value`, or none, or is damaged.
    pub(super) fn line(damages: &[Damage], section: &str, value: Option<String>) -> String {
        let damage = damages.iter().find(|damage| damage.section == section);
        value.or(damage.map(|damage| damage.problem.clone())).unwrap_or("none".into())
    }
}

/// Gaussians and bytes of a layer and the layers before it, of all segments.
#[derive(Serialize)]
pub(super) struct Layer {
    /// Without the plates.
    pub(super) gaussians: usize,
    /// Bytes of the file up to its end.
    pub(super) bytes: usize,
    /// Whether the file holds the whole layer of every segment.
    pub(super) complete: bool,
}

impl Layer {
    /// The layers that the table announces, with the plates.
    pub(super) fn list(file: &TakeFile) -> Vec<Layer> {
        let is_there = |k: usize, index: usize| {
            let layers = &file.take().segments[index].layers;
            layers.get(k).or(layers.last()).is_some_and(|layer| layer.bytes <= file.available(index))
        };
        let layers = file.layers().into_iter().enumerate();
        layers
            .map(|(k, SegmentLayer { bytes, gaussians })| Layer {
                gaussians,
                bytes,
                complete: (0..file.take().segments.len()).all(|index| is_there(k, index)),
            })
            .collect()
    }
}

#[derive(Serialize)]
pub(super) struct SegmentRow {
    pub(super) start_s: f64,
    pub(super) duration_s: f64,
    pub(super) level: u8,
    /// Gaussians and bytes that the table announces, the plate included.
    pub(super) gaussians: usize,
    pub(super) bytes: usize,
    pub(super) layers: Vec<SegmentLayerRow>,
    /// Whether all of it is in the file and decodes.
    pub(super) complete: bool,
    /// What is missing or damaged.
    pub(super) problem: Option<String>,
}

/// Cost of a layer of a segment and the layers before it.
#[derive(Serialize)]
pub(super) struct SegmentLayerRow {
    gaussians: usize,
    bytes: usize,
}

impl SegmentRow {
    /// A segment, of which nothing is known to be damaged.
    pub(super) fn new(file: &TakeFile, index: usize) -> SegmentRow {
        let segment = &file.take().segments[index];
        let (bytes, missing) = (segment.bytes(), segment.bytes() - file.available(index));
        let row = |&SegmentLayer { bytes, gaussians }: &SegmentLayer| SegmentLayerRow { gaussians, bytes };
        SegmentRow {
            start_s: segment.start_s,
            duration_s: segment.duration_s,
            level: segment.level,
            gaussians: segment.gaussians(),
            bytes,
            layers: segment.layers.iter().map(row).collect(),
            complete: missing == 0,
            problem: (missing > 0).then(|| format!("{missing} of {bytes} bytes are missing")),
        }
    }
}

/// Coded size of an attribute of all Gaussians, and the sizes that simpler coders would reach for the same numbers.
#[derive(Serialize)]
pub(super) struct Attribute {
    pub(super) attribute: &'static str,
    /// Order-0 entropy: each number coded by its frequency alone. Preserves any order of the Gaussians.
    pub(super) order_0_bytes: usize,
    /// Order-0 entropy of the prediction residuals. The coder chooses the order of the Gaussians.
    pub(super) predicted_bytes: usize,
    /// Size as coded.
    pub(super) coded_bytes: usize,
}

impl Attribute {
    /// Adds the sizes of a segment to those of its attribute.
    pub(super) fn add(sums: &mut Vec<Attribute>, size: &AttributeSize) {
        let AttributeSize { attribute, .. } = *size;
        let place = sums.iter().position(|sum| sum.attribute == attribute).unwrap_or_else(|| {
            sums.push(Attribute { attribute, order_0_bytes: 0, predicted_bytes: 0, coded_bytes: 0 });
            sums.len() - 1
        });
        let sum = &mut sums[place];
        sum.order_0_bytes += size.order_0.round() as usize;
        sum.predicted_bytes += size.predicted.round() as usize;
        sum.coded_bytes += size.coded.round() as usize;
    }
}

/// Gaussians at an instant.
#[derive(Serialize)]
pub(super) struct Alive {
    pub(super) time_s: f64,
    /// Gaussians that the time indices of the segments there list, and all motionless ones.
    pub(super) candidates: usize,
    /// Candidates with an opacity of at least 1/255.
    pub(super) alive: usize,
}

impl Alive {
    /// Adds a segment that is at its clip time `t`.
    pub(super) fn add(&mut self, clip: &Clip, t: f64) {
        let is_alive = |field: &Field, i: usize| field.opacity_at(i, t) >= codec::ALPHA_MIN;
        self.candidates += clip.static_field.len();
        self.alive += (0..clip.static_field.len()).filter(|&i| is_alive(&clip.static_field, i)).count();
        for range in clip.time_index.candidates(t, clip.layers.len()) {
            self.candidates += range.len();
            self.alive += range.filter(|&i| is_alive(&clip.dynamic_field, i)).count();
        }
    }
}

/// The sections of a kind and region in all segments.
#[derive(Serialize)]
pub(super) struct SectionSum {
    kind: String,
    region: &'static str,
    pub(super) number: usize,
    pub(super) bytes: usize,
    pub(super) raw_bytes: usize,
}

impl SectionSum {
    /// Adds a section to the sum of its kind and region.
    pub(super) fn add(sums: &mut Vec<SectionSum>, section: &Section) {
        let kind = match section.kind {
            SectionKind::Gaussians => "gaussians".into(),
            SectionKind::TimeIndex => "time index".into(),
            SectionKind::Poster => "poster".into(),
            SectionKind::Sound => "sound".into(),
            SectionKind::Unknown(kind) => format!("unknown {kind}"),
        };
        let region = match section.region {
            Region::Static => "still",
            Region::Dynamic => "moving",
            Region::Plate => "plate",
        };
        let place =
            sums.iter().position(|sum| sum.kind == kind && sum.region == region).unwrap_or_else(|| {
                sums.push(SectionSum { kind, region, number: 0, bytes: 0, raw_bytes: 0 });
                sums.len() - 1
            });
        let sum = &mut sums[place];
        sum.number += 1;
        sum.bytes += section.length;
        sum.raw_bytes += section.raw_length;
    }

    /// The name of the line of the terminal.
    pub(super) fn name(&self) -> String {
        match self.kind.as_str() {
            kind @ ("sound" | "poster") => kind.into(),
            kind => format!("{} {kind}", self.region),
        }
    }
}

impl From<&Viewpoint> for ViewpointRow {
    fn from(viewpoint: &Viewpoint) -> ViewpointRow {
        ViewpointRow {
            name: viewpoint.name.clone(),
            position: viewpoint.position,
            target: viewpoint.target,
            fov_y_deg: viewpoint.fov_y.to_degrees(),
        }
    }
}
