//! [`render_held`]: the picture of a player that does not sort in every frame.

use codec::Camera;

use super::evaluate::evaluate;
use super::sort::{Order, sort_by};
use super::{FieldPrefix, RenderScene, alive, splat};
use crate::image::Image;
use crate::raster::Splat;

/// Renders `scene` from `camera` at clip time `t` over black, with the visible Gaussians and their order
/// of an earlier frame: the camera and clip time `sorted_at`.
///
/// Both cameras must satisfy [`Camera::check`].
pub fn render_held(
    scene: &RenderScene,
    camera: &Camera,
    t: f64,
    order: Order,
    sorted_at: (&Camera, f64),
) -> Image {
    let mut splats = in_held_order(&scene.prefixes, camera, t, order, sorted_at);
    splats.append(&mut in_held_order(&scene.plates, camera, t, order, sorted_at));
    splat::splat(&splats, camera.width, camera.height)
}

/// The splats at `t`, in the order of the earlier frame.
fn in_held_order(
    prefixes: &[FieldPrefix],
    camera: &Camera,
    t: f64,
    order: Order,
    (earlier_camera, earlier_t): (&Camera, f64),
) -> Vec<Splat<f64>> {
    let visible = |prefix: &FieldPrefix, camera: &Camera, t: f64| {
        let at = |t| evaluate(prefix.field, &alive::alive(prefix.field, prefix.rows, t), camera, t);
        prefix.clip_time(t).map_or_else(Vec::new, at)
    };
    let mut earlier: Vec<(usize, Splat<f64>)> = Vec::new();
    let mut now: Vec<Vec<Option<Splat<f64>>>> = Vec::new();
    for (i, prefix) in prefixes.iter().enumerate() {
        earlier.extend(visible(prefix, earlier_camera, earlier_t).into_iter().map(|splat| (i, splat)));
        let mut by_row = vec![None; prefix.rows];
        visible(prefix, camera, t).into_iter().for_each(|splat| by_row[splat.row as usize] = Some(splat));
        now.push(by_row);
    }
    sort_by(&mut earlier, order, |(_, splat)| splat);
    earlier.into_iter().filter_map(|(prefix, splat)| now[prefix][splat.row as usize]).collect()
}
