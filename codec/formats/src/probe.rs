//! [`Probe`]: whether a camera in a file sees the field of that file, which many do not.
//!
//! Draws the field into a picture of a few pixels, each Gaussian as a disc of its mean size, front to back. That is
//! enough to tell a view of the field from empty space and from the inside of one Gaussian.

use std::borrow::Cow;

use codec::{ALPHA_MIN, Camera, Field, Visibility};

use crate::limits::ImportBudget;

/// Instants for a field that changes. One of the instants must show enough.
const INSTANTS: [f64; 3] = [1.0 / 6.0, 0.5, 5.0 / 6.0];

/// Most rows that are drawn; a larger field is thinned.
const ROWS_MAX: usize = 100_000;

/// Memory for drawing a row, in bytes, with its copy.
const BYTES_PER_ROW: u64 = 512;

/// Width and height of the picture in pixels.
const SIZE: (u32, u32) = (32, 24);

/// Smallest radius of a disc in pixels.
const RADIUS_MIN: f64 = 0.5;

/// Radius of a disc in standard deviations.
const RADIUS_SIGMAS: f64 = 2.0;

/// A field to point cameras at.
pub(crate) struct Probe<'a>(Cow<'a, Field>);

/// A Gaussian in the picture.
struct Disc {
    depth: f64,
    center: [f64; 2],
    radius: f64,
    opacity: f64,
}

impl<'a> Probe<'a> {
    /// # Errors
    /// If drawing the field exceeds `budget`.
    pub(crate) fn new(field: &'a Field, budget: &mut ImportBudget) -> Result<Probe<'a>, String> {
        let step = field.len().div_ceil(ROWS_MAX).max(1);
        budget.spend((field.len() / step) as u64 * BYTES_PER_ROW)?;
        Ok(Probe(match step {
            1 => Cow::Borrowed(field),
            _ => Cow::Owned(field.select(&(0..field.len()).step_by(step).collect::<Vec<_>>())),
        }))
    }

    /// Whether the image of `camera`, which satisfies [`Camera::check`], shows enough of the field at some instant.
    pub(crate) fn shows(&self, camera: &Camera) -> bool {
        let instants = if self.0.temporal.is_some() { &INSTANTS[..] } else { &INSTANTS[..1] };
        let camera = camera.resized(SIZE.0, SIZE.1);
        camera.check().is_ok() && instants.iter().any(|&t| self.shows_at(&camera, t))
    }

    fn shows_at(&self, camera: &Camera, t: f64) -> bool {
        let alive: Vec<usize> =
            (0..self.0.len()).filter(|&row| self.0.opacity_at(row, t) >= ALPHA_MIN).collect();
        let mut discs: Vec<Disc> = alive.iter().filter_map(|&row| self.disc(row, camera, t)).collect();
        discs.sort_by(|a, b| a.depth.total_cmp(&b.depth));
        let mut transmittance = [1.0; (SIZE.0 * SIZE.1) as usize];
        let weights: Vec<f64> = discs.iter().map(|disc| disc.draw(&mut transmittance)).collect();
        let total: f64 = weights.iter().sum();
        let covered = transmittance.iter().filter(|&&rest| rest < 1.0).count() as f64;
        let largest = weights.iter().copied().fold(0.0, f64::max);
        let visibility = Visibility {
            alive: alive.len(),
            gaussians: weights.iter().filter(|&&weight| weight >= ALPHA_MIN).count(),
            covered: covered / f64::from(SIZE.0 * SIZE.1),
            // Without weights nothing is covered either.
            largest_share: if total > 0.0 { largest / total } else { 0.0 },
        };
        visibility.is_informative()
    }

    /// The disc of a row, unless it lies behind the camera or outside the image.
    fn disc(&self, row: usize, camera: &Camera, t: f64) -> Option<Disc> {
        let position = self.0.position_at(row, t);
        let along = |[x, y, z, w]: [f64; 4]| x * position[0] + y * position[1] + z * position[2] + w;
        let [x, y, depth] = [0, 1, 2].map(|axis| along(camera.camera_from_world[axis]));
        let sigma = self.0.log_scales[row].iter().map(|&scale| f64::from(scale)).sum::<f64>() / 3.0;
        let radius = (RADIUS_SIGMAS * sigma.exp() * camera.k[1][1] / depth).max(RADIUS_MIN);
        let center =
            [camera.k[0][0] * x / depth + camera.k[0][2], camera.k[1][1] * y / depth + camera.k[1][2]];
        let is_inside = |x: f64, size: u32| (-radius..f64::from(size) + radius).contains(&x);
        (depth > 0.0 && is_inside(center[0], SIZE.0) && is_inside(center[1], SIZE.1)).then(|| Disc {
            depth,
            center,
            radius,
            opacity: self.0.opacity_at(row, t),
        })
    }
}

impl Disc {
    /// Blends the disc behind what is in the picture; returns the sum of its weights.
    fn draw(&self, transmittance: &mut [f64]) -> f64 {
        let range = |center: f64, size: u32| {
            let end = |x: f64| x.clamp(0.0, f64::from(size)) as usize;
            end((center - self.radius).floor())..end((center + self.radius).ceil())
        };
        let mut weight = 0.0;
        for y in range(self.center[1], SIZE.1) {
            for x in range(self.center[0], SIZE.0) {
                let rest = &mut transmittance[y * SIZE.0 as usize + x];
                weight += self.opacity * *rest;
                *rest *= 1.0 - self.opacity;
            }
        }
        weight
    }
}
