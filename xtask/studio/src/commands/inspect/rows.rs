//! Parts of the JSON that clips and takes share.

use codec::{Poster, SOUND_RATE_HZ, Sound, Viewpoint};
use serde::Serialize;

use crate::messages::decimal;

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

/// The sound of a clip, or of all segments of a take.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(super) struct Audio {
    codec: &'static str,
    channels: u8,
    rate_hz: u32,
    /// Seconds that are heard.
    pub(super) duration_s: f64,
    /// Bytes of packets.
    pub(super) bytes: usize,
    /// Point of the scene from which it comes.
    position: Option<[f32; 3]>,
}

impl Audio {
    /// Adds the sound of a further segment.
    pub(super) fn add(&mut self, other: &Audio) {
        self.duration_s += other.duration_s;
        self.bytes += other.bytes;
        self.channels = self.channels.max(other.channels);
        // One that stands elsewhere later has no one position.
        self.position = self.position.filter(|position| other.position == Some(*position));
    }

    /// The line of the terminal.
    pub(super) fn describe(&self) -> String {
        let from = match self.position {
            Some(position) => format!("mono from {position:?}"),
            None if self.channels == 1 => "mono".into(),
            None => "stereo".into(),
        };
        let kbps = self.bytes as f64 * 8e-3 / self.duration_s;
        let (duration_s, bytes) = (decimal(self.duration_s, 3), self.bytes);
        format!("{duration_s} s of Opus, {from}, {bytes} bytes, {kbps:.0} kbps")
    }
}

impl From<&Sound> for Audio {
    fn from(sound: &Sound) -> Audio {
        let info = sound.info();
        Audio {
            codec: "opus",
            channels: info.channels,
            rate_hz: SOUND_RATE_HZ,
            duration_s: f64::from(info.length) / f64::from(SOUND_RATE_HZ),
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

/// A section without which a package plays, and which is damaged.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(super) struct Damage {
    section: &'static str,
    problem: String,
}

impl Damage {
    /// What `read` found, or nothing and its error, which is added to `damages` under the name of the section.
    pub(super) fn note<T>(
        damages: &mut Vec<Damage>,
        section: &'static str,
        read: Result<Option<T>, String>,
    ) -> Option<T> {
        read.unwrap_or_else(|problem| {
            damages.push(Damage { section, problem });
            None
        })
    }

    /// The line of the terminal for a section that has `value`, or none, or is damaged.
    pub(super) fn line(damages: &[Damage], section: &str, value: Option<String>) -> String {
        let damage = damages.iter().find(|damage| damage.section == section);
        match (value, damage) {
            (Some(value), _) => value,
            (None, Some(damage)) => damage.problem.clone(),
            (None, None) => "none".into(),
        }
    }

    /// The sentence about all damage; `None` if there is none.
    pub(super) fn sentence(damages: &[Damage]) -> Option<String> {
        let each = damages.iter().map(|damage| &damage.problem[..]).collect::<Vec<_>>().join("; ");
        (!damages.is_empty()).then(|| format!("{each}; the rest plays; get the file again"))
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
