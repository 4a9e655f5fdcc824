//! [`Content`]: what a name can stand for, a clip or a take, and what displays ask of either.

use std::sync::Arc;

use codec::ClipInfo;
use program::Subject;

use super::event::ClipVersion;
#[cfg(any(feature = "window", feature = "xr"))]
use crate::audio::SoundTrack;
use crate::takes::OpenTake;

/// A clip or a take.
#[derive(Clone, Debug)]
pub enum Content {
    /// All of it is in memory, with its sound.
    Clip(ClipVersion),
    /// Its head is in memory.
    Take(Arc<OpenTake>),
}

impl Content {
    /// The sound. The sound of a take grows as its segments are loaded.
    #[cfg(any(feature = "window", feature = "xr"))]
    pub(crate) fn sound(&self) -> SoundTrack {
        match self {
            Content::Clip(version) => version.sound.clone(),
            Content::Take(opened) => opened.sound.clone(),
        }
    }

    /// Axes, frames per second, viewpoints. There is at least one viewpoint.
    pub(crate) fn info(&self) -> &ClipInfo {
        match self {
            Content::Clip(version) => &version.clip.info,
            Content::Take(opened) => &opened.take.info,
        }
    }

    /// Duration in seconds.
    pub(crate) fn duration_s(&self) -> f64 {
        match self {
            Content::Clip(version) => version.clip.info.duration_s.into(),
            Content::Take(opened) => opened.take.duration_s,
        }
    }

    /// Number of layers; of a take, the most of a segment.
    pub(crate) fn layers(&self) -> usize {
        match self {
            Content::Clip(version) => version.clip.layers.len(),
            Content::Take(opened) => opened.layer_ends().len(),
        }
    }

    /// Number of layers that the package announces; a clip that is cut short has fewer.
    pub(crate) fn layers_announced(&self) -> usize {
        match self {
            Content::Clip(version) => version.clip.layers_announced.len(),
            Content::Take(_) => self.layers(),
        }
    }

    /// Number of Gaussians, plates included.
    pub(crate) fn gaussians(&self) -> usize {
        match self {
            Content::Clip(ClipVersion { clip, .. }) => {
                clip.len() + clip.plate.as_ref().map_or(0, |plate| plate.len())
            }
            Content::Take(opened) => opened.layer_ends().last().copied().unwrap_or(0),
        }
    }

    /// Whether there is nothing to play: the image is the same at all times, and silent.
    pub(crate) fn is_static(&self) -> bool {
        match self {
            // One with sound plays, although nothing moves.
            Content::Clip(ClipVersion { clip, sound, .. }) => {
                clip.dynamic_field.is_empty() && sound.is_empty()
            }
            Content::Take(_) => false,
        }
    }

    /// The upright frame of it, at the start of a take. Found by the first call, which belongs on a thread that loads.
    pub(crate) fn subject(&self) -> Subject {
        match self {
            Content::Clip(version) => version.subject(),
            Content::Take(opened) => opened.subject(),
        }
    }
}
