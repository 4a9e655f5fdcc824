//! The views in which packages are ranked, judged and compared. Rankings see other places than the
//! pictures that judge them.

use codec::{Camera, Field};
use refine::prune::{PosedView, dome, instants, posed_views, steps_aside};
use refine::reference::RenderScene;

use crate::scene::Scene;

/// Size in pixels of the pictures that rank and judge.
const SIZE: (u32, u32) = (256, 192);

/// About how many pictures rank, and how many judge, where all are taken at the same instants.
const PICTURES: usize = 20;

/// Most instants at which pictures are taken.
const INSTANTS: usize = 4;

/// Most viewpoints from which pictures are taken with all their steps aside.
const VIEWPOINTS: usize = 2;

/// Viewpoints from which pictures are taken with one step aside each, where so many are suggested: those
/// of a capture, whose cameras may stand all around. As many as a dome has.
const AROUND: usize = 8;

/// How many pictures rank and judge what moves and is looked at from all around.
const AROUND_PICTURES: usize = 24;

/// Pictures that a package is compared in with what was coded. Errors of trajectories are largest at
/// both ends of a clip, so that each picture has an instant of its own.
const COMPARED: usize = 8;

/// Step through the cameras from one picture to the next where each has an instant of its own; shares
/// no factor with their number, 5, 8 or 10.
const CAMERA_STEP: usize = 3;

/// Size in pixels of the pictures that tell what an error of coding looks like.
pub(crate) const CODED_SIZE: (u32, u32) = (640, 480);

/// Where pictures are taken from: steps aside in degrees, or turn of the dome in parts of the angle
/// from camera to camera.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Places {
    pub(crate) aside: f64,
    pub(crate) turn: f64,
}

/// For rankings.
pub(crate) const RANKING_PLACES: Places = Places { aside: 10.0, turn: 0.0 };

/// For judging between them.
pub(crate) const JUDGING_PLACES: Places = Places { aside: 6.0, turn: 0.5 };

pub(crate) fn ranking_views(scene: &Scene, field: &Field) -> Vec<PosedView> {
    views_of(scene, field, RANKING_PLACES, SIZE)
}

pub(crate) fn judging_views(scene: &Scene, field: &Field) -> Vec<PosedView> {
    views_of(scene, field, JUDGING_PLACES, SIZE)
}

/// Pictures to compare a package in with the field that was coded.
pub(crate) fn compared_views(scene: &Scene, field: &Field) -> Vec<PosedView> {
    paired(&cameras(scene, field, JUDGING_PLACES, CODED_SIZE), &instants(field, COMPARED), COMPARED)
}

/// So many pictures, each from the next place and at the next instant.
fn paired(cameras: &[Camera], instants: &[f64], count: usize) -> Vec<PosedView> {
    let view = |i: usize| PosedView {
        camera: cameras[i * CAMERA_STEP % cameras.len()].clone(),
        t: instants[i % instants.len()],
    };
    (0..count).map(view).collect()
}

/// From where and when to look at a field: what moves is looked at from all around at an instant of its
/// own from each place, as Gaussians that live for a few frames are missed between few instants.
pub(crate) fn views_of(scene: &Scene, field: &Field, places: Places, size: (u32, u32)) -> Vec<PosedView> {
    let cameras = cameras(scene, field, places, size);
    if cameras.len() == AROUND && field.temporal.is_some() {
        return paired(&cameras, &instants(field, AROUND_PICTURES), AROUND_PICTURES);
    }
    let count = (PICTURES / cameras.len()).clamp(2, INSTANTS);
    posed_views(&cameras, &instants(field, count))
}

/// Where to look at a field from: the viewpoints that somebody suggested and steps aside of them, a
/// step aside of each where there are many, or else a dome. Never empty.
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
