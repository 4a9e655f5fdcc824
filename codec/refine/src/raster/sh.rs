//! Colour from spherical harmonics to degree 3 and their derivatives, in the basis order and signs of 3D Gaussian
//! Splatting.

use std::f64::consts::PI;

use super::real::Real;
use super::vector::{add, scaled};

/// Normalisation constants, named by degree and order.
struct Norms<T> {
    n00: T,
    n1: T,
    n20: T,
    n21: T,
    n22: T,
    n30: T,
    n31: T,
    n32: T,
    n33: T,
}

impl<T: Real> Norms<T> {
    #[inline(always)]
    fn new() -> Norms<T> {
        let root = |x: f64| T::from_f64((x / PI).sqrt());
        Norms {
            n00: root(1.0 / 4.0),
            n1: root(3.0 / 4.0),
            n20: root(5.0 / 16.0),
            n21: root(15.0 / 4.0),
            n22: root(15.0 / 16.0),
            n30: root(7.0 / 16.0),
            n31: root(21.0 / 32.0),
            n32: root(105.0 / 16.0),
            n33: root(35.0 / 32.0),
        }
    }
}

/// `0.5 + sum(Y_k c_k)` per channel, seen along the unit vector `direction` from the eye; a splat has the positive part. There
/// are 1, 4, 9 or 16 `coefficients`.
pub(crate) fn color<T: Real, C: Copy + Into<T>>(coefficients: &[[C; 3]], direction: [T; 3]) -> [T; 3] {
    let mut color = [T::from_f64(0.5); 3];
    for (y, c) in basis(direction, coefficients.len()).iter().zip(coefficients) {
        color = add(color, scaled((*c).map(Into::into), *y));
    }
    color
}

/// Values of the first `count` harmonics (1, 4, 9 or 16) at a unit vector; 0 for the others.
pub(crate) fn basis<T: Real>([x, y, z]: [T; 3], count: usize) -> [T; 16] {
    let n = Norms::<T>::new();
    let (xx, yy, zz) = (x * x, y * y, z * z);
    let (two, three, four) = (T::from_f64(2.0), T::from_f64(3.0), T::from_f64(4.0));
    let mut values = [T::zero(); 16];
    values[0] = n.n00;
    if count > 1 {
        values[1] = -n.n1 * y;
        values[2] = n.n1 * z;
        values[3] = -n.n1 * x;
    }
    if count > 4 {
        values[4] = n.n21 * x * y;
        values[5] = -n.n21 * y * z;
        values[6] = n.n20 * (two * zz - xx - yy);
        values[7] = -n.n21 * x * z;
        values[8] = n.n22 * (xx - yy);
    }
    if count > 9 {
        values[9] = -n.n33 * y * (three * xx - yy);
        values[10] = two * n.n32 * x * y * z;
        values[11] = -n.n31 * y * (four * zz - xx - yy);
        values[12] = n.n30 * z * (two * zz - three * (xx + yy));
        values[13] = -n.n31 * x * (four * zz - xx - yy);
        values[14] = n.n32 * z * (xx - yy);
        values[15] = -n.n33 * x * (xx - three * yy);
    }
    values
}

/// Gradient of `sum(w_k Y_k)` with respect to the direction, for the polynomials of [`basis`]. `w` has 1,
/// 4, 9 or 16 entries.
pub(crate) fn basis_backward<T: Real>([x, y, z]: [T; 3], w: &[T]) -> [T; 3] {
    let n = Norms::<T>::new();
    let (xx, yy, zz) = (x * x, y * y, z * z);
    let (two, three, four, six, eight) =
        (T::from_f64(2.0), T::from_f64(3.0), T::from_f64(4.0), T::from_f64(6.0), T::from_f64(8.0));
    let [mut dx, mut dy, mut dz] = [T::zero(); 3];
    if let Some(w) = w.get(1..4) {
        dx -= n.n1 * w[2];
        dy -= n.n1 * w[0];
        dz += n.n1 * w[1];
    }
    if let Some(w) = w.get(4..9) {
        dx += n.n21 * (y * w[0] - z * w[3]) + two * x * (n.n22 * w[4] - n.n20 * w[2]);
        dy += n.n21 * (x * w[0] - z * w[1]) - two * y * (n.n22 * w[4] + n.n20 * w[2]);
        dz += four * n.n20 * z * w[2] - n.n21 * (y * w[1] + x * w[3]);
    }
    if let Some(w) = w.get(9..16) {
        dx += two * n.n32 * (y * z * w[1] + x * z * w[5])
            + n.n31 * (two * x * y * w[2] - (four * zz - three * xx - yy) * w[4])
            - six * n.n30 * x * z * w[3]
            - n.n33 * (six * x * y * w[0] + three * (xx - yy) * w[6]);
        dy += two * n.n32 * (x * z * w[1] - y * z * w[5])
            + n.n31 * (two * x * y * w[4] - (four * zz - xx - three * yy) * w[2])
            - six * n.n30 * y * z * w[3]
            - n.n33 * (three * (xx - yy) * w[0] - six * x * y * w[6]);
        dz += n.n32 * (two * x * y * w[1] + (xx - yy) * w[5]) - eight * n.n31 * z * (y * w[2] + x * w[4])
            + n.n30 * (six * zz - three * (xx + yy)) * w[3];
    }
    [dx, dy, dz]
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

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
            let values = basis([sin * f64::cos(phi), sin * f64::sin(phi), cos], 16);
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
                let y = basis([r * phi.cos(), r * phi.sin(), z], 16);
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
    fn derivatives_match_finite_differences() {
        let (direction, step) = ([0.36, -0.48, 0.8], 1e-5);
        for k in 0..16 {
            let mut w = [0.0; 16];
            w[k] = 1.0;
            let gradient = basis_backward(direction, &w);
            for axis in 0..3 {
                let at = |offset: f64| {
                    let mut moved = direction;
                    moved[axis] += offset;
                    basis(moved, 16)[k]
                };
                let expected = (at(step) - at(-step)) / (2.0 * step);
                let actual = gradient[axis];
                assert!((actual - expected).abs() < 1e-9, "Y_{k} by axis {axis}: {actual} for {expected}");
            }
        }
    }
}
