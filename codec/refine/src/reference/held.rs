//! [`render_held`]: what a player shows that does not sort in every frame.

use codec::Camera;

use super::evaluate::{Splat, evaluate};
use super::sort::{Order, nearer};
use super::{FieldPrefix, RenderScene, alive, splat};
use crate::image::Image;

/// Renders `scene` from `camera` at clip time `t` over black, but in the order, and only of those
/// Gaussians, that were found from the camera and at the clip time of `made`.
///
/// Both cameras must satisfy [`Camera::check`].
pub fn render_held(
    scene: &RenderScene,
    camera: &Camera,
    t: f64,
    order: Order,
    made: (&Camera, f64),
) -> Image {
    let mut splats = held(&scene.parts, camera, t, order, made);
    if let Some(plate) = scene.plate {
        let plate = [FieldPrefix { field: plate, rows: plate.len() }];
        splats.append(&mut held(&plate, camera, t, order, made));
    }
    splat::splat(&splats, camera.width, camera.height)
}

/// The splats of now, in the order of then.
fn held(
    parts: &[FieldPrefix],
    camera: &Camera,
    t: f64,
    order: Order,
    (made_by, made_at): (&Camera, f64),
) -> Vec<Splat> {
    let seen = |part: &FieldPrefix, camera: &Camera, t: f64| {
        evaluate(part.field, &alive::alive(part.field, part.rows, t), camera, t)
    };
    let mut then: Vec<(usize, Splat)> = Vec::new();
    let mut now: Vec<Vec<Option<Splat>>> = Vec::new();
    for (i, part) in parts.iter().enumerate() {
        then.extend(seen(part, made_by, made_at).into_iter().map(|splat| (i, splat)));
        let mut by_row = vec![None; part.rows];
        seen(part, camera, t).into_iter().for_each(|splat| by_row[splat.row] = Some(splat));
        now.push(by_row);
    }
    then.sort_by(|(_, a), (_, b)| nearer(a, b, order));
    then.into_iter().filter_map(|(part, splat)| now[part][splat.row]).collect()
}
