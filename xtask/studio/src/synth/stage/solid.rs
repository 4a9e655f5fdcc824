//! [`Solid`]: the solids of the figure, and their intersections with rays in closed form.

use glam::{DVec3, dvec3};

/// A convex solid around the origin of its own axes. Lengths in metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Solid {
    /// All points within `radius` of the segment of the y axis from `-half` to `half`.
    Capsule { half: f64, radius: f64 },
    /// An ellipsoid with these semi-axes.
    Ellipsoid { radii: DVec3 },
}

impl Solid {
    /// Ray parameter, above 0, at which the ray from `origin` along `direction` enters; `None` if it misses or
    /// starts inside. `direction` need not have length 1.
    pub(super) fn enter(self, origin: DVec3, direction: DVec3) -> Option<f64> {
        match self {
            Solid::Ellipsoid { radii } => first_root(origin / radii, direction / radii, 1.0),
            Solid::Capsule { half, radius } => {
                let flat = |v: DVec3| dvec3(v.x, 0.0, v.z);
                let around = flat(direction).length_squared();
                // The ray can only enter through the end on whose side it meets the infinite cylinder. A ray
                // along the axis does not meet the cylinder.
                let end = if around > 1e-12 * direction.length_squared() {
                    let t = smaller_root(flat(origin), flat(direction), radius)?;
                    let y = origin.y + t * direction.y;
                    if y.abs() <= half {
                        return Some(t).filter(|t| *t > 0.0);
                    }
                    half.copysign(y)
                } else {
                    half.copysign(-direction.y)
                };
                first_root(origin - dvec3(0.0, end, 0.0), direction, radius)
            }
        }
    }

    /// Outward unit normal at a point of the surface.
    pub(super) fn normal(self, point: DVec3) -> DVec3 {
        match self {
            Solid::Ellipsoid { radii } => (point / (radii * radii)).normalize(),
            Solid::Capsule { half, .. } => (point - dvec3(0.0, point.y.clamp(-half, half), 0.0)).normalize(),
        }
    }

    /// Distance from the origin to the farthest point.
    pub(super) fn bounding_radius(self) -> f64 {
        match self {
            Solid::Ellipsoid { radii } => radii.max_element(),
            Solid::Capsule { half, radius } => half + radius,
        }
    }

    /// Farthest the solid goes along `direction`, of length 1, from the origin.
    #[cfg(test)]
    pub(super) fn support(self, direction: DVec3) -> f64 {
        match self {
            Solid::Ellipsoid { radii } => (radii * direction).length(),
            Solid::Capsule { half, radius } => half * direction.y.abs() + radius,
        }
    }

    /// Negative inside, 0 on the surface, positive outside; not a distance.
    #[cfg(test)]
    pub(super) fn side(self, point: DVec3) -> f64 {
        match self {
            Solid::Ellipsoid { radii } => (point / radii).length() - 1.0,
            Solid::Capsule { half, radius } => {
                point.distance(dvec3(0.0, point.y.clamp(-half, half), 0.0)) / radius - 1.0
            }
        }
    }
}

/// Ray parameter at which a line enters the sphere around the origin.
fn smaller_root(origin: DVec3, direction: DVec3, radius: f64) -> Option<f64> {
    let (a, b) = (direction.length_squared(), origin.dot(direction));
    // The foot of the perpendicular loses less to cancellation than b^2 - ac.
    let foot = origin - direction * (b / a);
    let inside = radius * radius - foot.length_squared();
    (inside >= 0.0).then(|| (-b - (inside * a).sqrt()) / a)
}

fn first_root(origin: DVec3, direction: DVec3, radius: f64) -> Option<f64> {
    smaller_root(origin, direction, radius).filter(|t| *t > 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAPSULE: Solid = Solid::Capsule { half: 0.5, radius: 0.2 };

    #[test]
    fn rays_enter_where_the_surface_is() {
        let egg = Solid::Ellipsoid { radii: dvec3(1.0, 2.0, 0.5) };
        let mut random = fastrand::Rng::with_seed(7);
        let mut point = |extent: f64| dvec3(random.f64(), random.f64(), random.f64()) * 2.0 * extent - extent;
        let mut entered = 0;
        for _ in 0..2000 {
            let (origin, direction) = (point(3.0), point(2.0));
            for solid in [CAPSULE, egg].into_iter().filter(|solid| solid.side(origin) > 0.0) {
                let found = solid.enter(origin, direction);
                // Walks along the ray in small steps up to ten times `direction`.
                let walked =
                    (0..10_000).map(|i| i as f64 * 1e-3).find(|t| solid.side(origin + *t * direction) < 0.0);
                if let Some(t) = found {
                    let at = origin + t * direction;
                    assert!(solid.side(at).abs() < 1e-9, "{solid:?} {origin} {direction}");
                    assert!(solid.normal(at).dot(direction) <= 1e-6, "the normal faces the ray");
                }
                if let Some(walked) = walked {
                    let t = found.expect("the walk entered");
                    assert!(t <= walked + 1e-9 && walked - t <= 1e-3 + 1e-9, "{t} {walked}");
                    entered += 1;
                }
            }
        }
        assert!(entered > 100, "{entered}");
    }

    #[test]
    fn rays_along_the_axis_and_from_inside() {
        let along = |y: f64, dy: f64| CAPSULE.enter(dvec3(0.0, y, 0.0), dvec3(0.0, dy, 0.0));
        assert!((along(2.0, -1.0).unwrap() - 1.3).abs() < 1e-12);
        assert!((along(-2.0, 2.0).unwrap() - 0.65).abs() < 1e-12);
        assert_eq!(along(2.0, 1.0), None);
        assert_eq!(along(0.0, 1.0), None);
        assert_eq!(CAPSULE.enter(DVec3::ZERO, dvec3(1.0, 0.2, 0.0)), None);
    }
}
