//! [`ReportSubject`]: the visible Gaussians of a field or package to report on.

use std::ffi::OsStr;
use std::path::Path;

use codec::Field;
use refine::reference;

use crate::input::{Input, check_one_field};
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
    /// Reads a package or field folder of one segment, a fitted field file or a folder holding one.
    ///
    /// # Errors
    /// [`Fault::Data`] that names the file and the problem, also for several segments and if no Gaussian is visible.
    pub fn load(path: &Path) -> anyhow::Result<ReportSubject> {
        check_one_field(path)?;
        let scene = match Input::load(path)? {
            Input::Scene(scene) => *scene,
            Input::Take(take) => {
                let name = path.file_stem().unwrap_or(OsStr::new("clip")).to_string_lossy();
                let (plate, info) = (take.plate().cloned(), take.info.clone());
                let scene = |field| Scene::made(&name, field, info.clone());
                let mut whole = scene(take.into_field().0);
                whole.plate = plate.map(|plate| scene(plate).subject);
                whole.assumed = if info.viewpoints.is_empty() { vec!["viewpoints"] } else { Vec::new() };
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
