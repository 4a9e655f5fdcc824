//! The visual hull: the largest body consistent with all silhouettes.
//!
//! A coarse search finds the bounding box, and a voxel grid in the box is carved. Each pixel's ray is
//! then traced through the grid to its entry voxel and bisected there against the silhouettes, so that
//! depths are as fine as the masks and not as the grid. Concavities that no silhouette shows stay
//! filled.

use glam::{DVec3, UVec3};
use rayon::prelude::*;

use super::AnchorError;
use super::pinhole::{Pinhole, common_point};
use super::silhouette::Silhouette;

/// Settings of the visual hull.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HullSettings {
    /// Voxels along the longest side of the grid, clamped to 8 to 512.
    pub voxels: usize,
    /// Number of masks that may wrongly exclude a point of the subject; at most one in eight of the
    /// cameras.
    pub misses: usize,
}

impl Default for HullSettings {
    fn default() -> HullSettings {
        HullSettings { voxels: 128, misses: 1 }
    }
}

/// Cells along each side of the search box, and the most times that the box shrinks. The search ends
/// when the box keeps more than 0.9 of its size, so even a tiny subject in a large rig is found.
const SEARCH_CELLS: u32 = 24;
const SEARCHES: usize = 12;

/// Bisections of the interval that contains the surface: from 2 voxels to a quarter of one.
const HALVINGS: usize = 3;

/// A carved grid.
pub(super) struct Hull {
    silhouettes: Vec<Silhouette>,
    misses: usize,
    /// Corner of the grid.
    low: DVec3,
    /// Side of a voxel.
    pub(super) voxel: f64,
    size: UVec3,
    /// Whether each voxel is in the hull, x fastest.
    inside: Vec<bool>,
}

impl Hull {
    /// Carves the hull. Empty masks are ignored: the subject may be outside the image, or the
    /// segmentation failed.
    ///
    /// # Errors
    /// [`AnchorError::NoMasks`], [`AnchorError::NoSubject`], [`AnchorError::OneView`] or
    /// [`AnchorError::NoHull`].
    pub(super) fn carve(all: Vec<Silhouette>, settings: HullSettings) -> Result<Hull, AnchorError> {
        if !all.is_empty() && all.iter().all(Silhouette::is_full) {
            return Err(AnchorError::NoMasks);
        }
        let silhouettes: Vec<Silhouette> = all.into_iter().filter(|s| !s.is_empty()).collect();
        match silhouettes.len() {
            0 => return Err(AnchorError::NoSubject),
            1 => return Err(AnchorError::OneView),
            _ => (),
        }
        let misses = settings.misses.min(silhouettes.len() / 8);
        let mut hull =
            Hull { silhouettes, misses, low: DVec3::ZERO, voxel: 0.0, size: UVec3::ZERO, inside: Vec::new() };
        let [low, high] = hull.find_box().ok_or(AnchorError::NoHull)?;
        let voxels = settings.voxels.clamp(8, 512);
        hull.voxel = (high - low).max_element() / (voxels - 2) as f64;
        hull.size = ((high - low) / hull.voxel).ceil().as_uvec3() + 2;
        hull.low = 0.5 * (low + high) - 0.5 * hull.voxel * hull.size.as_dvec3();
        let slab = (hull.size.x * hull.size.y) as usize;
        let mut inside = vec![false; slab * hull.size.z as usize];
        inside.par_chunks_mut(slab).enumerate().for_each(|(z, slab)| {
            for (i, inside) in slab.iter_mut().enumerate() {
                let cell = UVec3::new(i as u32 % hull.size.x, i as u32 / hull.size.x, z as u32);
                *inside = hull.holds(hull.center(cell));
            }
        });
        hull.inside = inside;
        if hull.inside.contains(&true) { Ok(hull) } else { Err(AnchorError::NoHull) }
    }

    fn center(&self, cell: UVec3) -> DVec3 {
        self.low + self.voxel * (cell.as_dvec3() + 0.5)
    }

    /// Whether more than half of the silhouettes vote for the point and at most `misses` against it.
    ///
    /// A majority is required because a point right in front of a camera is inside the silhouettes of
    /// that camera and of the opposite one, and outside the view of all others.
    fn agree(&self, votes: impl Iterator<Item = Option<bool>>) -> bool {
        let (mut inside, mut outside) = (0, 0);
        for vote in votes.flatten() {
            match vote {
                true => inside += 1,
                false => outside += 1,
            }
            if outside > self.misses {
                return false;
            }
        }
        inside > self.silhouettes.len() / 2
    }

    /// Whether a point is in the hull.
    fn holds(&self, point: DVec3) -> bool {
        self.agree(self.silhouettes.iter().map(|silhouette| silhouette.at(point)))
    }

    /// Bounding box of the hull: starts with a box around all cameras and shrinks it to the cells that
    /// may contain the hull.
    fn find_box(&self) -> Option<[DVec3; 2]> {
        let pinholes: Vec<Pinhole> = self.silhouettes.iter().map(|s| s.pinhole.clone()).collect();
        let farthest =
            |from: DVec3| pinholes.iter().map(|pinhole| pinhole.position.distance(from)).fold(0.0, f64::max);
        let mean = |vector: fn(&Pinhole) -> DVec3| {
            pinholes.iter().map(vector).sum::<DVec3>() / pinholes.len() as f64
        };
        let (center, half) = match common_point(&pinholes) {
            Some(center) => (center, farthest(center)),
            // Parallel cameras: beyond about ten times their baseline, silhouettes do not bound depth.
            None => {
                let half = 10.0 * farthest(mean(|pinhole| pinhole.position));
                (mean(|pinhole| pinhole.position) + half * mean(|pinhole| pinhole.forward), half)
            }
        };
        let (mut low, mut high) = (center - half, center + half);
        for _ in 0..SEARCHES {
            let cell = (high - low) / f64::from(SEARCH_CELLS);
            let radius = 0.5 * cell.length();
            if !radius.is_normal() {
                return None;
            }
            let n = SEARCH_CELLS;
            let occupied: Vec<UVec3> = (0..n * n * n)
                .into_par_iter()
                .map(|i| UVec3::new(i % n, i / n % n, i / (n * n)))
                .filter(|at| {
                    let center = low + cell * (at.as_dvec3() + 0.5);
                    self.agree(self.silhouettes.iter().map(|silhouette| silhouette.near(center, radius)))
                })
                .collect();
            let first = occupied.iter().copied().reduce(UVec3::min)?;
            let last = occupied.iter().copied().reduce(UVec3::max)?;
            let before = high - low;
            (low, high) = (low + cell * first.as_dvec3(), low + cell * (last.as_dvec3() + 1.0));
            if (high - low).cmpgt(0.9 * before).all() {
                break;
            }
        }
        Some([low, high])
    }

    /// Centroid of the hull.
    pub(super) fn centroid(&self) -> DVec3 {
        let (mut sum, mut count) = (DVec3::ZERO, 0.0);
        for (i, _) in self.inside.iter().enumerate().filter(|(_, inside)| **inside) {
            let (i, size) = (i as u32, self.size);
            sum += self.center(UVec3::new(i % size.x, i / size.x % size.y, i / (size.x * size.y)));
            count += 1.0;
        }
        sum / count
    }

    /// Depths at which the ray of each pixel in `subject` enters the hull and first leaves it; `[0, 0]`
    /// for all other pixels, for rays that miss the hull, and for a camera inside the hull.
    pub(super) fn spans(&self, pinhole: &Pinhole, subject: impl Fn(usize) -> bool + Sync) -> Vec<[f32; 2]> {
        let [width, height] = pinhole.size.map(|n| n as usize);
        let mut spans = vec![[0.0; 2]; width * height];
        spans.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
            for (x, span) in row.iter_mut().enumerate().filter(|(x, _)| subject(y * width + x)) {
                let ray = pinhole.ray([x as u32, y as u32]);
                if let Some(found) = self.span(pinhole.position, ray) {
                    *span = found.map(|depth| depth as f32);
                }
            }
        });
        spans
    }

    fn span(&self, origin: DVec3, ray: DVec3) -> Option<[f64; 2]> {
        let step = self.voxel / ray.length();
        let (from, along) = ((origin - self.low) / self.voxel, ray / self.voxel);
        let holds = |depth: f64| self.holds(origin + depth * ray);
        let [enter, leave] = self.walk(from, along).or_else(|| {
            // The ray misses the centres of all voxels: the hull is thin here, or this is its edge.
            let [start, end] = self.crossing(from, along)?;
            let depth = |k: u32| start + (f64::from(k) + 0.5) * 0.5 * step;
            let enter = (0..).map(depth).take_while(|depth| *depth < end).find(|depth| holds(*depth))?;
            Some([enter, enter + step])
        })?;
        if enter == 0.0 {
            return None;
        }
        let (mut out, mut within) = (enter - step, enter + step);
        // A ray that clips the corner of a voxel may be nowhere inside the hull itself.
        if out > 0.0 && !holds(out) && holds(within) {
            for _ in 0..HALVINGS {
                let half_way = 0.5 * (out + within);
                if holds(half_way) { within = half_way } else { out = half_way }
            }
            return Some([0.5 * (out + within), leave.max(within)]);
        }
        Some([enter, leave])
    }

    /// Depths at which a ray enters and leaves the grid, in front of its origin; `origin` and `ray` are
    /// in voxels.
    fn crossing(&self, origin: DVec3, ray: DVec3) -> Option<[f64; 2]> {
        let inverse = nonzero(ray).recip();
        let (a, b) = (-origin * inverse, (self.size.as_dvec3() - origin) * inverse);
        let (start, end) = (a.min(b).max_element().max(0.0), a.max(b).min_element());
        (start < end).then_some([start, end])
    }

    /// Traces a ray through the voxels (Amanatides and Woo, 1987) and returns its first interval inside
    /// the hull; `origin` and `ray` are in voxels.
    fn walk(&self, origin: DVec3, ray: DVec3) -> Option<[f64; 2]> {
        let [start, _] = self.crossing(origin, ray)?;
        let ray = nonzero(ray);
        let inverse = ray.recip();
        let at = (origin + start * ray).floor().clamp(DVec3::ZERO, self.size.as_dvec3() - 1.0);
        let mut cell = at.as_ivec3();
        let step = ray.signum().as_ivec3();
        let ahead = at + DVec3::select(ray.cmpgt(DVec3::ZERO), DVec3::ONE, DVec3::ZERO);
        let mut next = ((ahead - origin) * inverse).to_array();
        let across = inverse.abs().to_array();
        let (mut depth, mut entered) = (start, None);
        loop {
            let [x, y, z] = cell.to_array().map(|c| c as usize);
            let index = (z * self.size.y as usize + y) * self.size.x as usize + x;
            match (self.inside[index], entered) {
                (true, None) => entered = Some(depth),
                (false, Some(entered)) => return Some([entered, depth]),
                _ => (),
            }
            let axis = if next[0] <= next[1] && next[0] <= next[2] {
                0
            } else if next[1] <= next[2] {
                1
            } else {
                2
            };
            depth = next[axis].max(depth);
            next[axis] += across[axis];
            cell[axis] += step[axis];
            if cell[axis] < 0 || cell[axis] >= self.size[axis] as i32 {
                return entered.map(|entered| [entered, depth]);
            }
        }
    }
}

/// The direction with zeros replaced by 1e-12: a ray along a face of the grid would give 0 * inf.
fn nonzero(ray: DVec3) -> DVec3 {
    DVec3::select(ray.abs().cmplt(DVec3::splat(1e-12)), DVec3::splat(1e-12), ray)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::anchor::AnchorView;
    use crate::anchor::test_scene::{Shape, pattern, ring, sphere, view};

    fn body() -> Vec<Shape> {
        let limb = Shape { ends: [DVec3::new(0.1, 0.2, 0.0), DVec3::new(0.5, 0.5, 0.2)], radius: 0.08 };
        vec![sphere(DVec3::ZERO, 0.4), limb]
    }

    fn seen(shapes: &[Shape], cameras: usize) -> Vec<(AnchorView, Vec<f32>)> {
        let cameras = ring(cameras, 3.0, 128);
        cameras.iter().enumerate().map(|(i, camera)| view(i, camera, shapes, pattern)).collect()
    }

    fn carve(views: &[(AnchorView, Vec<f32>)], voxels: usize) -> Result<Hull, AnchorError> {
        let silhouette = |(view, _): &(AnchorView, Vec<f32>)| {
            Silhouette::new(&Pinhole::new(&view.camera), &view.photograph)
        };
        Hull::carve(views.iter().map(silhouette).collect(), HullSettings { voxels, misses: 1 })
    }

    /// Depth errors of a view in voxels, sorted, and the fraction of its pixels that have a depth.
    fn errors(hull: &Hull, (view, depths): &(AnchorView, Vec<f32>)) -> (Vec<f64>, f64) {
        let spans = hull.spans(&Pinhole::new(&view.camera), |pixel| depths[pixel] > 0.0);
        let found = spans.iter().zip(depths).filter(|(span, _)| span[0] > 0.0);
        let mut errors: Vec<f64> =
            found.map(|(span, depth)| f64::from((span[0] - depth).abs()) / hull.voxel).collect();
        errors.sort_by(f64::total_cmp);
        let share = errors.len() as f64 / depths.iter().filter(|depth| **depth > 0.0).count() as f64;
        (errors, share)
    }

    #[test]
    fn depths_of_spheres_and_limbs_are_within_a_voxel() {
        let views = seen(&body(), 32);
        let hull = carve(&views, 64).unwrap();
        for i in [0, 7] {
            let (errors, share) = errors(&hull, &views[i]);
            let (median, p90) = (errors[errors.len() / 2], errors[errors.len() * 9 / 10]);
            assert!(median < 0.5 && p90 < 1.5 && share > 0.99, "{median} {p90} {share}");
        }
        assert!(hull.centroid().length() < 0.1);
    }

    #[test]
    fn a_small_off_center_subject_fills_the_grid() {
        let views = seen(&[sphere(DVec3::new(0.3, -0.2, 0.1), 0.03)], 16);
        let hull = carve(&views, 32).unwrap();
        assert!(hull.voxel < 0.006, "{}", hull.voxel);
        assert!(hull.centroid().distance(DVec3::new(0.3, -0.2, 0.1)) < 0.006);
    }

    #[test]
    fn a_wrong_mask_and_an_empty_mask_are_tolerated() {
        let mut views = seen(&body(), 16);
        views[3].0.photograph.pixels.fill([0; 4]);
        for pixel in &mut views[5].0.photograph.pixels[..128 * 70] {
            *pixel = [0; 4];
        }
        let (errors, share) = errors(&carve(&views, 64).unwrap(), &views[0]);
        assert!(errors[errors.len() / 2] < 1.0 && share > 0.99);
    }

    /// Pixels that a lens leaves blank are not background.
    #[test]
    fn blank_pixels_do_not_vote() {
        let mut views = seen(&body(), 16);
        for (view, _) in &mut views[..4] {
            view.photograph.valid = (0..128 * 128).map(|i| i % 128 < 64).collect();
            for (i, pixel) in view.photograph.pixels.iter_mut().enumerate() {
                *pixel = if i % 128 < 64 { *pixel } else { [0; 4] };
            }
        }
        let (errors, share) = errors(&carve(&views, 64).unwrap(), &views[8]);
        assert!(errors[errors.len() / 2] < 1.0 && share > 0.99);
    }

    #[test]
    fn a_camera_inside_the_subject_gets_no_depths() {
        let mut views = seen(&body(), 16);
        let inside = codec::Camera::look_at([0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], 0.7, 32, 32);
        let (mut within, _) = view(16, &inside, &[], pattern);
        within.photograph.pixels.fill([9, 9, 9, 255]);
        views.push((within, vec![1.0; 32 * 32]));
        let hull = carve(&views, 64).unwrap();
        assert!(hull.spans(&Pinhole::new(&inside), |_| true).iter().all(|span| *span == [0.0; 2]));
        assert!(errors(&hull, &views[0]).1 > 0.99);
    }

    #[test]
    fn without_silhouettes_there_is_no_hull() {
        let fault = |views: &[(AnchorView, Vec<f32>)]| carve(views, 32).err();
        let views = seen(&body(), 16);
        let mut full = views.clone();
        full.iter_mut().for_each(|(view, _)| view.photograph.pixels.fill([9, 9, 9, 255]));
        assert_eq!(fault(&full), Some(AnchorError::NoMasks));
        assert_eq!(fault(&seen(&[], 16)), Some(AnchorError::NoSubject));
        assert_eq!(fault(&views[..1]), Some(AnchorError::OneView));
        // Each camera sees a different object.
        let apart: Vec<_> = (0..4)
            .map(|i| {
                let y = f64::from(i) * 0.2 - 0.3;
                view(
                    i as usize,
                    &ring(4, 3.0, 128)[i as usize],
                    &[sphere(DVec3::new(0.0, y, 0.0), 0.02)],
                    pattern,
                )
            })
            .collect();
        assert_eq!(fault(&apart), Some(AnchorError::NoHull));
        // The same camera twice: the axes are parallel, and only the search bounds the depth.
        assert!(fault(&[views[0].clone(), views[0].clone()]).is_some());
    }
}
