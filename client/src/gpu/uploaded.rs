//! [`UploadedClip`]: a clip as the only segment of a take in GPU memory, uploaded at once or layer by layer.

use std::sync::Arc;

use codec::Clip;
use program::Fault;

use super::clip::GpuClip;
use super::device::Gpu;
use super::segment::{PackedLayers, PackedSegment, TakeLayout};
use super::slots::{SlotId, Slots};
use super::span::Span;

impl GpuClip {
    /// Packs and uploads the layers of `clip`, into buffers with room for all that are announced.
    ///
    /// # Errors
    /// [`Fault::Device`] if the clip does not fit the device with all its layers.
    pub fn upload(gpu: &Gpu, clip: &Clip) -> Result<Arc<GpuClip>, Fault> {
        UploadedClip::new(gpu, clip).map(|uploaded| uploaded.clip().clone())
    }
}

/// A clip in GPU memory whose layers arrive one after the other.
pub struct UploadedClip {
    slots: Slots,
    segment: SlotId,
    layout: TakeLayout,
    /// Bytes that the latest layers took.
    bytes: usize,
}

impl UploadedClip {
    /// Packs and uploads the layers of `clip`, into buffers with room for all that are announced.
    ///
    /// # Errors
    /// [`Fault::Device`] if the clip does not fit the device with all its layers.
    pub fn new(gpu: &Gpu, clip: &Clip) -> Result<UploadedClip, Fault> {
        let layout = TakeLayout::for_clip(clip);
        let mut slots = Slots::new(gpu, &layout)?;
        let packed = PackedSegment::new(clip, Span::WHOLE, &layout)?;
        let segment = slots.insert(packed).expect("it has its room");
        let mut uploaded = UploadedClip { slots, segment, layout, bytes: 0 };
        uploaded.write(gpu)?;
        Ok(uploaded)
    }

    /// Packs and uploads the layers of `clip` that it lacks, see [`Clip::append`](codec::Clip::append). What was drawn
    /// before shares its memory, and stays as it is.
    ///
    /// # Errors
    /// [`Fault::Device`] if there is not enough memory.
    ///
    /// # Panics
    /// If `clip` has fewer layers, or other ones.
    pub fn extend(&mut self, gpu: &Gpu, clip: &Clip) -> Result<(), Fault> {
        let there = self.slots.clip().ends();
        assert!(clip.layers.starts_with(&there), "it is the same clip, with further layers");
        self.slots.append(self.segment, PackedLayers::since(clip, there.len(), &self.layout)?);
        self.write(gpu)
    }

    fn write(&mut self, gpu: &Gpu) -> Result<(), Fault> {
        self.bytes = gpu.allocate("the clip", || self.slots.upload(gpu, usize::MAX))?;
        Ok(())
    }

    /// The clip as it is now.
    pub fn clip(&self) -> &Arc<GpuClip> {
        self.slots.clip()
    }

    /// Bytes that uploading the latest layers wrote.
    pub fn bytes(&self) -> usize {
        self.bytes
    }

    /// Uploads a version of a clip: only the layers that the version `before` lacks, if it continues one. It becomes the
    /// version before the next.
    ///
    /// # Errors
    /// As for [`UploadedClip::new`].
    #[cfg(any(feature = "window", feature = "xr"))]
    pub(crate) fn following(
        gpu: &Gpu,
        before: &mut Option<UploadedClip>,
        clip: &Clip,
    ) -> Result<Arc<GpuClip>, Fault> {
        let uploaded = match before.take() {
            Some(mut before) => {
                before.extend(gpu, clip)?;
                before
            }
            None => UploadedClip::new(gpu, clip)?,
        };
        Ok(before.insert(uploaded).clip().clone())
    }
}
