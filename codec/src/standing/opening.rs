//! [`Surroundings::opening`]: the view in which people see a field first.
//!
//! The content fills the view: from the front, or from the side, the height or the distance from which most of it shows. A
//! furnished room is seen from within. One without anything in it looks as a hollow body does, and is seen from outside.

use std::collections::BTreeMap;
use std::f64::consts::{FRAC_PI_4, FRAC_PI_6};

use super::discs::{Disc, Discs};
use super::glance::{SIZE, glance};
use super::{
    AROUND_FOV_Y, CLEAR_CONTENT_MIN, DISTANCES, FOV_Y, Look, Surroundings, level_directions, moved, rotate,
};
use crate::camera::{cross, norm, normalize, sub};
use crate::{Viewpoint, near_fade};

/// Turns around the content from the front, in eighths of a whole one.
const TURNS: [f64; 8] = [0.0, 1.0, -1.0, 2.0, -2.0, 3.0, -3.0, 4.0];

/// Elevation of the views from above, in radians.
const ELEVATION: f64 = FRAC_PI_6;

/// Things right before the eye cover at most this share of the view: no clip opens in the haze of a wall.
const HAZE_MAX: f64 = 0.03;

/// The first turn is taken from which the content has at least this share of the area that it has from the best one: a
/// picture on a wall is seen from before it.
const AREA_MIN: f64 = 0.9;

/// Content that has less than this share of the area that it has from above is seen from there: a carpet, a table.
const LEVEL_AREA_MIN: f64 = 0.5;

/// A room is furnished where at least this share of its rows, ...
const FURNITURE_MIN: f64 = 0.06;

/// ... seen from a place in it, is nearer than this share of the distance to the last row in about that direction.
const FURNITURE_DEPTH_MAX: f64 = 0.6;

/// About one direction: bins along each side of a cube.
const BINS: f64 = 4.0;

/// Steps back, as shares of the way to the content behind, in the order in which they are tried.
const BACK: [f64; 3] = [0.6, 0.3, 0.0];

/// A direction from which people may look at the content.
struct Side {
    /// The view that the content fills.
    framing: Viewpoint,
    /// Area of the silhouette of the content alone, times the number of its rows that are seen.
    area: f64,
}

impl Surroundings {
    /// The view in which people see the field first.
    pub fn opening(&self) -> Viewpoint {
        self.view_within().unwrap_or_else(|| self.view_of_content())
    }

    fn view_of_content(&self) -> Viewpoint {
        let [level, raised] = self.sides();
        for distance in DISTANCES {
            let clear = |sides: &[Side]| -> Vec<(f64, Viewpoint)> {
                let views = sides.iter().map(|side| (side.area, self.view(&side.framing, distance)));
                let clear = views.filter(|(_, (_, shown))| *shown >= CLEAR_CONTENT_MIN);
                clear.map(|(area, (viewpoint, _))| (area, viewpoint)).collect()
            };
            let most = |views: &[(f64, Viewpoint)]| views.iter().map(|(area, _)| *area).fold(0.0, f64::max);
            let [of_level, of_raised] = [clear(&level), clear(&raised)];
            let is_flat = most(&of_level) < LEVEL_AREA_MIN * most(&of_raised);
            let views = if is_flat { of_raised } else { of_level };
            let least = AREA_MIN * most(&views);
            if let Some((_, viewpoint)) = views.into_iter().find(|(area, _)| *area >= least) {
                return viewpoint;
            }
        }
        let views = DISTANCES
            .iter()
            .flat_map(|&distance| level.iter().map(move |side| self.view(&side.framing, distance)));
        let front = (level[0].framing.clone(), 0.0);
        // The first of equals.
        views.fold(front, |best, view| if view.1 > best.1 { view } else { best }).0
    }

    /// The sides of the content, level and from above, each from the front on.
    fn sides(&self) -> [[Side; 8]; 2] {
        let alone = self.content_discs();
        let bounds = self.framed_bounds(&alone).map(|corner| corner.map(|x| x as f32));
        let front = Viewpoint::framing(bounds, self.up.map(|x| x as f32));
        let [target, position] = [front.target, front.position].map(|point| point.map(f64::from));
        let forward = sub(target, position);
        let right = normalize(cross(forward, self.up)).unwrap_or([1.0, 0.0, 0.0]);
        [0.0, ELEVATION].map(|elevation| {
            let lowered = rotate(forward, right, -elevation);
            TURNS.map(|turn| {
                let forward = rotate(lowered, self.up, turn * FRAC_PI_4);
                let framing = Viewpoint::framing_along(forward, bounds, self.up);
                Side { framing, area: self.area(&alone, forward) }
            })
        })
    }

    /// The discs in the box of the content.
    pub(super) fn content_discs(&self) -> Discs {
        let [low, high] = self.content.bounds;
        let is_within = |disc: &&Disc| {
            let range = |axis: usize| low[axis]..=high[axis];
            disc.row < self.discs.field_rows && (0..3).all(|axis| range(axis).contains(&disc.center[axis]))
        };
        let content = |disc: &Disc| Disc { is_content: true, ..*disc };
        let instants = self.discs.instants.iter();
        let instants = instants.map(|discs| discs.iter().filter(is_within).map(content).collect()).collect();
        Discs { instants, ..self.discs }
    }

    /// The area of the silhouette of `discs`, in units of a picture of the content, times the number of rows that are seen.
    fn area(&self, discs: &Discs, forward: [f64; 3]) -> f64 {
        let (center, radius) = self.center_and_radius();
        let arm = normalize(forward).map_or([0.0; 3], |forward| forward.map(|x| -x));
        let position = moved(center, arm, radius / libm::sin(0.5 * FOV_Y));
        let glance = glance(discs, &self.camera(position, center, FOV_Y), 0.0, 0.0);
        glance.filled * glance.seen.iter().filter(|seen| **seen).count() as f64
    }

    /// The box of the content with the size of its discs.
    fn framed_bounds(&self, discs: &Discs) -> [[f64; 3]; 2] {
        let mut radii: Vec<f64> = discs.instants.iter().flatten().map(|disc| disc.radius).collect();
        radii.sort_by(f64::total_cmp);
        let margin = radii.get(radii.len() / 2).copied().unwrap_or(0.0);
        let [low, high] = self.content.bounds;
        [low.map(|x| x - margin), high.map(|x| x + margin)]
    }

    /// The view of `framing` from `distance` times as far away, and the share of the content that shows there; 0 in the haze of
    /// something right before the eye.
    fn view(&self, framing: &Viewpoint, distance: f64) -> (Viewpoint, f64) {
        let [target, position] = [framing.target, framing.position].map(|point| point.map(f64::from));
        let arm = sub(position, target);
        let position = moved(target, arm, distance).map(|x| x as f32);
        let viewpoint = Viewpoint { position, ..framing.clone() };
        let camera = viewpoint.camera(self.up.map(|x| x as f32), SIZE.0, SIZE.1);
        let look = self.look(camera, distance * norm(arm));
        let shown = if self.is_clear(&look) { look.glance.content } else { 0.0 };
        (viewpoint, shown)
    }

    /// The view of a furnished room from within; `None` where the content is no such room.
    fn view_within(&self) -> Option<Viewpoint> {
        let places = self.inside(0.0);
        let furniture = self.furniture(places.first()?.0)?;
        let (_, radius) = self.center_and_radius();
        let look = |position: [f64; 3], direction| {
            self.look(self.camera(position, moved(position, direction, radius), AROUND_FOV_Y), radius)
        };
        let mut best: Option<(usize, Viewpoint)> = None;
        for (place, _) in places {
            for direction in level_directions(self.up, TURNS.len() as u32, 0.0) {
                let behind = look(place, direction.map(|x| -x)).glance.depth;
                let back = |back: &f64| moved(place, direction, -back * behind);
                let looks = BACK.iter().map(back).map(|position| look(position, direction));
                let Some(Look { camera, glance }) = looks.into_iter().find(|look| self.is_clear(look)) else {
                    continue;
                };
                let shown = furniture.iter().filter(|row| glance.seen[**row]).count();
                if best.as_ref().is_none_or(|(most, _)| shown > *most) {
                    let position = camera.position();
                    let [position, target] = [position, moved(position, direction, 0.5 * glance.depth)]
                        .map(|point| point.map(|x| x as f32));
                    let fov_y = AROUND_FOV_Y as f32;
                    best = Some((shown, Viewpoint { name: "front".into(), position, target, fov_y }));
                }
            }
        }
        best.map(|(_, viewpoint)| viewpoint)
    }

    /// Whether the eye is in no haze, and in nothing.
    pub(super) fn is_clear(&self, look: &Look) -> bool {
        let eye = look.camera.position();
        let is_around = |disc: &Disc| {
            let distance = norm(sub(disc.center, eye));
            distance < disc.radius && disc.opacity * near_fade(distance, self.discs.near) >= HAZE_MAX
        };
        look.glance.blocked <= HAZE_MAX && !self.discs.instants.iter().flatten().any(is_around)
    }

    /// The rows that are within what surrounds `place`, if there are many.
    pub(super) fn furniture(&self, place: [f64; 3]) -> Option<Vec<usize>> {
        let discs = self.content_discs();
        let discs: Vec<(usize, [f64; 3])> =
            discs.instants.iter().flatten().map(|disc| (disc.row, sub(disc.center, place))).collect();
        let mut last = BTreeMap::new();
        for (_, arm) in &discs {
            let most: &mut f64 = last.entry(bin(*arm)).or_default();
            *most = most.max(norm(*arm));
        }
        let is_before = |arm: &[f64; 3]| norm(*arm) < FURNITURE_DEPTH_MAX * last[&bin(*arm)];
        let before: Vec<usize> =
            discs.iter().filter(|(_, arm)| is_before(arm)).map(|(row, _)| *row).collect();
        (before.len() as f64 >= FURNITURE_MIN * discs.len() as f64).then_some(before)
    }
}

/// The bin of a direction on a cube around the origin.
fn bin(arm: [f64; 3]) -> [i8; 3] {
    let largest = arm.iter().fold(0.0, |largest: f64, x| largest.max(x.abs()));
    arm.map(|x| if largest > 0.0 { (0.5 * BINS * x / largest).round() as i8 } else { 0 })
}
