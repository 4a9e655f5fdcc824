//! The views that rank Gaussians, judge rankings and measure coding errors. Judging views differ from
//! ranking views, so that no ranking is judged by the pictures that it has seen.

use codec::{Camera, Field};
use refine::prune::{PosedView, dome, instants, posed_views, steps_aside};
use refine::reference::RenderScene;

use crate::scene::Scene;

/// Size in pixels of the ranking and judging pictures.
const SIZE: (u32, u32) = (256, 192);

/// Approximate number of pictures where all cameras share the same instants.
const PICTURES: usize = 20;

/// Maximum number of shared instants.
const INSTANTS: usize = 4;

/// Maximum number of viewpoints that are used with all their steps aside.
const VIEWPOINTS: usize = 2;

/// Number of viewpoints, with one step aside each, where a scene suggests at least so many: those of a
/// capture may surround the subject. Equals the number of cameras of a dome.
const AROUND: usize = 8;

/// Number of pictures of a dynamic field from all around.
const AROUND_PICTURES: usize = 24;

/// Number of pictures that measure the coding error. Errors of trajectories are largest at both ends of a
/// clip, so each picture has an instant of its own.
const COMPARED: usize = 8;

/// Increment of the camera index from picture to picture where each has its own instant; coprime to the
/// number of cameras, 5, 8 or 10.
const CAMERA_STEP: usize = 3;

/// Size in pixels of the pictures that measure the coding error.
pub(crate) const CODED_SIZE: (u32, u32) = (640, 480);

/// Camera placement: steps aside in degrees, or rotation of the dome relative to the angle between
/// its cameras.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Places {
    pub(crate) aside: f64,
    pub(crate) turn: f64,
}

/// Placement of the ranking views.
pub(crate) const RANKING_PLACES: Places = Places { aside: 10.0, turn: 0.0 };

/// Placement of the judging views.
pub(crate) const JUDGING_PLACES: Places = Places { aside: 6.0, turn: 0.5 };

pub(crate) fn ranking_views(scene: &Scene, field: &Field) -> Vec<PosedView> {
    views_of(scene, field, RANKING_PLACES, SIZE)
}

pub(crate) fn judging_views(scene: &Scene, field: &Field) -> Vec<PosedView> {
    views_of(scene, field, JUDGING_PLACES, SIZE)
}

/// Views that compare a package with the field before coding.
pub(crate) fn compared_views(scene: &Scene, field: &Field) -> Vec<PosedView> {
    paired(&cameras(scene, field, JUDGING_PLACES, CODED_SIZE), &instants(field, COMPARED), COMPARED)
}

/// `count` views, each with the next camera and the next instant.
fn paired(cameras: &[Camera], instants: &[f64], count: usize) -> Vec<PosedView> {
    let view = |i: usize| PosedView {
        camera: cameras[i * CAMERA_STEP % cameras.len()].clone(),
        t: instants[i % instants.len()],
    };
    (0..count).map(view).collect()
}

/// Views of a field. A dynamic field seen from all around gets an instant per view, because a few shared
/// instants miss Gaussians that live for a few frames.
pub(crate) fn views_of(scene: &Scene, field: &Field, places: Places, size: (u32, u32)) -> Vec<PosedView> {
    let cameras = cameras(scene, field, places, size);
    if cameras.len() == AROUND && field.temporal.is_some() {
        return paired(&cameras, &instants(field, AROUND_PICTURES), AROUND_PICTURES);
    }
    let count = (PICTURES / cameras.len()).clamp(2, INSTANTS);
    posed_views(&cameras, &instants(field, count))
}

/// Cameras for a field: the suggested viewpoints and steps aside of them, one step aside of each if there are
/// many, or a dome if there are none. Never empty.
fn cameras(scene: &Scene, field: &Field, places: Places, size: (u32, u32)) -> Vec<Camera> {
    let up = scene.info.up;
    let viewpoints = &scene.info.viewpoints;
    if scene.assumed.contains(&"viewpoints") || viewpoints.is_empty() {
        return dome(field, &instants(field, INSTANTS), up, places.turn, size);
    }
    let steps_aside = |viewpoint| steps_aside(viewpoint, up, places.aside.to_radians(), size);
    match viewpoints.len() {
        ..AROUND => viewpoints.iter().take(VIEWPOINTS).flat_map(steps_aside).collect(),
        many => (0..AROUND).map(|i| steps_aside(&viewpoints[i * many / AROUND]).swap_remove(1)).collect(),
    }
}

pub(crate) fn render_scene<'a>(field: &'a Field, plate: Option<&'a Field>) -> RenderScene<'a> {
    let scene = RenderScene::from(field);
    plate.map_or(scene.clone(), |plate| scene.with_plate(plate))
}

#[cfg(test)]
mod tests {
    use super::*;
    use codec::{ClipInfo, Viewpoint};

    /// A Gaussian in the middle of a ring of viewpoints.
    fn ring(count: usize) -> Scene {
        let field = Field {
            centers: vec![[0.0; 3]],
            rotations: vec![[1.0, 0.0, 0.0, 0.0]],
            log_scales: vec![[-1.0; 3]],
            opacities: vec![1.0],
            sh_degree: 0,
            sh: vec![[0.0; 3]],
            temporal: None,
        };
        let viewpoint = |i: usize| {
            let (sin, cos) = (std::f32::consts::TAU * i as f32 / count as f32).sin_cos();
            let position = [3.0 * sin, 1.0, 3.0 * cos];
            Viewpoint { name: i.to_string(), position, target: [0.0; 3], fov_y: 0.8 }
        };
        let viewpoints = (0..count).map(viewpoint).collect();
        let info =
            ClipInfo { duration_s: 1.0, fps: 30.0, up: [0.0, 1.0, 0.0], metres_per_unit: 1.0, viewpoints };
        Scene::made("ring", field, info)
    }

    fn positions(scene: &Scene, places: Places) -> Vec<[f64; 3]> {
        cameras(scene, &scene.subject.field, places, SIZE).iter().map(Camera::position).collect()
    }

    #[test]
    fn a_ring_is_looked_at_from_all_around() {
        let scene = ring(16);
        let [ranking, judging] = [RANKING_PLACES, JUDGING_PLACES].map(|places| positions(&scene, places));
        assert_eq!((ranking.len(), judging.len()), (AROUND, AROUND));
        for places in [&ranking, &judging] {
            let middle = [0, 1, 2].map(|axis| places.iter().map(|p| p[axis]).sum::<f64>() / 8.0);
            assert!(middle[0].abs() < 1e-5 && middle[2].abs() < 1e-5, "{middle:?}");
        }
        assert!(ranking.iter().all(|place| !judging.contains(place)), "other places judge");
    }

    #[test]
    fn what_moves_is_looked_at_at_many_instants() {
        let mut scene = ring(16);
        assert_eq!(ranking_views(&scene, &scene.subject.field).len(), AROUND, "it stands still");
        let (tau, s) = (vec![0.5], vec![0.1]);
        scene.subject.field.temporal = Some(codec::Temporal { tau, s, ..Default::default() });
        let views = ranking_views(&scene, &scene.subject.field);
        assert_eq!(views.len(), AROUND_PICTURES);
        assert!(views.windows(2).all(|pair| pair[0].t < pair[1].t));
        // Any eight in a row see it from all sides.
        for eight in views.windows(AROUND) {
            let x = eight.iter().map(|view| view.camera.position()[0]).sum::<f64>();
            assert!(x.abs() < 1e-4, "{x}");
        }
    }

    #[test]
    fn of_a_few_viewpoints_the_first_count() {
        let places = positions(&ring(4), RANKING_PLACES);
        assert_eq!(places.len(), 5 * VIEWPOINTS);
        // The first two stand at +z and +x.
        assert!(places.iter().all(|[x, _, z]| x + z > 1.5), "{places:?}");
    }
}
