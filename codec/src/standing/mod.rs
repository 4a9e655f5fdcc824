//! [`Surroundings`]: where the content of a field is, where people stand to look at it, and from where they see it first.
//!
//! All of it follows from the rows as discs in pictures of 48x36 pixels, at a few instants:
//!
//! ```text
//! discs -> content (a ball) -> stand points: rings around the content, each point as far away as walls let it be
//!                           -> further stand points, while they show rows that none has shown
//!                           -> opening: the content fills the view, from a side where nothing stands before it
//! ```
//!
//! A field has no unit: distances are those at which the content fills the view, and fractions of them. Everything is
//! deterministic, on any machine.

mod coarse;
mod content;
mod discs;
mod glance;
mod opening;
#[cfg(test)]
mod tests;

use crate::camera::{cross, dot, norm, normalize, sub};
use crate::clip::FRAMING_FOV_Y as FOV_Y;
use crate::{Camera, Clip, ClipInfo, Field, Viewpoint};
pub use coarse::{CoarseField, Sight};
use content::{Ball, Content, EXTENT, bounds_along};
use discs::{Discs, DiscsBuilder};
use glance::{Glance, SIZE, glance};

/// Rows of a field that are looked at, at most.
const ROWS: usize = 12_000;

/// Vertical field of view of the stand points that look around, in radians.
const AROUND_FOV_Y: f64 = 75.0 * std::f64::consts::PI / 180.0;

/// Rings of stand points: elevation in degrees, number of points.
const RINGS: [(f64, u32); 2] = [(10.0, 5), (45.0, 3)];

/// Places within content beside its middle, where a person may stand, or a table: eighths of a turn around the
/// middle, in the order in which they are tried, ...
const PLACES: [f64; 8] = [0.0, 3.0, 6.0, 1.0, 4.0, 7.0, 2.0, 5.0];

/// ... at this share of the way to the sides of its box.
const PLACE_SHARE: f64 = 0.5;

/// How far the middle is moved aside for places of another turn, as a share of the way to the sides of the box: places of
/// two turns share no eye.
const MIDDLE_SHARE: f64 = 0.2;

/// Most places within content from which it is judged.
const PLACES_MAX: usize = 3;

/// Content surrounds a place where it is seen from there at this distance on average, in units of half the diagonal
/// of its box: walls are near it, the inside of a body's surface is at a fifth; ...
const INSIDE_DEPTH_MIN: f64 = 0.3;

/// ... and where it fills at least this share of the view.
const INSIDE_FILLED_MIN: f64 = 0.5;

/// Distances of a stand point, tried from far to near: what is too far away is behind a wall. The unit is the distance at
/// which the content fills the view.
const DISTANCES: [f64; 4] = [1.0, 0.7, 0.5, 0.35];

/// Distances of further stand points, across a room, in the same unit.
const FAR: [f64; 2] = [2.0, 4.0];

/// A person does not stand where things nearer than this share of the distance to the content ...
const NEAR: f64 = 0.15;

/// ... cover more than this share of the picture, ...
const BLOCKED_MAX: f64 = 0.25;

/// ... or where less than this share of the content shows between what stands before it.
const CONTENT_MIN: f64 = 0.25;

/// Share of the content that shows at least in the opening view, if any does, and from a stand point across a room.
const CLEAR_CONTENT_MIN: f64 = 0.5;

/// A further stand point shows at least this share of all rows that no other has shown, ...
const COVER_GAIN_MIN: f64 = 0.01;

/// ... and there are at most so many.
const FURTHER_MAX: usize = 12;

/// Places to look from, each with its camera.
#[derive(Clone, Debug, PartialEq)]
pub struct StandPoints {
    /// Around the content, or within it where that is a furnished room, or both where it may be one; 4 to 12 cameras.
    pub content: Vec<Camera>,
    /// Further places and directions that show the rest: walls, sky, the far side of a room, the background. At most 12, none
    /// for an object alone.
    pub around: Vec<Camera>,
}

/// A field as people see it who stand in or before it.
#[derive(Clone, Debug)]
pub struct Surroundings {
    /// What people look at.
    content: Content,
    /// Whether there is nothing but content.
    is_alone: bool,
    discs: Discs,
    /// Unit vector.
    up: [f64; 3],
}

/// Makes the [`Surroundings`] of fields that need not be in memory at once, such as the segments of a take.
#[derive(Clone, Debug)]
pub struct SurroundingsBuilder(DiscsBuilder);

impl SurroundingsBuilder {
    /// For fields that have `rows` rows together.
    pub fn new(rows: usize) -> SurroundingsBuilder {
        SurroundingsBuilder(DiscsBuilder::new(rows, ROWS))
    }

    /// Adds a field that is looked at in a range of its clip time.
    pub fn add(&mut self, field: &Field, range: [f64; 2]) {
        self.0.add(field, range);
    }

    /// Adds the static background; the first one counts.
    pub fn add_plate(&mut self, plate: &Field) {
        self.0.add_plate(plate);
    }

    /// The surroundings that all of them make; `up` points up in their axes.
    pub fn build(self, up: [f32; 3]) -> Surroundings {
        Surroundings::from_discs(self.0.build(), up)
    }
}

/// A camera, and what it sees.
struct Look {
    camera: Camera,
    glance: Glance,
}

impl Look {
    /// Whether nothing is right before the eye.
    fn is_free(&self) -> bool {
        self.glance.blocked <= BLOCKED_MAX
    }

    /// Whether a person would look at the content from here.
    fn shows_content(&self) -> bool {
        self.is_free() && self.glance.content >= CONTENT_MIN
    }
}

impl Surroundings {
    /// Turn of the stand points from which packages are measured: nothing is chosen by pictures from there.
    pub const MEASURED_TURN: f64 = 0.75;

    /// The surroundings that a field and its static background make; `up` points up in the axes of the field.
    pub fn new(field: &Field, plate: Option<&Field>, up: [f32; 3]) -> Surroundings {
        Surroundings::from_parts(&[(field, [0.0, 1.0])], plate, up)
    }

    /// The surroundings that fields make which are shown at once, each in a range of its clip time.
    pub fn from_parts(parts: &[(&Field, [f64; 2])], plate: Option<&Field>, up: [f32; 3]) -> Surroundings {
        let mut builder = SurroundingsBuilder::new(parts.iter().map(|(field, _)| field.len()).sum());
        parts.iter().for_each(|(field, range)| builder.add(field, *range));
        plate.into_iter().for_each(|plate| builder.add_plate(plate));
        builder.build(up)
    }

    /// The surroundings that `clips` make which are shown at once, each in a range of its clip time.
    pub(crate) fn from_clips(clips: &[(&Clip, [f64; 2])], up: [f32; 3]) -> Surroundings {
        let parts: Vec<(&Field, [f64; 2])> = clips
            .iter()
            .flat_map(|&(clip, range)| [(&clip.static_field, range), (&clip.dynamic_field, range)])
            .collect();
        let plate = clips.iter().find_map(|(clip, _)| clip.plate.as_ref());
        Surroundings::from_parts(&parts, plate, up)
    }

    /// The surroundings of a field whose box alone is known: all of it is content.
    pub(crate) fn from_box(bounds: [[f32; 3]; 2], up: [f32; 3]) -> Surroundings {
        let bounds = bounds.map(|corner| corner.map(f64::from));
        let [low, high] = bounds;
        let half_diagonal = 0.5 * norm(sub(high, low));
        let radius = if half_diagonal > 0.0 { half_diagonal } else { 1.0 };
        let center = std::array::from_fn(|axis| 0.5 * (low[axis] + high[axis]));
        let content = Content { balls: vec![Ball { center, radius, score: 0.0 }], ends: Vec::new(), bounds };
        Surroundings { content, is_alone: true, discs: DiscsBuilder::new(0, 0).build(), up: unit_up(up) }
    }

    fn from_discs(discs: Discs, up: [f32; 3]) -> Surroundings {
        let up = unit_up(up);
        let (content, whole) = Content::find(&discs, up);
        let mut near = Surroundings { content, is_alone: false, discs, up };
        let (_, radius) = near.center_and_radius();
        near.discs.thin_out(radius, SIZE);
        near.mark_content();
        // What is around the balls belongs to the content where they are seen from outside of all: a body with a neck.
        let Some(bounds) = whole else { return near };
        let content = near.content.clone();
        let all = Surroundings { content: Content { bounds, ..near.content }, is_alone: true, ..near };
        let ring = ring_directions(up, 0.0);
        let shown = ring.iter().filter(|&&direction| all.stand(direction, 1.0).shows_content()).count();
        if 2 * shown >= ring.len() { all } else { Surroundings { content, is_alone: false, ..all } }
    }

    /// Corners `[min, max]` of the box around the content, without strays, in source units.
    pub fn content_bounds(&self) -> [[f64; 3]; 2] {
        self.content.bounds
    }

    /// As [`Surroundings::content_bounds`], along `axes`: three unit vectors at right angles, such as the axes of an
    /// upright frame.
    pub fn content_bounds_along(&self, axes: [[f64; 3]; 3]) -> [[f64; 3]; 2] {
        bounds_along(axes, &self.content, &self.discs, self.is_alone)
    }

    /// Radius of the ball that holds most of the content, in source units, above 0.
    pub fn content_radius(&self) -> f64 {
        self.content.radius()
    }

    /// Where playing starts: the first viewpoint of `info`, or else the opening.
    pub fn first_viewpoint(&self, info: &ClipInfo) -> Viewpoint {
        info.viewpoints.first().cloned().unwrap_or_else(|| self.opening())
    }

    /// The view of `camera`, its target as far away as the content, or else as far away as what it sees.
    pub fn viewpoint(&self, name: &str, camera: &Camera) -> Viewpoint {
        let (center, radius) = self.center_and_radius();
        let [x, y, z, _] = camera.camera_from_world[2];
        let (position, forward) = (camera.position(), [x, y, z]);
        let ahead = dot(sub(center, position), forward);
        let is_ahead = ahead > NEAR * radius;
        let depth =
            if is_ahead { ahead } else { self.look(camera.resized(SIZE.0, SIZE.1), 0.0).glance.depth };
        let distance = if depth > 0.0 { depth } else { radius };
        let [position, target] =
            [position, moved(position, forward, distance)].map(|point| point.map(|x| x as f32));
        let fov_y = 2.0 * libm::atan(0.5 * f64::from(camera.height) / camera.k[1][1]);
        Viewpoint { name: name.into(), position, target, fov_y: fov_y as f32 }
    }

    /// Which of `cameras` show the content: nothing stands before it or right before the eye, and it fills at least half as
    /// much of the picture as in the best of them. A camera in haze counts if all that show the content are in haze. None if
    /// none shows it.
    pub fn which_show_content<'a>(&self, cameras: impl Iterator<Item = &'a Camera>) -> Vec<bool> {
        let (center, _) = self.center_and_radius();
        let look =
            |camera: &Camera| self.look(camera.resized(SIZE.0, SIZE.1), norm(sub(center, camera.position())));
        let looks: Vec<Look> = cameras.map(look).collect();
        let is_any_clear = looks.iter().any(|look| look.shows_content() && self.is_clear(look));
        let filled = |look: &Look| {
            let is_shown = look.shows_content() && (!is_any_clear || self.is_clear(look));
            if is_shown { look.glance.filled } else { 0.0 }
        };
        let filled: Vec<f64> = looks.iter().map(filled).collect();
        let least = 0.5 * filled.iter().copied().fold(0.0, f64::max);
        filled.into_iter().map(|filled| filled > 0.0 && filled >= least).collect()
    }

    /// The places where people stand, as cameras of `size` pixels. From each the content shows between what stands
    /// before it, and nothing is right before the eye; where no place is such, they are around the content all the same.
    /// `turn` rotates the places around the content, in units of the angle between neighbours. What was chosen from the
    /// places of one turn is judged from the places of another.
    pub fn stand_points(&self, turn: f64, size: (u32, u32)) -> StandPoints {
        let mut inside = self.inside(turn);
        let is_furnished = inside.first().is_some_and(|(place, _)| self.furniture(*place).is_some());
        let (mut content, further) = if is_furnished {
            // Nobody looks at a furnished room from outside of its walls.
            let further = inside.iter().flat_map(|(place, _)| self.looks_up_and_down(*place, turn)).collect();
            (Vec::new(), further)
        } else {
            // It may as well be a hollow body.
            inside.truncate(1);
            self.looks_from_around(turn)
        };
        content.extend(inside.into_iter().flat_map(|(_, looks)| looks));
        let around = self.cover(&content, further);
        let cameras = |looks: Vec<Look>| {
            looks.into_iter().map(|look| look.camera.resized(size.0, size.1)).collect::<Vec<Camera>>()
        };
        StandPoints { content: cameras(content), around: cameras(around) }
    }

    /// Looks at the content from around it, and further ones that may show what else there is.
    fn looks_from_around(&self, turn: f64) -> (Vec<Look>, Vec<Look>) {
        let directions = ring_directions(self.up, turn);
        let (mut content, mut further) = (Vec::new(), Vec::new());
        for &direction in &directions {
            let stand = |distance: &f64| Some(self.stand(direction, *distance)).filter(Look::shows_content);
            // Near a wall, one sees little of it; near the content, one may see another wall from afar.
            if let Some(nearest) = DISTANCES.iter().rev().find_map(stand) {
                further.push(self.look_away(&nearest));
            }
            if let Some(farthest) = DISTANCES.iter().find_map(stand) {
                further.push(self.look_away(&farthest));
                content.push(farthest);
            }
        }
        if content.is_empty() {
            content = directions.iter().map(|&direction| self.stand(direction, 1.0)).collect();
        }
        let far =
            FAR.iter().flat_map(|&distance| directions.iter().map(move |&direction| (direction, distance)));
        // A gap in a wall is no place to look through.
        let is_clear = |look: &Look| look.is_free() && look.glance.content >= CLEAR_CONTENT_MIN;
        further.extend(far.map(|(direction, distance)| self.stand(direction, distance)).filter(is_clear));
        (content, further)
    }

    /// Marks the discs in the balls.
    fn mark_content(&mut self) {
        for disc in self.discs.instants.iter_mut().flatten() {
            disc.is_content = disc.row < self.discs.field_rows && self.content.radii_to(disc.center) <= 1.0;
        }
    }

    /// Those of `candidates` that show the rows around the content which `first` does not. Each one chosen shows most of the
    /// rows that are left.
    fn cover(&self, first: &[Look], mut candidates: Vec<Look>) -> Vec<Look> {
        let rows = self.discs.rows;
        let mut is_left = vec![false; rows];
        for disc in self.discs.instants.iter().flatten() {
            let may_be_around = !self.is_alone || disc.row >= self.discs.field_rows;
            is_left[disc.row] |= may_be_around && self.content.radii_to(disc.center) > EXTENT;
        }
        let show = |look: &Look, is_left: &mut [bool]| {
            is_left.iter_mut().zip(&look.glance.seen).for_each(|(left, seen)| *left &= !seen);
        };
        first.iter().for_each(|look| show(look, &mut is_left));
        let mut chosen = Vec::new();
        while chosen.len() < FURTHER_MAX {
            let gain = |look: &Look| {
                look.glance.seen.iter().zip(&is_left).filter(|(seen, left)| **seen && **left).count()
            };
            // The first of equals.
            let best =
                (0..candidates.len()).rev().map(|i| (gain(&candidates[i]), i)).max_by_key(|(gain, _)| *gain);
            let is_worth = |gain: usize| gain > 0 && gain as f64 >= COVER_GAIN_MIN * rows as f64;
            let Some((_, best)) = best.filter(|(gain, _)| is_worth(*gain)) else { break };
            let look = candidates.remove(best);
            show(&look, &mut is_left);
            chosen.push(look);
        }
        chosen
    }

    /// Centre of the content's box, and half the box's diagonal, at least the radius of the content.
    fn center_and_radius(&self) -> ([f64; 3], f64) {
        let [low, high] = self.content.bounds;
        let half_diagonal = 0.5 * norm(sub(high, low));
        let center = std::array::from_fn(|axis| 0.5 * (low[axis] + high[axis]));
        (center, half_diagonal.max(self.content.radius()))
    }

    /// The look at the content from `direction`; at a `distance` of 1 its box fills the view.
    fn stand(&self, direction: [f64; 3], distance: f64) -> Look {
        let (center, radius) = self.center_and_radius();
        let distance = distance * radius / libm::sin(0.5 * FOV_Y);
        self.look(self.camera(moved(center, direction, distance), center, FOV_Y), distance)
    }

    /// The look in the other direction from where `look` looks at the content.
    fn look_away(&self, look: &Look) -> Look {
        let (center, _) = self.center_and_radius();
        let position = look.camera.position();
        let arm = sub(position, center);
        self.look(self.camera(position, moved(position, arm, 1.0), AROUND_FOV_Y), norm(arm))
    }

    /// Free places within the content, if it surrounds them at some distance, perhaps open to one side, with the looks around
    /// there.
    fn inside(&self, turn: f64) -> Vec<([f64; 3], Vec<Look>)> {
        let (center, radius) = self.center_and_radius();
        let axes: Vec<[f64; 3]> = level_directions(self.up, 4, 0.0).take(2).collect();
        let extent = |axis: [f64; 3]| {
            let [low, high] = self.content.bounds;
            0.5 * (0..3).map(|i| (axis[i] * (high[i] - low[i])).abs()).sum::<f64>()
        };
        let place = |eighths: f64, share: f64| {
            let (sin, cos) = libm::sincos(std::f64::consts::FRAC_PI_4 * (eighths + turn));
            let place = moved(center, axes[0], share * cos * extent(axes[0]));
            moved(place, axes[1], share * sin * extent(axes[1]))
        };
        let middle = place(0.0, MIDDLE_SHARE * turn);
        let beside = |eighths: f64| place(eighths, PLACE_SHARE);
        let quarter = std::f64::consts::FRAC_PI_2;
        // The first look from beside the center is at the center.
        let directions = |place: [f64; 3]| -> [[f64; 3]; 4] {
            let front = normalize(sub(center, place)).unwrap_or(axes[0]);
            std::array::from_fn(|i| rotate(front, self.up, quarter * i as f64))
        };
        let alone = self.content_discs();
        let sees_walls = |camera: &Camera| {
            // A body that fades before the eye is no room.
            let glance = glance(&alone, camera, NEAR * radius, 0.0);
            let is_far = glance.content_depth >= INSIDE_DEPTH_MIN * radius;
            glance.blocked <= BLOCKED_MAX && glance.filled >= INSIDE_FILLED_MIN && is_far
        };
        let around = |place: [f64; 3]| {
            let camera = |direction| self.camera(place, moved(place, direction, radius), AROUND_FOV_Y);
            let cameras = directions(place).map(camera);
            let mut open = 0;
            let is_open = |camera: &Camera| {
                open += usize::from(!sees_walls(camera));
                open > 1
            };
            if cameras.iter().any(is_open) {
                return None;
            }
            Some((place, cameras.into_iter().map(|camera| self.look(camera, radius)).collect()))
        };
        std::iter::once(middle).chain(PLACES.map(beside)).filter_map(around).take(PLACES_MAX).collect()
    }

    /// Looks at the ceiling and the floor around `place`.
    fn looks_up_and_down(&self, place: [f64; 3], turn: f64) -> Vec<Look> {
        let (_, radius) = self.center_and_radius();
        let tilted = |direction: [f64; 3]| [1.0, -1.0].map(|tilt| moved(direction, self.up, tilt));
        level_directions(self.up, 4, turn)
            .flat_map(tilted)
            .map(|arm| self.look(self.camera(place, moved(place, arm, radius), AROUND_FOV_Y), radius))
            .collect()
    }

    fn camera(&self, position: [f64; 3], target: [f64; 3], fov_y: f64) -> Camera {
        Camera::look_at(position, target, self.up, fov_y, SIZE.0, SIZE.1)
    }

    /// What `camera` sees. Things nearer than a share of `distance` are right before the eye.
    fn look(&self, camera: Camera, distance: f64) -> Look {
        let glance = glance(&self.discs, &camera, NEAR * distance, self.discs.near);
        Look { camera, glance }
    }
}

impl Clip {
    /// Where the content is, and where people stand to look at it. Takes a tenth of a second and more.
    pub fn surroundings(&self) -> Surroundings {
        Surroundings::from_clips(&[(self, [0.0, 1.0])], self.info.up)
    }

    /// The viewpoints, or [`Surroundings::opening`] if there are none. Never empty.
    pub fn viewpoints(&self) -> Vec<Viewpoint> {
        match self.info.viewpoints.as_slice() {
            [] => vec![self.surroundings().opening()],
            viewpoints => viewpoints.to_vec(),
        }
    }
}

/// A unit vector along `up`, or along y where that has no direction.
fn unit_up(up: [f32; 3]) -> [f64; 3] {
    normalize(up.map(f64::from)).unwrap_or([0.0, 1.0, 0.0])
}

/// Directions from the content to the stand points around it.
fn ring_directions(up: [f64; 3], turn: f64) -> Vec<[f64; 3]> {
    let ring = |(elevation, count): (f64, u32)| {
        let (sin, cos) = libm::sincos(elevation.to_radians());
        let raised = move |level: [f64; 3]| std::array::from_fn(|axis| cos * level[axis] + sin * up[axis]);
        level_directions(up, count, turn).map(raised)
    };
    RINGS.into_iter().flat_map(ring).collect()
}

/// `count` directions at right angles to `up`, evenly around it.
fn level_directions(up: [f64; 3], count: u32, turn: f64) -> impl Iterator<Item = [f64; 3]> {
    let axis = if up[0].abs() < 0.9 { [1.0, 0.0, 0.0] } else { [0.0, 0.0, 1.0] };
    let level = normalize(cross(up, axis)).unwrap_or([0.0, 0.0, 1.0]);
    (0..count)
        .map(move |i| rotate(level, up, std::f64::consts::TAU * (f64::from(i) + turn) / f64::from(count)))
}

/// `arm`, rotated by `angle` radians around the unit vector `axis`.
fn rotate(arm: [f64; 3], axis: [f64; 3], angle: f64) -> [f64; 3] {
    let (sin, cos) = libm::sincos(angle);
    let (across, along) = (cross(axis, arm), dot(axis, arm));
    std::array::from_fn(|i| cos * arm[i] + sin * across[i] + (1.0 - cos) * along * axis[i])
}

/// `point`, moved by `distance` times `direction`.
fn moved(point: [f64; 3], direction: [f64; 3], distance: f64) -> [f64; 3] {
    std::array::from_fn(|axis| point[axis] + distance * direction[axis])
}
