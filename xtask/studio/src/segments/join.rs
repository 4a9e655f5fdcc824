//! [`JoinPlan`]: fields, packages and field folders, one after another, become one field folder.
//!
//! Each input shows its own duration and nothing outside of it. All inputs are read twice: first to compare them and to
//! count their bytes, before anything is written, then to write them one after another.

use std::path::{Path, PathBuf};

use codec::{ClipInfo, Field, retime};
use formats::is_package;
use program::{Fault, output};

use super::agreement::Agreement;
use super::file::TakeFile;
use super::folder::{FieldFolder, FolderEntry};
use super::span::{Span, check_spans, order_of};
use crate::fields::{FitRecord, fitted_field_file};
use crate::scene::{FIELD_FOLDER, Scene};

/// Shortest part of a segment that is worth joining, as a fraction of the segment: less is rounding.
const PART_MIN: f64 = 1e-6;

/// An input of a take.
#[derive(Debug)]
enum JoinInput {
    Package(Box<TakeFile>),
    Folder(FieldFolder),
    Scene(PathBuf),
}

/// A segment of an input, in memory.
struct LoadedSegment {
    name: String,
    /// In seconds of its input.
    span: Span,
    field: Field,
    plate: Option<Field>,
    info: ClipInfo,
    record: FitRecord,
}

/// Inputs that fit together, and what joining them takes.
#[derive(Debug)]
pub struct JoinPlan {
    inputs: Vec<JoinInput>,
    /// Spans in the take of the segments of each input that show something; `None` for the others.
    spans: Vec<Vec<Option<Span>>>,
    fps: f32,
    /// Duration of the take in seconds.
    pub duration_s: f64,
    /// Size of the folder in bytes.
    pub bytes: u64,
    /// What the user should know about the inputs.
    pub notes: Vec<String>,
}

/// A field folder that was written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JoinedTake {
    /// Duration in seconds.
    pub duration_s: f64,
    /// Number of segments.
    pub segments: usize,
    /// Number of Gaussians, backgrounds included.
    pub gaussians: usize,
    /// Size of the folder in bytes.
    pub bytes: u64,
}

impl JoinInput {
    fn open(path: &Path) -> Result<JoinInput, Fault> {
        Ok(if is_package(path) {
            JoinInput::Package(Box::new(TakeFile::open(path)?))
        } else if FieldFolder::is_one(path) {
            JoinInput::Folder(FieldFolder::open(path)?)
        } else if path.is_dir() && !Scene::is_capture(path) && !Scene::has_field(path) {
            return Err(Fault::Data(format!(
                "{}: nothing to join in it; name a package (.aarc), a folder with a field.json, a fitted field file or a \
                 folder holding one ({})",
                path.display(),
                formats::titles()
            )));
        } else {
            JoinInput::Scene(path.to_owned())
        })
    }

    fn len(&self) -> usize {
        match self {
            JoinInput::Package(file) => file.take().segments.len(),
            JoinInput::Folder(folder) => folder.len(),
            JoinInput::Scene(_) => 1,
        }
    }

    /// Duration in seconds; `None` for a scene, whose only segment lasts as long.
    fn duration_s(&self) -> Option<f64> {
        match self {
            JoinInput::Package(file) => Some(file.take().duration_s),
            JoinInput::Folder(folder) => Some(folder.duration_s),
            JoinInput::Scene(_) => None,
        }
    }

    fn load(&self, index: usize) -> anyhow::Result<LoadedSegment> {
        let of_scene = |scene: Scene, name: String, span: Span| {
            let has_viewpoints = !scene.assumed.contains(&"viewpoints");
            let viewpoints = if has_viewpoints { scene.info.viewpoints.clone() } else { Vec::new() };
            LoadedSegment {
                name,
                span,
                record: scene.fit_record(),
                info: ClipInfo { viewpoints, ..scene.info },
                field: scene.subject.field,
                plate: scene.plate.map(|plate| plate.field),
            }
        };
        Ok(match self {
            JoinInput::Package(file) => {
                let segment = &file.take().segments[index];
                let mut clip = file.decode(index)?;
                let name = match self.len() {
                    1 => file.path().display().to_string(),
                    _ => format!("{}, segment {index}", file.path().display()),
                };
                LoadedSegment {
                    name,
                    span: Span::from(segment),
                    field: clip.merged(),
                    plate: clip.plate.take(),
                    info: file.take().info.clone(),
                    record: FitRecord::default(),
                }
            }
            JoinInput::Folder(folder) => {
                let name = folder.file(index).display().to_string();
                of_scene(folder.scene(index)?, name, folder.span(index))
            }
            JoinInput::Scene(path) => {
                let scene = Scene::load(path)?;
                let duration_s = f64::from(scene.info.duration_s);
                of_scene(scene, path.display().to_string(), Span { start_s: 0.0, duration_s, level: 0 })
            }
        })
    }
}

impl LoadedSegment {
    /// Cuts it to the part that an input of `input_s` seconds shows. `None` if no Gaussian is alive in it.
    fn cut_to(mut self, input_s: f64) -> Option<LoadedSegment> {
        let Span { start_s, duration_s, level } = self.span;
        let (first_s, last_s) = (start_s.max(0.0), self.span.end_s().min(input_s));
        if (first_s, last_s) == (start_s, self.span.end_s()) {
            return Some(self);
        }
        if last_s - first_s < PART_MIN * duration_s {
            return None;
        }
        if let Some(temporal) = &mut self.field.temporal {
            retime(temporal, duration_s, first_s - start_s, last_s - first_s);
        }
        let alive: Vec<usize> =
            (0..self.field.len()).filter(|&i| self.field.alive_interval(i).is_some()).collect();
        self.field = self.field.select(&alive);
        self.span = Span { start_s: first_s, duration_s: last_s - first_s, level };
        (!self.field.is_empty()).then_some(self)
    }

    /// Its field files: the subject's, and the background's.
    fn files(&self) -> (Vec<u8>, Option<Vec<u8>>) {
        let info = ClipInfo { duration_s: self.span.duration_s as f32, ..self.info.clone() };
        let of_plate = |plate| {
            fitted_field_file(
                plate,
                &ClipInfo { viewpoints: Vec::new(), ..info.clone() },
                &FitRecord::default(),
            )
        };
        (fitted_field_file(&self.field, &info, &self.record), self.plate.as_ref().map(of_plate))
    }
}

impl JoinPlan {
    /// Reads and compares the inputs.
    ///
    /// # Errors
    /// [`Fault::Data`] that names an input that cannot be read, two that differ in axes, scale, origin or filter, or a segment
    /// without a visible Gaussian.
    pub fn new(paths: &[PathBuf]) -> anyhow::Result<JoinPlan> {
        let inputs = paths.iter().map(|path| JoinInput::open(path)).collect::<Result<Vec<_>, Fault>>()?;
        let mut agreement = Agreement::default();
        let mut plan = JoinPlan {
            inputs: Vec::new(),
            spans: Vec::new(),
            fps: 0.0,
            duration_s: 0.0,
            bytes: 0,
            notes: Vec::new(),
        };
        for (number, (input, path)) in inputs.into_iter().zip(paths).enumerate() {
            let start_s = plan.duration_s;
            let mut spans = Vec::new();
            for index in 0..input.len() {
                let segment = input.load(index)?;
                if number == 0 && index == 0 {
                    plan.fps = segment.info.fps;
                } else if index == 0 && segment.info.fps != plan.fps {
                    let (name, fps, first) = (path.display(), segment.info.fps, plan.fps);
                    plan.notes
                        .push(format!("{name}: {fps} frames per second, and the take steps by {first}"));
                }
                agreement.add(
                    &segment.name,
                    &segment.info,
                    &segment.record,
                    &segment.field,
                    segment.plate.as_ref(),
                )?;
                let (name, own_s, has_plate) =
                    (segment.name.clone(), segment.span.duration_s, segment.plate.is_some());
                if index == 0 {
                    plan.duration_s += input.duration_s().unwrap_or(own_s);
                }
                let Some(segment) = segment.cut_to(input.duration_s().unwrap_or(own_s)) else {
                    if has_plate {
                        plan.notes.push(format!("{name}: nothing of it is shown, and its plate is left out"));
                    }
                    spans.push(None);
                    continue;
                };
                let (file, plate) = segment.files();
                plan.bytes += file.len() as u64 + plate.map_or(0, |plate| plate.len() as u64);
                spans.push(Some(Span { start_s: start_s + segment.span.start_s, ..segment.span }));
            }
            plan.inputs.push(input);
            plan.spans.push(spans);
        }
        let all: Vec<Span> = plan.spans.iter().flatten().flatten().copied().collect();
        let order = order_of(plan.duration_s, &all);
        let ordered: Vec<Span> = order.iter().map(|&i| all[i]).collect();
        check_spans(plan.duration_s, &ordered).map_err(Fault::Data)?;
        Ok(plan)
    }

    /// Writes the folder `out`, at which there is nothing or an empty folder.
    ///
    /// # Errors
    /// [`Fault::Usage`] if it cannot be written; then nothing is left of it. [`Fault::Data`] if an input changed.
    pub fn write(&self, out: &Path) -> anyhow::Result<JoinedTake> {
        let folder = output::OutputFolder::begin(out)?;
        let all: Vec<Span> = self.spans.iter().flatten().flatten().copied().collect();
        let order = order_of(self.duration_s, &all);
        let mut rank = vec![0; all.len()];
        order.iter().enumerate().for_each(|(place, &i)| rank[i] = place);
        let digits = all.len().saturating_sub(1).to_string().len().max(4);
        let mut entries: Vec<Option<FolderEntry>> = vec![None; all.len()];
        let (mut number, mut gaussians, mut bytes) = (0, 0, 0);
        for (input, spans) in self.inputs.iter().zip(&self.spans) {
            for (index, span) in spans.iter().enumerate() {
                let Some(span) = span else { continue };
                let segment = input.load(index)?;
                let input_s = input.duration_s().unwrap_or(segment.span.duration_s);
                let name = segment.name.clone();
                let Some(segment) =
                    segment.cut_to(input_s).filter(|cut| cut.span.duration_s == span.duration_s)
                else {
                    return Err(Fault::Data(format!("{name}: it changed meanwhile; join again")).into());
                };
                let place = rank[number];
                let file = format!("segment-{place:0digits$}.ply");
                let (field, plate) = segment.files();
                folder.write(&file, &field)?;
                bytes += field.len() as u64;
                let plate = match plate {
                    Some(plate) => {
                        let file = format!("segment-{place:0digits$}-plate.ply");
                        folder.write(&file, &plate)?;
                        bytes += plate.len() as u64;
                        Some(file)
                    }
                    None => None,
                };
                gaussians += segment.field.len() + segment.plate.as_ref().map_or(0, Field::len);
                let Span { start_s, duration_s, level } = *span;
                entries[place] = Some(FolderEntry { file, start_s, duration_s, level, plate });
                number += 1;
            }
        }
        let entries: Vec<FolderEntry> = entries.into_iter().flatten().collect();
        let segments = entries.len();
        let manifest = FieldFolder::manifest(self.duration_s, self.fps, entries);
        folder.write(FIELD_FOLDER, manifest.as_bytes())?;
        folder.finish()?;
        let bytes = bytes + manifest.len() as u64;
        Ok(JoinedTake { duration_s: self.duration_s, segments, gaussians, bytes })
    }
}
