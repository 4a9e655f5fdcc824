//! The room around the stage: floor, walls and ceiling, textured at many scales, which never move.
//!
//! The cameras are inside. The floor has planks, walls have plaster and pictures, the ceiling has rafters; noise of
//! wavelengths from metres to centimetres lies over all, so that no two places look alike.

use glam::{DVec3, dvec3};

use crate::synth::stage::{noise, split_mix, unit};

/// Corners in metres. The soles of the figure are above the floor.
const LOW: DVec3 = dvec3(-4.4, -0.05, -4.0);
const HIGH: DVec3 = dvec3(4.4, 3.3, 4.8);

/// Widest noise in metres, number of octaves, and how much it darkens and brightens.
const WIDEST: f64 = 1.6;
const OCTAVES: i32 = 6;
const CONTRAST: f64 = 0.7;

/// Light of the lamps above, and of the sun where it shines: on the floor.
const AMBIENT: f64 = 0.8;
const ON_FLOOR: [f64; 2] = [0.5, 0.4];

/// Widths of planks, of pictures with their distances, and of rafters.
const PLANK: f64 = 0.19;
const PICTURE: [f64; 2] = [1.1, 0.9];
const RAFTER: f64 = 0.9;
const SKIRTING: f64 = 0.14;

/// Colours of the walls in the order of [`Face`], as displayed.
const WALLS: [[f64; 3]; 4] = [[0.72, 0.66, 0.55], [0.52, 0.60, 0.66], [0.66, 0.52, 0.44], [0.56, 0.62, 0.52]];
const WOOD: [f64; 3] = [0.62, 0.45, 0.30];
const PAINT: [f64; 3] = [0.86, 0.85, 0.82];

/// Where a ray meets the room.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct RoomHit {
    pub(super) point: DVec3,
    face: Face,
}

/// A side of the room.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Face {
    /// A wall, by its number: low and high x, low and high z.
    Wall(usize),
    Floor,
    Ceiling,
}

/// Colour of a place without the sun, and what the sun adds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct RoomColor {
    pub(super) ambient: [f64; 3],
    pub(super) sun: [f64; 3],
}

/// Where the ray from a point inside leaves the room.
pub(super) fn hit(origin: DVec3, direction: DVec3) -> RoomHit {
    let toward = |axis: usize| if direction[axis] > 0.0 { HIGH[axis] } else { LOW[axis] };
    let leaves = |axis: usize| (toward(axis) - origin[axis]) / direction[axis];
    // A direction along a wall never meets it.
    let at = [0, 1, 2].map(|axis| if direction[axis] == 0.0 { f64::INFINITY } else { leaves(axis) });
    let axis = (0..3).min_by(|a, b| at[*a].total_cmp(&at[*b])).expect("three axes");
    let is_high = direction[axis] > 0.0;
    let face = match axis {
        0 => Face::Wall(usize::from(is_high)),
        1 if is_high => Face::Ceiling,
        1 => Face::Floor,
        _ => Face::Wall(2 + usize::from(is_high)),
    };
    RoomHit { point: origin + at[axis] * direction, face }
}

impl RoomHit {
    pub(super) fn is_on_floor(&self) -> bool {
        self.face == Face::Floor
    }

    /// The colour, from 0 to 1 as displayed.
    pub(super) fn color(&self) -> RoomColor {
        let p = self.point;
        let flat = match self.face {
            Face::Floor => plank(p),
            Face::Ceiling => match (p.z / RAFTER).rem_euclid(1.0) < 0.2 {
                true => WOOD.map(|c| c * 0.8),
                false => PAINT,
            },
            Face::Wall(wall) => wall_color(wall, p),
        };
        let shade = 1.0 + CONTRAST * (clouds(p) - 0.5);
        let [ambient, sun] = if self.is_on_floor() { ON_FLOOR } else { [AMBIENT, 0.0] };
        let lit = |light: f64| flat.map(|c| (c * shade * light).min(1.0));
        RoomColor { ambient: lit(ambient), sun: lit(sun) }
    }
}

/// Sum of noise of all wavelengths, from 0 to 1.
fn clouds(point: DVec3) -> f64 {
    let octave = |i: i32| {
        let weight = 0.7f64.powi(i);
        [weight, weight * noise(point * (2f64.powi(i) / WIDEST) + DVec3::splat(11.3 * f64::from(i)))]
    };
    let [weights, sum] = (0..OCTAVES).map(octave).fold([0.0; 2], |[a, b], [c, d]| [a + c, b + d]);
    sum / weights
}

/// A number from 0 to 1 for a pair of whole numbers.
fn chance(kind: u64, [a, b]: [f64; 2]) -> f64 {
    let number = [a as i64 as u64, b as i64 as u64].into_iter().fold(kind, |hash, x| split_mix(hash ^ x));
    unit(number)
}

/// Planks along z of different lengths and tints, with gaps and grain.
fn plank(p: DVec3) -> [f64; 3] {
    let row = (p.x / PLANK).floor();
    let along = p.z / 1.7 + chance(1, [row, 0.0]);
    let tint = 0.75 + 0.5 * chance(2, [row, along.floor()]);
    let is_gap = p.x - row * PLANK < 0.012 || along.rem_euclid(1.0) < 0.006;
    let grain = 0.85 + 0.3 * noise(dvec3(p.x / 0.012, row, p.z / 0.4));
    WOOD.map(|c| c * tint * grain * if is_gap { 0.4 } else { 1.0 })
}

/// Plaster with pictures of two colours each, above a skirting board.
fn wall_color(wall: usize, p: DVec3) -> [f64; 3] {
    let across = if wall < 2 { p.z } else { p.x };
    let up = p.y - LOW.y;
    if up < SKIRTING {
        return PAINT.map(|c| c * 0.7);
    }
    let [column, row] = [across / PICTURE[0], up / PICTURE[1]].map(f64::floor);
    let [u, v] = [across / PICTURE[0] - column, up / PICTURE[1] - row];
    let drawn = |kind: u64| chance(100 * wall as u64 + kind, [column, row]);
    let border = [0.10 + 0.2 * drawn(10), 0.12 + 0.2 * drawn(11)];
    let inside = |frame: f64| {
        let is_within = |at: f64, border: f64| (border + frame..1.0 - border - frame).contains(&at);
        is_within(u, border[0]) && is_within(v, border[1])
    };
    if drawn(12) < 0.4 || !inside(0.0) {
        return WALLS[wall];
    }
    if !inside(0.035) {
        return [0.22, 0.17, 0.13];
    }
    let colors = [0, 3].map(|first| [0, 1, 2].map(|c| 0.15 + 0.75 * drawn(first + c)));
    let scale = 0.12 + 0.2 * drawn(13);
    let painted = noise(p / scale + DVec3::splat(50.0 * drawn(14)));
    [0, 1, 2].map(|c| colors[0][c] + (colors[1][c] - colors[0][c]) * ((painted - 0.35) / 0.3).clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_leave_where_the_walls_are() {
        let origin = dvec3(1.0, 1.0, 0.0);
        for (direction, point, face) in [
            (dvec3(2.0, 0.0, 0.0), dvec3(4.4, 1.0, 0.0), Face::Wall(1)),
            (dvec3(0.0, -1.0, 0.0), dvec3(1.0, -0.05, 0.0), Face::Floor),
            (dvec3(0.0, 1.0, 0.1), dvec3(1.0, 3.3, 0.23), Face::Ceiling),
            (dvec3(0.0, 0.0, -1.0), dvec3(1.0, 1.0, -4.0), Face::Wall(2)),
        ] {
            let hit = hit(origin, direction);
            assert!(hit.point.distance(point) < 1e-12 && hit.face == face, "{hit:?}");
        }
    }

    #[test]
    fn the_room_has_texture_at_all_scales_and_no_extremes() {
        let color = |i: usize, step: f64| {
            let angle = i as f64 * step;
            let direction = dvec3(libm::sin(angle), 0.2 * libm::sin(7.0 * angle) - 0.1, libm::cos(angle));
            let RoomColor { ambient, sun } = hit(dvec3(0.0, 1.0, 0.0), direction).color();
            [0, 1, 2].map(|c| ambient[c] + sun[c])
        };
        for step in [0.003, 0.03, 0.3] {
            let values: Vec<f64> = (0..2000).map(|i| color(i, step)[1]).collect();
            let differences = values.windows(2).map(|pair| (pair[1] - pair[0]).abs());
            let mean = differences.sum::<f64>() / 1999.0;
            assert!(mean > 0.004, "{step}: {mean}");
            assert!(values.iter().all(|value| (0.03..0.95).contains(value)));
        }
    }
}
