//! [`PackedSegment`]: a segment of a take, ready for the GPU. Packing needs no device, so loaders do it on their thread.

use codec::{Clip, Field, LayerEnd, PixelFilter, TimeIndex};
use glam::DVec3;
use program::Fault;
use shaders::{Features, Motion};

use super::pack::{Packed, features, pack};
use super::span::Span;
use super::stages::alive::Rows;

/// What a renderer is built for to draw a take: buffers of fixed size, and pipelines with the features of all segments.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TakeLayout {
    /// Largest degree of the spherical harmonics of a segment.
    pub sh_degree: u8,
    /// Highest power of time of a segment.
    pub motion_order: u8,
    /// Whether Gaussians of a segment rotate.
    pub rotates: bool,
    /// The filter of all segments.
    pub filter: PixelFilter,
    /// Origin of the centres in GPU memory, in the world of the take: the middle of its bounds.
    pub origin: DVec3,
    /// Number of Gaussians that are resident at once, at most 2^26; drawn ones, those that are uploaded ahead of use,
    /// and what is lost to gaps between segments.
    pub rows: usize,
    /// Duration in seconds.
    pub duration_s: f64,
    /// The plate, if a segment has one.
    pub plate: Option<PlateLayout>,
}

/// The largest plate of a segment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlateLayout {
    /// Degree of the spherical harmonics.
    pub sh_degree: u8,
    /// The filter.
    pub filter: PixelFilter,
    /// Number of Gaussians of all plates that are resident at once.
    pub rows: usize,
}

impl TakeLayout {
    /// Features of the shaders for the segments.
    pub(super) fn features(&self) -> Features {
        Features {
            sh_degree: self.sh_degree,
            motion: Some(Motion { order: self.motion_order, rotates: self.rotates }),
            mip: self.filter == PixelFilter::Mip,
            segmented: true,
        }
    }
}

impl PlateLayout {
    /// Features of the shaders for the plates.
    pub(super) fn features(&self) -> Features {
        let mip = self.filter == PixelFilter::Mip;
        Features { sh_degree: self.sh_degree, motion: None, mip, segmented: true }
    }
}

/// A segment, packed for the GPU, with the columns that culling reads.
pub struct PackedSegment {
    pub(super) span: Span,
    pub(super) clip: PackedPart,
    pub(super) plate: Option<PackedPart>,
}

/// The Gaussians of a segment that are sorted together.
pub(super) struct PackedPart {
    pub(super) packed: Packed,
    pub(super) rows: Rows,
}

impl PackedSegment {
    /// Packs `clip`, which lasts `span` of a take of `layout`.
    ///
    /// # Errors
    /// [`Fault::Data`] if the clip has features that `layout` lacks.
    pub fn new(clip: &Clip, span: Span, layout: &TakeLayout) -> Result<PackedSegment, Fault> {
        let fields = [&clip.static_field, &clip.dynamic_field];
        let index = (clip.layers.clone(), clip.time_index.clone());
        let plate = match (&clip.plate, layout.plate) {
            (Some(plate), _) if plate.is_empty() => None,
            (None, _) => None,
            (Some(_), None) => return Err(unexpected(span, "a plate")),
            (Some(plate), Some(of_take)) => {
                let all = LayerEnd { static_count: plate.len(), dynamic_count: 0 };
                let index = (vec![all], TimeIndex::default());
                let fields = [plate, &Field::default()];
                Some(PackedPart::new(fields, index, span, layout.origin, of_take.features())?)
            }
        };
        Ok(PackedSegment {
            span,
            clip: PackedPart::new(fields, index, span, layout.origin, layout.features())?,
            plate,
        })
    }

    /// Number of Gaussians, without those of the plate.
    pub fn gaussians(&self) -> usize {
        self.clip.rows.len()
    }

    /// Bytes that its upload writes.
    pub fn bytes(&self) -> usize {
        [Some(&self.clip), self.plate.as_ref()].into_iter().flatten().map(|part| part.packed.bytes()).sum()
    }
}

impl PackedPart {
    fn new(
        fields: [&Field; 2],
        (layers, time_index): (Vec<LayerEnd>, TimeIndex),
        span: Span,
        origin: DVec3,
        of_take: Features,
    ) -> Result<PackedPart, Fault> {
        let found = features(fields);
        let is_empty = fields.iter().all(|field| field.is_empty());
        if found.sh_degree > of_take.sh_degree {
            return Err(unexpected(span, "spherical harmonics of a higher degree"));
        }
        if found.mip != of_take.mip && !is_empty {
            return Err(unexpected(span, "another filter"));
        }
        let (order, rotates) =
            (found.motion.map(|motion| motion.order), found.motion.map(|motion| motion.rotates));
        if order > of_take.motion.map(|motion| motion.order) {
            return Err(unexpected(span, "motion of a higher order"));
        }
        if rotates > of_take.motion.map(|motion| motion.rotates) {
            return Err(unexpected(span, "Gaussians that rotate"));
        }
        Ok(PackedPart {
            packed: pack(fields, origin, of_take),
            rows: Rows::new(fields, origin, layers, time_index),
        })
    }
}

fn unexpected(span: Span, what: &str) -> Fault {
    Fault::Data(format!(
        "the segment at {:.3} s has {what}, unlike the head of its take: package it again",
        span.start_s
    ))
}
