//! [`ReadyClip`]: a clip that can be drawn for two eyes, and [`HeadsetTarget`], which makes it on the
//! loader's thread.
//!
//! That thread fills buffers and builds pipelines without a submission: copies go along with the next
//! frame.

use std::sync::{Arc, Weak};

use codec::{Clip, ClipInfo};

use crate::clips::{ClipTarget, Entry};
use crate::gpu::{FrameLayout, Gpu, GpuClip, Renderer, RuntimeFormat};
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

    fn prepare(&self, _: &Entry, clip: Box<Clip>) -> Result<Box<ReadyClip>, Fault> {
        let gpu = self
            .gpu
            .upgrade()
            .ok_or_else(|| Fault::Device("the graphics device is gone: open the clip again".into()))?;
        let on_gpu = Arc::new(GpuClip::upload(&gpu, &clip)?);
        let layout = FrameLayout { format: self.format.drawn(), eyes: 2, foveated: true };
        Ok(Box::new(ReadyClip {
            subject: Subject::of(&clip),
            layer_ends: on_gpu.layer_ends(),
            renderer: Some(Renderer::new(&gpu, on_gpu, layout)?),
            gaussians: clip.len() + clip.plate.as_ref().map_or(0, |plate| plate.len()),
            is_static: clip.dynamic_field.is_empty(),
            info: clip.info,
        }))
    }
}

/// A clip that can be drawn.
pub(super) struct ReadyClip {
    pub(super) subject: Subject,
    /// `None` once its device was lost.
    pub(super) renderer: Option<Renderer>,
    /// Whether the image is the same at all times.
    pub(super) is_static: bool,
    pub(super) info: ClipInfo,
    /// Number of Gaussians in the first k layers, for each k.
    pub(super) layer_ends: Vec<usize>,
    /// Number of Gaussians, plate included.
    pub(super) gaussians: usize,
}

impl ReadyClip {
    /// Whether this clip is seen from the same viewpoints as `other`, so that it stands on its stage.
    pub(super) fn shares_stage(&self, other: &ReadyClip) -> bool {
        let stage = |info: &ClipInfo| (info.up, info.metres_per_unit, info.viewpoints.clone());
        !self.info.viewpoints.is_empty() && stage(&self.info) == stage(&other.info)
    }
}
