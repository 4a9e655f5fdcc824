//! A [`StabilityCase`]: what is drawn, and how far the GPU's picture may be from the reference's.

use client::gpu::SortOrder;
use codec::{Camera, Clip, ClipInfo, Field, LayerEnd, TimeIndex};
use refine::prune::PosedView;

use crate::scene::info;

/// A case: what is drawn, and what of it is measured.
pub struct StabilityCase {
    /// What makes it hard.
    pub group: &'static str,
    /// Unique among the cases.
    pub name: String,
    /// How the renderer, or the packer before it, handles it.
    pub how: &'static str,
    /// Largest deviation that is allowed, in the unit of the measure.
    pub bound: f64,
    /// What is measured.
    pub measure: DeviationKind,
    /// Whether it takes seconds where the GPU is a program.
    pub slow: bool,
    /// Makes the scene.
    pub scene: Box<dyn Fn() -> StabilityScene + Send + Sync>,
}

/// What of the pictures is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DeviationKind {
    /// The largest difference of a channel from the reference, alpha among them, in 255ths.
    Largest,
    /// The root mean square of these differences over a picture, in 255ths.
    Mean,
    /// The largest change of a channel from one posed_view to the next, in 255ths.
    Change,
    /// How far the only Gaussian is from where the trajectory equation puts it, in pixels.
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

/// What is drawn.
pub struct StabilityScene {
    /// The Gaussians.
    pub clip: Clip,
    /// What they are meant to look like, where that is not what the reference makes of `clip`.
    pub meant: Option<Clip>,
    /// From where and when; all of one size.
    pub posed_views: Vec<PosedView>,
    /// What they are sorted by.
    pub sort: SortOrder,
    /// Whether a package can hold them.
    pub coding: PackageExpectation,
    /// Whether nothing is to be seen. Otherwise a picture that shows nothing fails: it tests nothing.
    pub blank: bool,
}

/// Whether a package can hold a field.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PackageExpectation {
    /// Both coders take it; what they decode to is drawn, too.
    Taken,
    /// The encoder says that it cannot, in words that hold these.
    Refused(&'static str),
    /// Not tried, for this reason.
    Untried(&'static str),
}

/// A case of the largest difference.
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
    /// A field that both coders take, seen as `posed_views` say.
    pub(super) fn new(field: Field, posed_views: Vec<PosedView>) -> StabilityScene {
        StabilityScene {
            clip: exact(field),
            meant: None,
            posed_views,
            sort: SortOrder::Depth,
            coding: PackageExpectation::Taken,
            blank: false,
        }
    }

    /// The same, refused by the encoder.
    pub(super) fn refused(self, words: &'static str) -> StabilityScene {
        StabilityScene { coding: PackageExpectation::Refused(words), ..self }
    }

    /// The same, not packaged for this reason.
    pub(super) fn untried(self, reason: &'static str) -> StabilityScene {
        StabilityScene { coding: PackageExpectation::Untried(reason), ..self }
    }

    /// The same, meant to look like `field`.
    pub(super) fn meant(self, field: Field) -> StabilityScene {
        StabilityScene { meant: Some(exact(field)), ..self }
    }
}

/// A field as a clip, bit-exact: not coded.
pub(super) fn exact(field: Field) -> Clip {
    let bounds = field.bounds();
    let (static_field, dynamic_field) =
        if field.temporal.is_some() { (Field::default(), field) } else { (field, Field::default()) };
    let end = LayerEnd { static_count: static_field.len(), dynamic_count: dynamic_field.len() };
    Clip {
        info: ClipInfo { viewpoints: Vec::new(), ..info() },
        bounds,
        time_index: TimeIndex::of_candidates(dynamic_field.len()),
        static_field,
        dynamic_field,
        layers: vec![end],
        layers_announced: 1,
        plate: None,
    }
}

/// The field that [`exact`] made a clip of.
pub(super) fn field_of(clip: &Clip) -> &Field {
    if clip.dynamic_field.is_empty() { &clip.static_field } else { &clip.dynamic_field }
}

/// Size of the pictures in pixels, unless a case has its own.
const SIZE: (u32, u32) = (96, 72);

/// How far in front of the origin the usual camera stands, and its vertical field of view.
pub(super) const DISTANCE: f64 = 4.0;
const FOV_Y: f64 = 0.8;

/// The usual camera: on the z axis, looking along it at the origin; x right, y down.
fn front() -> Camera {
    look([0.0, 0.0, -DISTANCE], [0.0; 3])
}

/// A camera with y down.
pub(super) fn look(position: [f64; 3], target: [f64; 3]) -> Camera {
    Camera::look_at(position, target, [0.0, -1.0, 0.0], FOV_Y, SIZE.0, SIZE.1)
}

/// The usual camera at these instants.
pub(super) fn at(instants: &[f64]) -> Vec<PosedView> {
    instants.iter().map(|&t| PosedView { camera: front(), t }).collect()
}
