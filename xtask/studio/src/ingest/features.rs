//! Corners of a picture and descriptors of their surroundings, to find the same point in another picture.
//!
//! Corners are Harris's, on a pyramid. A descriptor is a histogram of gradient directions in 4x4 cells, as SIFT's, but
//! upright: cameras of a rig seldom roll.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use image::RgbImage;
use image::imageops::{self, FilterType};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Largest side in pixels at which corners are sought.
const SIDE_MAX: u32 = 960;

/// Levels of the pyramid and their ratio.
const LEVELS: usize = 4;
const RATIO: f64 = std::f64::consts::SQRT_2;

/// Most corners of a picture, and of a cell of the grid over which they are spread.
const CORNERS_MAX: usize = 900;
const GRID: usize = 10;

/// Half the side of a descriptor's patch, in pixels of its level.
const PATCH: usize = 8;
const CELLS: usize = 4;
const DIRECTIONS: usize = 8;

/// Numbers of a descriptor.
pub(super) const DESCRIPTOR: usize = CELLS * CELLS * DIRECTIONS;

/// Least corner response of a picture, as a part of the largest.
const RESPONSE_MIN: f32 = 1e-4;

/// Similarity of the second best match up to which the best counts, as squared distances.
const RATIO_SQUARED_MAX: f32 = 0.8 * 0.8;

/// The corners of a picture.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(super) struct Features {
    /// In pixels of the picture, from its corner.
    pub(super) points: Vec<[f32; 2]>,
    /// [`DESCRIPTOR`] numbers of each.
    #[serde(serialize_with = "to_base64", deserialize_with = "from_base64")]
    descriptors: Vec<u8>,
}

fn to_base64<S: Serializer>(bytes: &[u8], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(&STANDARD.encode(bytes))
}

fn from_base64<'d, D: Deserializer<'d>>(deserializer: D) -> Result<Vec<u8>, D::Error> {
    let text = String::deserialize(deserializer)?;
    STANDARD.decode(text).map_err(serde::de::Error::custom)
}

/// Brightness, row by row.
struct Grey {
    width: usize,
    height: usize,
    values: Vec<f32>,
}

impl Grey {
    fn at(&self, x: usize, y: usize) -> f32 {
        self.values[y * self.width + x]
    }

    /// Differences over two pixels.
    fn gradients(&self) -> [Grey; 2] {
        let zero = || Grey { values: vec![0.0; self.values.len()], ..*self };
        let [mut dx, mut dy] = [zero(), zero()];
        for y in 1..self.height.saturating_sub(1) {
            for x in 1..self.width.saturating_sub(1) {
                let i = y * self.width + x;
                dx.values[i] = self.at(x + 1, y) - self.at(x - 1, y);
                dy.values[i] = self.at(x, y + 1) - self.at(x, y - 1);
            }
        }
        [dx, dy]
    }

    /// Blurred with 1 2 1 in both directions, `times` times.
    fn blurred(mut self, times: usize) -> Grey {
        for _ in 0..times {
            // Each row by itself, as the end of one lies beside the start of the next.
            self.values.chunks_mut(self.width).for_each(|row| blur(row, 1));
            blur(&mut self.values, self.width);
        }
        self
    }
}

/// Blurs values that lie `step` apart with 1 2 1, but for those at the ends.
fn blur(values: &mut [f32], step: usize) {
    let from = values.to_owned();
    for i in step..values.len().saturating_sub(step) {
        values[i] = 0.25 * (from[i - step] + 2.0 * from[i] + from[i + step]);
    }
}

impl Features {
    /// Finds the corners of a picture.
    pub(super) fn detect(picture: &RgbImage) -> Features {
        let (width, height) = picture.dimensions();
        let mut features = Features::default();
        let base = (f64::from(SIDE_MAX) / f64::from(width.max(height))).min(1.0);
        for level in 0..LEVELS {
            let scale = base / RATIO.powi(level as i32);
            let side = |side: u32| ((f64::from(side) * scale).round() as u32).max(1);
            let (w, h) = (side(width), side(height));
            if w.min(h) < 4 * PATCH as u32 {
                break;
            }
            let small = imageops::resize(picture, w, h, FilterType::Triangle);
            let luma = |p: &image::Rgb<u8>| {
                let [r, g, b] = p.0.map(f32::from);
                0.299 * r + 0.587 * g + 0.114 * b
            };
            let grey =
                Grey { width: w as usize, height: h as usize, values: small.pixels().map(luma).collect() };
            let [dx, dy] = grey.blurred(1).gradients();
            // A level has half the pixels of the level before.
            let most = CORNERS_MAX / (2 << level);
            for [x, y] in corners(&dx, &dy, most) {
                features.points.push([
                    ((x as f64 + 0.5) * f64::from(width) / f64::from(w)) as f32,
                    ((y as f64 + 0.5) * f64::from(height) / f64::from(h)) as f32,
                ]);
                features.descriptors.extend(descriptor(&dx, &dy, x, y));
            }
        }
        features
    }

    fn descriptor(&self, i: usize) -> &[u8] {
        &self.descriptors[i * DESCRIPTOR..(i + 1) * DESCRIPTOR]
    }

    /// Pairs of points of `self` and `other` that are each other's best match, and clearly better than the second; those whose
    /// numbers `may_match` refuses are not compared.
    pub(super) fn matches(
        &self,
        other: &Features,
        may_match: impl Fn(usize, usize) -> bool,
    ) -> Vec<[usize; 2]> {
        // Best match and distance, and the distance of the second best, for each point of both.
        let none = (usize::MAX, f32::INFINITY, f32::INFINITY);
        let (mut of_self, mut of_other) = (vec![none; self.points.len()], vec![none; other.points.len()]);
        for (i, best_of_i) in of_self.iter_mut().enumerate() {
            let descriptor = self.descriptor(i);
            for (j, best_of_j) in of_other.iter_mut().enumerate() {
                if !may_match(i, j) {
                    continue;
                }
                let apart = distance(descriptor, other.descriptor(j));
                for (best, number) in [(&mut *best_of_i, j), (best_of_j, i)] {
                    if apart < best.1 {
                        *best = (number, apart, best.1);
                    } else if apart < best.2 {
                        best.2 = apart;
                    }
                }
            }
        }
        let is_clear = |best: &(usize, f32, f32)| best.1 < RATIO_SQUARED_MAX * best.2;
        let mutual = |(i, best): (usize, &(usize, f32, f32))| {
            let back = of_other.get(best.0)?;
            (back.0 == i && is_clear(best) && is_clear(back)).then_some([i, best.0])
        };
        of_self.iter().enumerate().filter_map(mutual).collect()
    }
}

/// Squared distance of two descriptors.
fn distance(a: &[u8], b: &[u8]) -> f32 {
    let square = |(a, b): (&u8, &u8)| (i32::from(*a) - i32::from(*b)).pow(2);
    a.iter().zip(b).map(square).sum::<i32>() as f32
}

/// Corners by Harris's response, the strongest of each cell of a grid.
fn corners(dx: &Grey, dy: &Grey, most: usize) -> Vec<[usize; 2]> {
    let product = |a: &Grey, b: &Grey| {
        let values = a.values.iter().zip(&b.values).map(|(a, b)| a * b).collect();
        Grey { values, ..*a }.blurred(3)
    };
    let [xx, xy, yy] = [product(dx, dx), product(dx, dy), product(dy, dy)];
    let (width, height) = (dx.width, dx.height);
    let response: Vec<f32> = (0..dx.values.len())
        .map(|i| {
            let [a, b, c] = [xx.values[i], xy.values[i], yy.values[i]];
            a * c - b * b - 0.05 * (a + c) * (a + c)
        })
        .collect();
    let largest = response.iter().copied().fold(0.0, f32::max);
    let mut cells: Vec<Vec<(f32, [usize; 2])>> = vec![Vec::new(); GRID * GRID];
    let margin = PATCH + 2;
    for y in margin..height.saturating_sub(margin) {
        for x in margin..width.saturating_sub(margin) {
            let value = response[y * width + x];
            let is_largest = || {
                let near = (y - 2..=y + 2).flat_map(|v| (x - 2..=x + 2).map(move |u| [u, v]));
                near.into_iter().all(|[u, v]| response[v * width + u] <= value)
            };
            if value > RESPONSE_MIN * largest && is_largest() {
                cells[y * GRID / height * GRID + x * GRID / width].push((value, [x, y]));
            }
        }
    }
    let of_cell = most.div_ceil(GRID * GRID).max(1);
    for cell in &mut cells {
        cell.sort_by(|a, b| b.0.total_cmp(&a.0));
        cell.truncate(2 * of_cell);
    }
    let mut found: Vec<(f32, [usize; 2])> = cells.into_iter().flatten().collect();
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    found.truncate(most);
    found.into_iter().map(|(_, point)| point).collect()
}

/// The descriptor of a point that is more than [`PATCH`] pixels inside.
fn descriptor(dx: &Grey, dy: &Grey, x: usize, y: usize) -> [u8; DESCRIPTOR] {
    let mut bins = [0.0f32; DESCRIPTOR];
    let cell = 2 * PATCH / CELLS;
    for v in 0..2 * PATCH {
        for u in 0..2 * PATCH {
            let (at_x, at_y) = (x + u - PATCH, y + v - PATCH);
            let (gx, gy) = (dx.at(at_x, at_y), dy.at(at_x, at_y));
            let turn = (gy.atan2(gx) / std::f32::consts::TAU + 1.0) * DIRECTIONS as f32;
            let off = [u, v].map(|w| (w as f32 + 0.5 - PATCH as f32) / PATCH as f32);
            let weight = gx.hypot(gy) * (-(off[0] * off[0] + off[1] * off[1])).exp();
            let first = (v / cell * CELLS + u / cell) * DIRECTIONS;
            let part = turn.fract();
            bins[first + turn as usize % DIRECTIONS] += weight * (1.0 - part);
            bins[first + (turn as usize + 1) % DIRECTIONS] += weight * part;
        }
    }
    let unit = |bins: &mut [f32; DESCRIPTOR]| {
        let norm = bins.iter().map(|x| x * x).sum::<f32>().sqrt().max(1e-6);
        bins.iter_mut().for_each(|x| *x /= norm);
    };
    unit(&mut bins);
    // As SIFT does: no single edge decides.
    bins.iter_mut().for_each(|x| *x = x.min(0.2));
    unit(&mut bins);
    bins.map(|x| (x * 512.0).min(255.0) as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Blocks of pseudorandom colours, moved by `by` pixels.
    fn picture(by: [u32; 2]) -> RgbImage {
        RgbImage::from_fn(320, 240, |x, y| {
            let (u, v) = ((x + by[0]) / 9, (y + by[1]) / 7);
            let hash = u.wrapping_mul(0x9e37_79b9) ^ v.wrapping_mul(0x85eb_ca6b);
            let hash = (hash ^ (hash >> 15)).wrapping_mul(0x2c1b_3c6d);
            image::Rgb([(hash >> 8) as u8, (hash >> 16) as u8, (hash >> 24) as u8])
        })
    }

    #[test]
    fn a_row_is_blurred_without_its_neighbours_ends() {
        let (width, height) = (5, 4);
        let values = (0..width * height).map(|i| if i % width == width - 1 { 1.0 } else { 0.0 }).collect();
        let blurred = Grey { width, height, values }.blurred(1);
        for row in blurred.values.chunks(width) {
            assert_eq!(row, [0.0, 0.0, 0.0, 0.25, 1.0]);
        }
    }

    #[test]
    fn the_same_points_are_found_in_a_moved_picture() {
        let [a, b] = [[0, 0], [6, 3]].map(|by| Features::detect(&picture(by)));
        let matches = a.matches(&b, |_, _| true);
        assert!(matches.len() > 60, "{}", matches.len());
        let is_right = |[i, j]: &&[usize; 2]| {
            let (p, q) = (a.points[*i], b.points[*j]);
            (p[0] - q[0] - 6.0).hypot(p[1] - q[1] - 3.0) < 2.0
        };
        let right = matches.iter().filter(is_right).count();
        assert!(right * 10 > matches.len() * 9, "{right} of {}", matches.len());
        assert!(a.matches(&b, |_, _| false).is_empty());
    }

    #[test]
    fn features_survive_json() {
        let features = Features::detect(&picture([0, 0]));
        let again: Features = serde_json::from_str(&serde_json::to_string(&features).unwrap()).unwrap();
        assert_eq!((again.points, again.descriptors), (features.points, features.descriptors));
    }

    #[test]
    fn a_uniform_or_tiny_picture_has_none() {
        assert!(Features::detect(&RgbImage::new(320, 240)).points.is_empty());
        assert!(Features::detect(&RgbImage::new(8, 8)).points.is_empty());
    }
}
