//! [`Overrides`]: the contents of a `scene.json`.

use std::fs;
use std::path::Path;

use codec::Viewpoint;
use serde::Deserialize;

use crate::error::ImportError;

/// Metadata of a clip that takes precedence over the metadata of its field file; `None` where the file decides.
#[derive(Clone, Debug, Default)]
pub struct Overrides {
    /// Length of the clip in seconds, above 0.
    pub duration_s: Option<f32>,
    /// Captured frames per second, above 0.
    pub fps: Option<f32>,
    /// Unit vector of the source's axes that points up.
    pub up: Option<[f32; 3]>,
    /// Metres per unit of the source, above 0.
    pub metres_per_unit: Option<f32>,
    /// Suggested viewpoints, the initial one first.
    pub viewpoints: Option<Vec<Viewpoint>>,
}

/// The file as it is written.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Document {
    duration_s: Option<f32>,
    fps: Option<f32>,
    up: Option<[f32; 3]>,
    metres_per_unit: Option<f32>,
    viewpoints: Option<Vec<ViewpointEntry>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ViewpointEntry {
    name: String,
    position: [f32; 3],
    target: [f32; 3],
    fov_y_deg: f32,
}

impl Overrides {
    /// Reads a `scene.json`.
    ///
    /// # Errors
    /// [`ImportError`] that names the file and the key.
    pub fn load(path: &Path) -> Result<Overrides, ImportError> {
        let text = fs::read_to_string(path).map_err(|error| ImportError::unreadable(path, &error))?;
        let text = text.trim_start_matches('\u{feff}');
        let document: Document = serde_json::from_str(text)
            .map_err(|error| ImportError::new(path, format!("{error}; `package --help` shows its keys")))?;
        document.check().map_err(|what| ImportError::new(path, what))?;
        Ok(Overrides {
            duration_s: document.duration_s,
            fps: document.fps,
            up: document.up.and_then(normalized),
            metres_per_unit: document.metres_per_unit,
            viewpoints: document.viewpoints.map(|views| views.into_iter().map(Viewpoint::from).collect()),
        })
    }
}

impl Document {
    fn check(&self) -> Result<(), String> {
        let positive = |key: &str, value: Option<f32>| match value {
            Some(x) if !(x.is_finite() && x > 0.0) => {
                Err(format!("{key} must be a positive number, not {x}"))
            }
            _ => Ok(()),
        };
        positive("duration_s", self.duration_s)?;
        positive("fps", self.fps)?;
        positive("metres_per_unit", self.metres_per_unit)?;
        if let Some(up) = self.up
            && normalized(up).is_none()
        {
            return Err(format!("up must be a direction, not {up:?}"));
        }
        let views = self.viewpoints.as_deref().unwrap_or_default();
        for (i, view) in views.iter().enumerate() {
            let at = format!("viewpoints[{i}]");
            if view.name.is_empty() {
                return Err(format!("{at}.name is empty; name it"));
            }
            if views[..i].iter().any(|other| other.name == view.name) {
                return Err(format!("{at}.name \"{}\" is there twice; rename one", view.name));
            }
            if !view.position.iter().chain(&view.target).all(|x| x.is_finite()) {
                return Err(format!("{at}: a coordinate is not a finite number; correct it"));
            }
            if view.position == view.target {
                return Err(format!("{at}: position and target are the same point; move one"));
            }
            if !(view.fov_y_deg > 0.0 && view.fov_y_deg < 180.0) {
                return Err(format!("{at}.fov_y_deg must lie between 0 and 180, not {}", view.fov_y_deg));
            }
        }
        Ok(())
    }
}

impl From<ViewpointEntry> for Viewpoint {
    fn from(view: ViewpointEntry) -> Viewpoint {
        Viewpoint {
            name: view.name,
            position: view.position,
            target: view.target,
            fov_y: view.fov_y_deg.to_radians(),
        }
    }
}

/// A vector of length 1; `None` if it has no direction.
pub(crate) fn normalized(v: [f32; 3]) -> Option<[f32; 3]> {
    let length = v.iter().map(|x| x * x).sum::<f32>().sqrt();
    (length.is_finite() && length > 1e-6).then(|| v.map(|x| x / length))
}
