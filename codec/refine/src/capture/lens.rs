//! [`Lens`]: the distortion of a camera's lens by OpenCV's models, rational and fisheye.

use std::f64::consts::FRAC_PI_2;

use codec::Camera;

/// Maximum squared radius of a rational lens in focal lengths. Pixels beyond 100 focal lengths do not occur.
const RADIUS_SQUARED_MAX: f64 = 1e4;

/// A lens, with the radius at which it ends. Its coefficients are finite.
///
/// Fields are private because the end depends on the coefficients, and each pixel needs it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens {
    model: Model,
    /// Squared radius in focal lengths from which on the lens shows nothing, or shows it twice.
    end_squared: f64,
}

/// Factors are polynomials, lowest coefficient first; that coefficient is 1.
///
/// The two models share names of coefficients, but not their meanings.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Model {
    /// The radius is multiplied with `numerator / denominator`, polynomials of its square: 1, k1, k2, k3 and
    /// 1, k4, k5, k6. `tangential` are p1 and p2. Brown and Conrady's model has k4 = k5 = k6 = 0.
    Rational { numerator: [f64; 4], denominator: [f64; 4], tangential: [f64; 2] },
    /// Distorted radius over the angle to the axis, of the squared angle in radians: 1, k1, k2, k3, k4.
    Fisheye([f64; 5]),
}

impl Default for Lens {
    /// No lens: it does not distort.
    fn default() -> Lens {
        Lens::new(Model::Rational {
            numerator: [1.0, 0.0, 0.0, 0.0],
            denominator: [1.0, 0.0, 0.0, 0.0],
            tangential: [0.0; 2],
        })
    }
}

impl Lens {
    /// Creates a lens of OpenCV's rational model from coefficients in its order: k1, k2, p1, p2, k3, k4, k5,
    /// k6. Missing ones are 0.
    ///
    /// # Errors
    /// A sentence if further coefficients, of a thin prism or a tilted sensor, are not 0, or if a coefficient
    /// is not finite.
    pub fn rational(coefficients: &[f64]) -> Result<Lens, String> {
        let [k1, k2, p1, p2, k3, k4, k5, k6] = padded(coefficients, || {
            format!(
                "the lens has {} coefficients: only k1, k2, p1, p2, k3, k4, k5, k6 are supported, no thin prism \
                 and no tilted sensor",
                coefficients.len()
            )
        })?;
        Ok(Lens::new(Model::Rational {
            numerator: [1.0, k1, k2, k3],
            denominator: [1.0, k4, k5, k6],
            tangential: [p1, p2],
        }))
    }

    /// Creates a lens of OpenCV's fisheye model, which COLMAP calls `OPENCV_FISHEYE`, from its coefficients k1,
    /// k2, k3, k4. Missing ones are 0. A fisheye lens without coefficients distorts: the distorted radius is
    /// the angle.
    ///
    /// # Errors
    /// A sentence if further coefficients are not 0, or if a coefficient is not finite.
    pub fn fisheye(coefficients: &[f64]) -> Result<Lens, String> {
        let [k1, k2, k3, k4] = padded(coefficients, || {
            format!(
                "the fisheye lens has {} coefficients: only k1, k2, k3, k4 are supported",
                coefficients.len()
            )
        })?;
        Ok(Lens::new(Model::Fisheye([1.0, k1, k2, k3, k4])))
    }

    fn new(model: Model) -> Lens {
        let end_squared = match &model {
            Model::Rational { numerator, denominator, .. } => {
                // For q = r^2, the derivative of r N(q) / D(q) times D^2 is
                // (N + 2 q N') D - 2 q N D' = sum of (1 + 2 i - 2 j) n_i d_j q^(i + j).
                let mut slope = [0.0; 7];
                for (i, n) in numerator.iter().enumerate() {
                    for (j, d) in denominator.iter().enumerate() {
                        slope[i + j] += (1.0 + 2.0 * i as f64 - 2.0 * j as f64) * n * d;
                    }
                }
                // Towards a pole, the radius grows beyond all bounds, and behind it, it is negative.
                let pole = positive_until(denominator, RADIUS_SQUARED_MAX);
                positive_until(&slope, RADIUS_SQUARED_MAX).min(pole)
            }
            Model::Fisheye(radius) => {
                let slope: [f64; 5] = std::array::from_fn(|i| (1.0 + 2.0 * i as f64) * radius[i]);
                let angle_squared = positive_until(&slope, FRAC_PI_2 * FRAC_PI_2);
                // A pinhole has no points at right angles to the axis.
                if angle_squared.is_finite() { angle_squared.sqrt().tan().powi(2) } else { f64::INFINITY }
            }
        };
        Lens { model, end_squared }
    }

    /// Its coefficients in the order of [`Lens::fisheye`] if the flag is set, and else in the order of
    /// [`Lens::rational`].
    pub fn coefficients(&self) -> (bool, Vec<f64>) {
        match &self.model {
            Model::Rational {
                numerator: [_, k1, k2, k3],
                denominator: [_, k4, k5, k6],
                tangential: [p1, p2],
            } => (false, vec![*k1, *k2, *p1, *p2, *k3, *k4, *k5, *k6]),
            Model::Fisheye([_, k @ ..]) => (true, k.to_vec()),
        }
    }

    /// Whether the lens does not distort.
    pub fn is_none(&self) -> bool {
        *self == Lens::default()
    }

    /// Distorts a point in normalised image coordinates. `None` beyond the end of the lens: the radius at which
    /// the distorted one, without its tangential part, stops growing, so that the image would fold over, or
    /// jumps at a pole.
    pub fn distort(&self, [x, y]: [f64; 2]) -> Option<[f64; 2]> {
        let r2 = x * x + y * y;
        if r2 >= self.end_squared {
            return None;
        }
        let bent = match &self.model {
            Model::Rational { numerator, denominator, tangential: [p1, p2] } => {
                let radial = value(numerator, r2) / value(denominator, r2);
                [
                    x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
                    y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
                ]
            }
            Model::Fisheye(radius) => {
                let r = r2.sqrt();
                let angle = r.atan();
                let factor = if r > 0.0 { angle / r * value(radius, angle * angle) } else { 1.0 };
                [x * factor, y * factor]
            }
        };
        bent.iter().all(|x| x.is_finite()).then_some(bent)
    }

    /// For each pixel of the undistorted image, row by row, its coordinates in the distorted one, in pixels
    /// from the image corner. `columns` by `rows` is the size of both, which may differ from the size of
    /// `camera`. `None` for pixels beyond the lens; coordinates may lie outside the image.
    pub fn sources(
        self,
        camera: &Camera,
        [columns, rows]: [u32; 2],
    ) -> impl Iterator<Item = Option<[f64; 2]>> {
        let scale =
            [f64::from(columns) / f64::from(camera.width), f64::from(rows) / f64::from(camera.height)];
        let [f, c] = [[camera.k[0][0], camera.k[1][1]], [camera.k[0][2], camera.k[1][2]]];
        let pixels = (0..rows).flat_map(move |y| (0..columns).map(move |x| [x, y].map(f64::from)));
        pixels.map(move |pixel| {
            let straight = [0, 1].map(|axis| ((pixel[axis] + 0.5) / scale[axis] - c[axis]) / f[axis]);
            let bent = self.distort(straight)?;
            Some([0, 1].map(|axis| (bent[axis] * f[axis] + c[axis]) * scale[axis]))
        })
    }
}

/// The first `N` coefficients, with zeros for missing ones.
fn padded<const N: usize>(coefficients: &[f64], too_many: impl Fn() -> String) -> Result<[f64; N], String> {
    if !coefficients.iter().all(|k| k.is_finite()) {
        return Err("a coefficient of the lens is not finite".into());
    }
    if coefficients.iter().skip(N).any(|k| *k != 0.0) {
        return Err(too_many());
    }
    Ok(std::array::from_fn(|i| coefficients.get(i).copied().unwrap_or(0.0)))
}

/// Value of a polynomial, lowest coefficient first.
fn value(polynomial: &[f64], x: f64) -> f64 {
    polynomial.iter().rev().fold(0.0, |sum, coefficient| sum * x + coefficient)
}

/// Least point from 0 to `limit` at which a polynomial that is positive at 0 is not; infinite if there is none.
/// A point where it overflows counts.
fn positive_until(polynomial: &[f64], limit: f64) -> f64 {
    // Between its extremes a polynomial is monotonic, so the first root is in the first interval with a change
    // of sign.
    let ends = [extremes(polynomial, limit), vec![limit]].concat();
    let mut low = 0.0;
    for high in ends {
        if !is_positive(polynomial, high) {
            return sign_change(polynomial, low, high);
        }
        low = high;
    }
    f64::INFINITY
}

/// The extremes of a polynomial from 0 to `limit`, ascending.
fn extremes(polynomial: &[f64], limit: f64) -> Vec<f64> {
    let derivative: Vec<f64> = (1..polynomial.len()).map(|i| i as f64 * polynomial[i]).collect();
    if derivative.len() < 2 {
        return Vec::new();
    }
    let ends = [vec![0.0], extremes(&derivative, limit), vec![limit]].concat();
    let changes =
        ends.windows(2).filter(|ends| is_positive(&derivative, ends[0]) != is_positive(&derivative, ends[1]));
    changes.map(|ends| sign_change(&derivative, ends[0], ends[1])).collect()
}

fn is_positive(polynomial: &[f64], x: f64) -> bool {
    value(polynomial, x) > 0.0
}

/// The point between `low` and `high` where a polynomial changes from positive to not positive, or back.
fn sign_change(polynomial: &[f64], mut low: f64, mut high: f64) -> f64 {
    let before = is_positive(polynomial, low);
    for _ in 0..100 {
        let half_way = 0.5 * (low + high);
        if is_positive(polynomial, half_way) == before { low = half_way } else { high = half_way }
    }
    high
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rational(coefficients: &[f64]) -> Lens {
        Lens::rational(coefficients).unwrap()
    }

    /// Distorted radius, without the tangential part; infinite or negative beyond a pole.
    fn radius(lens: &Lens, r: f64) -> f64 {
        match &lens.model {
            Model::Rational { numerator, denominator, .. } => {
                r * value(numerator, r * r) / value(denominator, r * r)
            }
            Model::Fisheye(radius) => r.atan() * value(radius, r.atan().powi(2)),
        }
    }

    #[test]
    fn a_lens_ends_where_the_distorted_radius_stops_growing() {
        // r - 0.1 r^3 grows to r = sqrt(1 / 0.3).
        let lens = rational(&[-0.1]);
        let edge = (1.0f64 / 0.3).sqrt();
        assert!(lens.distort([edge - 1e-6, 0.0]).is_some() && lens.distort([edge + 1e-6, 0.0]).is_none());
        // A polynomial that dips below zero and recovers ends at the dip.
        let q = rational(&[-0.5, 0.08]).end_squared;
        assert!((1.0 - 1.5 * q + 0.4 * q * q).abs() < 1e-9 && q < 1.5, "{q}");
        assert_eq!(rational(&[0.1]).end_squared, f64::INFINITY);
        assert_eq!(Lens::default().end_squared, f64::INFINITY);
    }

    #[test]
    fn a_rational_lens_ends_at_its_pole() {
        // r / (1 - 0.25 r^2) grows to the pole at r = 2 and is negative behind it.
        let lens = rational(&[0.0, 0.0, 0.0, 0.0, 0.0, -0.25]);
        assert!((lens.end_squared - 4.0).abs() < 1e-12, "{}", lens.end_squared);
        assert!(lens.distort([0.0, 1.999999]).unwrap()[1] > 1e5);
        assert_eq!(lens.distort([0.0, 2.0]), None);
        // r / (1 + r^2) grows to r = 1; its denominator has no root.
        let lens = rational(&[0.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
        assert!((lens.end_squared - 1.0).abs() < 1e-12, "{}", lens.end_squared);
    }

    #[test]
    fn a_fisheye_lens_ends_at_right_angles_or_before() {
        let lens = Lens::fisheye(&[]).unwrap();
        assert!(!lens.is_none() && lens.end_squared == f64::INFINITY);
        // The angle is a right one in the limit of infinite radii.
        let [x, _] = lens.distort([1e100, 0.0]).unwrap();
        assert!((x - FRAC_PI_2).abs() < 1e-12, "{x}");
        assert_eq!(lens.distort([0.0; 2]), Some([0.0; 2]));
        assert_eq!(lens.distort([1e200, 0.0]), None);
        // t - t^3 grows to t = sqrt(1 / 3).
        let (lens, edge) = (Lens::fisheye(&[-1.0]).unwrap(), (1.0f64 / 3.0).sqrt().tan());
        assert!(lens.distort([0.0, edge - 1e-9]).is_some() && lens.distort([0.0, edge + 1e-9]).is_none());
    }

    /// Whether coefficients of any size, even of a lens that no maker would sell, give a radius that grows
    /// to the end of the lens and no further.
    #[test]
    fn extreme_lenses_end_exactly() {
        let mut random = fastrand::Rng::with_seed(5);
        let mut finite_ends = [0; 2];
        for case in 0..2000 {
            let coefficients: [f64; 8] = std::array::from_fn(|_| {
                let size = 10f64.powf(random.f64() * 12.0 - 6.0);
                if random.bool() { size } else { -size }
            });
            let fisheye = case % 2;
            let lens = match fisheye {
                0 => rational(&coefficients),
                _ => Lens::fisheye(&coefficients[..4]).unwrap(),
            };
            let end = lens.end_squared.sqrt();
            let longest = if end.is_finite() { end } else { 100.0 };
            let mut last = 0.0;
            for step in (0..4000).rev() {
                let r = longest * 10f64.powf(-f64::from(step) * 0.002) * (1.0 - 1e-9);
                let grown = radius(&lens, r);
                assert!(grown.is_finite() && grown > last, "{coefficients:?}: {r} of {end}: {grown}, {last}");
                last = grown;
            }
            if end.is_finite() {
                finite_ends[fisheye] += 1;
                assert!(radius(&lens, end * (1.0 + 1e-4)) < last, "{coefficients:?}: {end}");
            }
        }
        assert!(finite_ends.iter().all(|count| *count > 500), "{finite_ends:?}");
    }

    #[test]
    fn overflow_ends_a_lens() {
        for coefficient in [1e300, -1e300, f64::MAX] {
            for i in 0..8 {
                let mut coefficients = [0.5; 8];
                coefficients[i] = coefficient;
                for lens in [Lens::rational(&coefficients), Lens::fisheye(&coefficients[4..])] {
                    for x in [0.0, 1e-3, 1.0, 1e3, 1e200] {
                        let bent = lens.as_ref().unwrap().distort([x, -x]);
                        assert!(bent.iter().flatten().all(|x| x.is_finite()), "{coefficients:?} {x}");
                    }
                }
            }
        }
    }

    #[test]
    fn other_models_are_refused() {
        let thin_prism = Lens::rational(&[0.1, 0.0, 0.0, 0.0, 0.0, 0.2, 0.0, 0.0, 1e-3, 0.0, 0.0, 0.0]);
        assert!(thin_prism.unwrap_err().contains("12 coefficients"));
        assert!(Lens::fisheye(&[0.1, 0.0, 0.0, 0.0, 0.1]).unwrap_err().contains("5 coefficients"));
        for wrong in [f64::NAN, f64::INFINITY] {
            assert!(Lens::rational(&[wrong]).is_err() && Lens::fisheye(&[0.0, wrong]).is_err());
            assert!(Lens::rational(&[&[0.0; 11][..], &[wrong]].concat()).is_err());
        }
        assert!(Lens::rational(&[0.0; 14]).unwrap().is_none());
        assert_eq!(Lens::fisheye(&[0.0; 14]), Lens::fisheye(&[]));
    }
}
