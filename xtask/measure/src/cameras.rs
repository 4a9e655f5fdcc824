//! [`measured_cameras`]: from where a package is measured.

use codec::{Camera, ClipInfo, Surroundings};
use glam::DVec3;

/// At most `count` cameras of this size in pixels. The first is where playing starts. The others stand where people stand,
/// around the content or in it; each next one is the place farthest from all cameras chosen so far.
pub fn measured_cameras(
    info: &ClipInfo,
    surroundings: &Surroundings,
    count: usize,
    [width, height]: [u32; 2],
) -> Vec<Camera> {
    let mut cameras = vec![surroundings.first_viewpoint(info).camera(info.up, width, height)];
    let mut places = surroundings.stand_points(Surroundings::MEASURED_TURN, (width, height)).content;
    while cameras.len() < count && !places.is_empty() {
        let apart = |camera: &Camera| {
            let eye = DVec3::from(camera.position());
            cameras.iter().map(|other| eye.distance(other.position().into())).fold(f64::INFINITY, f64::min)
        };
        let farthest = (0..places.len()).max_by(|&a, &b| apart(&places[a]).total_cmp(&apart(&places[b])));
        cameras.push(places.swap_remove(farthest.expect("there are places")));
    }
    cameras
}
