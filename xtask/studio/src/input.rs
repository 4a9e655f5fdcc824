//! [`Input`]: the input of a command, segments or a scene.

use std::path::Path;

use codec::{ClipInfo, Field, Viewpoint};
use formats::is_package;
use refine::reference;

use crate::fields::FitRecord;
use crate::messages::decimal;
use crate::scene::{Scene, frames_of};
use crate::segments::{DecodedTake, FieldFolder, TakeFile};
use program::Fault;

/// What a command works on.
#[derive(Debug)]
pub enum Input {
    /// The segments of a package or of a field folder.
    Take(Box<DecodedTake>),
    /// A fitted field, perhaps with a background.
    Scene(Box<Scene>),
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

    /// Reads an input as [`Input::load`] does, but only the segments that hold one of these `seconds`.
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
            let take = DecodedTake::of_file(&TakeFile::open(path)?, seconds)?;
            return Ok(Input::Take(Box::new(take)));
        }
        let scene = Scene::load(path)?;
        for (part, imported) in [("", Some(&scene.subject)), (" (plate)", scene.plate.as_ref())] {
            for sentence in imported.iter().flat_map(|imported| imported.account.sentences()) {
                eprintln!("note: {}{part}: {sentence}", path.display());
            }
        }
        Ok(Input::Scene(Box::new(scene)))
    }

    /// Duration, axes, viewpoints.
    pub fn info(&self) -> &ClipInfo {
        match self {
            Input::Take(take) => &take.info,
            Input::Scene(scene) => &scene.info,
        }
    }

    /// Number of captured frames, if known; packages and field folders always record it.
    pub fn frames(&self) -> Option<usize> {
        match self {
            Input::Take(take) => Some(frames_of(&take.info)),
            Input::Scene(scene) => scene.frames(),
        }
    }

    /// The photographs that it was fitted to, as far as a field file records them.
    pub fn fit_record(&self) -> FitRecord {
        match self {
            Input::Take(take) => take.fit_record(),
            Input::Scene(scene) => scene.fit_record(),
        }
    }

    /// Whether all but the background shows the same at all times.
    pub fn is_static(&self) -> bool {
        match self {
            Input::Take(take) => take.is_static(),
            Input::Scene(scene) => scene.subject.field.temporal.is_none(),
        }
    }

    /// The background plate of a scene or of the only segment; several segments have one each.
    pub fn plate(&self) -> Option<&Field> {
        match self {
            Input::Take(take) => take.plate(),
            Input::Scene(scene) => scene.plate.as_ref().map(|plate| &plate.field),
        }
    }

    /// Whether there is a background plate.
    pub fn has_plate(&self) -> bool {
        match self {
            Input::Take(take) => take.has_plate(),
            Input::Scene(scene) => scene.plate.is_some(),
        }
    }

    /// The scene for the reference renderer.
    pub fn to_reference(&self) -> reference::RenderScene<'_> {
        match self {
            Input::Take(take) => take.to_reference(usize::MAX),
            Input::Scene(scene) => {
                let subject = reference::RenderScene::from(&scene.subject.field);
                match &scene.plate {
                    Some(plate) => subject.with_plate(&plate.field),
                    None => subject,
                }
            }
        }
    }

    /// Number of Gaussians, the background's included, also of segments that were not read; `None` for a field folder of
    /// which only a part was read.
    pub fn gaussians(&self) -> Option<usize> {
        match self {
            Input::Take(take) => take.gaussians,
            Input::Scene(scene) => {
                let plate = scene.plate.as_ref().map_or(0, |plate| plate.field.len());
                Some(scene.subject.field.len() + plate)
            }
        }
    }

    /// All Gaussians but the background's as one field, and how many of them it shows before or after the span of their
    /// segment, where the take does not.
    pub fn into_field(self) -> (Field, usize) {
        match self {
            Input::Take(take) => take.into_field(),
            Input::Scene(scene) => (scene.subject.field, 0),
        }
    }

    /// The viewpoint with this name or index; by default the first.
    ///
    /// # Errors
    /// [`Fault::Usage`] that lists the viewpoints.
    pub fn viewpoint(&self, name: Option<&str>) -> Result<Viewpoint, Fault> {
        let viewpoints = match self {
            Input::Take(take) => &take.viewpoints,
            Input::Scene(scene) => &scene.info.viewpoints,
        };
        viewpoint(viewpoints, name.unwrap_or("0")).cloned()
    }
}

/// The viewpoint with this name or index.
///
/// # Errors
/// [`Fault::Usage`] that lists the viewpoints.
pub(crate) fn viewpoint<'v>(viewpoints: &'v [Viewpoint], name: &str) -> Result<&'v Viewpoint, Fault> {
    let named = viewpoints.iter().find(|viewpoint| viewpoint.name == name);
    let numbered = || viewpoints.get(name.parse::<usize>().ok()?);
    named.or_else(numbered).ok_or_else(|| {
        let known = viewpoints.iter().enumerate().map(|(i, viewpoint)| format!("{i} \"{}\"", viewpoint.name));
        let known = known.collect::<Vec<_>>().join(", ");
        Fault::Usage(format!("--view {name}: there is no such viewpoint; there are {known}"))
    })
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

/// Number of segments of a package or a field folder, 1 of anything else. Decodes nothing.
///
/// # Errors
/// [`Fault::Data`] if it is a package with a damaged head, or a field folder with a bad `field.json`.
pub fn segments_in(path: &Path) -> Result<usize, Fault> {
    Ok(match is_package(path) {
        true => TakeFile::open(path)?.take().segments.len(),
        false if FieldFolder::is_one(path) => FieldFolder::open(path)?.len(),
        false => 1,
    })
}

/// Checks that a path names one field: one segment, if it names a package or a field folder.
///
/// # Errors
/// [`Fault::Data`] that says what to name instead; those of [`segments_in`].
pub(crate) fn check_one_field(path: &Path) -> Result<(), Fault> {
    let (name, segments) = (path.display(), segments_in(path)?);
    if segments == 1 {
        return Ok(());
    }
    let advice = match FieldFolder::is_one(path) {
        true => "name a field file in it",
        false => "make it one field with `export --ply`",
    };
    Err(Fault::Data(format!("{name}: {segments} segments, where one field is expected; {advice}")))
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
