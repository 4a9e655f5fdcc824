//! [`PackedSegment`] and [`PackedLayers`]: a segment of a take, and further layers of it, ready for the GPU. Packing needs
//! no device, so loaders do it on their thread.

use codec::{Clip, Field, LayerEnd, Layers};
use glam::DVec3;
use program::Fault;
use shaders::{Features, Motion};

use super::layer_run::LayerRun;
use super::pack::{Packed, RecordFormat, features, motion_units, origin, pack};
use super::span::Span;
use super::stages::alive::LayerRows;

/// What a renderer is built for: buffers of fixed size, and pipelines with the features of all segments.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TakeLayout {
    /// Features of the shaders for the Gaussians of all segments, but their plates.
    pub features: Features,
    /// Depth before an eye from which on Gaussians are drawn whole; 0 if none fades.
    pub near: f32,
    /// Origin of the centres in GPU memory, in the world of the take.
    pub origin: DVec3,
    /// Corners `[min, max]` of the box around the centres of all segments while alive, in units of the take.
    pub bounds: [[f32; 3]; 2],
    /// Number of Gaussians that there is room for. A single segment has its own counts. Several segments share the sum of
    /// both counts, at most 2^26: for what is drawn, for what is uploaded ahead of use, and for gaps between segments.
    pub room: LayerEnd,
    /// Duration in the unit of the spans.
    pub duration_s: f64,
    /// The plate, if a segment has one.
    pub plate: Option<PlateLayout>,
}

/// The largest plate of a segment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlateLayout {
    /// Features of the shaders.
    pub features: Features,
    /// Number of Gaussians of all plates that are resident at once.
    pub rows: usize,
}

impl TakeLayout {
    /// For `clip` as the only segment, which lasts [`Span::WHOLE`]: it has no room for anything that the clip lacks.
    pub fn for_clip(clip: &Clip) -> TakeLayout {
        let fields = [&clip.static_field, &clip.dynamic_field];
        let room = clip.layers_announced.last().copied().unwrap_or_default();
        let plate = |plate: &Field| {
            let room = LayerEnd { static_count: plate.len(), dynamic_count: 0 };
            PlateLayout { features: features([plate, &Field::default()], room), rows: plate.len() }
        };
        TakeLayout {
            features: features(fields, room),
            near: clip.near(),
            origin: origin(&clip.static_field, &clip.dynamic_field),
            bounds: clip.bounds,
            room,
            duration_s: Span::WHOLE.duration_s,
            plate: clip.plate.as_ref().filter(|plate| !plate.is_empty()).map(plate),
        }
    }

    /// The same for several segments with these features in a take of `duration_s` seconds: any row may move.
    #[must_use]
    pub fn segmented(self, duration_s: f64) -> TakeLayout {
        let motion = self.features.motion.unwrap_or(Motion { order: 0, rotates: false });
        let plate = self
            .plate
            .map(|plate| PlateLayout { features: Features { segmented: true, ..plate.features }, ..plate });
        let features = Features { segmented: true, motion: Some(motion), ..self.features };
        TakeLayout { features, duration_s, plate, ..self }
    }

    /// The same with room for `rows` Gaussians.
    #[must_use]
    pub fn with_rows(self, rows: usize) -> TakeLayout {
        TakeLayout { room: LayerEnd { static_count: 0, dynamic_count: rows }, ..self }
    }

    /// The format of the records of all segments.
    pub(super) fn format(&self) -> RecordFormat {
        let motion_units = motion_units(self.bounds);
        RecordFormat { features: self.features, origin: self.origin, motion_units }
    }
}

/// A segment, or its first layers, packed for the GPU, with the columns that culling reads.
pub struct PackedSegment {
    pub(super) span: Span,
    pub(super) clip: PackedRun,
    pub(super) plate: Option<PackedRun>,
    /// Number of Gaussians for which it takes room: the Gaussians of all announced layers.
    pub(super) room: LayerEnd,
    /// Factors of the motion coefficients.
    pub(super) motion_units: [f32; 3],
}

/// Layers of a segment, packed as a [`PackedSegment`] is. The layers before them are in GPU memory.
pub struct PackedLayers {
    pub(super) run: PackedRun,
}

/// Gaussians of consecutive layers that are sorted together.
pub(super) struct PackedRun {
    pub(super) packed: Packed,
    pub(super) rows: LayerRows,
}

impl PackedSegment {
    /// Packs `clip`, which lasts `span` of a take of `layout`.
    ///
    /// # Errors
    /// [`Fault::Data`] if the clip has features that `layout` lacks.
    pub fn new(clip: &Clip, span: Span, layout: &TakeLayout) -> Result<PackedSegment, Fault> {
        let format = layout.format();
        let plate = match (&clip.plate, layout.plate) {
            (Some(plate), _) if plate.is_empty() => None,
            (None, _) => None,
            (Some(_), None) => return Err(unexpected(span, "a plate")),
            (Some(plate), Some(of_take)) => {
                let format = RecordFormat { features: of_take.features, ..format };
                Some(PackedRun::new(&LayerRun::of_static(plate, &Field::default()), span, &format)?)
            }
        };
        Ok(PackedSegment {
            span,
            clip: PackedRun::new(&LayerRun::of_clip(clip, 0), span, &format)?,
            plate,
            room: clip.layers_announced.last().copied().unwrap_or_default(),
            motion_units: format.motion_units,
        })
    }

    /// Number of Gaussians, without the plate's.
    pub fn gaussians(&self) -> usize {
        self.clip.rows.len()
    }

    /// Bytes that its upload writes.
    pub fn bytes(&self) -> usize {
        [Some(&self.clip), self.plate.as_ref()].into_iter().flatten().map(|run| run.packed.bytes()).sum()
    }
}

impl PackedLayers {
    /// Packs further layers of a segment that lasts `span` of a take of `layout`.
    ///
    /// # Errors
    /// As for [`PackedSegment::new`].
    pub fn new(layers: &Layers, span: Span, layout: &TakeLayout) -> Result<PackedLayers, Fault> {
        Ok(PackedLayers { run: PackedRun::new(&LayerRun::from(layers), span, &layout.format())? })
    }

    /// Number of Gaussians.
    pub fn gaussians(&self) -> usize {
        self.run.rows.len()
    }

    /// Bytes that its upload writes.
    pub fn bytes(&self) -> usize {
        self.run.packed.bytes()
    }
}

impl PackedRun {
    fn new(run: &LayerRun<'_>, span: Span, format: &RecordFormat) -> Result<PackedRun, Fault> {
        let of_take = format.features;
        let found = features(run.fields, run.count());
        if found.sh_degree > of_take.sh_degree {
            return Err(unexpected(span, "spherical harmonics of a higher degree"));
        }
        if found.mip != of_take.mip && run.len() > 0 {
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
        Ok(PackedRun { packed: pack(run, format), rows: LayerRows::new(run, format.origin) })
    }
}

fn unexpected(span: Span, what: &str) -> Fault {
    Fault::Data(format!(
        "the segment at {:.3} s has {what}, unlike the head of its take: package it again",
        span.start_s
    ))
}

#[cfg(test)]
mod tests {
    use codec::{ClipInfo, PixelFilter, Temporal};

    use super::*;

    const LAYOUT: TakeLayout = TakeLayout {
        features: Features {
            sh_degree: 1,
            motion: Some(Motion { order: 1, rotates: false }),
            mip: false,
            segmented: true,
        },
        near: 0.0,
        origin: DVec3::ZERO,
        bounds: [[-1.0; 3], [1.0; 3]],
        room: LayerEnd { static_count: 0, dynamic_count: 10 },
        duration_s: 4.0,
        plate: None,
    };

    const SPAN: Span = Span { start_s: 1.5, duration_s: 2.0 };

    /// One static Gaussian.
    fn field(sh_degree: u8) -> Field {
        Field {
            centers: vec![[0.0; 3]],
            rotations: vec![[1.0, 0.0, 0.0, 0.0]],
            log_scales: vec![[0.0; 3]],
            opacities: vec![0.5],
            sh_degree,
            sh: vec![[0.0; 3]; codec::sh_coefficients(sh_degree)],
            ..Field::default()
        }
    }

    fn dynamic(motion_order: u8, rotates: bool) -> Field {
        let temporal = Temporal {
            tau: vec![0.5],
            s: vec![0.1],
            motion_order,
            motion: vec![[1.0; 3]; motion_order.into()],
            rotation_rates: rotates.then(|| vec![[0.0, 1.0, 0.0, 0.0]]),
        };
        Field { temporal: Some(temporal), ..field(0) }
    }

    fn clip(static_field: Field, dynamic_field: Field) -> Clip {
        Clip::of_one_layer(ClipInfo::default(), [[0.0; 3]; 2], static_field, dynamic_field, None)
    }

    #[test]
    fn a_segment_with_less_than_its_take_is_widened() {
        for (clip, motion_words) in
            [(clip(field(0), Field::default()), 0), (clip(field(1), dynamic(0, false)), 3)]
        {
            let packed = PackedSegment::new(&clip, SPAN, &LAYOUT).unwrap();
            let columns = &packed.clip.packed;
            assert_eq!((columns.motion.len(), columns.sh.len()), (motion_words, 4 * clip.len()));
            assert_eq!(packed.bytes(), 32 * clip.len() + 4 * (motion_words + 4 * clip.len()));
            assert_eq!(packed.gaussians(), clip.len());
        }
    }

    #[test]
    fn a_segment_with_more_than_its_take_is_refused() {
        let mip = Field { filter: PixelFilter::Mip, ..field(0) };
        let none = Field::default;
        let with_plate = Clip { plate: Some(field(0)), ..clip(field(0), none()) };
        for (clip, what) in [
            (clip(field(2), none()), "spherical harmonics of a higher degree"),
            (clip(none(), dynamic(2, false)), "motion of a higher order"),
            (clip(none(), dynamic(1, true)), "Gaussians that rotate"),
            (clip(mip, none()), "another filter"),
            (with_plate, "a plate"),
        ] {
            let Err(fault) = PackedSegment::new(&clip, SPAN, &LAYOUT) else { panic!("{what}") };
            let expected =
                format!("the segment at 1.500 s has {what}, unlike the head of its take: package it again");
            assert_eq!((fault.to_string(), fault.exit_code()), (expected, 3));
        }
    }
}
