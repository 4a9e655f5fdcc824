//! Stability: the GPU's pictures of stiff and extreme fields against the f64 reference's.
//!
//! The cases are data: a field, what to look at, and how far the GPU's picture may be from the
//! reference's. [`cases`] lists them, [`run()`] measures one. `cargo xtask report --stability` prints
//! all as a table, and the test `stability` runs the same ones.
//!
//! The GPU gets the field itself, without a package between: most of what is here no package can
//! hold. Where one can, it is also drawn packaged, by each coder; where none can, the encoder has to
//! say so.

mod amount;
mod precision;
mod rows;
mod run;
mod space;
mod time;

use codec::{Camera, Clip, ClipInfo, Field, LayerEnd, TimeIndex};
pub use precision::along;
pub use run::{Meter, run};

use crate::scene::info;
use client::gpu::SortOrder;

/// A case: what is drawn, and what of it is measured.
pub struct Case {
    /// What makes it hard.
    pub group: &'static str,
    /// Unique among the cases.
    pub name: String,
    /// How the renderer, or the packer before it, handles it.
    pub how: &'static str,
    /// Largest deviation that is allowed, in the unit of the measure.
    pub bound: f64,
    /// What is measured.
    pub measure: Measure,
    /// Whether it takes seconds where the GPU is a program.
    pub slow: bool,
    /// Makes the scene.
    pub scene: Box<dyn Fn() -> Scene + Send + Sync>,
}

/// What of the pictures is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Measure {
    /// The largest difference of a channel from the reference, alpha among them, in 255ths.
    Largest,
    /// The root mean square of these differences over a picture, in 255ths.
    Mean,
    /// The largest change of a channel from one shot to the next, in 255ths.
    Change,
    /// How far the only Gaussian is from where the trajectory equation puts it, in pixels.
    Place,
}

impl Measure {
    /// The unit of the deviation.
    pub fn unit(self) -> &'static str {
        match self {
            Measure::Largest => "/255",
            Measure::Mean => "/255 rms",
            Measure::Change => "/255 a frame",
            Measure::Place => "px",
        }
    }
}

/// What is drawn.
pub struct Scene {
    /// The Gaussians.
    pub clip: Clip,
    /// What they are meant to look like, where that is not what the reference makes of `clip`.
    pub meant: Option<Clip>,
    /// From where and when; all of one size.
    pub shots: Vec<Shot>,
    /// What they are sorted by.
    pub sort: SortOrder,
    /// Whether a package can hold them.
    pub coding: Coding,
    /// Whether nothing is to be seen. Otherwise a picture that shows nothing fails: it tests nothing.
    pub blank: bool,
}

/// One picture.
#[derive(Clone, Debug)]
pub struct Shot {
    /// From where.
    pub camera: Camera,
    /// Clip time.
    pub t: f64,
}

/// Whether a package can hold a field.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Coding {
    /// Both coders take it; what they decode to is drawn, too.
    Taken,
    /// The encoder says that it cannot, in words that hold these.
    Refused(&'static str),
    /// Not tried, for this reason.
    Untried(&'static str),
}

/// All cases that need no files.
pub fn cases() -> Vec<Case> {
    [time::cases(), space::cases(), amount::cases(), precision::cases()].into_iter().flatten().collect()
}

/// A case of the largest difference.
fn case(
    group: &'static str,
    name: impl Into<String>,
    bound: f64,
    how: &'static str,
    scene: impl Fn() -> Scene + Send + Sync + 'static,
) -> Case {
    Case {
        group,
        name: name.into(),
        how,
        bound,
        measure: Measure::Largest,
        slow: false,
        scene: Box::new(scene),
    }
}

impl Scene {
    /// A field that both coders take, seen as `shots` say.
    fn new(field: Field, shots: Vec<Shot>) -> Scene {
        Scene {
            clip: exact(field),
            meant: None,
            shots,
            sort: SortOrder::Depth,
            coding: Coding::Taken,
            blank: false,
        }
    }

    /// The same, refused by the encoder.
    fn refused(self, words: &'static str) -> Scene {
        Scene { coding: Coding::Refused(words), ..self }
    }

    /// The same, not packaged for this reason.
    fn untried(self, reason: &'static str) -> Scene {
        Scene { coding: Coding::Untried(reason), ..self }
    }

    /// The same, meant to look like `field`.
    fn meant(self, field: Field) -> Scene {
        Scene { meant: Some(exact(field)), ..self }
    }
}

/// A field as a clip, to the last bit, whatever its numbers: no coder is between.
fn exact(field: Field) -> Clip {
    let bounds = field.bounds();
    let (still, moving) =
        if field.temporal.is_some() { (Field::default(), field) } else { (field, Field::default()) };
    let end = LayerEnd { static_count: still.len(), dynamic_count: moving.len() };
    Clip {
        info: ClipInfo { viewpoints: Vec::new(), ..info() },
        bounds,
        time_index: TimeIndex::of_candidates(moving.len()),
        static_field: still,
        dynamic_field: moving,
        layers: vec![end],
        layers_announced: 1,
        plate: None,
    }
}

/// The field that [`exact`] made a clip of.
fn field_of(clip: &Clip) -> &Field {
    if clip.dynamic_field.is_empty() { &clip.static_field } else { &clip.dynamic_field }
}

/// Size of the pictures in pixels, unless a case has its own.
const SIZE: (u32, u32) = (96, 72);

/// How far in front of the origin the usual camera stands, and its vertical field of view.
const DISTANCE: f64 = 4.0;
const FOV_Y: f64 = 0.8;

/// The usual camera: on the z axis, looking along it at the origin; x right, y down.
fn front() -> Camera {
    look([0.0, 0.0, -DISTANCE], [0.0; 3])
}

/// A camera with y down.
fn look(position: [f64; 3], target: [f64; 3]) -> Camera {
    Camera::look_at(position, target, [0.0, -1.0, 0.0], FOV_Y, SIZE.0, SIZE.1)
}

/// The usual camera at these instants.
fn at(instants: &[f64]) -> Vec<Shot> {
    instants.iter().map(|&t| Shot { camera: front(), t }).collect()
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn names_are_unique_and_bounds_are_bounds() {
        let cases = cases();
        let names: BTreeSet<&str> = cases.iter().map(|case| case.name.as_str()).collect();
        assert_eq!(names.len(), cases.len());
        assert!(cases.iter().all(|case| case.bound > 0.0 && case.bound < 8.0 && !case.how.is_empty()));
    }
}
