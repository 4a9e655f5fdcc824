//! Reads any bytes as `scene.json`, with the tool's reader, or as the JSON of a camera, with serde.

use std::sync::OnceLock;

use codec::{Camera, EncodeOptions, Source, encode};
use formats::write_field_file;
use studio::scene::Scene;

use crate::files::{InputFiles, check_refusal};
use crate::kinds::scene::CAMERA;
use crate::parts;
use crate::seeds;

/// Reads an input.
///
/// # Panics
/// If an accepted scene cannot be packaged, a refusal is not one line, or an accepted camera has no
/// finite position.
pub fn check_scene(bytes: &[u8]) {
    static FILES: OnceLock<InputFiles> = OnceLock::new();
    let Some((kind, bytes)) = parts::split_kind(bytes, 2) else { return };
    if kind == CAMERA {
        if let Ok(camera) = serde_json::from_slice::<Camera>(bytes)
            && camera.check().is_ok()
        {
            assert!(camera.position().iter().all(|x| x.is_finite()), "{camera:?}");
        }
        return;
    }
    let files = FILES
        .get_or_init(|| InputFiles::new([("field.ply", write_field_file(&seeds::field(1), &seeds::info()))]));
    files.put("scene.json", bytes);
    match Scene::load(&files.path("")) {
        Ok(scene) => {
            let source = Source { info: &scene.info, field: &scene.subject.field, plate: None };
            encode(&source, &EncodeOptions::default()).expect("an accepted scene can be packaged");
        }
        Err(error) => check_refusal(&error),
    }
}
