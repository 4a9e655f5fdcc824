//! Makes the first Gaussians of a fit from its [`FitStart`].

use std::path::Path;

use anyhow::bail;
use codec::{Field, sh_coefficients};
use program::Fault;
use refine::anchor::{
    Alignment, AnchorError, AnchorFrame, AnchorSettings, AnchorView, DepthSource, anchor, scatter,
};
use refine::capture::{PhotoId, Response};
use refine::fit::{CameraGains, Carried, Fit, Learned, Parameters, Rig, Timeline, TrainingView};

use super::plan::{DepthScale, FitPlan, FitStart};
use super::training_views::{TrainingViews, by_frame};
use crate::capture::CaptureFiles;
use crate::input::Input;

/// A plate, as the fit of what moves before it starts from it.
#[derive(Clone, Debug)]
pub struct FittedPlate {
    /// Its rows.
    pub field: Field,
    /// What was learned of the cameras for it.
    pub learned: Learned,
}

/// Width of the window of what is always on, in clips.
pub(super) const ALWAYS: f64 = 16.0;

impl DepthScale {
    fn alignment(self, views: &TrainingViews) -> Alignment {
        match self {
            DepthScale::Auto if has_hull(views) => Alignment::Hull,
            DepthScale::Auto | DepthScale::Rig => Alignment::Rig,
            DepthScale::Metric => Alignment::Metric,
            DepthScale::Hull => Alignment::Hull,
        }
    }
}

/// Whether masks carve a visual hull in every frame: at least two photographs show the subject, and at
/// least one of these is masked.
fn has_hull(views: &TrainingViews) -> bool {
    by_frame(&views.train).values().all(|views| {
        let photographs = views.iter().map(|(_, view)| &view.photograph);
        let seen: Vec<_> = photographs.filter(|photograph| photograph.has_subject()).collect();
        seen.is_empty() || (seen.len() >= 2 && seen.iter().any(|photograph| photograph.is_masked()))
    })
}

/// A fit before its first step.
///
/// # Errors
/// [`Fault::Data`] if there is no Gaussian to start from or a file cannot be read.
pub(super) fn start(
    plan: &FitPlan,
    capture_files: &CaptureFiles,
    views: &TrainingViews,
    plate: Option<&FittedPlate>,
) -> anyhow::Result<Fit> {
    let mut parameters = match &plan.start {
        FitStart::Hull | FitStart::Sweep | FitStart::Depths(..) => {
            let frame_time = |frame| capture_files.capture.frame_clip_time(frame) * views.timeline.intervals;
            let train: Vec<&(PhotoId, TrainingView)> = views.train.iter().collect();
            let anchored = anchored(plan, plan.gaussians, capture_files, views, &train, &frame_time);
            anchored.map_err(AnchorFault::into_fault)?
        }
        FitStart::Scatter => {
            let cameras: Vec<_> = capture_files.capture.cameras.iter().map(|camera| &camera.camera).collect();
            scatter(
                &anchor_settings(plan, plan.gaussians, capture_files)?,
                views.timeline,
                &cameras,
                plan.seed,
            )
            .map_err(|error| Fault::Data(error.to_string()))?
        }
        FitStart::Field(path, _) => {
            let (field, _) = Input::load(Path::new(path))?.into_field();
            Parameters { near: plan.near, ..Parameters::from_field(&field, views.timeline) }
        }
    };
    if parameters.is_empty() {
        bail!(Fault::Data(
            "there is no Gaussian to start from; choose another --anchor, or more --gaussians".into()
        ));
    }
    let rig = match plate {
        Some(plate) => {
            let learned = Learned { gains: plan.learned.gains || plate.learned.gains, ..plan.learned };
            views.rig(learned)
        }
        None => rig(plan, &parameters, views),
    };
    let carried =
        plate.map(|plate| put_behind(&mut parameters, &plate.field, Carried::STATIC, views.timeline));
    let cameras = views.train.iter().map(|(_, view)| &view.camera);
    let fit = Fit::new(plan.fit_settings(), parameters, views.timeline, cameras).seen_by(rig);
    Ok(match carried {
        Some(carried) => fit.carrying(carried),
        None => fit,
    })
}

/// Root mean square of the gains of cameras from which on they are learned. Cameras of a dome differ by 0.10.
const DISAGREEMENT_MIN: f64 = 0.02;

/// The cameras: as the plan says. Where it learns their colours, or does so if they disagree, and they disagree, from gains
/// that are measured here. Says so in a line.
fn rig(plan: &FitPlan, parameters: &Parameters<f32>, views: &TrainingViews) -> Rig {
    // In front of a background, half of a subject's surface is hidden, and would pass for another colour.
    if !(plan.measures_gains() && views.are_whole() && views.responses.iter().all(Response::is_neutral)) {
        return views.rig(plan.learned);
    }
    let train: Vec<&TrainingView> = views.train.iter().map(|(_, view)| view).collect();
    let gains = CameraGains::measure(parameters, &train);
    let Some(disagreement) = gains.disagreement() else { return views.rig(plan.learned) };
    let percent = 100.0 * disagreement;
    if disagreement < DISAGREEMENT_MIN {
        eprintln!("note: cameras agree about colours within {percent:.1} %");
        return views.rig(plan.learned);
    }
    let what = if plan.learned.colors { "a transform of colours" } else { "gain, offset" };
    eprintln!(
        "note: cameras show the same in colours that differ by {percent:.1} %: {what} and vignette of each are learned"
    );
    let learned = Learned { gains: !plan.learned.colors, ..plan.learned };
    views.rig_from(learned, &gains.responses(views.responses.len()))
}

/// Adds the rows of a plate to `parameters`, always on and behind all others, with the columns of these. Returns the past of
/// each row: `of_plate` for rows of the plate, none for the others.
pub(super) fn put_behind(
    parameters: &mut Parameters<f32>,
    plate: &Field,
    of_plate: Carried,
    timeline: Timeline,
) -> Vec<Carried> {
    let plate = Parameters::<f32>::from_field(plate, timeline);
    let mut rows = parameters.zeros(plate.len());
    let [to, from] = [&rows, &plate].map(|rows| sh_coefficients(rows.sh_degree));
    for (to, from) in rows.sh.chunks_mut(to).zip(plate.sh.chunks(from)) {
        to.iter_mut().zip(from).for_each(|(to, from)| *to = *from);
    }
    rows.tau.fill((0.5 * timeline.intervals) as f32);
    rows.log_widths.fill(libm::log(ALWAYS * timeline.intervals) as f32);
    let carried = [vec![Carried::NONE; parameters.len()], vec![of_plate; plate.len()]].concat();
    let Parameters { centers, rotations, log_scales, logits, .. } = plate;
    let behind = vec![true; centers.len()];
    parameters.append(Parameters { centers, rotations, log_scales, logits, behind, ..rows });
    carried
}

/// Indices of the cameras whose pixels become Gaussians; `None` for all cameras.
fn anchor_cameras(plan: &FitPlan, capture_files: &CaptureFiles) -> Result<Option<Vec<usize>>, Fault> {
    let index =
        |name: &String| capture_files.camera(name).map_err(|fault| fault.about("--set anchor-cameras"));
    let indices: Vec<usize> = plan.anchor_cameras.iter().map(index).collect::<Result<_, _>>()?;
    Ok((!indices.is_empty()).then_some(indices))
}

fn anchor_settings(
    plan: &FitPlan,
    gaussians: usize,
    capture_files: &CaptureFiles,
) -> Result<AnchorSettings, Fault> {
    Ok(AnchorSettings {
        views: anchor_cameras(plan, capture_files)?,
        gaussians,
        mirror: plan.mirror,
        motion_start: plan.motion_start,
        filter: plan.filter,
        near: plan.near,
        sh_degree: plan.sh_degree,
        ..AnchorSettings::default()
    })
}

/// An error while making an anchor: of the anchor, or of a depth map.
pub(super) enum AnchorFault {
    Anchor(AnchorError),
    Fault(Fault),
}

impl From<AnchorError> for AnchorFault {
    fn from(error: AnchorError) -> AnchorFault {
        AnchorFault::Anchor(error)
    }
}

impl AnchorFault {
    pub(super) fn into_fault(self) -> Fault {
        match self {
            AnchorFault::Anchor(error) => Fault::Data(format!("no anchor: {error}")),
            AnchorFault::Fault(fault) => fault,
        }
    }
}

/// About `gaussians` Gaussians on the surfaces that the photographs `train` of `views` show, by the start of the plan,
/// which has an anchor; `frame_time` gives the time of a frame in intervals.
pub(super) fn anchored(
    plan: &FitPlan,
    gaussians: usize,
    capture_files: &CaptureFiles,
    views: &TrainingViews,
    train: &[&(PhotoId, TrainingView)],
    frame_time: &dyn Fn(usize) -> f64,
) -> Result<Parameters<f32>, AnchorFault> {
    let (source, depths) = match &plan.start {
        FitStart::Hull => (DepthSource::Hull, None),
        FitStart::Depths(folder, scale) => {
            (DepthSource::Given(scale.alignment(views)), Some(Path::new(folder)))
        }
        FitStart::Sweep | FitStart::Scatter | FitStart::Field(..) => (DepthSource::HullAndSweep, None),
    };
    let settings = anchor_settings(plan, gaussians, capture_files).map_err(AnchorFault::Fault)?;
    let anchor_view = |(photo_id, view): &(PhotoId, TrainingView)| {
        let depths = match depths {
            Some(folder) => capture_files.depth(folder, *photo_id).map_err(AnchorFault::Fault)?,
            None => None,
        };
        let (camera, photograph) = (view.camera.clone(), view.photograph.clone());
        Ok(AnchorView { camera_id: photo_id.camera, camera, photograph, depths })
    };
    let frames = by_frame(train.iter().copied()).into_iter().map(|(frame, views)| {
        let views = views.into_iter().map(anchor_view).collect::<Result<_, AnchorFault>>()?;
        Ok(AnchorFrame { frame, time: frame_time(frame), views })
    });
    anchor(&AnchorSettings { source, ..settings }, views.timeline, frames)
}

#[cfg(test)]
mod tests {
    use codec::Camera;
    use refine::fit::{Photograph, Timeline};

    use super::*;

    /// A photograph of two pixels with these alphas, from left to right.
    fn view(camera: usize, frame: usize, alpha: [u8; 2]) -> (PhotoId, TrainingView) {
        let photograph = Photograph {
            width: 2,
            height: 1,
            pixels: alpha.map(|alpha| [0, 0, 0, alpha]).to_vec(),
            valid: Vec::new(),
        };
        let camera_of = Camera::look_at([0.0, 0.0, -2.0], [0.0; 3], [0.0, -1.0, 0.0], 1.0, 2, 1);
        let view = TrainingView { camera_id: camera, camera: camera_of, time: frame as f64, photograph };
        (PhotoId { camera, frame }, view)
    }

    #[test]
    fn depths_are_scaled_on_the_hull_where_every_frame_has_one() {
        let scale = |train: Vec<_>| {
            let views =
                TrainingViews { train, held: Vec::new(), timeline: Timeline::even(2), responses: Vec::new() };
            DepthScale::Auto.alignment(&views)
        };
        let (partial, full, empty) = ([255, 0], [255, 255], [0, 0]);
        let both = || vec![view(0, 0, partial), view(1, 0, full)];
        assert_eq!(scale(both()), Alignment::Hull);
        assert_eq!(scale(vec![view(0, 0, full), view(1, 0, full)]), Alignment::Rig, "no masks");
        assert_eq!(
            scale([both(), vec![view(0, 1, partial)]].concat()),
            Alignment::Rig,
            "a frame of one camera"
        );
        let left = vec![view(0, 1, empty), view(1, 1, empty)];
        assert_eq!(scale([both(), left].concat()), Alignment::Hull, "an empty frame");
    }
}
