//! [`FieldFolder`]: a take as a folder of fields, one file a segment, that `field.json` lists; FIELD.md specifies it.

use std::fs;
use std::path::{Path, PathBuf};

use codec::{SEGMENTS_MAX, Surroundings, Viewpoint};
use program::Fault;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::span::{Span, check_spans};
use crate::messages::unreadable;
use crate::scene::{FIELD_FOLDER, Scene};

/// Version of the format.
pub const FIELD_FOLDER_VERSION: u32 = 1;

/// A folder of fields that play as a take.
#[derive(Clone, Debug, PartialEq)]
pub struct FieldFolder {
    folder: PathBuf,
    /// Duration of the take in seconds.
    pub duration_s: f64,
    /// Frames per second.
    pub fps: f32,
    entries: Vec<FolderEntry>,
}

/// The contents of `field.json`.
#[derive(Serialize, Deserialize)]
struct Manifest {
    version: u32,
    duration_s: f64,
    fps: f32,
    segments: Vec<FolderEntry>,
}

/// A segment in `field.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct FolderEntry {
    /// Name of its field file.
    pub(crate) file: String,
    pub(crate) start_s: f64,
    pub(crate) duration_s: f64,
    #[serde(default)]
    pub(crate) level: u8,
    /// Name of the field file of its static background.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) plate: Option<String>,
}

impl FieldFolder {
    /// Whether `path` is a folder with a `field.json`.
    pub fn is_one(path: &Path) -> bool {
        path.join(FIELD_FOLDER).is_file()
    }

    /// Reads `field.json` and checks that its files are there.
    ///
    /// # Errors
    /// [`Fault::Data`] that names the file: unreadable, of another version, with spans that make no take, or a field
    /// that is missing.
    pub fn open(folder: &Path) -> Result<FieldFolder, Fault> {
        let path = folder.join(FIELD_FOLDER);
        let text = fs::read_to_string(&path).map_err(|error| unreadable(&path, &error))?;
        let bad = |what: String| Fault::Data(format!("{}: {what}", path.display()));
        let described = "xtask/FIELD.md describes it";
        let value: Value =
            serde_json::from_str(&text).map_err(|error| bad(format!("{error}; {described}")))?;
        match value["version"].as_u64() {
            Some(version) if version == u64::from(FIELD_FOLDER_VERSION) => {}
            Some(version) => {
                return Err(bad(format!(
                    "a field folder of version {version}, and this program reads {FIELD_FOLDER_VERSION}; update it"
                )));
            }
            None => return Err(bad(format!("no version; {described}"))),
        }
        let manifest: Manifest =
            serde_json::from_value(value).map_err(|error| bad(format!("{error}; {described}")))?;
        let Manifest { duration_s, fps, segments: entries, .. } = manifest;
        if !(fps.is_finite() && fps > 0.0) {
            return Err(bad(format!("fps must be a positive number, not {fps}")));
        }
        if !(1..=SEGMENTS_MAX).contains(&entries.len()) {
            return Err(bad(format!("{} segments; a take has 1 to {SEGMENTS_MAX}", entries.len())));
        }
        let spans: Vec<Span> = entries.iter().map(FolderEntry::span).collect();
        check_spans(duration_s, &spans).map_err(bad)?;
        for name in entries.iter().flat_map(|entry| [Some(&entry.file), entry.plate.as_ref()]).flatten() {
            if Path::new(name).file_name() != Some(name.as_ref()) {
                return Err(bad(format!(
                    "\"{name}\" is no name of a file in this folder; move the file there"
                )));
            }
            let file = folder.join(name);
            fs::metadata(&file).map_err(|error| unreadable(&file, &error))?;
        }
        Ok(FieldFolder { folder: folder.to_owned(), duration_s, fps, entries })
    }

    /// Number of segments, at least 1.
    pub fn len(&self) -> usize {
        self.entries.len()
    }

    /// Whether there is no segment: never.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// The span of a segment.
    pub fn span(&self, index: usize) -> Span {
        self.entries[index].span()
    }

    /// Path of the field file of a segment.
    pub fn file(&self, index: usize) -> PathBuf {
        self.folder.join(&self.entries[index].file)
    }

    /// Reads a segment.
    ///
    /// # Errors
    /// Those of [`Scene::load`].
    pub fn scene(&self, index: usize) -> anyhow::Result<Scene> {
        let entry = &self.entries[index];
        let plate = entry.plate.as_ref().map(|name| self.folder.join(name));
        Scene::of_segment(&self.file(index), plate.as_deref(), entry.duration_s as f32, self.fps)
    }

    /// The viewpoints that the first segment, `first`, states, or else the opening by the segments that are shown when it
    /// begins. Never empty.
    ///
    /// # Errors
    /// Those of [`FieldFolder::scene`].
    pub(crate) fn viewpoints(&self, first: &Scene) -> anyhow::Result<Vec<Viewpoint>> {
        if !first.assumed.contains(&"viewpoints") {
            return Ok(first.info.viewpoints.clone());
        }
        let spans: Vec<Span> = (0..self.len()).map(|index| self.span(index)).collect();
        let start_s = spans[0].start_s.max(0.0);
        let others: Vec<usize> =
            (1..spans.len()).filter(|&index| spans[index].holds(self.duration_s, start_s)).collect();
        let read = others.iter().map(|&index| self.scene(index)).collect::<anyhow::Result<Vec<Scene>>>()?;
        let scenes: Vec<&Scene> = std::iter::once(first).chain(&read).collect();
        let shown: Vec<Span> = [0].iter().chain(&others).map(|&index| spans[index]).collect();
        let end_s = shown.iter().map(Span::end_s).fold(self.duration_s, f64::min);
        let range = |span: &Span| [start_s, end_s].map(|second| (second - span.start_s) / span.duration_s);
        let parts: Vec<_> =
            scenes.iter().map(|scene| &scene.subject.field).zip(shown.iter().map(range)).collect();
        let plate = scenes.iter().find_map(|scene| scene.plate.as_ref()).map(|plate| &plate.field);
        Ok(vec![Surroundings::from_parts(&parts, plate, first.info.up).opening()])
    }

    /// The text of a `field.json`.
    pub(crate) fn manifest(duration_s: f64, fps: f32, segments: Vec<FolderEntry>) -> String {
        let manifest = Manifest { version: FIELD_FOLDER_VERSION, duration_s, fps, segments };
        let text = serde_json::to_string_pretty(&manifest).expect("numbers and names");
        format!("{text}\n")
    }
}

impl FolderEntry {
    pub(crate) fn span(&self) -> Span {
        Span { start_s: self.start_s, duration_s: self.duration_s, level: self.level }
    }
}
