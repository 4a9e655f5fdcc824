//! Precision ladders: f32 against f64 along whole clips, packed records as time goes away from their
//! instant, and scenes of the user's own.

use codec::{Camera, Clip, ClipInfo, Field, Viewpoint};

use super::gaussians::{Gaussian, crowd, field};
use refine::prune::PosedView;

use super::case::{DeviationKind, PackageExpectation, StabilityCase, StabilityScene, at, case, exact};
use crate::scene::{Motion, Recipe};
use client::gpu::SortOrder;

const GROUP: &str = "precision";

/// Instants along a whole clip.
fn instants() -> Vec<f64> {
    (0..=16).map(|i| f64::from(i) / 16.0).collect()
}

// Long: a table of cases.
pub(super) fn cases() -> Vec<StabilityCase> {
    let mut cases = Vec::new();
    for order in 0..=3u8 {
        cases.push(case(
            GROUP,
            format!("along a clip, motion of order {order}, SH of degree {order}"),
            3.0,
            "f32 and packed records against f64, at 17 instants",
            move || {
                let recipe = Recipe {
                    count: 400,
                    sh_degree: order,
                    motion: Motion::Mixed,
                    motion_order: order,
                    turning: order == 3,
                    seed: 20 + u64::from(order),
                };
                StabilityScene::new(recipe.field(), at(&instants()))
            },
        ));
    }
    // As far from the record's instant, the middle of the clip, as a part of the clip.
    for (part, bound) in [(0.0, 0.01), (0.0625, 0.015), (0.125, 0.02), (0.25, 0.03), (0.5, 0.06)] {
        cases.push(StabilityCase {
            measure: DeviationKind::Place,
            ..case(
                GROUP,
                format!("the packed record {part} of the clip from its instant"),
                bound,
                "2^-11 of the way of each power from the middle of the clip, see the packer",
                move || {
                    // 80 pixels to either side at most, in three powers.
                    let motion = [[4.1, 0.9, 0.0], [-2.7, 3.3, 0.0], [3.7, -2.9, 0.0]];
                    let row = Gaussian { motion, s: 3.0, tau: 0.5, ..Gaussian::default() }.sized([0.2; 3]);
                    let mut posed_views = at(&[0.5 - part, 0.5 + part]);
                    posed_views.iter_mut().for_each(|posed_view| posed_view.camera = wide());
                    StabilityScene::new(field(&[row]), posed_views)
                },
            )
        });
    }
    cases.push(StabilityCase {
        measure: DeviationKind::Place,
        ..case(
            GROUP,
            "the packed record of a window 20 clips away",
            0.06,
            "2^-11 of the way from the middle of the clip, wherever the window is",
            || {
                // Where it is at tau = -20, 20.5 before the middle of the clip.
                let motion = [[4.0, -2.0, 0.0], [0.0; 3], [0.0; 3]];
                let center = [-82.0, 41.0, 0.0];
                let row =
                    Gaussian { center, motion, s: 12.0, tau: -20.0, ..Gaussian::default() }.sized([0.2; 3]);
                let mut posed_views = at(&instants());
                posed_views.iter_mut().for_each(|posed_view| posed_view.camera = wide());
                StabilityScene::new(field(&[row]), posed_views)
                    .untried("rounding the centre moves it out of sight")
            },
        )
    });
    cases.push(StabilityCase {
        measure: DeviationKind::Mean,
        ..case(
            GROUP,
            "many layers of many pictures",
            1.0,
            "each layer is rounded to f16 when it is blended",
            || StabilityScene::new(field(&crowd(3000)), at(&instants())),
        )
    });
    cases
}

/// A camera that sees far to either side.
fn wide() -> Camera {
    Camera::look_at([0.0, 0.0, -8.0], [0.0; 3], [0.0, -1.0, 0.0], 0.9, 256, 192)
}

/// A case of the user's own field: the whole clip, from its viewpoints.
pub fn along(name: &str, info: &ClipInfo, field: &Field, plate: Option<&Field>) -> StabilityCase {
    let clip = Clip { plate: plate.cloned(), info: info.clone(), ..exact(field.clone()) };
    let viewpoints = match info.viewpoints.as_slice() {
        [] => vec![Viewpoint::framing(clip.bounds, info.up)],
        some => some.iter().take(4).cloned().collect(),
    };
    let posed_views: Vec<PosedView> = viewpoints
        .iter()
        .map(|viewpoint| viewpoint.camera(info.up, 320, 240))
        .flat_map(|camera| {
            instants().into_iter().step_by(4).map(move |t| PosedView { camera: camera.clone(), t })
        })
        .collect();
    StabilityCase {
        measure: DeviationKind::Mean,
        ..case(
            GROUP,
            format!("along {name}"),
            1.5,
            "f32 and packed records against f64, at 5 instants from up to 4 viewpoints",
            move || StabilityScene {
                clip: clip.clone(),
                meant: None,
                posed_views: posed_views.clone(),
                sort: SortOrder::Depth,
                coding: PackageExpectation::Untried("it is drawn as it is"),
                blank: false,
            },
        )
    }
}
