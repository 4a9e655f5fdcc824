//! [`read_camera`]: camera files, which the player and the host tool draw from.

use std::path::Path;

use codec::Camera;

use crate::{Fault, read_error};

/// Reads a camera file: JSON with `width`, `height`, `K` (3x3) and `world_to_camera` (4x4).
///
/// # Errors
/// [`Fault::Data`] with the path and the reason.
pub fn read_camera(path: &Path) -> Result<Camera, Fault> {
    let fault = |what: String| Fault::Data(format!("camera {}: {what}", path.display()));
    let text = std::fs::read_to_string(path).map_err(|error| fault(read_error(&error)))?;
    let camera: Camera = serde_json::from_str(&text)
        .map_err(|error| fault(format!("{error}: --help describes a camera file")))?;
    camera.check().map_err(|problem| fault(format!("{problem}: correct it")))?;
    Ok(camera)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_camera_is_read_and_a_fault_names_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("camera.json");
        let camera = Camera::look_at([0.0, 1.0, 2.0], [0.0; 3], [0.0, 1.0, 0.0], 1.0, 64, 48);
        std::fs::write(&path, serde_json::to_string(&camera).unwrap()).unwrap();
        assert_eq!(read_camera(&path), Ok(camera));
        let no_focal_length = r#"{"width":1,"height":1,"K":[[0,0,0],[0,0,0],[0,0,1]],
            "world_to_camera":[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}"#;
        for text in [None, Some("{}"), Some(no_focal_length)] {
            text.map_or_else(|| std::fs::remove_file(&path), |text| std::fs::write(&path, text)).unwrap();
            let Err(Fault::Data(message)) = read_camera(&path) else { panic!("{text:?} is no camera") };
            assert!(message.starts_with(&format!("camera {}: ", path.display())), "{message}");
        }
    }
}
