//! What `inspect` says of a field: what its file states, what was assumed in place of what it does not, what was lost.

use std::path::Path;

use serde::Serialize;

use crate::messages::decimal;
use crate::scene::Scene;

/// Description of a field; the fields are the keys of the JSON.
#[derive(Serialize)]
pub(super) struct FieldInspection {
    format: &'static str,
    /// Gaussians, without the background.
    gaussians: usize,
    sh_degree: u8,
    motion_order: u8,
    filter: &'static str,
    /// In source units; 0 where nothing fades.
    near: f32,
    duration_s: f32,
    fps: f32,
    up: [f32; 3],
    metres_per_unit: f32,
    /// Gaussians of the background.
    plate: Option<usize>,
    /// Name of the graphics device that computed the fit; null of others.
    device: Option<String>,
    /// Keys of `scene.json` that nothing states.
    assumed: Vec<&'static str>,
    /// What was repaired, assumed and lost.
    notes: Vec<String>,
}

impl FieldInspection {
    /// Reads a field.
    ///
    /// # Errors
    /// As [`Scene::load`] has them.
    pub(super) fn read(path: &Path) -> anyhow::Result<FieldInspection> {
        let scene = Scene::load(path)?;
        let device = scene.fit_record().device;
        let Scene { subject, plate, info, assumed, .. } = scene;
        let background = plate.iter().flat_map(|plate| plate.account.sentences());
        Ok(FieldInspection {
            format: subject.format,
            gaussians: subject.field.len(),
            sh_degree: subject.field.sh_degree,
            motion_order: subject.field.temporal.as_ref().map_or(0, |temporal| temporal.motion_order),
            filter: subject.field.filter.name(),
            near: subject.field.near,
            duration_s: info.duration_s,
            fps: info.fps,
            up: info.up,
            metres_per_unit: info.metres_per_unit,
            plate: plate.as_ref().map(|plate| plate.field.len()),
            device,
            assumed,
            notes: subject.account.sentences().into_iter().chain(background).collect(),
        })
    }

    pub(super) fn print(&self, path: &Path) {
        let row = |name: &str, value: String| println!("{name:<12}{value}");
        println!("{}: {}, not packaged\n", path.display(), self.format);
        let plate = self.plate.map_or(String::new(), |count| format!(", and {count} in the background"));
        row("gaussians", format!("{}{plate}", self.gaussians));
        row("attributes", format!("SH degree {}, motion of order {}", self.sh_degree, self.motion_order));
        row("drawing", format!("filter {}, near distance {} units", self.filter, self.near));
        let [duration_s, fps] = [self.duration_s, self.fps].map(|x| decimal(f64::from(x), 3));
        row("duration", format!("{duration_s} s at {fps} frames per second"));
        let [x, y, z] = self.up;
        row("axes", format!("up is {x} {y} {z}, {} m per unit", self.metres_per_unit));
        if let Some(device) = &self.device {
            row("fitted", format!("by {device}; elsewhere the same fit may give other numbers"));
        }
        if !self.assumed.is_empty() {
            row("assumed", format!("{}; scene.json can say otherwise", self.assumed.join(", ")));
        }
        self.notes.iter().for_each(|note| row("note", note.clone()));
    }
}
