//! Precision: f32 against f64 along whole clips, packed records at growing distances from their instant, and the
//! user's own scenes.

use codec::{Camera, Clip, ClipInfo, Field};

use super::gaussians::{Gaussian, crowd, field};
use refine::reference::PosedView;

use super::case::{DeviationKind, PackageExpectation, StabilityCase, StabilityScene, at, case, exact};
use crate::cameras::measured_cameras;
use crate::scene::{Motion, Recipe};
use client::gpu::SortOrder;

const GROUP: &str = "precision";

/// 17 instants, evenly spaced over the clip.
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
    // Distances from the record's instant, which is the middle of the clip, as fractions of the clip.
    for (part, bound) in [(0.0, 0.01), (0.0625, 0.015), (0.125, 0.02), (0.25, 0.03), (0.5, 0.06)] {
        cases.push(StabilityCase {
            measure: DeviationKind::Place,
            ..case(
                GROUP,
                format!("the packed record {part} of the clip from its instant"),
                bound,
                "off by 2^-11 of the distance that each power has moved it since the middle of the clip, see the packer",
                move || {
                    // Three powers that move it by at most 80 pixels to either side.
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
            "off by 2^-11 of the distance moved since the middle of the clip, wherever the window is",
            || {
                // The centre at tau = -20, which is 20.5 clips before the middle of the clip.
                let motion = [[4.0, -2.0, 0.0], [0.0; 3], [0.0; 3]];
                let center = [-82.0, 41.0, 0.0];
                let row =
                    Gaussian { center, motion, s: 12.0, tau: -20.0, ..Gaussian::default() }.sized([0.2; 3]);
                let mut posed_views = at(&instants());
                posed_views.iter_mut().for_each(|posed_view| posed_view.camera = wide());
                StabilityScene::new(field(&[row]), posed_views)
                    .untried("rounding the centre moves it out of view")
            },
        )
    });
    cases.push(StabilityCase {
        measure: DeviationKind::Mean,
        ..case(GROUP, "many layers of many pictures", 1.0, "blending rounds every layer to f16", || {
            StabilityScene::new(field(&crowd(3000)), at(&instants()))
        })
    });
    cases
}

/// A camera with a wide field of view.
fn wide() -> Camera {
    Camera::look_at([0.0, 0.0, -8.0], [0.0; 3], [0.0, -1.0, 0.0], 0.9, 256, 192)
}

/// A case that draws the user's field at 5 instants of the clip, from up to four of its viewpoints; from where people stand, if
/// it states none.
pub fn along(name: &str, info: &ClipInfo, field: &Field, plate: Option<&Field>) -> StabilityCase {
    let clip = Clip { plate: plate.cloned(), info: info.clone(), ..exact(field.clone()) };
    let size = [320, 240];
    let stated = info.viewpoints.iter().take(4).map(|viewpoint| viewpoint.camera(info.up, size[0], size[1]));
    let mut cameras: Vec<Camera> = stated.collect();
    if cameras.is_empty() {
        cameras = measured_cameras(info, &clip.surroundings(), 4, size);
    }
    let at_instants = |camera: Camera| {
        instants().into_iter().step_by(4).map(move |t| PosedView { camera: camera.clone(), t })
    };
    let posed_views: Vec<PosedView> = cameras.into_iter().flat_map(at_instants).collect();
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
                take: None,
                posed_views: posed_views.clone(),
                sort: SortOrder::Depth,
                coding: PackageExpectation::Untried("the field is drawn without encoding"),
                blank: false,
            },
        )
    }
}
