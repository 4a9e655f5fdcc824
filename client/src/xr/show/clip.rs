//! [`ReadyClip`]: a clip that can be drawn for two eyes, and [`HeadsetTarget`], which makes it on the
//! loader's thread.
//!
//! That thread fills buffers and builds pipelines without a submission: copies go along with the next
//! frame.

use std::sync::Weak;

use codec::ClipInfo;

use crate::audio::SoundTrack;
use crate::clips::{Beginning, ClipTarget, Content, Entry};
use crate::gpu::{FrameLayout, Gpu, Renderer, RuntimeFormat, UploadedClip};
use crate::takes::TakePlayer;
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
    type Uploaded = UploadedClip;

    fn prepare(
        &self,
        _: &Entry,
        content: Content,
        beginning: Beginning<'_>,
        uploaded: &mut Option<UploadedClip>,
    ) -> Result<Box<ReadyClip>, Fault> {
        let gpu = self
            .gpu
            .upgrade()
            .ok_or_else(|| Fault::Device("the graphics device is gone: open the clip again".into()))?;
        let layout = FrameLayout { format: self.format.drawn(), eyes: 2, foveated: true };
        let (renderer, take, layer_ends) = match &content {
            Content::Clip(version) => {
                let on_gpu = UploadedClip::following(&gpu, uploaded, &version.clip)?;
                let layer_ends = on_gpu.layer_ends();
                (Renderer::new(&gpu, on_gpu, layout)?, None, layer_ends)
            }
            Content::Take(opened) => {
                // A frame of the headset follows in any case: it needs nothing to wake it.
                let (renderer, take) = TakePlayer::begin(&gpu, opened.clone(), layout, beginning, || ())?;
                (renderer, Some(take), opened.layer_ends())
            }
        };
        Ok(Box::new(ReadyClip {
            subject: content.subject(),
            layer_ends,
            renderer: Some(renderer),
            take,
            gaussians: content.gaussians(),
            sound: content.sound(),
            is_static: content.is_static(),
            duration_s: content.duration_s(),
            info: content.info().clone(),
        }))
    }
}

/// A clip that can be drawn.
pub(super) struct ReadyClip {
    pub(super) subject: Subject,
    /// `None` once its device was lost.
    pub(super) renderer: Option<Renderer>,
    /// The segments of a take, as long as there is a renderer.
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
