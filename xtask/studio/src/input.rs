//! [`Input`]: the input of a command, a package or a scene.

use std::fs::{self, File};
use std::io::Read;
use std::path::Path;

use codec::{Clip, ClipInfo, Contents, Field, Limits, SectionKind, Viewpoint};
use refine::reference;

use crate::import::FitRecord;
use crate::messages::{bad_package, decimal, unreadable};
use crate::scene::{Scene, frames_of};
use crate::segments::{DecodedTake, FieldFolder, TakeFile};
use program::Fault;

/// First bytes of a package.
const PACKAGE_MAGIC: [u8; 4] = *b"AARC";

/// Maximum size of a package: its offsets have 32 bits.
const PACKAGE_BYTES_MAX: u64 = u32::MAX as u64;

/// A package, or a scene that one can be made from.
#[derive(Debug)]
pub enum Input {
    /// A decoded package.
    Package(Box<Clip>),
    /// A fitted field, perhaps with a background.
    Scene(Box<Scene>),
    /// A take of segments: a package, or a field folder.
    Take(Box<DecodedTake>),
}

impl Input {
    /// Reads a package, a fitted field file, a folder holding one, or a field folder; prints repairs and assumptions
    /// on stderr.
    ///
    /// # Errors
    /// [`Fault::Data`] that names the file and what is wrong with it.
    pub fn load(path: &Path) -> anyhow::Result<Input> {
        Input::load_part(path, None)
    }

    /// Reads an input as [`Input::load`] does, but only the segments of a take that hold one of these `seconds`.
    ///
    /// # Errors
    /// Those of [`Input::load`].
    pub fn load_at(path: &Path, seconds: &[f64]) -> anyhow::Result<Input> {
        Input::load_part(path, Some(seconds))
    }

    fn load_part(path: &Path, seconds: Option<&[f64]>) -> anyhow::Result<Input> {
        if FieldFolder::is_one(path) {
            let take = DecodedTake::of_folder(path, &FieldFolder::open(path)?, seconds)?;
            return Ok(Input::Take(Box::new(take)));
        }
        if is_package(path) {
            let file = TakeFile::open(path)?;
            if !file.is_clip() {
                return Ok(Input::Take(Box::new(DecodedTake::of_file(&file, seconds)?)));
            }
            let clip = codec::decode(&read_package(path)?, &Limits::default());
            return Ok(Input::Package(Box::new(clip.map_err(|error| bad_package(path, &error))?)));
        }
        let scene = Scene::load(path)?;
        for (part, imported) in [("", Some(&scene.subject)), (" (plate)", scene.plate.as_ref())] {
            if let Some(imported) = imported.filter(|imported| !imported.repairs.is_empty()) {
                eprintln!("note: {}{part}: {}", path.display(), imported.repairs);
            }
        }
        for note in &scene.subject.notes {
            eprintln!("note: {}: {note}", path.display());
        }
        Ok(Input::Scene(Box::new(scene)))
    }

    /// Duration, axes, viewpoints.
    pub fn info(&self) -> &ClipInfo {
        match self {
            Input::Package(clip) => &clip.info,
            Input::Scene(scene) => &scene.info,
            Input::Take(take) => &take.info,
        }
    }

    /// Number of captured frames, if known; packages always record it.
    pub fn frames(&self) -> Option<usize> {
        match self {
            Input::Package(clip) => Some(frames_of(&clip.info)),
            Input::Scene(scene) => scene.frames(),
            Input::Take(take) => Some(frames_of(&take.info)),
        }
    }

    /// The photographs that it was fitted to, as far as a field file records them.
    pub fn fit_record(&self) -> FitRecord {
        match self {
            Input::Package(_) => FitRecord::default(),
            Input::Take(take) => take.fit_record(),
            Input::Scene(scene) => scene.fit_record(),
        }
    }

    /// Whether all but the background shows the same at all times.
    pub fn is_static(&self) -> bool {
        match self {
            Input::Package(clip) => clip.dynamic_field.is_empty(),
            Input::Scene(scene) => scene.subject.field.temporal.is_none(),
            Input::Take(_) => false,
        }
    }

    /// The background plate of a package or scene; a take has one for each segment.
    pub fn plate(&self) -> Option<&Field> {
        match self {
            Input::Package(clip) => clip.plate.as_ref(),
            Input::Scene(scene) => scene.plate.as_ref().map(|plate| &plate.field),
            Input::Take(_) => None,
        }
    }

    /// Whether there is a background plate.
    pub fn has_plate(&self) -> bool {
        match self {
            Input::Take(take) => take.has_plate(),
            Input::Package(_) | Input::Scene(_) => self.plate().is_some(),
        }
    }

    /// The scene for the reference renderer.
    pub fn to_reference(&self) -> reference::RenderScene<'_> {
        match self {
            Input::Package(clip) => (&**clip).into(),
            Input::Take(take) => take.to_reference(),
            Input::Scene(scene) => {
                let subject = reference::RenderScene::from(&scene.subject.field);
                match &scene.plate {
                    Some(plate) => subject.with_plate(&plate.field),
                    None => subject,
                }
            }
        }
    }

    /// Number of Gaussians, the background's included.
    pub fn gaussians(&self) -> usize {
        match self {
            Input::Take(take) => take.gaussians(),
            Input::Package(clip) => clip.len() + clip.plate.as_ref().map_or(0, |plate| plate.len()),
            Input::Scene(scene) => {
                scene.subject.field.len() + scene.plate.as_ref().map_or(0, |plate| plate.field.len())
            }
        }
    }

    /// All Gaussians but the background's as one field, and the metadata.
    pub fn into_field(self) -> (Field, ClipInfo) {
        match self {
            Input::Package(clip) => (clip.merged(), clip.info),
            Input::Take(take) => (take.merged().0, take.info),
            Input::Scene(scene) => (scene.subject.field, scene.info),
        }
    }

    /// The viewpoint with this name or index; by default the first.
    ///
    /// # Errors
    /// [`Fault::Usage`] that lists the viewpoints.
    pub fn viewpoint(&self, name: Option<&str>) -> Result<Viewpoint, Fault> {
        let mut viewpoints = match self {
            Input::Package(clip) => clip.viewpoints(),
            Input::Scene(scene) => scene.info.viewpoints.clone(),
            Input::Take(take) => take.viewpoints.clone(),
        };
        let name = name.unwrap_or("0");
        let named = viewpoints.iter().position(|viewpoint| viewpoint.name == name);
        match named.or_else(|| name.parse().ok()).filter(|&index| index < viewpoints.len()) {
            Some(index) => Ok(viewpoints.swap_remove(index)),
            None => {
                let known = viewpoints.iter().enumerate().map(|(i, v)| format!("{i} \"{}\"", v.name));
                let known = known.collect::<Vec<_>>().join(", ");
                Err(Fault::Usage(format!("--view {name}: there is no such viewpoint; there are {known}")))
            }
        }
    }
}

/// Converts seconds to clip time. Up to half a captured frame beyond the end counts as the end, because
/// times in text are often rounded.
///
/// # Errors
/// [`Fault::Usage`] that names `option` if the time is outside the clip.
pub fn clip_time(option: &str, seconds: f64, info: &ClipInfo) -> Result<f64, Fault> {
    let duration = f64::from(info.duration_s);
    let slack = if info.fps > 0.0 { 0.5 / f64::from(info.fps) } else { 0.0 };
    if !(0.0..=duration + slack).contains(&seconds) {
        let duration = decimal(duration, 3);
        return Err(Fault::Usage(format!(
            "{option} {seconds}: choose a time in the clip, from 0 to {duration} s"
        )));
    }
    Ok((seconds / duration).min(1.0))
}

/// Reads the bytes of a package without decoding.
///
/// # Errors
/// [`Fault::Data`] if the file cannot be read or is larger than a package can be.
pub fn read_package(path: &Path) -> Result<Vec<u8>, Fault> {
    let bad = |what: &str| Fault::Data(format!("{}: {what}", path.display()));
    let metadata = fs::metadata(path).map_err(|error| unreadable(path, &error))?;
    if !metadata.is_file() {
        return Err(bad("not a file; name a package (.aarc)"));
    }
    if metadata.len() > PACKAGE_BYTES_MAX {
        return Err(bad("larger than a package can be (4 GiB); name a package (.aarc)"));
    }
    fs::read(path).map_err(|error| unreadable(path, &error))
}

/// Number of bytes of a package up to the end of layer `layer`, counted from 0.
pub fn prefix_bytes(contents: &Contents, layer: usize) -> usize {
    let sections = contents.sections.iter().filter(|section| {
        usize::from(section.layer) <= layer
            && matches!(section.kind, SectionKind::Gaussians | SectionKind::TimeIndex)
    });
    sections.map(|section| section.end()).max().unwrap_or(contents.head_bytes)
}

/// Whether a file begins with the magic number of packages.
pub fn is_package(path: &Path) -> bool {
    let mut magic = [0; 4];
    // Opening a pipe would wait for its other end.
    path.is_file()
        && File::open(path).and_then(|mut file| file.read_exact(&mut magic)).is_ok()
        && magic == PACKAGE_MAGIC
}

/// Whether a path names a take: a package of segments, or a field folder.
///
/// # Errors
/// [`Fault::Data`] if it is a package with a damaged head.
pub fn is_take(path: &Path) -> Result<bool, Fault> {
    Ok(FieldFolder::is_one(path) || is_package(path) && !TakeFile::open(path)?.is_clip())
}

/// The fault of a take where one field is expected: what to do instead.
pub(crate) fn not_one_field(path: &Path) -> Fault {
    let name = path.display();
    let advice = match FieldFolder::is_one(path) {
        true => "name a field file in it",
        false => "make it one field with `export --ply`",
    };
    Fault::Data(format!("{name}: a take of segments, where one field is expected; {advice}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_run_from_the_start_to_half_a_frame_after_the_end() {
        let info = ClipInfo { duration_s: 2.0, fps: 25.0, ..ClipInfo::default() };
        assert_eq!(clip_time("--at", 0.5, &info).unwrap(), 0.25);
        assert_eq!(clip_time("--at", 2.019, &info).unwrap(), 1.0);
        for seconds in [-0.01, 2.03, f64::NAN, f64::INFINITY] {
            assert_eq!(clip_time("--at", seconds, &info).unwrap_err().exit_code(), 2, "{seconds}");
        }
    }
}
