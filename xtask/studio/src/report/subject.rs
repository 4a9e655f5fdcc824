//! [`ReportSubject`]: the visible Gaussians of a field or package to report on.

use std::ffi::OsStr;
use std::path::Path;

use anyhow::bail;
use codec::Field;
use refine::reference;

use crate::input::{Input, not_one_field};
use crate::package::{render_scene, visible};
use crate::scene::Scene;
use program::Fault;

/// An unpruned, uncoded field, or the decoded field of a package.
#[derive(Debug)]
pub struct ReportSubject {
    /// The scene that the field is part of.
    pub scene: Scene,
    /// The Gaussians that are visible at some instant.
    pub field: Field,
    /// The visible Gaussians of the static background.
    pub plate: Option<Field>,
}

impl ReportSubject {
    /// Reads a package, a fitted field file or a folder holding one.
    ///
    /// # Errors
    /// [`Fault::Data`] that names the file and the problem, also if no Gaussian is visible.
    pub fn load(path: &Path) -> anyhow::Result<ReportSubject> {
        let scene = match Input::load(path)? {
            Input::Scene(scene) => *scene,
            Input::Take(_) => bail!(not_one_field(path)),
            Input::Package(clip) => {
                let name = path.file_stem().unwrap_or(OsStr::new("clip")).to_string_lossy();
                let scene = |field| Scene::made(&name, field, clip.info.clone());
                let plate = clip.plate.clone().map(|plate| scene(plate).subject);
                let assumed = if clip.info.viewpoints.is_empty() { vec!["viewpoints"] } else { Vec::new() };
                let mut whole = scene(clip.merged());
                (whole.plate, whole.assumed) = (plate, assumed);
                whole
            }
        };
        let (field, _) = visible(&scene.subject);
        let plate = scene.plate.as_ref().map(|plate| visible(plate).0).filter(|plate| !plate.is_empty());
        if field.is_empty() {
            return Err(Fault::Data(format!(
                "{}: no Gaussian is visible in the clip; check its opacities and windows",
                path.display()
            ))
            .into());
        }
        Ok(ReportSubject { scene, field, plate })
    }

    /// The scene for the reference renderer.
    pub fn to_reference(&self) -> reference::RenderScene<'_> {
        render_scene(&self.field, self.plate.as_ref())
    }

    /// Bit rate in Mbit/s of streaming `bytes` in the duration of the clip.
    pub fn mbps(&self, bytes: usize) -> f64 {
        bytes as f64 * 8e-6 / f64::from(self.scene.info.duration_s)
    }
}
