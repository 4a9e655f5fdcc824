//! Ray tracing of the figure: one ray per sample, its nearest intersection, sun with shadows and sky light.

use codec::Camera;
use glam::{DMat3, DVec3, dvec3};

use super::figure::FigurePart;

/// Samples along a side of a pixel.
const SAMPLES: u32 = 4;

/// Direction towards the sun (not of length 1), brightness of the sun, and of the sky from below and above.
const SUN: DVec3 = dvec3(0.45, 0.8, 0.4);
const SUNLIGHT: f64 = 0.65;
const SKYLIGHT: [f64; 2] = [0.45, 0.65];

/// Height above the surface at which shadow rays start, in metres.
const CLEARANCE: f64 = 1e-6;

/// An image with its mask and depths, in rows from the top left.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct TracedImage {
    /// Red, green, blue: the mean of the samples, over black.
    pub(super) colors: Vec<[u8; 3]>,
    /// Fraction of samples that hit the figure, times 255.
    pub(super) mask: Vec<u8>,
    /// Depth of the pixel's centre along the camera's axis, in millimetres; 0 beside the figure.
    pub(super) depths: Vec<u16>,
}

/// The intersection of a ray with the figure.
struct RayHit {
    /// Ray parameter.
    t: f64,
    /// Index of the part.
    part: usize,
}

/// The rays of a camera.
#[derive(Clone, Copy, Debug)]
pub(in crate::synth) struct Rays {
    /// Position of the camera.
    pub(in crate::synth) origin: DVec3,
    world_from_camera: DMat3,
    focal: [f64; 2],
    center: [f64; 2],
}

impl Rays {
    pub(in crate::synth) fn new(camera: &Camera) -> Rays {
        let (m, k) = (&camera.camera_from_world, &camera.k);
        let row = |r: usize| dvec3(m[r][0], m[r][1], m[r][2]);
        Rays {
            origin: DVec3::from(camera.position()),
            world_from_camera: DMat3::from_cols(row(0), row(1), row(2)),
            focal: [k[0][0], k[1][1]],
            center: [k[0][2], k[1][2]],
        }
    }

    /// Direction of the ray through a point of the image. Its component along the camera's axis is 1, so that ray
    /// parameters are depths.
    fn through(&self, x: f64, y: f64) -> DVec3 {
        let direction =
            dvec3((x - self.center[0]) / self.focal[0], (y - self.center[1]) / self.focal[1], 1.0);
        self.world_from_camera * direction
    }

    /// Directions of the rays of the samples of a pixel.
    pub(in crate::synth) fn of_pixel(&self, x: u32, y: u32) -> impl Iterator<Item = DVec3> {
        let place =
            |pixel: u32, sample: u32| f64::from(pixel) + (f64::from(sample) + 0.5) / f64::from(SAMPLES);
        (0..SAMPLES * SAMPLES)
            .map(move |sample| self.through(place(x, sample % SAMPLES), place(y, sample / SAMPLES)))
    }

    /// Replaces `near` by the indices of the parts that rays of a pixel may meet.
    fn parts_near(&self, parts: &[FigurePart], [x, y]: [u32; 2], near: &mut Vec<usize>) {
        let axis = self.through(f64::from(x) + 0.5, f64::from(y) + 0.5);
        // No ray of the pixel is farther from its axis than half the diagonal, times the depth.
        let spread = std::f64::consts::FRAC_1_SQRT_2 / self.focal[0].min(self.focal[1]);
        near.clear();
        near.extend((0..parts.len()).filter(|i| {
            let to = parts[*i].center - self.origin;
            let beside = to - axis * (to.dot(axis) / axis.length_squared());
            let margin = parts[*i].solid.bounding_radius() + spread * to.length();
            beside.length_squared() <= margin * margin
        }));
    }
}

/// Sums over the samples of a pixel.
#[derive(Clone, Copy, Debug)]
pub(in crate::synth) struct PixelSamples {
    /// Colours of those that hit the figure.
    pub(in crate::synth) color: [f64; 3],
    /// Number of those.
    pub(in crate::synth) hits: u32,
}

impl PixelSamples {
    /// Number of samples of a pixel.
    pub(in crate::synth) const COUNT: u32 = SAMPLES * SAMPLES;

    /// Fraction of samples that hit the figure, times 255.
    pub(in crate::synth) fn mask(&self) -> u8 {
        byte(f64::from(self.hits))
    }
}

/// A byte from a sum over samples of numbers from 0 to 1.
fn byte(sum: f64) -> u8 {
    (sum / f64::from(PixelSamples::COUNT) * 255.0).round() as u8
}

/// Samples a pixel and calls `on_miss` with the direction of each ray that does not hit the figure. `near` is a buffer.
pub(in crate::synth) fn sample_pixel(
    parts: &[FigurePart],
    rays: &Rays,
    pixel: [u32; 2],
    near: &mut Vec<usize>,
    mut on_miss: impl FnMut(DVec3),
) -> PixelSamples {
    rays.parts_near(parts, pixel, near);
    let mut samples = PixelSamples { color: [0.0; 3], hits: 0 };
    for direction in rays.of_pixel(pixel[0], pixel[1]) {
        match nearest(parts, near, rays.origin, direction) {
            Some(hit) => {
                let color = shaded(parts, hit.part, rays.origin + hit.t * direction);
                (0..3).for_each(|c| samples.color[c] += color[c]);
                samples.hits += 1;
            }
            None => on_miss(direction),
        }
    }
    samples
}

/// Renders the image of `camera`.
pub(super) fn trace(parts: &[FigurePart], camera: &Camera) -> TracedImage {
    let rays = Rays::new(camera);
    let pixels = camera.width as usize * camera.height as usize;
    let mut image = TracedImage {
        colors: Vec::with_capacity(pixels),
        mask: Vec::with_capacity(pixels),
        depths: Vec::with_capacity(pixels),
    };
    let mut near = Vec::new();
    for y in 0..camera.height {
        for x in 0..camera.width {
            let samples = sample_pixel(parts, &rays, [x, y], &mut near, |_| ());
            image.colors.push(samples.color.map(byte));
            image.mask.push(samples.mask());
            let axis = rays.through(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let at_center = nearest(parts, &near, rays.origin, axis);
            image.depths.push(at_center.map_or(0, |hit| (hit.t * 1000.0).round() as u16));
        }
    }
    image
}

/// The nearest intersection with the parts whose indices are `near`.
fn nearest(parts: &[FigurePart], near: &[usize], origin: DVec3, direction: DVec3) -> Option<RayHit> {
    let mut nearest: Option<RayHit> = None;
    for (part, found) in near.iter().map(|&i| (i, enter(&parts[i], origin, direction))) {
        if let Some(t) = found.filter(|t| nearest.as_ref().is_none_or(|hit| *t < hit.t)) {
            nearest = Some(RayHit { t, part });
        }
    }
    nearest
}

/// Whether a part of the figure lies between `point` and the sun.
pub(in crate::synth) fn is_shaded(parts: &[FigurePart], point: DVec3) -> bool {
    let sun = SUN.normalize();
    parts.iter().any(|part| enter(part, point, sun).is_some())
}

/// Ray parameter at which a ray enters a part.
fn enter(part: &FigurePart, origin: DVec3, direction: DVec3) -> Option<f64> {
    let from = origin - part.center;
    // The bounding sphere rejects most rays.
    let along = from.dot(direction) / direction.length_squared();
    if (from - along * direction).length_squared()
        > part.solid.bounding_radius() * part.solid.bounding_radius()
    {
        return None;
    }
    let part_from_world = part.axes.transpose();
    part.solid.enter(part_from_world * from, part_from_world * direction)
}

/// Display-referred colour, in `[0, 1]`, of a point on the part with index `number`.
fn shaded(parts: &[FigurePart], number: usize, point: DVec3) -> [f64; 3] {
    let part = &parts[number];
    let local = part.axes.transpose() * (point - part.center);
    let normal = part.axes * part.solid.normal(local);
    let facing = normal.dot(SUN.normalize());
    let lit = facing > 0.0 && !is_shaded(parts, point + CLEARANCE * normal);
    let sky = SKYLIGHT[0] + (SKYLIGHT[1] - SKYLIGHT[0]) * 0.5 * (1.0 + normal.y);
    let light = sky + if lit { SUNLIGHT * facing } else { 0.0 };
    part.texture.color(number, local).map(|c| (c * light).min(1.0))
}

#[cfg(test)]
mod tests {
    use super::super::figure::figure;
    use super::super::motion::Motion;
    use super::super::solid::Solid;
    use super::super::texture::Texture;
    use super::*;

    fn camera() -> Camera {
        Camera::look_at([0.0, 0.0, 4.0], [0.0; 3], [0.0, 1.0, 0.0], 0.8, 40, 40)
    }

    /// A unit ball in front of the camera, whose image has a closed form.
    #[test]
    fn a_ball_has_the_outline_and_depths_of_its_closed_form() {
        let colors = [[1.0; 3]; 2];
        let ball = FigurePart {
            solid: Solid::Ellipsoid { radii: DVec3::ONE },
            texture: Texture::Checks { side: 1.0, colors },
            center: DVec3::ZERO,
            axes: DMat3::IDENTITY,
        };
        let camera = camera();
        let image = trace(&[ball], &camera);
        let focal = camera.k[0][0];
        for (i, &depth) in image.depths.iter().enumerate() {
            let [x, y] = [i % 40, i / 40].map(|at| (at as f64 + 0.5 - 20.0) / focal);
            // |(x, y, 1) z - (0, 0, 4)| = 1.
            let a = x * x + y * y + 1.0;
            let inside = 16.0 - 15.0 * a;
            let expected = if inside >= 0.0 { (4.0 - inside.sqrt()) / a * 1000.0 } else { 0.0 };
            assert!((f64::from(depth) - expected).abs() <= 0.5, "{depth} {expected}");
        }
        // The silhouette is the cone with sin = 1/4.
        let radius = focal * 0.25 / (1.0 - 0.0625f64).sqrt();
        let covered: f64 = image.mask.iter().map(|m| f64::from(*m) / 255.0).sum();
        let disc = std::f64::consts::PI * radius * radius;
        assert!((covered / disc - 1.0).abs() < 0.005, "{covered} of {disc}");
        // The sun shines from the upper right.
        let brightness =
            |x: usize, y: usize| image.colors[y * 40 + x].iter().map(|c| u32::from(*c)).sum::<u32>();
        assert!(brightness(23, 15) > brightness(16, 25) + 50);
    }

    #[test]
    fn one_part_shades_another() {
        let white = Texture::Checks { side: 1.0, colors: [[1.0; 3]; 2] };
        let ball = |center: DVec3, radius: f64| FigurePart {
            solid: Solid::Ellipsoid { radii: DVec3::splat(radius) },
            texture: white,
            center,
            axes: DMat3::IDENTITY,
        };
        let toward_sun = SUN.normalize();
        let alone = [ball(DVec3::ZERO, 1.0)];
        let shaded_too = [alone[0], ball(3.0 * toward_sun, 0.5)];
        let [bright, dark] = [&alone[..], &shaded_too[..]].map(|parts| shaded(parts, 0, toward_sun)[0]);
        assert!(bright > dark + 0.25, "{bright} {dark}");
        let aside = toward_sun.cross(DVec3::Y).normalize();
        assert_eq!(shaded(&alone, 0, aside), shaded(&shaded_too, 0, aside));
    }

    /// Points in front of a depth are outside the figure; points directly behind it are inside.
    #[test]
    fn depths_lie_on_the_surface_of_the_figure() {
        let parts = figure(&Motion::new(33).pose(16.0));
        let camera = Camera::look_at([1.5, 1.6, 2.6], [0.0, 0.9, 0.0], [0.0, 1.0, 0.0], 0.8, 48, 48);
        let side = |point: DVec3| {
            let distance_to =
                |part: &FigurePart| part.solid.side(part.axes.transpose() * (point - part.center));
            parts.iter().map(distance_to).fold(f64::INFINITY, f64::min)
        };
        let image = trace(&parts, &camera);
        let m = &camera.camera_from_world;
        let seen = image.depths.iter().enumerate().filter(|(_, depth)| **depth > 0);
        for (i, &depth) in seen.clone() {
            let [x, y] = [i % 48, i / 48].map(|at| (at as f64 + 0.5 - 24.0) / camera.k[0][0]);
            let at = |z: f64| {
                let seen = [x * z, y * z, z];
                let world = |axis: usize| (0..3).map(|r| m[r][axis] * (seen[r] - m[r][3])).sum::<f64>();
                dvec3(world(0), world(1), world(2))
            };
            let depth = f64::from(depth) / 1000.0;
            assert!((1..200).all(|k| side(at((depth - 0.001) * f64::from(k) / 200.0)) > 0.0), "pixel {i}");
            assert!((0..=30).any(|k| side(at(depth - 0.001 + f64::from(k) * 1e-4)) < 0.0), "pixel {i}");
        }
        assert!(seen.count() > 150);
    }
}
