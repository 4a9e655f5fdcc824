//! Plane sweep through all the space in front of the cameras, for photographs without masks.
//!
//! Each pixel tries depths from near the camera to far behind the point that the cameras look at, evenly in inverse
//! depth and for several normals (Gallup et al., 2007), and takes the depth at which neighbouring photographs agree
//! best. Depths stay that a neighbour confirms and others around support. Other pixels, such as bare walls, get the
//! inverse depth of the farthest around them, from a pyramid that is filled from coarse to fine (pull-push: Gortler et al.,
//! 1996).

use codec::NEAR_SHARE;
use glam::DVec3;
use rayon::prelude::*;

use super::DepthMap;
use super::pinhole::Pinhole;
use super::sweep::{
    NEIGHBORS_MAX, Neighbor, Patch, SweptView, interpolated, nearest, neighbors, scores, shrunk,
};
use crate::capture::Focus;
use crate::fit::Photograph;

/// Longer side of the photographs in pixels, and number of depths that a pixel tries: from one to the next, its image
/// in a camera 30 degrees aside moves by about a pixel.
const SIZE: u32 = 192;
const DEPTHS: usize = 384;

/// Farthest depth, in distances between the cameras and what they look at; the nearest is the near distance's share.
const FARTHEST: f64 = 20.0;

/// Every so many columns and rows, a pixel is matched.
const STRIDE: u32 = 2;

/// Cosine of the widest angle between a view and its neighbours, as seen from what all look at.
const WIDEST: f64 = 0.0;

/// Number of normals of upright surfaces that are tried, and cosine between a normal and a ray above which a surface is
/// seen too flatly.
const AROUND: u32 = 8;
const FLATTEST: f64 = -0.3;

/// Least NCC of a match, and at the depth before or after it: of each two depths, one is tried where this is reached beside it.
const LEAST_SCORE: f32 = 0.8;
const LEAST_BESIDE: f32 = 0.4;

/// A neighbour confirms a depth if its own differs by at most so many steps.
const CONFIRMING: f64 = 2.0;

/// Number of pixels around one that support its depth, if theirs differ by at most so many steps.
const SUPPORTING: usize = 2;
const ALIKE: f64 = 8.0;

/// Depth maps of the views flagged in `grounding`, empty maps for the others; `None` if all cameras are at one place.
pub(super) fn sweep(views: &[(&Pinhole, &Photograph)], grounding: &[bool]) -> Option<Vec<DepthMap>> {
    let pinholes: Vec<Pinhole> = views.iter().map(|(pinhole, _)| (*pinhole).clone()).collect();
    let Focus { center, distance, .. } = focus(&pinholes)?;
    let steps = Steps { nearest: NEAR_SHARE * distance, farthest: FARTHEST * distance };
    let mut all: Vec<SweptView> =
        views.par_iter().map(|(pinhole, photograph)| shrunk(pinhole, photograph, SIZE)).collect();
    for (i, view) in all.iter_mut().enumerate() {
        view.neighbors = nearest(views, i, center, WIDEST, NEIGHBORS_MAX);
    }
    let normals = normals(&pinholes);
    let matched: Vec<Vec<Option<f32>>> = (0..all.len()).map(|i| matched(&all, i, &normals, &steps)).collect();
    let map = |i: usize| {
        if !grounding[i] {
            return DepthMap { width: 0, height: 0, depths: Vec::new() };
        }
        let [width, height] = all[i].pinhole.size;
        let known = supported(&confirmed(&all, &matched, i, &steps), width as usize);
        let filled = filled(&known, width as usize, steps.at(distance) as f32);
        let depths = filled.into_iter().map(|step| steps.depth(f64::from(step)) as f32).collect();
        DepthMap { width, height, depths }
    };
    Some((0..all.len()).map(map).collect())
}

/// What the cameras look at.
fn focus(pinholes: &[Pinhole]) -> Option<Focus> {
    Focus::from_axes(&pinholes.iter().map(Pinhole::axis).collect::<Vec<_>>())
}

/// The depths that are tried.
struct Steps {
    nearest: f64,
    farthest: f64,
}

impl Steps {
    /// Depth at a step from the nearest, 0 to `DEPTHS - 1` or between.
    fn depth(&self, step: f64) -> f64 {
        1.0 / (1.0 / self.nearest + step * self.size())
    }

    /// Step at a depth.
    fn at(&self, depth: f64) -> f64 {
        (1.0 / depth - 1.0 / self.nearest) / self.size()
    }

    /// Inverse depth of a step.
    fn size(&self) -> f64 {
        (1.0 / self.farthest - 1.0 / self.nearest) / (DEPTHS - 1) as f64
    }
}

/// Normals of surfaces that are tried: up, down and around.
fn normals(pinholes: &[Pinhole]) -> Vec<DVec3> {
    let up = pinholes.iter().map(|pinhole| pinhole.up).sum::<DVec3>().normalize_or(DVec3::Y);
    let (side, front) = up.any_orthonormal_pair();
    let around = (0..AROUND).map(|i| {
        let (sin, cos) = (std::f64::consts::TAU * f64::from(i) / f64::from(AROUND)).sin_cos();
        sin * side + cos * front
    });
    [up, -up].into_iter().chain(around).collect()
}

/// The step at which each pixel of view `i` matches; `None` where no NCC is high.
fn matched(all: &[SweptView], i: usize, normals: &[DVec3], steps: &Steps) -> Vec<Option<f32>> {
    let view = &all[i];
    let depths: Vec<f32> = (0..DEPTHS).map(|k| steps.depth(k as f64) as f32).collect();
    let neighbors = neighbors(all, i);
    let [width, height] = view.pinhole.size;
    let of_pixel = |pixel: u32| {
        let at = [pixel % width, pixel / width];
        if at.iter().any(|at| !at.is_multiple_of(STRIDE)) {
            return None;
        }
        let patch = Patch::around(view, at[0] as i32, at[1] as i32)?;
        let ray = view.pinhole.ray(at).normalize();
        let of_normal = |normal: &DVec3| {
            let patch = (normal.dot(ray) < FLATTEST).then(|| patch.tilted(view, at, *normal))??;
            let scores = scores_at(&patch, &neighbors, &depths);
            let best = (0..DEPTHS).max_by(|a, b| scores[*a].total_cmp(&scores[*b]))?;
            Some((scores[best], interpolated(&scores, best)))
        };
        let best = normals.iter().filter_map(of_normal).max_by(|(a, _), (b, _)| a.total_cmp(b));
        best.filter(|(score, _)| *score >= LEAST_SCORE).map(|(_, step)| step)
    };
    (0..width * height).into_par_iter().map(of_pixel).collect()
}

/// The scores of a patch at each second depth, and at the depths between these that are beside a high one.
fn scores_at(patch: &Patch, neighbors: &[Neighbor], depths: &[f32]) -> Vec<f32> {
    let mut all = vec![f32::NEG_INFINITY; depths.len()];
    let even = scores(patch, neighbors, depths.iter().copied().step_by(2));
    all.iter_mut().step_by(2).zip(even).for_each(|(score, even)| *score = even);
    let is_high = |k: usize| all.get(k).is_some_and(|score| *score >= LEAST_BESIDE);
    let between: Vec<usize> =
        (1..depths.len()).step_by(2).filter(|k| is_high(k - 1) || is_high(k + 1)).collect();
    let odd = scores(patch, neighbors, between.iter().map(|k| depths[*k]));
    between.into_iter().zip(odd).for_each(|(k, score)| all[k] = score);
    all
}

/// The steps of view `i` that more neighbours confirm than deny. A neighbour denies a point that it sees through.
fn confirmed(all: &[SweptView], matched: &[Vec<Option<f32>>], i: usize, steps: &Steps) -> Vec<Option<f32>> {
    let view = &all[i];
    let width = view.pinhole.size[0];
    let of_pixel = |pixel: usize| {
        let step = matched[i][pixel]?;
        let ray = view.pinhole.ray([pixel as u32 % width, pixel as u32 / width]);
        let point = view.pinhole.position + steps.depth(f64::from(step)) * ray;
        let mut votes = 0;
        for &other in &view.neighbors {
            let pinhole = &all[other].pinhole;
            let Some((place, depth)) = pinhole.project(point) else { continue };
            // The pixel that was matched and holds or is next to this one.
            let nearest = place.map(|at| f64::from(STRIDE) * (at / f64::from(STRIDE)).floor());
            let Some(own) = pinhole.pixel(nearest).and_then(|at| matched[other][at]) else { continue };
            let behind = f64::from(own) - steps.at(depth);
            votes += if behind.abs() <= CONFIRMING { 1 } else { -i32::from(behind > 0.0) };
        }
        (votes > 0).then_some(step)
    };
    (0..matched[i].len()).into_par_iter().map(of_pixel).collect()
}

/// The steps that others around them support: at least [`SUPPORTING`] of the eight next pixels that were matched. Chance
/// matches of bare surfaces stand alone, and would spread.
fn supported(steps: &[Option<f32>], width: usize) -> Vec<Option<f32>> {
    let (stride, height) = (STRIDE as usize, steps.len() / width.max(1));
    let of_pixel = |pixel: usize| {
        let step = steps[pixel]?;
        let near =
            |at: usize, size: usize| (at.saturating_sub(stride)..size.min(at + stride + 1)).step_by(stride);
        let around =
            near(pixel / width, height).flat_map(|y| near(pixel % width, width).map(move |x| y * width + x));
        let is_alike =
            |other: &usize| steps[*other].is_some_and(|other| f64::from((other - step).abs()) <= ALIKE);
        (around.filter(is_alike).count() > SUPPORTING).then_some(step)
    };
    (0..steps.len()).map(of_pixel).collect()
}

/// The known steps, and elsewhere what is between the farthest around, of a picture `width` pixels wide; `none` if nothing
/// is known. What is bare is rather a wall than what stands before it.
fn filled(known: &[Option<f32>], width: usize, none: f32) -> Vec<f32> {
    let height = known.len() / width.max(1);
    if known.iter().all(Option::is_some) || width * height <= 1 {
        return known.iter().map(|value| value.unwrap_or(none)).collect();
    }
    let half = width.div_ceil(2);
    let mut farthest = vec![None; half * height.div_ceil(2)];
    for (pixel, value) in known.iter().enumerate() {
        let cell = &mut farthest[pixel / width / 2 * half + pixel % width / 2];
        *cell = match (*cell, *value) {
            (Some(a), Some(b)) => Some(f32::max(a, b)),
            (a, b) => a.or(b),
        };
    }
    let coarse = filled(&farthest, half, none);
    // Bilinear between the centres of the coarse pixels.
    let at = |x: usize, y: usize| {
        let near = |k: usize, size: usize| {
            if k.is_multiple_of(2) { (k / 2).saturating_sub(1) } else { (k / 2 + 1).min(size - 1) }
        };
        let (columns, rows) = ([x / 2, near(x, half)], [y / 2, near(y, height.div_ceil(2))]);
        let row = |y: usize| 0.75 * coarse[y * half + columns[0]] + 0.25 * coarse[y * half + columns[1]];
        0.75 * row(rows[0]) + 0.25 * row(rows[1])
    };
    let of_pixel =
        |(pixel, value): (usize, &Option<f32>)| value.unwrap_or_else(|| at(pixel % width, pixel / width));
    known.iter().enumerate().map(of_pixel).collect()
}

#[cfg(test)]
mod tests {
    use codec::Camera;

    use super::*;

    /// A room of 8 by 5 by 8 with a waving texture, and a photograph of it with the true depths.
    fn photograph(camera: &Camera, is_bare: bool) -> (Photograph, Vec<f64>) {
        let (half, pinhole) = (DVec3::new(4.0, 2.5, 4.0), Pinhole::new(camera));
        let (mut pixels, mut depths) = (Vec::new(), Vec::new());
        for y in 0..camera.height {
            for x in 0..camera.width {
                let (ray, from) = (pinhole.ray([x, y]), pinhole.position);
                let wall = |k: usize| (half[k] * ray[k].signum() - from[k]) / ray[k];
                let depth = (0..3).map(wall).fold(f64::INFINITY, f64::min);
                let at = from + depth * ray;
                let wave =
                    |k: f64| (7.0 * at.x + k).sin() + (9.0 * at.y - k).sin() + (8.0 * at.z + 2.0 * k).sin();
                let has_texture = !is_bare || at.y < -1.0;
                let value =
                    if has_texture { 128.0 + 20.0 * (wave(0.0) + wave(1.0 + at.x * at.z)) } else { 128.0 };
                pixels.push([value as u8, value as u8, value as u8, 255]);
                depths.push(depth);
            }
        }
        let photograph = Photograph { width: camera.width, height: camera.height, pixels, valid: Vec::new() };
        (photograph, depths)
    }

    /// Relative errors of all depths, ascending.
    fn errors(is_bare: bool) -> Vec<f64> {
        let camera = |i: usize| {
            let angle = 0.5 * i as f64;
            let position = [3.0 * angle.sin(), 0.3 * (i % 2) as f64, 3.0 * angle.cos()];
            Camera::look_at(position, [0.0; 3], [0.0, 1.0, 0.0], 0.9, 96, 72)
        };
        let cameras: Vec<Camera> = (0..12).map(camera).collect();
        let taken: Vec<_> = cameras.iter().map(|camera| photograph(camera, is_bare)).collect();
        let pinholes: Vec<Pinhole> = cameras.iter().map(Pinhole::new).collect();
        let pairs: Vec<_> = pinholes.iter().zip(taken.iter().map(|(photograph, _)| photograph)).collect();
        let maps = sweep(&pairs, &[[true].as_slice(), &[false; 11]].concat()).unwrap();
        assert!(maps[1..].iter().all(|map| map.depths.is_empty()));
        let error = |(found, depth): (&f32, &f64)| (f64::from(*found) / depth - 1.0).abs();
        let mut errors: Vec<f64> = maps[0].depths.iter().zip(&taken[0].1).map(error).collect();
        errors.sort_by(f64::total_cmp);
        errors
    }

    #[test]
    fn the_walls_of_a_room_are_found() {
        let errors = errors(false);
        let [median, most] = [errors.len() / 2, errors.len() * 9 / 10].map(|i| errors[i]);
        assert!(median < 0.02 && most < 0.2, "{median} {most}");
    }

    #[test]
    fn bare_walls_are_as_far_as_what_is_around_them() {
        let errors = errors(true);
        let [median, most] = [errors.len() / 2, errors.len() * 9 / 10].map(|i| errors[i]);
        assert!(median < 0.3 && most < 0.6, "{median} {most}");
    }

    #[test]
    fn what_is_unknown_is_between_what_is_known() {
        let mut known = vec![None; 35];
        (known[0], known[34]) = (Some(1.0), Some(3.0));
        let filled = filled(&known, 7, 9.0);
        assert_eq!((filled[0], filled[34]), (1.0, 3.0));
        assert!(filled.iter().all(|value| (1.0..=3.0).contains(value)), "{filled:?}");
        assert_eq!(super::filled(&[None; 6], 3, 9.0), [9.0; 6]);
        assert!(super::filled(&[], 0, 9.0).is_empty());
    }

    #[test]
    fn cameras_side_by_side_look_at_something_and_those_at_one_place_at_nothing() {
        let camera = |x: f64| Camera::look_at([x, 0.0, 0.0], [x, 0.0, 5.0], [0.0, 1.0, 0.0], 1.0, 8, 8);
        let rig: Vec<Pinhole> = [0.0, 1.0, 2.0].map(|x| Pinhole::new(&camera(x))).into();
        let Focus { center, distance, .. } = focus(&rig).unwrap();
        assert!(center.z > 2.0 && (distance - center.z).abs() < 0.5, "{center} {distance}");
        assert!(focus(&[rig[0].clone(), rig[0].clone()]).is_none());
        assert!(focus(&[]).is_none());
    }
}
