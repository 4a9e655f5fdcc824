//! Colour from spherical harmonics, in the basis order and signs of 3D Gaussian Splatting.

use glam::DVec3;

/// Colour seen along the unit vector `direction` from the eye to the Gaussian:
/// `max(0, 0.5 + sum(Y_k c_k))` per channel. `coefficients` holds 1, 4, 9 or 16 entries.
pub(crate) fn color(coefficients: &[[f32; 3]], direction: DVec3) -> [f64; 3] {
    let basis = basis(direction);
    let mut color = [0.5; 3];
    for (y, c) in basis.iter().zip(coefficients) {
        for channel in 0..3 {
            color[channel] += y * f64::from(c[channel]);
        }
    }
    color.map(|c| c.max(0.0))
}

/// The real spherical harmonics up to degree 3 with the Condon-Shortley phase, by degree, then by order
/// from `-degree` to `degree`.
pub(crate) fn basis(d: DVec3) -> [f64; 16] {
    let (x, y, z) = (d.x, d.y, d.z);
    let (xx, yy, zz) = (x * x, y * y, z * z);
    let pi = std::f64::consts::PI;
    // Normalisation constants, named by degree and order.
    let n00 = (1.0 / (4.0 * pi)).sqrt();
    let n1 = (3.0 / (4.0 * pi)).sqrt();
    let n20 = (5.0 / (16.0 * pi)).sqrt();
    let n21 = (15.0 / (4.0 * pi)).sqrt();
    let n22 = (15.0 / (16.0 * pi)).sqrt();
    let n30 = (7.0 / (16.0 * pi)).sqrt();
    let n31 = (21.0 / (32.0 * pi)).sqrt();
    let n32 = (105.0 / (16.0 * pi)).sqrt();
    let n33 = (35.0 / (32.0 * pi)).sqrt();
    [
        n00,
        -n1 * y,
        n1 * z,
        -n1 * x,
        n21 * x * y,
        -n21 * y * z,
        n20 * (2.0 * zz - xx - yy),
        -n21 * x * z,
        n22 * (xx - yy),
        -n33 * y * (3.0 * xx - yy),
        2.0 * n32 * x * y * z,
        -n31 * y * (4.0 * zz - xx - yy),
        n30 * z * (2.0 * zz - 3.0 * xx - 3.0 * yy),
        -n31 * x * (4.0 * zz - xx - yy),
        n32 * z * (xx - yy),
        -n33 * x * (xx - 3.0 * yy),
    ]
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{PI, TAU};

    use super::*;

    fn factorial(n: u32) -> f64 {
        (1..=n).map(f64::from).product()
    }

    /// Associated Legendre function with the Condon-Shortley phase, by the explicit sum of Rodrigues'
    /// formula.
    fn legendre(l: u32, m: u32, x: f64) -> f64 {
        let sum: f64 = (m..=l)
            .filter(|k| (l + k).is_multiple_of(2))
            .map(|k| {
                // Coefficient of x^k in P_l, differentiated m times.
                let half = (l - k) / 2;
                let c = (-1f64).powi(half as i32) * factorial(l + k)
                    / (2f64.powi(l as i32) * factorial(half) * factorial((l + k) / 2) * factorial(k));
                c * factorial(k) / factorial(k - m) * x.powi((k - m) as i32)
            })
            .sum();
        (-1f64).powi(m as i32) * (1.0 - x * x).powf(0.5 * f64::from(m)) * sum
    }

    #[test]
    fn basis_is_the_closed_form() {
        for (theta, phi) in [(0.3, 0.2), (1.1, 2.9), (2.0, 4.4), (2.9, 5.9)] {
            let (sin, cos) = f64::sin_cos(theta);
            let values = basis(DVec3::new(sin * f64::cos(phi), sin * f64::sin(phi), cos));
            for l in 0..=3u32 {
                for m in -(l as i32)..=l as i32 {
                    let order = m.unsigned_abs();
                    let norm = (f64::from(2 * l + 1) / (4.0 * PI) * factorial(l - order)
                        / factorial(l + order))
                    .sqrt();
                    let angle = f64::from(order) * phi;
                    let around = match m {
                        0 => 1.0,
                        m if m > 0 => 2f64.sqrt() * angle.cos(),
                        _ => 2f64.sqrt() * angle.sin(),
                    };
                    let expected = norm * legendre(l, order, cos) * around;
                    let value = values[((l * (l + 1)) as i32 + m) as usize];
                    assert!((value - expected).abs() < 1e-12, "l {l} m {m}: {value} for {expected}");
                }
            }
        }
    }

    #[test]
    fn basis_is_orthonormal() {
        // Products have degree 6 or less, for which the midpoint rule in phi and Gauss-Legendre with four
        // points in z are exact.
        let nodes = [
            (-0.861_136_311_594_052_6, 0.347_854_845_137_453_9),
            (-0.339_981_043_584_856_3, 0.652_145_154_862_546_1),
            (0.339_981_043_584_856_3, 0.652_145_154_862_546_1),
            (0.861_136_311_594_052_6, 0.347_854_845_137_453_9),
        ];
        let steps = 8;
        let mut gram = [[0.0; 16]; 16];
        for (z, weight) in nodes {
            for step in 0..steps {
                let phi = (f64::from(step) + 0.5) * TAU / f64::from(steps);
                let r = f64::sqrt(1.0 - z * z);
                let y = basis(DVec3::new(r * phi.cos(), r * phi.sin(), z));
                for a in 0..16 {
                    for b in 0..16 {
                        gram[a][b] += y[a] * y[b] * weight * TAU / f64::from(steps);
                    }
                }
            }
        }
        for (a, row) in gram.iter().enumerate() {
            for (b, value) in row.iter().enumerate() {
                let expected = f64::from(u8::from(a == b));
                assert!((value - expected).abs() < 1e-12, "<{a},{b}> = {value}");
            }
        }
    }

    #[test]
    fn color_is_clamped_below_only() {
        let n00 = 0.5 / PI.sqrt();
        let term = |c: f32| 0.5 + n00 * f64::from(c);
        let color = color(&[[-4.0, 0.0, 4.0]], DVec3::Z);
        assert_eq!(color[0], 0.0);
        assert_eq!(color[1], 0.5);
        assert!((color[2] - term(4.0)).abs() < 1e-12 && color[2] > 1.0);
    }
}
