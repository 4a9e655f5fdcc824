//! The density `sigma_t(x) = sum_i o_i(t) G(x; mu_i(t), Sigma_i)` on a voxel grid (the paper's
//! `eq:density`).
//!
//! Each Gaussian becomes a [`Kernel`] in units of the grid once per instant; the density of any subset
//! of rows is a sum of kernels. A voxel adds its kernels in the order of rows on any number of threads,
//! so ties between voxels are deterministic. Rounding is monotone, so a subset is nowhere denser than
//! the whole field.

use codec::{ALPHA_MIN, Field, Surroundings};
use glam::{DMat3, DQuat, DVec3};
use rayon::prelude::*;

/// Least standard deviation of a kernel in voxels: a thinner kernel falls between the sample points.
const SIGMA_MIN: f64 = 0.5;

/// Greatest standard deviation of a kernel in voxels, far above the size of the grid.
const SIGMA_MAX: f64 = 1e4;

/// Support radius of a kernel in standard deviations.
const SUPPORT: f64 = 3.0;

/// Margin of the grid around the content of the field, in sizes of the content.
const MARGIN: f64 = 1.0;

/// The topology does not depend on the up axis.
const UP: [f32; 3] = [0.0, 1.0, 0.0];

/// Slices of voxels that one task fills.
const SLAB: usize = 4;

/// A grid of cubic voxels; the outermost ones are always empty. Voxel `x + nx (y + ny z)` has its centre at
/// `origin + voxel (x, y, z)`.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Grid {
    origin: DVec3,
    voxel: f64,
    /// Number of voxels along each axis.
    pub(crate) size: [usize; 3],
}

impl Grid {
    /// A grid with `voxels` voxels along its longest axis around `field` at `instants`.
    ///
    /// Strays, walls and a sky would make the voxels coarse, so the grid contains the content of the field and at most the
    /// content's size on either side: a thin arm is not in the box of the content.
    pub(crate) fn around(field: &Field, instants: &[f64], voxels: usize) -> Grid {
        let content = Surroundings::new(field, None, UP).content_bounds().map(DVec3::from);
        let supports = support_box(field, instants).unwrap_or_default();
        let margin = MARGIN * (content[1] - content[0]).max_element();
        // The content of a field in one point has no size; its Gaussians do.
        let margin = if margin > 0.0 { margin } else { f64::INFINITY };
        let low = supports[0].max(content[0] - margin);
        let high = supports[1].min(content[1] + margin);
        let longest = (high - low).max_element();
        let inner = voxels.max(3) - 2;
        let voxel = longest / inner as f64;
        let voxel = if voxel.is_normal() { voxel } else { 1.0 };
        let size = ((high - low) / voxel).to_array().map(|x| (x.ceil().max(1.0) as usize).min(inner) + 2);
        let half_size = DVec3::from_array(size.map(|n| 0.5 * (n - 1) as f64));
        Grid { origin: 0.5 * (low + high) - voxel * half_size, voxel, size }
    }

    /// Number of voxels.
    pub(crate) fn len(&self) -> usize {
        self.size.iter().product()
    }

    /// Coordinates of the voxel with the given index.
    pub(crate) fn coordinates(&self, voxel: usize) -> [usize; 3] {
        let [nx, ny, _] = self.size;
        [voxel % nx, voxel / nx % ny, voxel / (nx * ny)]
    }

    /// Kernels of the rows of `field` that are alive at `t` and overlap the grid, in the order of rows.
    pub(crate) fn kernels(&self, field: &Field, t: f64) -> Vec<Kernel> {
        (0..field.len()).into_par_iter().filter_map(|row| self.kernel(field, row, t)).collect()
    }

    fn kernel(&self, field: &Field, row: usize, t: f64) -> Option<Kernel> {
        let opacity = field.opacity_at(row, t);
        if opacity < ALPHA_MIN {
            return None;
        }
        let center = (DVec3::from_array(field.position_at(row, t)) - self.origin) / self.voxel;
        let [w, x, y, z] = field.rotation_at(row, t);
        let axes = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w));
        let scales =
            field.log_scales[row].map(|s| (libm::exp(f64::from(s)) / self.voxel).clamp(SIGMA_MIN, SIGMA_MAX));
        let scales = DVec3::from_array(scales);
        let stretched = axes * DMat3::from_diagonal(scales);
        let half = SUPPORT * DVec3::from_array([0, 1, 2].map(|axis| stretched.row(axis).length()));
        let (mut low, mut high) = ([0; 3], [0; 3]);
        for axis in 0..3 {
            // The border stays empty. Casts saturate, and NaN becomes 0.
            low[axis] = (center[axis] - half[axis]).ceil().max(1.0) as u32;
            high[axis] = ((center[axis] + half[axis]).floor() as u32).min(self.size[axis] as u32 - 2);
            if low[axis] > high[axis] || center[axis].is_nan() {
                return None;
            }
        }
        let precision = axes * DMat3::from_diagonal((scales * scales).recip()) * axes.transpose();
        let [px, py, pz] = [precision.x_axis, precision.y_axis, precision.z_axis];
        let precision = [px.x, px.y, px.z, py.y, py.z, pz.z].map(|p| p as f32);
        let center = center.to_array().map(|c| c as f32);
        Some(Kernel { row: row as u32, opacity: opacity as f32, center, precision, low, high })
    }

    /// Density of `kernels` at each voxel.
    pub(crate) fn density<'k>(&self, kernels: impl Iterator<Item = &'k Kernel>) -> Vec<f32> {
        let kernels: Vec<&Kernel> = kernels.collect();
        let [nx, ny, _] = self.size;
        let mut values = vec![0.0; self.len()];
        let slabs = values.par_chunks_mut(nx * ny * SLAB).enumerate();
        slabs.for_each(|(slab, values)| {
            let first = slab * SLAB;
            let last = first + values.len() / (nx * ny) - 1;
            for kernel in &kernels {
                let (low, high) = (kernel.low[2] as usize, kernel.high[2] as usize);
                for z in low.max(first)..=high.min(last) {
                    for y in kernel.low[1] as usize..=kernel.high[1] as usize {
                        let row = nx * (y + ny * (z - first));
                        kernel.add_to_row(y, z, &mut values[row..row + nx]);
                    }
                }
            }
        });
        values
    }
}

/// Corners of the bounding box of all supports at `instants`.
fn support_box(field: &Field, instants: &[f64]) -> Option<[DVec3; 2]> {
    let mut corners: Option<[DVec3; 2]> = None;
    for &t in instants {
        for row in (0..field.len()).filter(|&row| field.opacity_at(row, t) >= ALPHA_MIN) {
            let center = DVec3::from_array(field.position_at(row, t));
            let largest = field.log_scales[row].iter().fold(f32::MIN, |a, &b| a.max(b));
            let radius = DVec3::splat(SUPPORT * libm::exp(f64::from(largest)).min(f64::from(f32::MAX)));
            if center.is_finite() {
                let [low, high] = corners.unwrap_or([center; 2]);
                corners = Some([low.min(center - radius), high.max(center + radius)]);
            }
        }
    }
    corners
}

/// A Gaussian at an instant, in units of voxels.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Kernel {
    /// Row of the field.
    pub(crate) row: u32,
    opacity: f32,
    center: [f32; 3],
    /// Inverse of the covariance: xx, xy, xz, yy, yz, zz.
    precision: [f32; 6],
    /// First and last voxel of the support's bounding box, per axis, clipped to the grid.
    low: [u32; 3],
    high: [u32; 3],
}

impl Kernel {
    /// Adds the kernel to the voxels of row `y`, `z`.
    fn add_to_row(&self, y: usize, z: usize, values: &mut [f32]) {
        let (b, c) = self.along_row(y, z);
        let (cx, xx) = (f64::from(self.center[0]), f64::from(self.precision[0]));
        let discriminant = b * b - xx * (c - SUPPORT * SUPPORT);
        if discriminant <= 0.0 {
            return;
        }
        let (center, half) = (cx - b / xx, discriminant.sqrt() / xx);
        let first = (center - half).ceil().max(f64::from(self.low[0]));
        let last = (center + half).floor().min(f64::from(self.high[0]));
        if first > last {
            return;
        }
        // Along a row the exponent is quadratic, so the ratio of neighbouring values changes by a
        // constant factor: three multiplications replace an exponential.
        let d = first - cx;
        let mut value = f64::from(self.opacity) * libm::exp(-0.5 * (xx * d * d + 2.0 * b * d + c));
        let mut step = libm::exp(-0.5 * (xx * (2.0 * d + 1.0) + 2.0 * b));
        let curve = libm::exp(-xx);
        for sum in &mut values[first as usize..=last as usize] {
            *sum += value as f32;
            value *= step;
            step *= curve;
        }
    }

    /// Coefficients `(b, c)` of the squared distance in standard deviations along a row of voxels,
    /// `xx d^2 + 2 b d + c`, where `d` is the offset from the centre along x.
    fn along_row(&self, y: usize, z: usize) -> (f64, f64) {
        let [_, xy, xz, yy, yz, zz] = self.precision.map(f64::from);
        let (dy, dz) = (y as f64 - f64::from(self.center[1]), z as f64 - f64::from(self.center[2]));
        (xy * dy + xz * dz, yy * dy * dy + 2.0 * yz * dy * dz + zz * dz * dz)
    }

    /// Density of the kernel at one voxel.
    pub(crate) fn at(&self, [x, y, z]: [usize; 3]) -> f32 {
        let inside = [x, y, z].into_iter().zip(self.low.iter().zip(&self.high));
        if !inside.into_iter().all(|(i, (&low, &high))| (low as usize..=high as usize).contains(&i)) {
            return 0.0;
        }
        let (b, c) = self.along_row(y, z);
        let d = x as f64 - f64::from(self.center[0]);
        let q = f64::from(self.precision[0]) * d * d + 2.0 * b * d + c;
        if q > SUPPORT * SUPPORT { 0.0 } else { (f64::from(self.opacity) * libm::exp(-0.5 * q)) as f32 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prune::scenes::{balls, cloud};

    /// The density equation, evaluated voxel by voxel.
    fn by_definition(grid: &Grid, field: &Field, t: f64) -> Vec<f64> {
        let [nx, ny, nz] = grid.size;
        let mut values = vec![0.0; grid.len()];
        for row in 0..field.len() {
            let opacity = field.opacity_at(row, t);
            if opacity < ALPHA_MIN {
                continue;
            }
            let center = DVec3::from_array(field.position_at(row, t));
            let [w, x, y, z] = field.rotation_at(row, t);
            let inverse = DQuat::from_xyzw(x, y, z, w).inverse();
            let scales = field.log_scales[row].map(|s| f64::from(s).exp().max(0.5 * grid.voxel));
            for (index, value) in values.iter_mut().enumerate() {
                let [x, y, z] = [index % nx, index / nx % ny, index / nx / ny];
                if [(x, nx), (y, ny), (z, nz)].iter().any(|&(i, n)| i == 0 || i == n - 1) {
                    continue;
                }
                let point = grid.origin + grid.voxel * DVec3::new(x as f64, y as f64, z as f64);
                let q = (inverse * (point - center) / DVec3::from_array(scales)).length_squared();
                *value += if q <= 9.0 { opacity * (-0.5 * q).exp() } else { 0.0 };
            }
        }
        values
    }

    #[test]
    fn density_is_the_sum_of_kernels() {
        let field = cloud(1, 80);
        let t = 0.4;
        let grid = Grid::around(&field, &[t], 24);
        let kernels = grid.kernels(&field, t);
        let density = grid.density(kernels.iter());
        let expected = by_definition(&grid, &field, t);
        // Voxels on the edge of a support may round to either side.
        let off = density.iter().zip(&expected).filter(|(a, b)| (f64::from(**a) - **b).abs() > 1e-4).count();
        assert!(off < 5, "{off} voxels differ");
        assert!(expected.iter().filter(|&&v| v > 0.1).count() > 100);
        let [nx, ny, _] = grid.size;
        for index in (0..grid.len()).step_by(7) {
            let voxel = [index % nx, index / nx % ny, index / nx / ny];
            let sum: f32 = kernels.iter().map(|kernel| kernel.at(voxel)).sum();
            assert!((sum - density[index]).abs() < 1e-3 * (1.0 + sum), "{sum} for {}", density[index]);
        }
    }

    #[test]
    fn the_grid_contains_the_content() {
        let mut centers: Vec<[f32; 3]> = (0..300).map(|i| [i as f32 / 299.0, 5.0, -1.0]).collect();
        let near = Grid::around(&balls(&centers, 0.01, 0.9), &[0.0], 64);
        assert_eq!(near.size[0], 64);
        assert!(near.origin.x < -0.03 && (near.voxel - 1.06 / 62.0).abs() < 1e-6, "{near:?}");
        assert!(near.size[1] <= 7 && near.size[2] <= 7, "{near:?}");
        centers.push([1e5, 0.0, 0.0]);
        let far = Grid::around(&balls(&centers, 0.01, 0.9), &[0.0], 64);
        assert!(far.voxel < 2.1 * near.voxel, "{far:?}");
    }

    #[test]
    fn degenerate_fields_have_a_grid() {
        let mut huge = balls(&[[0.0; 3], [1e30; 3]], 0.1, 0.9);
        huge.log_scales[0] = [3e38; 3];
        let mut tiny = balls(&[[7.0; 3]], 0.1, 0.9);
        tiny.log_scales[0] = [-3e38; 3];
        let one = balls(&[[7.0; 3]; 9], 0.1, 0.9);
        for field in [balls(&[], 0.1, 0.9), balls(&[[0.0; 3]], 0.1, 0.0), huge, tiny.clone(), one.clone()] {
            let grid = Grid::around(&field, &[0.0], 32);
            assert!(grid.size.iter().all(|&n| (3..=32).contains(&n)), "{grid:?}");
            let density = grid.density(grid.kernels(&field, 0.0).iter());
            assert!(density.iter().all(|value| value.is_finite()));
        }
        for field in [tiny, one] {
            let grid = Grid::around(&field, &[0.0], 32);
            assert!(grid.density(grid.kernels(&field, 0.0).iter()).iter().any(|&value| value > 0.4));
        }
    }

    #[test]
    fn a_subset_is_nowhere_denser_on_any_number_of_threads() {
        let field = cloud(2, 600);
        let grid = Grid::around(&field, &[0.5], 40);
        let kernels = grid.kernels(&field, 0.5);
        let all = grid.density(kernels.iter());
        let some = grid.density(kernels.iter().filter(|kernel| kernel.row % 3 != 0));
        assert!(some.iter().zip(&all).all(|(a, b)| a <= b));
        assert!(some != all);
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        assert_eq!(pool.install(|| grid.density(grid.kernels(&field, 0.5).iter())), all);
    }
}
