//! [`ReadyClip`]: a clip that can be drawn for two eyes, and [`HeadsetTarget`], which makes it on the
//! loader's thread.
//!
//! That thread fills buffers and builds pipelines without a submission: copies go along with the next
//! frame.

use std::sync::{Arc, Weak};

use codec::ClipInfo;

use crate::audio::SoundTrack;
use crate::clips::{ClipTarget, Entry};
use crate::content::OpenTake;
use crate::gpu::{FrameLayout, Gpu, Renderer, RuntimeFormat};
use crate::player::{Beginning, TakePlayer};
use program::Fault;
use program::Subject;

/// The device and format that clips are made ready for.
#[derive(Clone)]
pub(super) struct HeadsetTarget {
    pub(super) gpu: Weak<Gpu>,
    pub(super) format: RuntimeFormat,
}

impl ClipTarget for HeadsetTarget {
    type Ready = Box<ReadyClip>;

    fn prepare(
        &self,
        _: &Entry,
        opened: Arc<OpenTake>,
        beginning: Beginning<'_>,
    ) -> Result<Box<ReadyClip>, Fault> {
        let gpu = self
            .gpu
            .upgrade()
            .ok_or_else(|| Fault::Device("the graphics device is gone: open the clip again".into()))?;
        // Before its loader waits for the server with what is left to read.
        let subject = opened.subject_unless(beginning.is_overtaken)?;
        let layout = FrameLayout { format: self.format.drawn(), eyes: 2, foveated: true };
        // A frame of the headset follows in any case: it needs nothing to wake it.
        let (renderer, take) = TakePlayer::begin(&gpu, opened.clone(), layout, beginning, || ())?;
        Ok(Box::new(ReadyClip {
            subject,
            layer_ends: opened.layer_ends(),
            renderer: Some(renderer),
            take: Some(take),
            gaussians: opened.gaussians(),
            sound: opened.sound.clone(),
            is_static: opened.is_static(),
            duration_s: opened.duration_s(),
            info: opened.info().clone(),
        }))
    }
}

/// A clip that can be drawn.
pub(super) struct ReadyClip {
    pub(super) subject: Subject,
    /// `None` once its device was lost.
    pub(super) renderer: Option<Renderer>,
    /// Its segments, as long as there is a renderer.
    pub(super) take: Option<TakePlayer>,
    /// Whether the image is the same at all times.
    pub(super) is_static: bool,
    pub(super) duration_s: f64,
    pub(super) info: ClipInfo,
    /// Number of Gaussians in the first k layers, for each k.
    pub(super) layer_ends: Vec<usize>,
    /// Number of Gaussians, plate included.
    pub(super) gaussians: usize,
    pub(super) sound: SoundTrack,
}

impl ReadyClip {
    /// Whether this clip is seen from the same viewpoints as `other`, so that it stands on its stage.
    pub(super) fn shares_stage(&self, other: &ReadyClip) -> bool {
        let stage = |info: &ClipInfo| (info.up, info.metres_per_unit, info.viewpoints.clone());
        !self.info.viewpoints.is_empty() && stage(&self.info) == stage(&other.info)
    }
}
