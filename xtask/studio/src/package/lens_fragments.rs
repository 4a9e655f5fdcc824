//! [`lens_fragments`]: what a scene and its package cost a headset.
//!
//! Counted in the quads that the player draws, through the lens of a Quest 3, at three standpoints: the numbers of
//! Gaussians and bytes say nothing about them.

use codec::{Clip, Field};
use program::{Lens, Standpoint};
use refine::prune::instants;
use refine::reference::{Radius, RenderScene, coverage};
use serde::Serialize;

use super::views::render_scene;

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
    /// The viewer 0.7 m in front of the centre ("near"), 2 m in front of it ("standing"), or in it ("inside").
    pub standpoint: &'static str,
    /// Those of the scene's visible Gaussians.
    pub before: f64,
    /// Those of the package's Gaussians.
    pub after: f64,
}

/// The fragments of `clip`, the decoded package of the visible `field` and `plate`, at every standpoint.
pub(super) fn lens_fragments(field: &Field, plate: Option<&Field>, clip: &Clip) -> Vec<LensFragments> {
    let viewpoint = &clip.viewpoints()[0];
    let instants = instants(field, INSTANTS);
    let [width, height] = LENS.size();
    let pixels = 2.0 * f64::from(width) * f64::from(height) * instants.len() as f64;
    let count = |(standpoint, name)| {
        let eyes = LENS.cameras(clip, viewpoint, Some(standpoint), [width, height]);
        let per_pixel = |scene: &RenderScene| {
            let views = instants.iter().flat_map(|&t| eyes.iter().map(move |eye| (eye, t)));
            views.map(|(eye, t)| coverage(scene, eye, t, Radius::Exact).fragments).sum::<u64>() as f64
                / pixels
        };
        LensFragments {
            standpoint: name,
            before: per_pixel(&render_scene(field, plate)),
            after: per_pixel(&RenderScene::from(clip)),
        }
    };
    STANDPOINTS.into_iter().map(count).collect()
}
