//! [`Start`]: what a fit starts from.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::bail;
use program::Fault;
use refine::anchor::{
    Alignment, AnchorError, AnchorFrame, AnchorSettings, AnchorView, DepthSource, anchor, scatter,
};
use refine::capture::PhotoId;
use refine::fit::{Fit, Parameters, Photograph, TrainingView};
use serde::{Deserialize, Serialize};

use super::{Settings, Shots};
use crate::capture::Footage;
use crate::input::Input;

/// What a fit starts from.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Start {
    /// The visual hull of the masks.
    Hull,
    /// The visual hull, refined by plane sweep.
    Sweep,
    /// Depth maps in a folder, named as the photographs are.
    Depths(String, DepthScale),
    /// Nothing: Gaussians anywhere.
    Scatter,
    /// A fitted field or a package, and a checksum of it.
    Field(String, u32),
}

/// How depth maps come to the scale of the cameras.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum DepthScale {
    /// [`DepthScale::Hull`] where masks carve a hull in every frame, else [`DepthScale::Rig`].
    Auto,
    /// They are in units of the capture.
    Metric,
    /// One factor for all: their median becomes the radius of the rig (the paper's rule).
    Rig,
    /// A factor and an offset for each, by which it fits the visual hull.
    Hull,
}

impl DepthScale {
    fn alignment(self, shots: &Shots) -> Alignment {
        match self {
            DepthScale::Auto if has_hull(shots) => Alignment::Hull,
            DepthScale::Auto | DepthScale::Rig => Alignment::Rig,
            DepthScale::Metric => Alignment::Metric,
            DepthScale::Hull => Alignment::Hull,
        }
    }
}

/// Whether masks carve a visual hull in every frame: two cameras or more see the subject, and one of
/// them what is beside it.
fn has_hull(shots: &Shots) -> bool {
    let mut frames: BTreeMap<usize, Vec<&Photograph>> = BTreeMap::new();
    for (taken, shot) in &shots.train {
        frames.entry(taken.frame).or_default().push(&shot.photograph);
    }
    frames.values().all(|photographs| {
        let seen: Vec<_> = photographs.iter().filter(|photograph| photograph.has_subject()).collect();
        seen.is_empty() || (seen.len() >= 2 && seen.iter().any(|photograph| photograph.is_masked()))
    })
}

/// A fit at its first step.
///
/// # Errors
/// [`Fault::Data`] where there is nothing to start from, or a file cannot be read.
pub(super) fn start(settings: &Settings, footage: &Footage, shots: &Shots) -> anyhow::Result<Fit> {
    let wanted = AnchorSettings {
        views: grounding(settings, footage)?,
        gaussians: settings.gaussians,
        mirror: settings.mirror,
        sh_degree: settings.sh_degree,
        ..AnchorSettings::default()
    };
    let parameters = match &settings.start {
        Start::Hull => {
            anchored(AnchorSettings { source: DepthSource::Hull, ..wanted }, footage, shots, None)?
        }
        Start::Sweep => {
            anchored(AnchorSettings { source: DepthSource::HullAndSweep, ..wanted }, footage, shots, None)?
        }
        Start::Depths(folder, scale) => {
            let source = DepthSource::Given(scale.alignment(shots));
            anchored(AnchorSettings { source, ..wanted }, footage, shots, Some(Path::new(folder)))?
        }
        Start::Scatter => {
            let cameras: Vec<_> = footage.capture.cameras.iter().map(|camera| &camera.camera).collect();
            scatter(&wanted, shots.timeline, &cameras, settings.seed)
                .map_err(|error| Fault::Data(error.to_string()))?
        }
        Start::Field(path, _) => {
            let (field, _) = Input::load(Path::new(path))?.into_field();
            Parameters::from_field(&field, shots.timeline)
        }
    };
    if parameters.is_empty() {
        bail!(Fault::Data("there is no Gaussian to start from".into()));
    }
    let cameras = shots.train.iter().map(|(_, shot)| &shot.camera);
    Ok(Fit::new(settings.of_fit(), parameters, shots.timeline, cameras))
}

/// Numbers of the cameras that are to ground the anchor; `None` for all.
fn grounding(settings: &Settings, footage: &Footage) -> Result<Option<Vec<usize>>, Fault> {
    let number = |name: &String| {
        let found = footage.capture.cameras.iter().position(|camera| camera.name == *name);
        found.ok_or_else(|| {
            Fault::Usage(format!("--anchor-cameras: the capture has no camera \"{name}\" to look at"))
        })
    };
    let numbers: Vec<usize> = settings.anchor_cameras.iter().map(number).collect::<Result<_, _>>()?;
    Ok((!numbers.is_empty()).then_some(numbers))
}

/// What stops an anchor: itself, or a depth map.
enum Stop {
    Anchor(AnchorError),
    Fault(Fault),
}

impl From<AnchorError> for Stop {
    fn from(error: AnchorError) -> Stop {
        Stop::Anchor(error)
    }
}

fn anchored(
    wanted: AnchorSettings,
    footage: &Footage,
    shots: &Shots,
    depths: Option<&Path>,
) -> Result<Parameters<f32>, Fault> {
    let mut frames: BTreeMap<usize, Vec<&(PhotoId, TrainingView)>> = BTreeMap::new();
    for shot in &shots.train {
        frames.entry(shot.0.frame).or_default().push(shot);
    }
    let view = |(taken, shot): &(PhotoId, TrainingView)| {
        let depths = match depths {
            Some(folder) => footage.depth(folder, *taken).map_err(Stop::Fault)?,
            None => None,
        };
        let (camera, photograph) = (shot.camera.clone(), shot.photograph.clone());
        Ok(AnchorView { camera_id: taken.camera, camera, photograph, depths })
    };
    let frames = frames.into_iter().map(|(frame, shots)| {
        let views = shots.into_iter().map(view).collect::<Result<_, Stop>>()?;
        Ok(AnchorFrame { frame, views })
    });
    let mut parameters = anchor(&wanted, shots.timeline, frames).map_err(|stop| match stop {
        Stop::Anchor(error) => Fault::Data(format!("no anchor: {error}")),
        Stop::Fault(fault) => fault,
    })?;
    // An anchor counts frames; those of some captures are not at even distances.
    let times = &footage.capture.times;
    for tau in &mut parameters.tau {
        *tau = (times[*tau as usize] * shots.timeline.frames_per_clip()) as f32;
    }
    Ok(parameters)
}

#[cfg(test)]
mod tests {
    use codec::Camera;
    use refine::fit::Timeline;

    use super::*;

    /// A photograph of a frame whose alpha is this, from left to right.
    fn shot(camera: usize, frame: usize, alpha: [u8; 2]) -> (PhotoId, TrainingView) {
        let photograph = Photograph {
            width: 2,
            height: 1,
            pixels: alpha.map(|alpha| [0, 0, 0, alpha]).to_vec(),
            valid: Vec::new(),
        };
        let camera_of = Camera::look_at([0.0, 0.0, -2.0], [0.0; 3], [0.0, -1.0, 0.0], 1.0, 2, 1);
        (PhotoId { camera, frame }, TrainingView { camera: camera_of, frame: frame as f64, photograph })
    }

    #[test]
    fn depths_are_scaled_on_the_hull_where_every_frame_has_one() {
        let scale = |train: Vec<_>| {
            let shots = Shots { train, held: Vec::new(), timeline: Timeline { frames: 2 } };
            DepthScale::Auto.alignment(&shots)
        };
        let (cut, full, empty) = ([255, 0], [255, 255], [0, 0]);
        let both = || vec![shot(0, 0, cut), shot(1, 0, full)];
        assert_eq!(scale(both()), Alignment::Hull);
        assert_eq!(scale(vec![shot(0, 0, full), shot(1, 0, full)]), Alignment::Rig, "no masks");
        assert_eq!(scale([both(), vec![shot(0, 1, cut)]].concat()), Alignment::Rig, "a frame of one camera");
        let left = vec![shot(0, 1, empty), shot(1, 1, empty)];
        assert_eq!(scale([both(), left].concat()), Alignment::Hull, "nobody is there any more");
    }
}
