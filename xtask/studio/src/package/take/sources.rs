//! [`SegmentSources`]: the segments that a take is packaged from, a field folder's or a split field's.

use std::path::Path;
use std::sync::Arc;

use codec::{ClipInfo, Field, SplitSegment, Surroundings, SurroundingsBuilder, Viewpoint, split};
use program::{Fault, counted};

use crate::package::{Counts, check_repairs, visible};
use crate::scene::{Scene, name_of};
use crate::segments::{FieldFolder, Span};

/// Segments in the order of their take, loaded one at a time where they are files.
#[derive(Debug)]
pub struct SegmentSources {
    /// Name of the folder or the field.
    pub name: String,
    /// Duration of the take in seconds.
    pub duration_s: f64,
    /// Rows of a field that was split, and those that no segment has; `None` for a folder.
    pub(super) whole: Option<Counts>,
    segments: Segments,
}

#[derive(Debug)]
enum Segments {
    Folder(FieldFolder),
    Split { whole: Box<Scene>, parts: Vec<SplitSegment> },
}

impl SegmentSources {
    /// The segments of a field folder.
    ///
    /// # Errors
    /// Those of [`FieldFolder::open`].
    pub fn of_folder(path: &Path) -> Result<SegmentSources, Fault> {
        let folder = FieldFolder::open(path)?;
        let (name, duration_s) = (name_of(path), folder.duration_s);
        Ok(SegmentSources { name, duration_s, whole: None, segments: Segments::Folder(folder) })
    }

    /// The segments of a scene that is split on a grid of `unit_s` seconds. Its plate goes to the segment that spans
    /// the take. `strict` refuses a scene with a row that was repaired or dropped on import.
    ///
    /// # Errors
    /// [`Fault::Usage`] if the scene lasts no longer than two units, and would be one segment; [`Fault::Data`] if no
    /// Gaussian of it is visible, or `strict` refuses it.
    pub fn of_scene(mut scene: Scene, unit_s: f64, strict: bool) -> Result<SegmentSources, Fault> {
        if strict {
            check_repairs(&scene)?;
        }
        let duration_s = f64::from(scene.info.duration_s);
        if duration_s <= 2.0 * unit_s {
            return Err(Fault::Usage(format!(
                "--split {unit_s}: a segment lasts twice that, and {} lasts {duration_s} s; choose less, or leave it out",
                scene.name
            )));
        }
        let (field, counts) = visible(&scene.subject);
        if field.is_empty() {
            return Err(Fault::Data(format!(
                "{}: it has no Gaussian that can be seen; check its opacities and times",
                scene.name
            )));
        }
        scene.subject.field = field;
        let mut parts = split(&scene.subject.field, duration_s, unit_s);
        if scene.plate.is_some() && !spans_all(&parts[0], duration_s) {
            add_top(&scene.subject.field, duration_s, &mut parts);
        }
        let name = scene.name.clone();
        let segments = Segments::Split { whole: Box::new(scene), parts };
        Ok(SegmentSources { name, duration_s, whole: Some(counts), segments })
    }

    /// The viewpoints of the take, whose first segment is `first`. Never empty.
    ///
    /// # Errors
    /// Those of [`FieldFolder::viewpoints`].
    pub(super) fn viewpoints(&self, first: &Scene) -> anyhow::Result<Vec<Viewpoint>> {
        match &self.segments {
            Segments::Folder(folder) => folder.viewpoints(first),
            Segments::Split { whole, .. } => Ok(whole.info.viewpoints.clone()),
        }
    }

    /// Where the content of the take is and where people stand, over all of its time. The fields have `rows` rows together, with
    /// `up` in their axes. Reads one segment after another.
    ///
    /// # Errors
    /// Those of [`Scene::load`].
    pub(super) fn surroundings(&self, rows: usize, up: [f32; 3]) -> anyhow::Result<Arc<Surroundings>> {
        match &self.segments {
            Segments::Split { whole, .. } => Ok(Arc::clone(whole.surroundings())),
            Segments::Folder(folder) => {
                let mut builder = SurroundingsBuilder::new(rows);
                for index in 0..folder.len() {
                    let scene = folder.scene(index)?;
                    builder.add(&scene.subject.field, [0.0, 1.0]);
                    scene.plate.iter().for_each(|plate| builder.add_plate(&plate.field));
                }
                Ok(Arc::new(builder.build(up)))
            }
        }
    }

    /// Number of segments, at least 1.
    pub fn len(&self) -> usize {
        match &self.segments {
            Segments::Folder(folder) => folder.len(),
            Segments::Split { parts, .. } => parts.len(),
        }
    }

    /// Whether there is no segment: never.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The span of a segment.
    pub fn span(&self, index: usize) -> Span {
        match &self.segments {
            Segments::Folder(folder) => folder.span(index),
            Segments::Split { parts, .. } => {
                let SplitSegment { start_s, duration_s, level, .. } = parts[index];
                Span { start_s, duration_s, level }
            }
        }
    }

    /// A segment as a scene.
    ///
    /// # Errors
    /// Those of [`Scene::load`].
    pub fn scene(&self, index: usize) -> anyhow::Result<Scene> {
        match &self.segments {
            Segments::Folder(folder) => folder.scene(index),
            Segments::Split { whole, parts } => Ok(scene_of_part(whole, &parts[index], self.duration_s)),
        }
    }

    /// The format of the fields, for people.
    pub fn format(&self) -> String {
        let segments = counted(self.len(), "segment");
        match &self.segments {
            Segments::Folder(_) => format!("field folder of {segments}"),
            Segments::Split { whole, .. } => {
                format!("{}, split into {segments}", whole.subject.format)
            }
        }
    }
}

fn spans_all(part: &SplitSegment, duration_s: f64) -> bool {
    part.start_s <= 0.0 && part.start_s + part.duration_s >= duration_s
}

/// Moves the Gaussian that is alive longest to a segment of its own that spans the take, where there is none. Its
/// clip time is the field's.
fn add_top(field: &Field, duration_s: f64, parts: &mut Vec<SplitSegment>) {
    let lifetime = |row: usize| field.alive_interval(row).map_or(0.0, |(birth, death)| death - birth);
    let Some(longest) = (0..field.len()).max_by(|&a, &b| lifetime(a).total_cmp(&lifetime(b)).then(b.cmp(&a)))
    else {
        return;
    };
    for part in parts.iter_mut() {
        if let Some(place) = part.rows.iter().position(|&row| row == longest) {
            let others: Vec<usize> = (0..part.rows.len()).filter(|&i| i != place).collect();
            part.field = part.field.select(&others);
            part.rows.remove(place);
        }
    }
    parts.retain(|part| !part.rows.is_empty());
    let level = parts.iter().map(|part| part.level).max().unwrap_or(0).saturating_add(1);
    let top = SplitSegment {
        start_s: 0.0,
        duration_s,
        level,
        rows: vec![longest],
        field: field.select(&[longest]),
    };
    parts.insert(0, top);
}

/// A part of a field as a scene. The part that spans the take has the plate.
fn scene_of_part(whole: &Scene, part: &SplitSegment, duration_s: f64) -> Scene {
    let info = ClipInfo { duration_s: part.duration_s as f32, ..whole.info.clone() };
    let name = format!("{} from {} s", whole.name, part.start_s);
    let mut scene = Scene::made(&name, part.field.clone(), info);
    scene.plate = whole.plate.as_ref().filter(|_| spans_all(part, duration_s)).cloned();
    (scene.assumed, scene.is_segment) = (whole.assumed.clone(), true);
    scene
}
