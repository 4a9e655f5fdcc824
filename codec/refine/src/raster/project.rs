//! Stage `project`: projects a Gaussian at an instant into the image.
//!
//! The footprint is the affine approximation of EWA splatting (Zwicker et al. 2001) in the form of gsplat: the Jacobian of
//! the projection is taken at the centre, clamped to at most 30 % of the half field of view outside the image. The
//! field's filter is added, and compensated in the opacity if it says so. The footprint is kept as the variances of y and
//! of x given y, so that needles lose no digits.

use codec::{ALPHA_MIN, Camera, FADE_START, PixelFilter, near_fade};

use super::real::Real;
use super::sh;
use super::vector::{add, cross, dot, matrix, scaled, times, transposed_times};

/// How far outside the image the Jacobian may be evaluated, as a fraction of tan(fov / 2).
const MARGIN: f64 = 0.3;

/// More than the largest [`Splat::q_max`], of an opacity of 1, by what rotations of cameras are allowed to be off and by
/// rounding.
const Q_LARGEST: f64 = 11.12;

/// A Gaussian projected into the image. With `d` from its centre to a pixel's centre, the squared
/// Mahalanobis distance is `q = inverse_variance[0] (d.x - shear d.y)^2 + inverse_variance[1] d.y^2`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Splat<T> {
    /// Row of the field or of the parameters.
    pub(crate) row: u32,
    /// Centre in pixels, from the image's top left corner.
    pub(crate) center: [T; 2],
    /// Mean of `d.x` per unit of `d.y`.
    pub(crate) shear: T,
    /// In px^-2: of x given y, and of y.
    pub(crate) inverse_variance: [T; 2],
    /// Opacity at the instant, in `[ALPHA_MIN, 1]`, compensated if the filter compensates.
    pub(crate) opacity: T,
    /// Red, green, blue towards the camera, at least 0.
    pub(crate) color: [T; 3],
    /// Variances of x and y and their covariance, in px^2, filter included: xx, xy, yy.
    pub(crate) covariance: [T; 3],
    /// Distance of the centre along the camera's axis.
    pub(crate) depth: T,
    /// Distance of the centre from the eye.
    pub(crate) distance: T,
    /// `q` above which alpha is certainly below [`ALPHA_MIN`].
    pub(crate) q_max: T,
    /// Half the size of the bounding box of the ellipse `q = q_max`.
    pub(crate) half_extent: [T; 2],
    /// `d.y` at which the ellipse touches its bounding box on the right; on the left it is `-tangent_y`.
    pub(crate) tangent_y: T,
}

impl<T: Real> Splat<T> {
    /// Whether both have the same alpha at each pixel.
    #[inline(always)]
    pub(crate) fn has_footprint_of(&self, other: &Splat<T>) -> bool {
        self.center == other.center
            && self.shear == other.shear
            && self.inverse_variance == other.inverse_variance
            && self.opacity == other.opacity
    }
}

/// The centre of a visible Gaussian.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Centered<T> {
    world: [T; 3],
    view: [T; 3],
    /// Faded near the camera.
    opacity: T,
}

/// A splat with the intermediate results of its projection.
#[derive(Clone, Debug)]
pub(crate) struct Projected<T> {
    pub(crate) splat: Splat<T>,
    /// Unit vector from the camera to the centre; 0 if they coincide.
    pub(crate) direction: [T; 3],
    /// Centre in camera space.
    pub(crate) view: [T; 3],
    /// Columns are the Gaussian's axes times their standard deviations, in camera space.
    pub(crate) axes: [[T; 3]; 3],
    pub(crate) footprint: Footprint<T>,
}

/// The affine approximation of a Gaussian in the image.
#[derive(Clone, Debug)]
pub(crate) struct Footprint<T> {
    /// x/z and y/z at which the Jacobian is evaluated, and whether those are the centre's.
    pub(crate) slope: [T; 2],
    pub(crate) is_inside: [bool; 2],
    /// Rows are the images of the scaled axes in x and in y, in pixels.
    pub(crate) images: [[T; 3]; 2],
    /// As [`Splat::covariance`].
    covariance: [T; 3],
    /// Determinant of the covariance matrix.
    pub(crate) determinant: T,
    /// Cross product of the images, whose square is the determinant without filter.
    pub(crate) area: [T; 3],
}

/// A camera in the precision of the projection, and the filter and the near distance of the field.
pub(crate) struct Projection<T> {
    pub(crate) filter: PixelFilter,
    near: f64,
    pub(crate) size: [T; 2],
    pub(crate) focal: [T; 2],
    principal: [T; 2],
    /// Lowest and highest x/z and y/z at which the Jacobian is evaluated.
    limits: [[T; 2]; 2],
    pub(crate) view_from_world: [[T; 3]; 3],
    translation: [T; 3],
    eye: [T; 3],
}

impl<T: Real> Projection<T> {
    pub(crate) fn new(camera: &Camera, filter: PixelFilter, near: f64) -> Projection<T> {
        let m = &camera.camera_from_world;
        Projection {
            filter,
            near,
            size: [camera.width, camera.height].map(|side| T::from_f64(f64::from(side))),
            focal: [camera.k[0][0], camera.k[1][1]].map(T::from_f64),
            principal: [camera.k[0][2], camera.k[1][2]].map(T::from_f64),
            limits: slope_limits(camera).map(|limits| limits.map(T::from_f64)),
            view_from_world: [0, 1, 2].map(|r| [0, 1, 2].map(|c| T::from_f64(m[r][c]))),
            translation: [0, 1, 2].map(|r| T::from_f64(m[r][3])),
            eye: camera.position().map(T::from_f64),
        }
    }

    /// Moves the centre of a Gaussian of some opacity into camera space; `None` if it is faded near the camera, or not
    /// finite.
    #[inline]
    pub(crate) fn center(&self, world: [T; 3], opacity: T) -> Option<Centered<T>> {
        let view = add(times(&self.view_from_world, world), self.translation);
        let opacity = opacity * T::from_f64(near_fade(view[2].to_double(), self.near));
        // NaN fails this test, too.
        let is_visible = opacity >= T::from_f64(ALPHA_MIN) && view[2].is_finite();
        is_visible.then_some(Centered { world, view, opacity })
    }

    /// Projects a Gaussian with a unit quaternion w, x, y, z, standard deviations and coefficients of its colour; `None`
    /// if its splat is not finite or compensated to nothing.
    #[inline]
    pub(crate) fn project<C: Copy + Into<T>>(
        &self,
        row: u32,
        Centered { world, view, opacity }: Centered<T>,
        rotation: [T; 4],
        scales: [T; 3],
        coefficients: &[[C; 3]],
    ) -> Option<Projected<T>> {
        let in_world =
            matrix(rotation).map(|row| [row[0] * scales[0], row[1] * scales[1], row[2] * scales[2]]);
        let axes = [0, 1, 2].map(|r| transposed_times(&in_world, self.view_from_world[r]));
        let footprint = self.footprint(view, &axes);
        let (direction, distance) = self.direction(world);
        let color = sh::color(coefficients, direction);
        if !(color.iter().all(|x| x.is_finite()) && distance.is_finite()) {
            return None;
        }
        let color = color.map(|c| c.max(T::zero()).min(T::one()));
        let splat = self.splat(row, view, distance, &footprint, opacity, color)?;
        Some(Projected { splat, direction, view, axes, footprint })
    }

    /// Unit vector from the camera to a point of the world, 0 if they coincide, and their distance.
    pub(crate) fn direction(&self, world: [T; 3]) -> ([T; 3], T) {
        let gaze = add(world, scaled(self.eye, -T::one()));
        let distance = dot(gaze, gaze).sqrt();
        (if distance > T::zero() { gaze.map(|x| x / distance) } else { [T::zero(); 3] }, distance)
    }

    /// Whether a Gaussian with standard deviations of at most `scale` may reach a pixel of the image: a bound that needs no
    /// axes. False for NaN.
    pub(crate) fn may_reach(&self, Centered { view, .. }: &Centered<T>, scale: T) -> bool {
        let [at_center, slope] = self.slopes(*view);
        (0..2).all(|axis| {
            let image = self.focal[axis] / view[2] * scale;
            let variance =
                image * image * (T::one() + slope[axis] * slope[axis]) + T::from_f64(self.filter.variance());
            let center = self.focal[axis] * at_center[axis] + self.principal[axis];
            let half = (T::from_f64(Q_LARGEST) * variance).sqrt();
            center + half > T::zero() && center - half < self.size[axis]
        })
    }

    /// Whether a splat may reach a pixel of the image.
    pub(crate) fn is_in_image(&self, splat: &Splat<T>) -> bool {
        (0..2).all(|axis| {
            let (center, half) = (splat.center[axis], splat.half_extent[axis]);
            center + half > T::zero() && center - half < self.size[axis]
        })
    }

    /// Derivative of the logarithm of the fade at a depth.
    pub(crate) fn log_fade_slope(&self, depth: T) -> T {
        match depth.to_double() < self.near {
            true => T::one() / (depth - T::from_f64(FADE_START * self.near)),
            false => T::zero(),
        }
    }

    /// x/z and y/z of a point in camera space, and those at which the Jacobian is evaluated.
    fn slopes(&self, [x, y, z]: [T; 3]) -> [[T; 2]; 2] {
        let [low, high] = self.limits;
        let at_center = [x / z, y / z];
        [at_center, [0, 1].map(|axis| at_center[axis].max(low[axis]).min(high[axis]))]
    }

    /// The footprint of scaled axes at `view`.
    fn footprint(&self, view: [T; 3], axes: &[[T; 3]; 3]) -> Footprint<T> {
        let [at_center, slope] = self.slopes(view);
        // Rows of the Jacobian times the axes.
        let image = |axis: usize| add(axes[axis], scaled(axes[2], -slope[axis]));
        let images = [0, 1].map(|axis| scaled(image(axis), self.focal[axis] / view[2]));
        let added = T::from_f64(self.filter.variance());
        let [x_image, y_image] = images;
        let (xx, yy) = (dot(x_image, x_image), dot(y_image, y_image));
        // |a|^2 |b|^2 - (a . b)^2 is |a x b|^2, which does not cancel.
        let area = cross(x_image, y_image);
        Footprint {
            slope,
            is_inside: [0, 1].map(|axis| at_center[axis] == slope[axis]),
            images,
            covariance: [xx + added, dot(x_image, y_image), yy + added],
            determinant: dot(area, area) + added * (xx + yy) + added * added,
            area,
        }
    }

    /// Factor of the opacity of a footprint, 0 to 1: the root of the ratio of the determinants without and with
    /// the filter if that compensates, else 1.
    fn compensation(&self, footprint: &Footprint<T>) -> T {
        match self.filter.compensates() {
            true => (dot(footprint.area, footprint.area) / footprint.determinant).sqrt(),
            false => T::one(),
        }
    }

    /// The splat of a footprint; `None` if it is not finite or compensated to nothing.
    fn splat(
        &self,
        row: u32,
        view: [T; 3],
        distance: T,
        footprint: &Footprint<T>,
        opacity: T,
        color: [T; 3],
    ) -> Option<Splat<T>> {
        let z = view[2];
        let center = [0, 1].map(|axis| self.focal[axis] / z * view[axis] + self.principal[axis]);
        let &Footprint { covariance: [xx, xy, yy], determinant, .. } = footprint;
        if !(center.iter().all(|x| x.is_finite()) && determinant.is_finite()) {
            return None;
        }
        let opacity = opacity * self.compensation(footprint);
        // NaN is invisible, too.
        let is_visible = opacity >= T::from_f64(ALPHA_MIN);
        if !is_visible {
            return None;
        }
        let visible = (T::from_f64(2.0) * (opacity / T::from_f64(ALPHA_MIN)).ln()).max(T::zero());
        // The margin exceeds the rounding errors of logarithm and exponential.
        let q_max = visible + T::from_f64(256.0) * T::epsilon();
        let half_extent = [(q_max * xx).sqrt(), (q_max * yy).sqrt()];
        Some(Splat {
            row,
            center,
            shear: xy / yy,
            inverse_variance: [yy / determinant, T::one() / yy],
            opacity,
            color,
            covariance: [xx, xy, yy],
            depth: z,
            distance,
            q_max,
            half_extent,
            tangent_y: half_extent[0] * (xy / xx),
        })
    }
}

/// Lowest and highest x/z and y/z at which the Jacobian of the projection is evaluated: `[lowest, highest]`, each
/// `[x/z, y/z]`.
pub(crate) fn slope_limits(camera: &Camera) -> [[f64; 2]; 2] {
    let focal = [camera.k[0][0], camera.k[1][1]];
    let principal = [camera.k[0][2], camera.k[1][2]];
    let size = [f64::from(camera.width), f64::from(camera.height)];
    let margin = |axis: usize| MARGIN * 0.5 * size[axis] / focal[axis];
    [
        [0, 1].map(|axis| -principal[axis] / focal[axis] - margin(axis)),
        [0, 1].map(|axis| (size[axis] - principal[axis]) / focal[axis] + margin(axis)),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Gaussians around cameras with the principal point in the middle and aside: what is in the image, the bound keeps, and
    /// of the rest it drops most.
    #[test]
    fn what_may_not_reach_the_image_does_not() {
        let mut random = fastrand::Rng::with_seed(3);
        let mut signed = |scale: f64| scale * (2.0 * random.f64() - 1.0);
        let (mut dropped, mut outside) = (0, 0);
        for (filter, aside) in PixelFilter::ALL.into_iter().flat_map(|filter| [(filter, 0.0), (filter, 40.0)])
        {
            let mut camera = Camera::look_at([0.0, 0.0, -3.0], [0.0; 3], [0.0, -1.0, 0.0], 0.8, 96, 64);
            camera.k[0][2] += aside;
            let projection = Projection::<f32>::new(&camera, filter, 0.0);
            for _ in 0..4000 {
                let world = [(); 3].map(|()| signed(4.0) as f32);
                let Some(center) = projection.center(world, 1.0) else { continue };
                let scales = [(); 3].map(|()| libm::exp(signed(2.5) - 2.0) as f32);
                let q = [(); 4].map(|()| signed(1.0));
                let length = q.iter().map(|x| x * x).sum::<f64>().sqrt();
                let rotation = q.map(|x| (x / length) as f32);
                let Some(projected) = projection.project(0, center, rotation, scales, &[[0.0_f32; 3]]) else {
                    continue;
                };
                let may_reach = projection.may_reach(&center, scales.into_iter().fold(0.0, f32::max));
                let is_in_image = projection.is_in_image(&projected.splat);
                assert!(may_reach || !is_in_image, "{world:?} {scales:?}");
                (dropped, outside) = (dropped + u32::from(!may_reach), outside + u32::from(!is_in_image));
            }
        }
        assert!(outside > 1000 && 2 * dropped > outside, "{dropped} of {outside}");
        let largest = 2.0 * libm::log(1.0 / ALPHA_MIN) + 256.0 * f64::from(f32::EPSILON);
        assert!(Q_LARGEST > 1.002 * largest, "cameras may be off by 0.001 in each product of their rows");
    }
}
