//! Stage `evaluate`: evaluates a Gaussian at the instant and projects it into the image.
//!
//! The footprint is the affine approximation of EWA splatting (Zwicker et al. 2001) in the form
//! of gsplat: the Jacobian of the projection is taken at the centre, clamped to at most 30 % of the half
//! field of view outside the image. The field's filter is added, and compensated in the opacity if it says so.

use codec::{ALPHA_MIN, Camera, Field, PixelFilter, near_fade};
use glam::{DMat3, DQuat, DVec2, DVec3};
use rayon::prelude::*;

use super::alive::Alive;
use super::sh;

/// Margin around the image within which the Jacobian is taken, as a fraction of tan(fov / 2).
const MARGIN: f64 = 0.3;

/// A Gaussian projected into one camera at one instant.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Splat {
    /// Row of the field.
    pub(crate) row: usize,
    /// Centre in pixels, from the image's top left corner.
    pub(crate) center: DVec2,
    /// Covariance in px^2, filter included: xx, xy, yy. Positive definite.
    pub(crate) covariance: [f64; 3],
    /// Opacity at the instant, in `[ALPHA_MIN, 1]`, compensated if the filter compensates.
    pub(crate) opacity: f64,
    /// Colour towards the eye: red, green, blue, from 0 up.
    pub(crate) color: [f64; 3],
    /// Distance of the centre along the camera's axis.
    pub(crate) depth: f64,
    /// Distance of the centre from the eye.
    pub(crate) distance: f64,
}

impl Splat {
    /// Number of standard deviations at which alpha falls to [`ALPHA_MIN`]:
    /// `sqrt(2 ln(o / ALPHA_MIN))`.
    pub(crate) fn radius(&self) -> f64 {
        (2.0 * libm::log(self.opacity / ALPHA_MIN)).max(0.0).sqrt()
    }
}

/// Projects the `alive` rows of `field` in order. Skips rows that are faded near the eye, rows without a
/// finite footprint, and rows that compensation makes invisible.
pub(crate) fn evaluate(field: &Field, alive: &[Alive], camera: &Camera, t: f64) -> Vec<Splat> {
    let projection = Projection::new(camera);
    alive.par_iter().filter_map(|&alive| projection.splat(field, alive, t)).collect()
}

/// The filtered affine approximation of a Gaussian in the image.
struct Footprint {
    /// See [`Splat::covariance`].
    covariance: [f64; 3],
    /// Factor of the opacity, 0 to 1; see [`PixelFilter::compensates`].
    compensation: f64,
}

/// The camera as the projection uses it.
struct Projection {
    focal: DVec2,
    principal: DVec2,
    /// Range of x/z and y/z within which the Jacobian is taken.
    limits: [DVec2; 2],
    view_from_world: DMat3,
    translation: DVec3,
    eye: DVec3,
}

impl Projection {
    fn new(camera: &Camera) -> Projection {
        let focal = DVec2::new(camera.k[0][0], camera.k[1][1]);
        let principal = DVec2::new(camera.k[0][2], camera.k[1][2]);
        let size = DVec2::new(f64::from(camera.width), f64::from(camera.height));
        let margin = MARGIN * 0.5 * size / focal;
        let m = &camera.camera_from_world;
        let row = |r: usize| DVec3::new(m[r][0], m[r][1], m[r][2]);
        Projection {
            focal,
            principal,
            limits: [-principal / focal - margin, (size - principal) / focal + margin],
            view_from_world: DMat3::from_cols(row(0), row(1), row(2)).transpose(),
            translation: DVec3::new(m[0][3], m[1][3], m[2][3]),
            eye: DVec3::from_array(camera.position()),
        }
    }

    fn splat(&self, field: &Field, Alive { row, opacity }: Alive, t: f64) -> Option<Splat> {
        let world = DVec3::from_array(field.position_at(row, t));
        let view = self.view_from_world * world + self.translation;
        let opacity = opacity * near_fade(view.z, f64::from(field.near));
        if opacity < ALPHA_MIN {
            return None;
        }
        let [w, x, y, z] = field.rotation_at(row, t);
        let scales = DVec3::from_array(field.log_scales[row].map(|s| libm::exp(f64::from(s))));
        let axes = self.view_from_world * DMat3::from_quat(DQuat::from_xyzw(x, y, z, w));
        let Footprint { covariance, compensation } =
            self.footprint(view, axes * DMat3::from_diagonal(scales), field.filter);
        let splat = Splat {
            row,
            center: self.focal * view.truncate() / view.z + self.principal,
            covariance,
            opacity: opacity * compensation,
            color: sh::color(field.sh_of(row), (world - self.eye).normalize_or_zero()),
            depth: view.z,
            distance: view.length(),
        };
        let [xx, xy, yy] = covariance;
        let determinant = xx * yy - xy * xy;
        let drawable = splat.center.is_finite()
            && splat.distance.is_finite()
            && splat.color.iter().all(|c| c.is_finite())
            && determinant.is_finite()
            && determinant > 0.0
            && splat.opacity >= ALPHA_MIN;
        drawable.then_some(splat)
    }

    /// The filtered footprint of a Gaussian at `view`; the columns of `axes` are its axes times its standard
    /// deviations.
    fn footprint(&self, view: DVec3, axes: DMat3, filter: PixelFilter) -> Footprint {
        let slope = (view.truncate() / view.z).max(self.limits[0]).min(self.limits[1]);
        let f = self.focal / view.z;
        // Rows of the Jacobian times the axes.
        let x = f.x * (axes.row(0) - slope.x * axes.row(2));
        let y = f.y * (axes.row(1) - slope.y * axes.row(2));
        let (xx, xy, yy) = (x.dot(x), x.dot(y), y.dot(y));
        let added = filter.variance();
        let compensation = if filter.compensates() {
            // |x|^2 |y|^2 - (x . y)^2 is |x x y|^2, which does not cancel.
            let sharp = x.cross(y).length_squared();
            (sharp / (sharp + added * (xx + yy) + added * added)).sqrt()
        } else {
            1.0
        };
        Footprint { covariance: [xx + added, xy, yy + added], compensation }
    }
}
