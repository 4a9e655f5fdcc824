//! [`ReportSubject`]: what is reported on, the Gaussians of a field or package that can be seen.

use std::ffi::OsStr;
use std::path::Path;

use codec::Field;
use refine::reference;

use crate::input::Input;
use crate::package::{render_scene, visible};
use crate::scene::Scene;
use program::Fault;

/// A field, unpruned and uncoded as far as there is such a thing: of a package, what it decodes to.
#[derive(Debug)]
pub struct ReportSubject {
    /// Where it comes from.
    pub scene: Scene,
    /// The Gaussians that can be seen at some instant.
    pub field: Field,
    /// Those of the static background.
    pub plate: Option<Field>,
}

impl ReportSubject {
    /// Reads a package, a fitted field file or a folder holding one.
    ///
    /// # Errors
    /// [`Fault::Data`] that names the file and what is wrong with it, also where nothing in it can
    /// be seen.
    pub fn load(path: &Path) -> anyhow::Result<ReportSubject> {
        let scene = match Input::load(path)? {
            Input::Scene(scene) => *scene,
            Input::Package(clip) => {
                let name = path.file_stem().unwrap_or(OsStr::new("clip")).to_string_lossy();
                let made = |field| Scene::made(&name, field, clip.info.clone());
                let plate = clip.plate.clone().map(|plate| made(plate).subject);
                let assumed = if clip.info.viewpoints.is_empty() { vec!["viewpoints"] } else { Vec::new() };
                Scene { plate, assumed, ..made(clip.merged()) }
            }
        };
        let (field, _) = visible(&scene.subject);
        let plate = scene.plate.as_ref().map(|plate| visible(plate).0).filter(|plate| !plate.is_empty());
        if field.is_empty() {
            return Err(Fault::Data(format!("{}: no Gaussian that can be seen", path.display())).into());
        }
        Ok(ReportSubject { scene, field, plate })
    }

    /// What the reference renderer draws of it.
    pub fn to_reference(&self) -> reference::RenderScene<'_> {
        render_scene(&self.field, self.plate.as_ref())
    }

    /// Rate of a stream that brings so many bytes while the clip plays once.
    pub fn mbps(&self, bytes: usize) -> f64 {
        bytes as f64 * 8e-6 / f64::from(self.scene.info.duration_s)
    }
}
