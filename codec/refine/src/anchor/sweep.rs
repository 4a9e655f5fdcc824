//! Plane sweep (Collins, 1996): finds the depth behind the hull's surface at which the photographs
//! agree.
//!
//! Each pixel of the subject tries depths from the hull's surface inwards. At each depth, the patch
//! around the pixel is compared with the neighbouring views by zero-mean normalised cross-correlation
//! (NCC). The score is the mean over the best half of the neighbours, which excludes views that are
//! occluded (Kang, Szeliski and Chai, 2001). The hull's depth stays if no depth scores well, or if
//! neighbours see through the point.

use glam::{DVec3, Mat3, Mat4, Vec3, Vec4};
use rayon::prelude::*;

use super::DepthMap;
use super::hull::Hull;
use super::pinhole::Pinhole;
use crate::fit::Photograph;

/// Settings of the plane sweep.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SweepSettings {
    /// Number of depths that a pixel tries, the hull's included, clamped to 2 to 256.
    pub depths: usize,
    /// Photographs are shrunk by a whole factor until their longer side has about this many pixels, up to 1900: pixels of one
    /// are counted in single precision.
    pub size: u32,
}

impl Default for SweepSettings {
    fn default() -> SweepSettings {
        SweepSettings { depths: 16, size: 512 }
    }
}

/// Most of [`SweptView`]'s longer side is one and a half of this: 2^23 pixels at most.
const SIZE_MAX: u32 = 1900;

/// Number of neighbours that a view is compared with, and how many of them must agree.
const NEIGHBORS: usize = 4;
const BEST: usize = 2;

/// Most neighbours that a view can be compared with.
pub(super) const NEIGHBORS_MAX: usize = 6;

/// Cosines of the least and greatest angle between a view and its neighbours: closer views have no
/// parallax, wider ones see another side.
const ANGLES: [f64; 2] = [0.9998, 0.5];

/// Half-size of a patch: it has `2 PATCH_HALF + 1` pixels a side.
const PATCH_HALF: i32 = 2;

/// Depths of a tilted patch, in units of the depth of its middle.
const TILTS: std::ops::Range<f64> = 0.7..1.4;

/// Least number of pixels of a patch that must show the subject.
const LEAST_PIXELS: usize = 13;

/// Least standard deviation of a patch's brightness, which is 0 to 1: below is noise.
const LEAST_DEVIATION: f32 = 2.0 / 255.0;

/// Least NCC at the best depth, and least gain over the NCC at the hull's depth.
const LEAST_SCORE: f32 = 0.7;
const LEAST_GAIN: f32 = 0.05;

/// Range of the sweep behind the hull: the larger of so many voxels and this fraction of the hull's
/// thickness.
const RANGE_VOXELS: f64 = 3.0;
const RANGE_THICKNESS: f64 = 0.05;

/// A photograph prepared for comparison.
pub(super) struct SweptView {
    pub(super) pinhole: Pinhole,
    /// Brightness over black at `(u, v)` from the middle of each pixel, with u and v from 0 to 1: the factors of 1, u, v and
    /// u v.
    bilinear: Vec<Vec4>,
    pub(super) subject: Vec<bool>,
    spans: Vec<[f32; 2]>,
    /// Views to compare with, nearest first.
    pub(super) neighbors: Vec<usize>,
}

/// Depth maps of the views flagged in `grounding`, empty maps for the others.
pub(super) fn sweep(
    settings: SweepSettings,
    hull: &Hull,
    views: &[(&Pinhole, &Photograph)],
    grounding: &[bool],
) -> Vec<DepthMap> {
    let center = hull.centroid();
    let neighbors: Vec<Vec<usize>> =
        (0..views.len()).map(|i| nearest(views, i, center, ANGLES[1], NEIGHBORS)).collect();
    // The check of a view needs the depths of its neighbours, too.
    let needed =
        |i: usize| grounding[i] || (0..views.len()).any(|j| grounding[j] && neighbors[j].contains(&i));
    let all: Vec<SweptView> = (0..views.len())
        .into_par_iter()
        .map(|i| {
            let (pinhole, photograph) = views[i];
            let mut view = shrunk(pinhole, photograph, settings.size);
            if needed(i) {
                view.spans = hull.spans(&view.pinhole, |pixel| view.subject[pixel]);
            }
            view.neighbors = neighbors[i].clone();
            view
        })
        .collect();
    let matched: Vec<Vec<f32>> = (0..all.len())
        .map(|i| if needed(i) { matched(&all, i, settings.depths, hull.voxel) } else { Vec::new() })
        .collect();
    let checked = |i: usize| match grounding[i] {
        true => checked(&all, &matched, i, hull.voxel),
        false => DepthMap { width: 0, height: 0, depths: Vec::new() },
    };
    (0..all.len()).map(checked).collect()
}

/// At most `count` views whose direction to `center` is closest to the direction of view `i`, closest first, if the
/// cosine of the angle is more than `widest`.
pub(super) fn nearest(
    views: &[(&Pinhole, &Photograph)],
    i: usize,
    center: DVec3,
    widest: f64,
    count: usize,
) -> Vec<usize> {
    let towards = |i: usize| (center - views[i].0.position).normalize_or_zero();
    let cosine = |other: usize| towards(i).dot(towards(other));
    let mut others: Vec<usize> = (0..views.len())
        .filter(|other| *other != i && cosine(*other) < ANGLES[0] && cosine(*other) > widest)
        .collect();
    others.sort_by(|a, b| cosine(*b).total_cmp(&cosine(*a)));
    others.truncate(count);
    others
}

/// Prepares a photograph: shrinks it by a whole factor to about `size` pixels along the longer side.
pub(super) fn shrunk(pinhole: &Pinhole, photograph: &Photograph, size: u32) -> SweptView {
    let size = size.clamp(1, SIZE_MAX);
    let factor = ((pinhole.size[0].max(pinhole.size[1]) + size / 2) / size).max(1);
    let factor = factor.min(pinhole.size[0]).min(pinhole.size[1]);
    let pinhole = pinhole.shrunk(factor);
    let [width, height] = pinhole.size;
    let (mut luma, mut subject) = (Vec::new(), Vec::new());
    for pixel in 0..width * height {
        let (mut sum, mut subject_pixels) = (0, 0);
        for part in 0..factor * factor {
            let x = pixel % width * factor + part % factor;
            let y = pixel / width * factor + part / factor;
            let at = y as usize * photograph.width as usize + x as usize;
            // Rec. 601, in 1/256.
            let [r, g, b, _] = photograph.pixels[at].map(u32::from);
            sum += 77 * r + 150 * g + 29 * b;
            subject_pixels += u32::from(photograph.is_subject(at));
        }
        luma.push(sum as f32 / (256 * 255 * factor * factor) as f32);
        subject.push(2 * subject_pixels > factor * factor);
    }
    let bilinear = bilinear(&luma, width as usize);
    SweptView { pinhole, bilinear, subject, spans: Vec::new(), neighbors: Vec::new() }
}

/// The factors of [`SweptView::bilinear`] of a picture `width` pixels wide; beyond its edges, it goes on as it ends.
fn bilinear(luma: &[f32], width: usize) -> Vec<Vec4> {
    let of_pixel = |pixel: usize| {
        let right = usize::from(pixel % width + 1 < width);
        let below = if pixel + width < luma.len() { width } else { 0 };
        let [here, aside] = [luma[pixel], luma[pixel + right]];
        let [under, across] = [luma[pixel + below], luma[pixel + below + right]];
        Vec4::new(here, aside - here, under - here, here - aside - under + across)
    };
    (0..luma.len()).map(of_pixel).collect()
}

/// 2^23: added to a number from 0 on, it leaves the nearest whole number in the bits of [`WHOLE_BITS`].
const WHOLE: Vec4 = Vec4::splat(8_388_608.0);
const WHOLE_BITS: u32 = (1 << 23) - 1;

impl SweptView {
    /// Bilinear brightness at four places in the picture, columns and rows from the middle of the first pixel.
    #[inline(always)]
    fn brightness(&self, x: Vec4, y: Vec4) -> Vec4 {
        // The pixel whose middle is to the left and above. Exactly at a middle, rounding may choose the pixel before it.
        let left = (x - 0.5).max(Vec4::ZERO) + WHOLE - WHOLE;
        let top = (y - 0.5).max(Vec4::ZERO) + WHOLE - WHOLE;
        let (u, v) = (x - left, y - top);
        let [a, b, c, d] = (top * self.pinhole.size[0] as f32 + left + WHOLE).to_array();
        let factors = |pixel: f32| self.bilinear[(pixel.to_bits() & WHOLE_BITS) as usize];
        let factors = Mat4::from_cols(factors(a), factors(b), factors(c), factors(d)).transpose();
        factors.x_axis + u * factors.y_axis + v * (factors.z_axis + u * factors.w_axis)
    }
}

/// The normalised brightness of a patch: zero mean, unit norm.
pub(super) struct Patch {
    /// Homogeneous image coordinates and brightness of each pixel.
    pixels: Vec<(Vec3, f32)>,
}

impl Patch {
    /// The patch around a pixel; `None` if it has too few pixels or too little contrast.
    pub(super) fn around(view: &SweptView, x: i32, y: i32) -> Option<Patch> {
        let [width, height] = view.pinhole.size.map(|n| n as i32);
        let mut pixels = Vec::with_capacity(PATCH_PIXELS);
        for v in (y - PATCH_HALF).max(0)..(y + PATCH_HALF + 1).min(height) {
            for u in (x - PATCH_HALF).max(0)..(x + PATCH_HALF + 1).min(width) {
                let at = (v * width + u) as usize;
                if view.subject[at] {
                    pixels.push((Vec3::new(u as f32 + 0.5, v as f32 + 0.5, 1.0), view.bilinear[at].x));
                }
            }
        }
        if pixels.len() < LEAST_PIXELS {
            return None;
        }
        let n = pixels.len() as f32;
        let mean = pixels.iter().map(|(_, luma)| luma).sum::<f32>() / n;
        let norm = pixels.iter().map(|(_, luma)| (luma - mean).powi(2)).sum::<f32>().sqrt();
        if norm < LEAST_DEVIATION * n.sqrt() {
            return None;
        }
        for (_, luma) in &mut pixels {
            *luma = (*luma - mean) / norm;
        }
        Some(Patch { pixels })
    }

    /// The patch on a plane with this normal instead of one across the axis of `view`: its pixels are farther or nearer
    /// than the middle one, at `middle`, in the same proportion at all depths. `None` if the plane is seen too flatly.
    pub(super) fn tilted(&self, view: &SweptView, middle: [u32; 2], normal: DVec3) -> Option<Patch> {
        let towards = normal.dot(view.pinhole.ray(middle));
        let tilted = |(place, luma): &(Vec3, f32)| {
            let factor = towards / normal.dot(view.pinhole.world_from_pixel * place.as_dvec3());
            TILTS.contains(&factor).then(|| (factor as f32 * *place, *luma))
        };
        self.pixels.iter().map(tilted).collect::<Option<Vec<_>>>().map(|pixels| Patch { pixels })
    }

    /// NCC, -1 to 1, of the patch with its projection into `other` if it is at `depth`; `None` if the
    /// projection leaves the image. `rays` are the pixels' rays in `other`.
    fn likeness(&self, other: &SweptView, rays: &Rays, offset: Vec3, depth: f32) -> Option<f32> {
        let [width, height] = other.pinhole.size;
        let most = [(width - 1) as f32, (height - 1) as f32];
        let [x, y] = rays.places(offset, depth, most)?;
        let (mut sum, mut squares, mut product) = (Vec4::ZERO, Vec4::ZERO, Vec4::ZERO);
        for i in 0..PATCH_VECTORS {
            let there = rays.is_pixel[i] * other.brightness(x[i], y[i]);
            sum += there;
            squares += there * there;
            product += rays.luma[i] * there;
        }
        let (sum, squares, product) = (sum.element_sum(), squares.element_sum(), product.element_sum());
        let n = self.pixels.len() as f32;
        let variance = (squares - sum * sum / n) / n;
        // The patch's own sum is 0, so the other's mean does not matter to the product.
        Some(if variance < LEAST_DEVIATION.powi(2) { 0.0 } else { product / (variance * n).sqrt() })
    }
}

/// Most pixels of a patch, and number of vectors that hold a coordinate of each.
const PATCH_PIXELS: usize = (2 * PATCH_HALF as usize + 1).pow(2);
const PATCH_VECTORS: usize = PATCH_PIXELS.div_ceil(4);

/// The rays of a patch's pixels in another view, in vectors of each coordinate, and their brightness: the sweep spends its
/// time on them. Behind the last ray are copies of the first that do not count.
struct Rays {
    rays: [[Vec4; PATCH_VECTORS]; 3],
    luma: [Vec4; PATCH_VECTORS],
    /// 1 where there is a pixel, else 0.
    is_pixel: [Vec4; PATCH_VECTORS],
}

impl Rays {
    fn new(patch: &Patch, matrix: Mat3) -> Rays {
        let first = patch.pixels.first().map_or(Vec3::ZERO, |(place, _)| matrix * *place);
        let mut rays = first.to_array().map(|x| [Vec4::splat(x); PATCH_VECTORS]);
        let [mut luma, mut is_pixel] = [[Vec4::ZERO; PATCH_VECTORS]; 2];
        for (i, (place, brightness)) in patch.pixels.iter().enumerate() {
            let ray = matrix * *place;
            (0..3).for_each(|axis| rays[axis][i / 4][i % 4] = ray[axis]);
            luma[i / 4][i % 4] = *brightness;
            is_pixel[i / 4][i % 4] = 1.0;
        }
        Rays { rays, luma, is_pixel }
    }

    /// Columns and rows of the pixels at `depth`, from the middle of the first one; `None` unless all are between 0 and
    /// `most`.
    fn places(&self, offset: Vec3, depth: f32, most: [f32; 2]) -> Option<[[Vec4; PATCH_VECTORS]; 2]> {
        let [x, y, z] = &self.rays;
        let mut places = [[Vec4::ZERO; PATCH_VECTORS]; 2];
        for i in 0..PATCH_VECTORS {
            let z = depth * z[i] + offset.z;
            let inverse = z.recip();
            let column = (depth * x[i] + offset.x) * inverse - 0.5;
            let row = (depth * y[i] + offset.y) * inverse - 0.5;
            let within = z.cmpgt(Vec4::ZERO)
                & column.cmpge(Vec4::ZERO)
                & row.cmpge(Vec4::ZERO)
                & column.cmplt(Vec4::splat(most[0]))
                & row.cmplt(Vec4::splat(most[1]));
            if !within.all() {
                return None;
            }
            (places[0][i], places[1][i]) = (column, row);
        }
        Some(places)
    }
}

/// Where the pixels of a view are in another: at `depth * (matrix * pixel) + offset`.
pub(super) struct Neighbor<'a> {
    view: &'a SweptView,
    matrix: Mat3,
    offset: Vec3,
}

/// The neighbours of view `i`.
pub(super) fn neighbors(all: &[SweptView], i: usize) -> Vec<Neighbor<'_>> {
    let from = &all[i].pinhole;
    let neighbor = |&other: &usize| {
        let to = &all[other].pinhole;
        let matrix = to.pixel_from_world * from.world_from_pixel;
        let offset = to.pixel_from_world * from.position + to.offset;
        Neighbor { view: &all[other], matrix: matrix.as_mat3(), offset: offset.as_vec3() }
    };
    all[i].neighbors.iter().map(neighbor).collect()
}

/// The score of a patch at each of `depths`: the mean NCC over the best neighbours.
pub(super) fn scores(
    patch: &Patch,
    neighbors: &[Neighbor],
    depths: impl ExactSizeIterator<Item = f32> + Clone,
) -> Vec<f32> {
    let mut scores = vec![[f32::NEG_INFINITY; NEIGHBORS_MAX]; depths.len()];
    for (slot, Neighbor { view, matrix, offset }) in neighbors.iter().enumerate() {
        let rays = Rays::new(patch, *matrix);
        for (depth, scores) in depths.clone().zip(&mut scores) {
            scores[slot] = patch.likeness(view, &rays, *offset, depth).unwrap_or(f32::NEG_INFINITY);
        }
    }
    let best = BEST.min(neighbors.len().max(1));
    let score = |mut scores: [f32; NEIGHBORS_MAX]| {
        scores.sort_by(|a, b| b.total_cmp(a));
        scores[..best].iter().sum::<f32>() / best as f32
    };
    scores.into_iter().map(score).collect()
}

/// The depths of view `i` with the highest NCC, or the hull's depths where no NCC is high.
fn matched(all: &[SweptView], i: usize, depths: usize, voxel: f64) -> Vec<f32> {
    let view = &all[i];
    let depths = depths.clamp(2, 256);
    let neighbors = neighbors(all, i);
    let width = view.pinhole.size[0] as usize;
    let mut swept: Vec<f32> = view.spans.iter().map(|[enter, _]| *enter).collect();
    swept.par_iter_mut().enumerate().filter(|(_, depth)| **depth > 0.0).for_each(|(pixel, depth)| {
        let (x, y) = (pixel % width, pixel / width);
        let [enter, leave] = view.spans[pixel];
        let ray = view.pinhole.ray([x as u32, y as u32]).length();
        let behind = (RANGE_VOXELS * voxel / ray) as f32;
        let behind = behind.max(RANGE_THICKNESS as f32 * (leave - enter)).min(leave - enter);
        let step = behind / (depths - 1) as f32;
        let tried = (0..depths).map(|k| enter + k as f32 * step);
        if let Some(patch) = Patch::around(view, x as i32, y as i32) {
            *depth = enter + step * peak(&scores(&patch, &neighbors, tried));
        }
    });
    swept
}

/// Position of the highest score in steps from the first, refined by a parabola; 0 if no score is
/// high.
fn peak(scores: &[f32]) -> f32 {
    let Some(k) = (0..scores.len()).max_by(|a, b| scores[*a].total_cmp(&scores[*b])) else { return 0.0 };
    let gains = scores[k] > scores[0] + LEAST_GAIN || !scores[0].is_finite();
    if scores[k] < LEAST_SCORE || !gains {
        return 0.0;
    }
    interpolated(scores, k)
}

/// Position of the peak at `k`, refined by the parabola through its neighbours.
pub(super) fn interpolated(scores: &[f32], k: usize) -> f32 {
    let near = |k: Option<usize>| k.and_then(|k| scores.get(k)).copied().filter(|s| s.is_finite());
    let aside = match (near(k.checked_sub(1)), near(Some(k + 1))) {
        (Some(before), Some(after)) => {
            let curve = before - 2.0 * scores[k] + after;
            if curve < 0.0 { (0.5 * (before - after) / curve).clamp(-0.5, 0.5) } else { 0.0 }
        }
        _ => 0.0,
    };
    k as f32 + aside
}

/// The matched depths of view `i` that neighbours confirm, and the hull's depths elsewhere.
///
/// A neighbour confirms a point within a voxel of its own surface and denies a point in front of it.
/// For a point behind its surface it abstains.
fn checked(all: &[SweptView], matched: &[Vec<f32>], i: usize, voxel: f64) -> DepthMap {
    let view = &all[i];
    let [width, height] = view.pinhole.size;
    let depth = |pixel: usize| {
        let (found, [enter, _]) = (matched[i][pixel], view.spans[pixel]);
        if found == enter {
            return enter;
        }
        let pixel = pixel as u32;
        let ray = view.pinhole.ray([pixel % width, pixel / width]);
        let point = view.pinhole.position + f64::from(found) * ray;
        let mut votes = 0;
        for &other in &view.neighbors {
            let pinhole = &all[other].pinhole;
            let Some((place, there)) = pinhole.project(point) else { continue };
            let Some(at) = pinhole.pixel(place).filter(|at| matched[other][*at] > 0.0) else { continue };
            let before = f64::from(matched[other][at]) - there;
            votes += if before.abs() < voxel { 1 } else { -i32::from(before > 0.0) };
        }
        if votes > 0 { found } else { enter }
    };
    let depths = (0..(width * height) as usize).into_par_iter().map(depth).collect();
    DepthMap { width, height, depths }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::anchor::hull::HullSettings;
    use crate::anchor::silhouette::Silhouette;
    use crate::anchor::test_scene::{pattern, ring, sphere, view};

    /// Mean depth errors of the hull and of the sweep where the hull is far from the surface: four balls
    /// with a smaller one between them form a hollow that no silhouette shows.
    fn mean_errors(color: fn(DVec3) -> [u8; 3]) -> [f64; 2] {
        let ball = |x: f64, y: f64| sphere(DVec3::new(x, y, 0.0), 0.22);
        let small = sphere(DVec3::ZERO, 0.17);
        let shapes = [ball(0.2, 0.2), ball(-0.2, 0.2), ball(0.2, -0.2), ball(-0.2, -0.2), small];
        let views: Vec<_> =
            ring(24, 3.0, 200).iter().enumerate().map(|(i, c)| view(i, c, &shapes, color)).collect();
        let pinholes: Vec<Pinhole> = views.iter().map(|(view, _)| Pinhole::new(&view.camera)).collect();
        let silhouettes = pinholes
            .iter()
            .zip(&views)
            .map(|(pinhole, (view, _))| Silhouette::new(pinhole, &view.photograph));
        let hull = Hull::carve(silhouettes.collect(), HullSettings { voxels: 64, misses: 0 }).unwrap();
        let pairs: Vec<_> = pinholes.iter().zip(views.iter().map(|(view, _)| &view.photograph)).collect();
        let grounding: Vec<bool> = (0..24).map(|i| i == 0).collect();
        let swept = sweep(SweepSettings::default(), &hull, &pairs, &grounding);
        assert!(swept[1..].iter().all(|map| map.depths.is_empty()));
        let spans = hull.spans(&pinholes[0], |pixel| views[0].1[pixel] > 0.0);
        let far: Vec<[f32; 2]> = (0..spans.len())
            .map(|i| [spans[i][0] - views[0].1[i], swept[0].depths[i] - views[0].1[i]])
            .zip(&spans)
            .filter(|(error, span)| span[0] > 0.0 && error[0].abs() > 0.015)
            .map(|(error, _)| error)
            .collect();
        assert!(far.len() > 100, "{}", far.len());
        [0, 1].map(|k| far.iter().map(|error| f64::from(error[k].abs())).sum::<f64>() / far.len() as f64)
    }

    #[test]
    fn the_sweep_finds_a_textured_hollow() {
        let [hull, swept] = mean_errors(pattern);
        assert!(swept < 0.7 * hull, "hull {hull}, swept {swept}");
    }

    #[test]
    fn without_texture_the_hull_stays() {
        for color in [|_| [0; 3], |_| [200, 100, 50]] as [fn(DVec3) -> [u8; 3]; 2] {
            let [hull, swept] = mean_errors(color);
            assert!((swept - hull).abs() < 0.05 * hull, "hull {hull}, swept {swept}");
        }
    }

    #[test]
    fn brightness_is_bilinear() {
        let mut random = fastrand::Rng::with_seed(7);
        let (width, height) = (5, 4);
        let luma: Vec<f32> = (0..width * height).map(|_| random.f32()).collect();
        let camera = &ring(1, 3.0, 5)[0];
        let pinhole = Pinhole { size: [width as u32, height as u32], ..Pinhole::new(camera) };
        let bilinear = bilinear(&luma, width);
        let view = SweptView { pinhole, bilinear, subject: vec![], spans: vec![], neighbors: vec![] };
        let expected = |x: f32, y: f32| {
            let weight = |pixel: usize| {
                let [dx, dy] = [x - (pixel % width) as f32, y - (pixel / width) as f32];
                (1.0 - dx.abs()).max(0.0) * (1.0 - dy.abs()).max(0.0)
            };
            (0..luma.len()).map(|pixel| weight(pixel) * luma[pixel]).sum::<f32>()
        };
        for i in 0..400 {
            // Whole numbers and halves, too.
            let mut place = |most: usize| {
                let part = if i % 2 == 0 { random.f32() } else { 0.125 * random.u32(0..8) as f32 };
                part * (most - 1) as f32
            };
            let (x, y) =
                (Vec4::from([0; 4].map(|_| place(width))), Vec4::from([0; 4].map(|_| place(height))));
            let found = view.brightness(x, y);
            (0..4).for_each(|k| assert!((found[k] - expected(x[k], y[k])).abs() < 1e-5, "{x} {y}"));
        }
    }

    #[test]
    fn peaks_are_interpolated_and_must_be_high() {
        let parabola: Vec<f32> = (0..9).map(|k| 0.95 - 0.02 * (k as f32 - 4.3).powi(2)).collect();
        assert!((peak(&parabola) - 4.3).abs() < 1e-4);
        assert_eq!(peak(&parabola.iter().map(|s| s - 0.5).collect::<Vec<_>>()), 0.0);
        assert_eq!(peak(&[0.9, 0.91, 0.92]), 0.0);
        assert_eq!(peak(&[f32::NEG_INFINITY; 3]), 0.0);
    }
}
