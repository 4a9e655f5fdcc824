//! [`lens_fragments`] and [`LensCounter`]: what a scene and its package cost a headset.
//!
//! Counted in the quads that the player draws, through the lens of a Quest 3, at three standpoints: the numbers of
//! Gaussians and bytes say nothing about them.

use codec::{Camera, Clip, Field};
use program::{Lens, Standpoint, Subject};
use refine::prune::instants;
use refine::reference::{Radius, RenderScene, coverage};
use serde::Serialize;

use super::views::render_scene;
use crate::scene::Scene;

/// Number of instants that the counts average.
const INSTANTS: usize = 4;

/// The lens.
const LENS: Lens = Lens::Quest3;

/// The standpoints with their names in reports.
const STANDPOINTS: [(Standpoint, &str); 3] =
    [(Standpoint::Near, "near"), (Standpoint::Standing, "standing"), (Standpoint::Inside, "inside")];

/// Fragments per pixel of both eyes, mean over a few instants.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct LensFragments {
    /// The viewer 0.7 m in front of the middle of the content ("near"), 2 m in front of it ("standing"), or in it ("inside").
    pub standpoint: &'static str,
    /// Those of the scene's visible Gaussians.
    pub before: f64,
    /// Those of the package's Gaussians.
    pub after: f64,
}

/// The eyes of a viewer and the instants at which they look: scenes are counted by the same pictures.
pub(crate) struct LensCounter {
    eyes: [Camera; 2],
    instants: Vec<f64>,
}

impl LensCounter {
    /// A viewer of `subject` at `standpoint`, at a few instants at which `field` has Gaussians. `up` is the clip's.
    pub(crate) fn new(subject: &Subject, up: [f32; 3], field: &Field, standpoint: Standpoint) -> LensCounter {
        let eyes = LENS.cameras(&standpoint.camera(subject, up), subject.metres_per_unit, LENS.size());
        LensCounter { eyes, instants: instants(field, INSTANTS) }
    }

    /// Fragments per pixel of both eyes, mean over the instants.
    pub(crate) fn per_pixel(&self, scene: &RenderScene) -> f64 {
        let [width, height] = LENS.size().map(f64::from);
        let pixels = 2.0 * width * height * self.instants.len() as f64;
        let counts = self.instants.iter().map(|&t| coverage(scene, &self.eyes, t, Radius::Exact).fragments);
        counts.sum::<u64>() as f64 / pixels
    }
}

/// The fragments of `clip`, the decoded package of the visible `field` and `plate` of `scene`, at every standpoint. The scene
/// places the viewer, not the package, so that packages with other budgets compare.
pub(super) fn lens_fragments(
    scene: &Scene,
    field: &Field,
    plate: Option<&Field>,
    clip: &Clip,
) -> Vec<LensFragments> {
    let subject = Subject::new(&scene.info, scene.surroundings());
    let count = |(standpoint, name)| {
        let counter = LensCounter::new(&subject, scene.info.up, field, standpoint);
        LensFragments {
            standpoint: name,
            before: counter.per_pixel(&render_scene(field, plate)),
            after: counter.per_pixel(&RenderScene::from(clip)),
        }
    };
    STANDPOINTS.into_iter().map(count).collect()
}
