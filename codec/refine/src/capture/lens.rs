//! [`Lens`]: the Brown-Conrady distortion of a camera's lens, as in OpenCV and COLMAP.

use codec::Camera;

/// Distortion coefficients; all 0 without a lens.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Lens {
    /// Radial, of the squared radius.
    pub k1: f64,
    /// Radial, of the fourth power of the radius.
    pub k2: f64,
    /// Radial, of the sixth power of the radius.
    pub k3: f64,
    /// Tangential, across the image.
    pub p1: f64,
    /// Tangential, along the image.
    pub p2: f64,
}

impl Lens {
    /// Creates a lens from coefficients in OpenCV's order: k1, k2, p1, p2, k3. Missing ones are 0.
    ///
    /// # Errors
    /// A sentence if further coefficients are not 0, or a coefficient is not finite.
    pub fn from_opencv(coefficients: &[f64]) -> Result<Lens, String> {
        if !coefficients.iter().all(|k| k.is_finite()) {
            return Err("a coefficient of the lens is not finite".into());
        }
        if coefficients.iter().skip(5).any(|k| *k != 0.0) {
            return Err(format!(
                "the lens has {} coefficients: only k1, k2, p1, p2, k3 are supported",
                coefficients.len()
            ));
        }
        let at = |i: usize| coefficients.get(i).copied().unwrap_or(0.0);
        Ok(Lens { k1: at(0), k2: at(1), p1: at(2), p2: at(3), k3: at(4) })
    }

    /// Whether the lens does not distort.
    pub fn is_none(&self) -> bool {
        *self == Lens::default()
    }

    /// Distorts a point in normalised image coordinates. `None` beyond the radius at which the radial
    /// polynomial stops growing, where the image would fold over.
    pub fn distort(&self, [x, y]: [f64; 2]) -> Option<[f64; 2]> {
        let r2 = x * x + y * y;
        if r2 >= self.monotonic_radius_squared() {
            return None;
        }
        let Lens { k1, k2, k3, p1, p2 } = *self;
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        Some([
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        ])
    }

    /// For each pixel of the undistorted image, row by row, its coordinates in the distorted one, in pixels
    /// from the image corner. `columns` by `rows` is the size of both, which may differ from that of
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

    /// Least squared radius `q` at which the derivative of the distorted radius,
    /// `1 + 3 k1 q + 5 k2 q^2 + 7 k3 q^3`, is not positive; infinite if there is none.
    fn monotonic_radius_squared(&self) -> f64 {
        let [a, b, c] = [3.0 * self.k1, 5.0 * self.k2, 7.0 * self.k3];
        let slope = |q: f64| 1.0 + q * (a + q * (b + q * c));
        // Between its extremes a cubic is monotonic, so the first root is in the first interval with a
        // change of sign. Radii above 100 focal lengths do not occur.
        let mut ends = vec![0.0];
        ends.extend(quadratic_roots(3.0 * c, 2.0 * b, a).into_iter().filter(|q| (0.0..1e4).contains(q)));
        ends.push(1e4);
        ends.sort_by(f64::total_cmp);
        for pair in ends.windows(2) {
            let [mut low, mut high] = [pair[0], pair[1]];
            if slope(high) > 0.0 {
                continue;
            }
            for _ in 0..100 {
                let half_way = 0.5 * (low + high);
                if slope(half_way) > 0.0 { low = half_way } else { high = half_way }
            }
            return high;
        }
        f64::INFINITY
    }
}

/// Real roots of `a x^2 + b x + c`.
fn quadratic_roots(a: f64, b: f64, c: f64) -> Vec<f64> {
    if a == 0.0 {
        return if b == 0.0 { Vec::new() } else { vec![-c / b] };
    }
    let root = (b * b - 4.0 * a * c).sqrt();
    if root.is_nan() { Vec::new() } else { vec![(-b - root) / (2.0 * a), (-b + root) / (2.0 * a)] }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_distorted_as_by_opencv() {
        // cv2.projectPoints of (0.3, -0.2, 1) with unit intrinsics.
        let lens = Lens::from_opencv(&[-0.2, 0.05, 0.01, -0.02, 0.003]).unwrap();
        let [x, y] = lens.distort([0.3, -0.2]).unwrap();
        let r2: f64 = 0.13;
        let radial = 1.0 - 0.2 * r2 + 0.05 * r2 * r2 + 0.003 * r2 * r2 * r2;
        assert!(
            (x - (0.3 * radial + 2.0 * 0.01 * 0.3 * -0.2 - 0.02 * (r2 + 2.0 * 0.09))).abs() < 1e-12,
            "{x}"
        );
        assert!(
            (y - (-0.2 * radial + 0.01 * (r2 + 2.0 * 0.04) + 2.0 * -0.02 * 0.3 * -0.2)).abs() < 1e-12,
            "{y}"
        );
    }

    #[test]
    fn a_lens_ends_where_the_distorted_radius_stops_growing() {
        // r - 0.1 r^3 grows to r = sqrt(1 / 0.3).
        let lens = Lens { k1: -0.1, ..Lens::default() };
        let edge = (1.0f64 / 0.3).sqrt();
        assert!(lens.distort([edge - 1e-6, 0.0]).is_some() && lens.distort([edge + 1e-6, 0.0]).is_none());
        // A polynomial that dips below zero and recovers ends at the dip.
        let dip = Lens { k1: -0.5, k2: 0.08, ..Lens::default() };
        let q = dip.monotonic_radius_squared();
        assert!((1.0 - 1.5 * q + 0.4 * q * q).abs() < 1e-9 && q < 1.5, "{q}");
        assert_eq!(Lens { k1: 0.1, ..Lens::default() }.monotonic_radius_squared(), f64::INFINITY);
        assert_eq!(Lens::default().monotonic_radius_squared(), f64::INFINITY);
    }

    #[test]
    fn other_models_are_refused() {
        assert!(Lens::from_opencv(&[0.1, 0.0, 0.0, 0.0, 0.0, 0.2]).is_err());
        assert!(Lens::from_opencv(&[f64::NAN]).is_err());
        assert!(Lens::from_opencv(&[0.0; 8]).unwrap().is_none());
    }
}
