//! [`Surroundings::opening`]: the view in which people see a field first.
//!
//! The content fills the view: from the front, or from the side, the height or the distance from which most of it shows. A
//! furnished room is seen from within. One without anything in it looks as a hollow body does, and is seen from outside.

use std::collections::BTreeMap;
use std::f64::consts::{FRAC_PI_4, FRAC_PI_6};

use super::{
    AROUND_FOV_Y, CLEAR_CONTENT_MIN, DISTANCES, SIZE, Surroundings, level_directions, moved, rotate,
};
use crate::Viewpoint;
use crate::camera::{cross, norm, normalize, sub};

/// Turns around the content from the front, in eighths of a whole one.
const TURNS: [f64; 8] = [0.0, 1.0, -1.0, 2.0, -2.0, 3.0, -3.0, 4.0];

/// Elevation of the views from above, in radians.
const ELEVATION: f64 = FRAC_PI_6;

/// Things right before the eye cover at most this share of the view: nobody opens in the haze of a wall.
const HAZE_MAX: f64 = 0.03;

/// The first turn is taken from which the content has at least this share of the area that it has from the best one: a
/// picture on a wall is seen from before it.
const AREA_MIN: f64 = 0.9;

/// Content that has less than this share of the area that it has from above is seen from there: a carpet, a table.
const LEVEL_AREA_MIN: f64 = 0.5;

/// A room is furnished where at least this share of its rows, ...
const FURNITURE_MIN: f64 = 0.1;

/// ... seen from its centre, is nearer than this share of the distance to the last row in about that direction.
const FURNITURE_DEPTH_MAX: f64 = 0.6;

/// About one direction: bins along each side of a cube.
const BINS: f64 = 4.0;

/// Places in a room, as shares of the way from its centre to what is behind, in the order in which they are tried.
const BACK: [f64; 3] = [0.6, 0.3, 0.0];

/// A view, with what it shows of the content.
struct View {
    viewpoint: Viewpoint,
    /// Share of the content that shows; 0 in the haze of something right before the eye.
    shown: f64,
    /// Area of the content's silhouette, times the share of all rows that are seen; the same unit in all views.
    area: f64,
}

impl View {
    fn is_clear(&self) -> bool {
        self.shown >= CLEAR_CONTENT_MIN
    }
}

impl Surroundings {
    /// The view in which people see the field first.
    pub fn opening(&self) -> Viewpoint {
        self.view_within().unwrap_or_else(|| self.view_of_content())
    }

    fn view_of_content(&self) -> Viewpoint {
        let bounds = self.framed_bounds().map(|corner| corner.map(|x| x as f32));
        let front = Viewpoint::framing(bounds, self.up.map(|x| x as f32));
        let [target, position] = [front.target, front.position].map(|point| point.map(f64::from));
        let forward = sub(target, position);
        let right = normalize(cross(forward, self.up)).unwrap_or([1.0, 0.0, 0.0]);
        let mut best: Option<View> = None;
        for distance in DISTANCES {
            let views = [0.0, ELEVATION].map(|elevation| {
                let lowered = rotate(forward, right, -elevation);
                let turned = |turn: f64| rotate(lowered, self.up, turn * FRAC_PI_4);
                let framing = |turn| Viewpoint::framing_along(turned(turn), bounds, self.up);
                TURNS.map(|turn| self.view(framing(turn), distance))
            });
            let most = |views: &[View]| {
                views.iter().filter(|view| view.is_clear()).map(|view| view.area).fold(0.0, f64::max)
            };
            let [of_level, of_raised] = [most(&views[0]), most(&views[1])];
            let is_flat = of_level > 0.0 && of_level < LEVEL_AREA_MIN * of_raised;
            let [level, raised] = views;
            let (views, most) = if is_flat { (raised, of_raised) } else { (level, of_level) };
            for view in views {
                if view.is_clear() && view.area >= AREA_MIN * most {
                    return view.viewpoint;
                }
                if best.as_ref().map_or(0.0, |best| best.shown) < view.shown {
                    best = Some(view);
                }
            }
        }
        best.map_or(front, |view| view.viewpoint)
    }

    /// The box of the content; a cube of its radius around a point.
    fn framed_bounds(&self) -> [[f64; 3]; 2] {
        let bounds = self.content.bounds;
        let radius = self.content.radius();
        match 0.5 * norm(sub(bounds[1], bounds[0])) < radius {
            true => [-radius, radius]
                .map(|offset| std::array::from_fn(|axis| 0.5 * (bounds[0][axis] + bounds[1][axis]) + offset)),
            false => bounds,
        }
    }

    /// What `framing` shows from `distance` times as far away.
    fn view(&self, framing: Viewpoint, distance: f64) -> View {
        let [target, position] = [framing.target, framing.position].map(|point| point.map(f64::from));
        let arm = sub(position, target);
        let viewpoint = Viewpoint { position: moved(target, arm, distance).map(|x| x as f32), ..framing };
        let camera = viewpoint.camera(self.up.map(|x| x as f32), SIZE.0, SIZE.1);
        let distance = distance * norm(arm);
        let glance = self.look(camera, distance).glance;
        let shown = if glance.blocked <= HAZE_MAX { glance.content } else { 0.0 };
        let rows = &glance.seen[..self.discs.field_rows];
        let seen = rows.iter().filter(|seen| **seen).count() as f64 / rows.len().max(1) as f64;
        View { viewpoint, shown, area: seen * glance.filled * distance.powi(2) }
    }

    /// The view along a furnished room; `None` where the content is no such room.
    fn view_within(&self) -> Option<Viewpoint> {
        if self.inside(0.0).is_empty() || !self.is_furnished() {
            return None;
        }
        let (center, radius) = self.center_and_radius();
        let look = |position: [f64; 3], direction| {
            self.look(self.camera(position, moved(position, direction, radius), AROUND_FOV_Y), radius)
        };
        let mut best: Option<(f64, Viewpoint)> = None;
        for direction in level_directions(self.up, TURNS.len() as u32, 0.0) {
            let behind = look(center, direction.map(|x| -x)).glance.depth;
            for back in BACK {
                let position = moved(center, direction, -back * behind);
                let glance = look(position, direction).glance;
                if glance.blocked > HAZE_MAX {
                    continue;
                }
                if best.as_ref().map_or(0.0, |(depth, _)| *depth) < glance.depth {
                    let [position, target] = [position, moved(position, direction, 0.5 * glance.depth)]
                        .map(|point| point.map(|x| x as f32));
                    let fov_y = AROUND_FOV_Y as f32;
                    best = Some((glance.depth, Viewpoint { name: "front".into(), position, target, fov_y }));
                }
                break;
            }
        }
        best.map(|(_, viewpoint)| viewpoint)
    }

    /// Whether much is within what surrounds the centre of the content.
    fn is_furnished(&self) -> bool {
        let (center, _) = self.center_and_radius();
        let [low, high] = self.content.bounds;
        let is_within = |point: [f64; 3]| (0..3).all(|axis| (low[axis]..=high[axis]).contains(&point[axis]));
        let discs = self.discs.instants.iter().flatten().filter(|disc| disc.row < self.discs.field_rows);
        let arms: Vec<[f64; 3]> =
            discs.filter(|disc| is_within(disc.center)).map(|disc| sub(disc.center, center)).collect();
        let mut last = BTreeMap::new();
        for arm in &arms {
            let most: &mut f64 = last.entry(bin(*arm)).or_default();
            *most = most.max(norm(*arm));
        }
        let is_before = |arm: &&[f64; 3]| norm(**arm) < FURNITURE_DEPTH_MAX * last[&bin(**arm)];
        arms.iter().filter(is_before).count() as f64 >= FURNITURE_MIN * arms.len() as f64
    }
}

/// The bin of a direction on a cube around the origin.
fn bin(arm: [f64; 3]) -> [i8; 3] {
    let largest = arm.iter().fold(0.0, |largest: f64, x| largest.max(x.abs()));
    arm.map(|x| if largest > 0.0 { (0.5 * BINS * x / largest).round() as i8 } else { 0 })
}
