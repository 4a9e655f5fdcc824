//! Parts of the JSON that clips and takes share.

use codec::{SOUND_RATE_HZ, Sound, Viewpoint};
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
