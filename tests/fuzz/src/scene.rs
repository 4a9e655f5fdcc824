//! Any bytes as what stands beside a field: `scene.json`, by the reader of the tool, and the JSON of a
//! camera, by its type alone.

use std::sync::OnceLock;

use codec::{Camera, EncodeOptions, Source, encode};
use studio::export::field_file;
use studio::scene::Scene;

use crate::files::{Desk, check_refusal};
use crate::parts;
use crate::seeds;

/// What an input is, which its first byte chooses.
pub(crate) const OVERRIDES: u8 = 0;
pub(crate) const CAMERA: u8 = 1;

/// Reads an input.
///
/// # Panics
/// If a scene is accepted that cannot be packaged or refused in more than one line, or a camera is
/// accepted that is nowhere.
pub fn check_scene(bytes: &[u8]) {
    static DESK: OnceLock<Desk> = OnceLock::new();
    let Some((kind, bytes)) = parts::kind(bytes, 2) else { return };
    if kind == CAMERA {
        if let Ok(camera) = serde_json::from_slice::<Camera>(bytes)
            && camera.check().is_ok()
        {
            assert!(camera.position().iter().all(|x| x.is_finite()), "{camera:?}");
        }
        return;
    }
    let desk = DESK.get_or_init(|| Desk::with([("field.ply", field_file(&seeds::field(1), &seeds::info()))]));
    desk.put("scene.json", bytes);
    match Scene::load(&desk.path("")) {
        Ok(scene) => {
            let source = Source { info: &scene.info, field: &scene.subject.field, plate: None };
            encode(&source, &EncodeOptions::default()).expect("an accepted scene can be packaged");
        }
        Err(error) => check_refusal(&error),
    }
}
