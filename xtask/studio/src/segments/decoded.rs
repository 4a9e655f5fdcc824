//! [`DecodedTake`]: segments of a take in memory, for pictures and exports.

use std::path::Path;

use codec::{Clip, ClipInfo, Field, Limits, SegmentLayer, Temporal, Viewpoint, retime, sh_coefficients};
use program::{Fault, counted};
use refine::reference::RenderScene;

use super::file::TakeFile;
use super::folder::FieldFolder;
use super::span::Span;
use crate::fields::FitRecord;
use crate::scene::Scene;

/// Segments of a take, decoded.
#[derive(Debug)]
pub struct DecodedTake {
    /// Metadata of the take.
    pub info: ClipInfo,
    /// Duration in seconds; the duration of `info` is this duration, rounded.
    pub duration_s: f64,
    /// The viewpoints of `info`, or the opening at the start if there are none. Never empty.
    pub viewpoints: Vec<Viewpoint>,
    /// Number of Gaussians of all segments, backgrounds included, as far as it is known: files of a field folder do not
    /// say it before they are read.
    pub gaussians: Option<usize>,
    /// Gaussians without the plates, and bytes of the package, of the first layers of all segments: one entry for each
    /// number of decoded layers. Empty for a field folder.
    pub layers: Vec<SegmentLayer>,
    segments: Vec<DecodedSegment>,
}

/// A segment in memory.
#[derive(Debug)]
struct DecodedSegment {
    span: Span,
    content: SegmentContent,
}

/// A segment's Gaussians.
#[derive(Debug)]
pub(super) enum SegmentContent {
    Clip(Box<Clip>),
    Scene(Box<Scene>),
}

impl SegmentContent {
    /// The first `layers` layers of a clip; all of a scene, which has none.
    pub(super) fn layers_to_reference(&self, layers: usize) -> RenderScene<'_> {
        match self {
            SegmentContent::Clip(clip) => RenderScene::from_layers(clip, layers.min(clip.layers.len())),
            SegmentContent::Scene(scene) => {
                let subject = RenderScene::from(&scene.subject.field);
                scene.plate.as_ref().map_or(subject.clone(), |plate| subject.with_plate(&plate.field))
            }
        }
    }

    fn plate(&self) -> Option<&Field> {
        match self {
            SegmentContent::Clip(clip) => clip.plate.as_ref(),
            SegmentContent::Scene(scene) => scene.plate.as_ref().map(|plate| &plate.field),
        }
    }

    /// What its file records of the photographs of its fit.
    fn fit_record(&self) -> FitRecord {
        match self {
            SegmentContent::Clip(_) => FitRecord::default(),
            SegmentContent::Scene(scene) => scene.fit_record(),
        }
    }

    /// Whether all but the background shows the same at all times.
    fn is_static(&self) -> bool {
        match self {
            SegmentContent::Clip(clip) => clip.dynamic_field.is_empty(),
            SegmentContent::Scene(scene) => scene.subject.field.temporal.is_none(),
        }
    }

    /// All Gaussians but the background's.
    fn into_field(self) -> Field {
        match self {
            SegmentContent::Clip(clip) => clip.merged(),
            SegmentContent::Scene(scene) => scene.subject.field,
        }
    }

    /// Number of layers that were decoded; 0 for a scene, which has none.
    fn layers(&self) -> usize {
        match self {
            SegmentContent::Clip(clip) => clip.layers.len(),
            SegmentContent::Scene(_) => 0,
        }
    }

    /// Number of Gaussians, the background's included.
    pub(super) fn len(&self) -> usize {
        let subject = match self {
            SegmentContent::Clip(clip) => clip.len(),
            SegmentContent::Scene(scene) => scene.subject.field.len(),
        };
        subject + self.plate().map_or(0, Field::len)
    }
}

impl DecodedTake {
    /// Decodes the segments of a package that hold one of the `seconds`, or all without any.
    ///
    /// A package that was cut short has the segments whose first layer is complete; a note on standard error tells.
    ///
    /// # Errors
    /// [`Fault::Data`] that names a damaged segment, if all are missing, or if more Gaussians are asked for than are decoded at a time.
    pub fn of_file(file: &TakeFile, seconds: Option<&[f64]>) -> Result<DecodedTake, Fault> {
        let take = file.take();
        let (name, mut needed, mut missing, mut gaussians) = (file.path().display(), 0, 0, 0);
        let mut segments = Vec::new();
        for (index, segment) in take.segments.iter().enumerate() {
            let is_needed = seconds.is_none_or(|seconds| seconds.iter().any(|&t_s| take.holds(index, t_s)));
            if !is_needed {
                continue;
            }
            needed += 1;
            if file.available(index) < file.first_layer_bytes(index) {
                missing += 1;
                continue;
            }
            gaussians += segment.gaussians();
            check_size(&name.to_string(), gaussians)?;
            let content = SegmentContent::Clip(Box::new(file.decode(index)?));
            segments.push(DecodedSegment { span: Span::from(segment), content });
        }
        if missing > 0 {
            let segments = counted(needed, "segment");
            let what = format!("{name}: cut short, has {} of the {segments} needed", needed - missing);
            if missing == needed {
                return Err(Fault::Data(format!("{what}; get the file again")));
            }
            eprintln!("note: {what}");
        }
        let decoded = segments.iter().map(|segment| segment.content.layers()).max().unwrap_or(0);
        let plates: usize =
            segments.iter().filter_map(|segment| segment.content.plate()).map(Field::len).sum();
        let mut layers = file.layers();
        layers.truncate(decoded);
        layers.iter_mut().for_each(|layer| layer.gaussians -= plates);
        let (info, duration_s, viewpoints) = (take.info.clone(), take.duration_s, file.viewpoints());
        let gaussians = Some(take.segments.iter().map(|segment| segment.gaussians()).sum());
        Ok(DecodedTake { info, duration_s, viewpoints, gaussians, layers, segments })
    }

    /// Reads the segments of a field folder that hold one of the `seconds`, or all without any.
    ///
    /// # Errors
    /// [`Fault::Data`] that names a field that cannot be read, or if more Gaussians are asked for than are read at a
    /// time.
    pub fn of_folder(
        path: &Path,
        folder: &FieldFolder,
        seconds: Option<&[f64]>,
    ) -> anyhow::Result<DecodedTake> {
        let (duration_s, mut gaussians) = (folder.duration_s, 0);
        let first = folder.scene(0)?;
        let viewpoints = folder.viewpoints(&first)?;
        let info = ClipInfo { duration_s: duration_s as f32, viewpoints: viewpoints.clone(), ..first.info };
        let mut segments = Vec::new();
        for index in 0..folder.len() {
            let span = folder.span(index);
            let is_needed =
                seconds.is_none_or(|seconds| seconds.iter().any(|&t_s| span.holds(duration_s, t_s)));
            if !is_needed {
                continue;
            }
            let content = read_segment(folder, index)?;
            gaussians += content.len();
            check_size(&path.display().to_string(), gaussians)?;
            segments.push(DecodedSegment { span, content });
        }
        let gaussians = Some(gaussians).filter(|_| segments.len() == folder.len());
        Ok(DecodedTake { info, duration_s, viewpoints, gaussians, layers: Vec::new(), segments })
    }

    /// What all of the segments that were read record of their fit: held-out frames, mattes, origin and device.
    pub fn fit_record(&self) -> FitRecord {
        let records: Vec<FitRecord> =
            self.segments.iter().map(|segment| segment.content.fit_record()).collect();
        let first = records.first().and_then(|record| record.holdout);
        FitRecord {
            holdout: first.filter(|_| records.iter().all(|record| record.holdout == first)),
            has_mattes: records.iter().any(|record| record.has_mattes),
            origin: records.iter().find_map(|record| record.origin),
            device: records.iter().find_map(|record| record.device.clone()),
            ..FitRecord::default()
        }
    }

    /// The union of the segments for the reference renderer, the first `layers` layers of packages.
    pub fn to_reference(&self, layers: usize) -> RenderScene<'_> {
        RenderScene::of_take(self.segments.iter().map(|DecodedSegment { span, content }| {
            (span.in_scene(self.duration_s), content.layers_to_reference(layers))
        }))
    }

    /// Whether all but the backgrounds shows the same at all times.
    pub fn is_static(&self) -> bool {
        let spans_all = |span: &Span| span.start_s <= 0.0 && span.end_s() >= self.duration_s;
        self.segments.iter().all(|segment| segment.content.is_static() && spans_all(&segment.span))
    }

    /// The background plate of the only segment; of several segments each may have one, and none stands for all.
    pub fn plate(&self) -> Option<&Field> {
        match &self.segments[..] {
            [only] => only.content.plate(),
            _ => None,
        }
    }

    /// Whether a segment has a background plate.
    pub fn has_plate(&self) -> bool {
        self.segments.iter().any(|segment| segment.content.plate().is_some())
    }

    /// All Gaussians but the backgrounds' as one field, in clip time of the take, and how many of them are alive
    /// before or after the span of their segment, where the take does not show them. The near distance is the largest, as
    /// in a package.
    pub fn into_field(self) -> (Field, usize) {
        let (take_s, is_static) = (self.duration_s, self.is_static());
        let segments = self.segments.into_iter().map(|segment| (segment.span, segment.content.into_field()));
        let segments: Vec<(Span, Field)> = segments.collect();
        let fields = || segments.iter().map(|(_, field)| field);
        let temporals = || fields().filter_map(|field| field.temporal.as_ref());
        let mut columns = Temporal {
            motion_order: temporals().map(|temporal| temporal.motion_order).max().unwrap_or(0),
            rotation_rates: temporals().any(|temporal| temporal.rotation_rates.is_some()).then(Vec::new),
            ..Temporal::default()
        };
        let sh_degree = fields().map(|field| field.sh_degree).max().unwrap_or(0);
        let (mut merged, mut beyond) = (Field { sh_degree, ..Field::default() }, 0);
        for (span, field) in segments {
            merged.filter = field.filter;
            merged.near = merged.near.max(field.near);
            beyond += (0..field.len()).filter(|&i| is_beyond(&field, i, &span, take_s)).count();
            append(&mut merged, &mut columns, field, &span, take_s);
        }
        merged.temporal = (!is_static).then_some(columns);
        (merged, beyond)
    }
}

/// Whether row `i` of the field of a segment is alive in the take outside its span.
fn is_beyond(field: &Field, i: usize, span: &Span, take_s: f64) -> bool {
    let alive_at = |t: f64| field.opacity_at(i, t) >= codec::ALPHA_MIN;
    (span.start_s > 0.0 && alive_at(0.0)) || (span.end_s() < take_s && alive_at(1.0))
}

/// Appends the rows of the field of a segment, with times in clip time of the take.
fn append(merged: &mut Field, columns: &mut Temporal, mut field: Field, span: &Span, take_s: f64) {
    let stored = sh_coefficients(field.sh_degree);
    let rows = sh_coefficients(merged.sh_degree);
    for sh in field.sh.chunks_exact(stored) {
        merged.sh.extend_from_slice(sh);
        merged.sh.extend(std::iter::repeat_n([0.0; 3], rows - stored));
    }
    if let Some(temporal) = &mut field.temporal {
        // The take is a span of the segment's clip, longer than that.
        retime(temporal, span.duration_s, -span.start_s, take_s);
    }
    let order = usize::from(columns.motion_order);
    for i in 0..field.len() {
        let temporal = field.temporal.as_ref();
        let (tau, s) = temporal.map_or((0.0, f32::INFINITY), |temporal| (temporal.tau[i], temporal.s[i]));
        columns.tau.push(tau);
        columns.s.push(s);
        let motion = temporal.map_or(&[][..], |temporal| temporal.motion_of(i));
        let powers = (0..order).map(|k| motion.get(k).copied().unwrap_or([0.0; 3]));
        columns.motion.extend(powers);
        if let Some(rates) = &mut columns.rotation_rates {
            let rate = temporal.and_then(|temporal| temporal.rotation_rates.as_ref()).map(|rates| rates[i]);
            rates.push(rate.unwrap_or([0.0; 4]));
        }
    }
    merged.centers.extend(field.centers);
    merged.rotations.extend(field.rotations);
    merged.log_scales.extend(field.log_scales);
    merged.opacities.extend(field.opacities);
}

/// Reads a segment of a field folder, and says on standard error what was repaired.
///
/// # Errors
/// Those of [`Scene::load`].
pub(super) fn read_segment(folder: &FieldFolder, index: usize) -> anyhow::Result<SegmentContent> {
    let scene = folder.scene(index)?;
    if !scene.subject.account.repairs.is_empty() {
        eprintln!("note: {}: {}", folder.file(index).display(), scene.subject.account.repairs);
    }
    Ok(SegmentContent::Scene(Box::new(scene)))
}

/// # Errors
/// [`Fault::Data`] if a take has more Gaussians than are in memory at a time.
fn check_size(name: &str, gaussians: usize) -> Result<(), Fault> {
    let limit = Limits::default().max_gaussians;
    match gaussians > limit {
        true => Err(Fault::Data(format!(
            "{name}: more than {limit} Gaussians, the most that this command holds; make a shorter take with `trim`"
        ))),
        false => Ok(()),
    }
}
