//! [`StabilityCase`]: a scene to draw, and the largest deviation allowed between the GPU's image and the
//! reference's.

use client::gpu::{SortOrder, Span, TakeLayout};
use codec::{Camera, Clip, ClipInfo, Field};
use refine::reference::PosedView;

use crate::scene::info;

/// A scene to draw, and the deviation to measure.
pub struct StabilityCase {
    /// The kind of difficulty.
    pub group: &'static str,
    /// Unique among the cases.
    pub name: String,
    /// How the renderer, or the packer before it, handles the difficulty.
    pub how: &'static str,
    /// Largest allowed deviation, in the unit of `measure`.
    pub bound: f64,
    /// The measured deviation.
    pub measure: DeviationKind,
    /// Whether it takes seconds on a software GPU.
    pub slow: bool,
    /// Makes the scene.
    pub scene: Box<dyn Fn() -> StabilityScene + Send + Sync>,
}

/// A deviation of images, as a case measures it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DeviationKind {
    /// Largest difference from the reference in any channel, alpha included, in 255ths.
    Largest,
    /// Root mean square of these differences over an image, in 255ths.
    Mean,
    /// Largest change of a channel from one view to the next, in 255ths.
    Change,
    /// Distance of the only Gaussian from its place by the trajectory equation, in pixels.
    Place,
}

impl DeviationKind {
    /// The unit of the deviation.
    pub fn unit(self) -> &'static str {
        match self {
            DeviationKind::Largest => "/255",
            DeviationKind::Mean => "/255 rms",
            DeviationKind::Change => "/255 a frame",
            DeviationKind::Place => "px",
        }
    }
}

/// The scene of a case.
pub struct StabilityScene {
    /// The Gaussians.
    pub clip: Clip,
    /// The clip that the reference renders instead of `clip`, if the renderer is expected to change it.
    pub meant: Option<Clip>,
    /// The take that is drawn instead of `clip`, which is then its field unsplit.
    pub take: Option<TakeScene>,
    /// Cameras and instants; all images have one size.
    pub posed_views: Vec<PosedView>,
    /// Sort order of the Gaussians.
    pub sort: SortOrder,
    /// Whether a package can hold the Gaussians.
    pub coding: PackageExpectation,
    /// Whether every image must be blank. Otherwise a case whose images are all blank fails, because it tests
    /// nothing.
    pub blank: bool,
}

/// A take of segments.
pub struct TakeScene {
    /// Duration in seconds.
    pub duration_s: f64,
    /// The segments.
    pub segments: Vec<(Span, Clip)>,
    /// For each view, the clip time at which the reference draws the field unsplit.
    pub meant: Vec<f64>,
}

/// Whether a package can hold a field.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PackageExpectation {
    /// Both coders encode it; the decoded packages are drawn, too.
    Taken,
    /// The encoder refuses it with an error that contains these words.
    Refused(&'static str),
    /// Not encoded, for this reason.
    Untried(&'static str),
}

/// A case that measures [`DeviationKind::Largest`].
pub(super) fn case(
    group: &'static str,
    name: impl Into<String>,
    bound: f64,
    how: &'static str,
    scene: impl Fn() -> StabilityScene + Send + Sync + 'static,
) -> StabilityCase {
    StabilityCase {
        group,
        name: name.into(),
        how,
        bound,
        measure: DeviationKind::Largest,
        slow: false,
        scene: Box::new(scene),
    }
}

impl StabilityScene {
    /// A field that both coders encode, drawn from `posed_views`.
    pub(super) fn new(field: Field, posed_views: Vec<PosedView>) -> StabilityScene {
        StabilityScene {
            clip: exact(field),
            meant: None,
            take: None,
            posed_views,
            sort: SortOrder::Depth,
            coding: PackageExpectation::Taken,
            blank: false,
        }
    }

    /// The same scene, which the encoder refuses with an error that contains `words`.
    pub(super) fn refused(self, words: &'static str) -> StabilityScene {
        StabilityScene { coding: PackageExpectation::Refused(words), ..self }
    }

    /// The same scene, not encoded for this reason.
    pub(super) fn untried(self, reason: &'static str) -> StabilityScene {
        StabilityScene { coding: PackageExpectation::Untried(reason), ..self }
    }

    /// The same scene in front of a background.
    pub(super) fn before(self, plate: Field) -> StabilityScene {
        StabilityScene { clip: Clip { plate: Some(plate), ..self.clip }, ..self }
    }

    /// The same scene; the reference renders `field` instead.
    pub(super) fn meant(self, field: Field) -> StabilityScene {
        StabilityScene { meant: Some(exact(field)), ..self }
    }
}

impl TakeScene {
    /// What a renderer of the take is built for. `whole` is the field unsplit.
    pub(super) fn layout(&self, whole: &Clip) -> TakeLayout {
        // At one of the starts the most segments hold an instant.
        let at = |t_s: f64| {
            let held = self.segments.iter().filter(|(span, _)| span.holds(t_s, self.duration_s));
            held.map(|(_, clip)| clip.len()).sum::<usize>()
        };
        // Half of them for gaps between the rows of segments.
        let rows = 2 * self.segments.iter().map(|(span, _)| at(span.start_s)).max().unwrap_or(0);
        TakeLayout::for_clip(whole).segmented(self.duration_s).with_rows(rows)
    }
}

/// The clip of a field, bit-exact: without encoding.
pub(super) fn exact(field: Field) -> Clip {
    let bounds = field.bounds();
    let (static_field, dynamic_field) =
        if field.temporal.is_some() { (Field::default(), field) } else { (field, Field::default()) };
    let info = ClipInfo { viewpoints: Vec::new(), ..info() };
    Clip::of_one_layer(info, bounds, static_field, dynamic_field, None)
}

/// The field that [`exact`] made this clip from.
pub(super) fn field_of(clip: &Clip) -> &Field {
    if clip.dynamic_field.is_empty() { &clip.static_field } else { &clip.dynamic_field }
}

/// Default size of the images in pixels.
const SIZE: (u32, u32) = (96, 72);

/// Distance of the default camera from the origin, and its vertical field of view in radians.
pub(super) const DISTANCE: f64 = 4.0;
const FOV_Y: f64 = 0.8;

/// The default camera: on the negative z axis, looking at the origin; x right, y down.
fn front() -> Camera {
    look([0.0, 0.0, -DISTANCE], [0.0; 3])
}

/// A camera at `position` that looks at `target`, with y down.
pub(super) fn look(position: [f64; 3], target: [f64; 3]) -> Camera {
    Camera::look_at(position, target, [0.0, -1.0, 0.0], FOV_Y, SIZE.0, SIZE.1)
}

/// Views of the default camera at these instants.
pub(super) fn at(instants: &[f64]) -> Vec<PosedView> {
    instants.iter().map(|&t| PosedView { camera: front(), t }).collect()
}
