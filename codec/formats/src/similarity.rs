//! [`Similarity`]: turns, scales and moves a field, with its view-dependent colours.

use std::f64::consts::PI;

use codec::{Field, sh_coefficients};

/// Nodes and weights of the Gauss-Legendre quadrature of 4 points on `[-1, 1]`, exact up to degree 7: a product of two
/// spherical harmonics has degree 6.
const NODES: [(f64, f64); 4] = [
    (-0.861_136_311_594_052_6, 0.347_854_845_137_453_85),
    (-0.339_981_043_584_856_26, 0.652_145_154_862_546_1),
    (0.339_981_043_584_856_26, 0.652_145_154_862_546_1),
    (0.861_136_311_594_052_6, 0.347_854_845_137_453_85),
];

/// Points around the axis: exact for orders up to 7.
const AROUND: usize = 8;

/// Maps `p` to `scale R p + translation`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Similarity {
    /// Unit quaternion w, x, y, z of `R`.
    pub rotation: [f64; 4],
    /// Factor of lengths, above 0.
    pub scale: f64,
    /// Translation.
    pub translation: [f64; 3],
}

impl Similarity {
    /// Maps everything to itself.
    pub const IDENTITY: Similarity =
        Similarity { rotation: [1.0, 0.0, 0.0, 0.0], scale: 1.0, translation: [0.0; 3] };

    /// The shortest turn that takes the unit vector `from` to the unit vector `to`; about x where they are opposite and
    /// x is at right angles to them.
    pub fn turning(from: [f32; 3], to: [f32; 3]) -> Similarity {
        let [a, b] = [from, to].map(|v| v.map(f64::from));
        let cos: f64 = (0..3).map(|axis| a[axis] * b[axis]).sum();
        let rotation = if cos < -0.999_999 {
            // Any axis at right angles.
            let axis = if a[0].abs() < 0.9 {
                [1.0 - a[0] * a[0], -a[0] * a[1], -a[0] * a[2]]
            } else {
                [-a[1], a[0], 0.0]
            };
            [0.0, axis[0], axis[1], axis[2]]
        } else {
            let [x, y, z] = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
            [1.0 + cos, x, y, z]
        };
        let norm = rotation.iter().map(|x| x * x).sum::<f64>().sqrt();
        Similarity { rotation: rotation.map(|x| x / norm), ..Similarity::IDENTITY }
    }

    /// Maps a field.
    pub fn apply(&self, field: &mut Field) {
        if *self == Similarity::IDENTITY {
            return;
        }
        let point = self.points();
        field.centers.iter_mut().for_each(|center| *center = point(*center).map(|x| x as f32));
        let turn = self.turns();
        let turned_quaternion = |q: [f32; 4]| product(self.rotation, q.map(f64::from)).map(|x| x as f32);
        field.rotations.iter_mut().for_each(|q| *q = turned_quaternion(*q));
        let log_scale = self.scale.ln() as f32;
        field.log_scales.as_flattened_mut().iter_mut().for_each(|scale| *scale += log_scale);
        field.near = (f64::from(field.near) * self.scale) as f32;
        if let Some(temporal) = &mut field.temporal {
            temporal.motion.iter_mut().for_each(|v| *v = turn(*v).map(|x| x as f32));
            temporal.rotation_rates.iter_mut().flatten().for_each(|rate| *rate = turned_quaternion(*rate));
        }
        if self.rotation != Similarity::IDENTITY.rotation {
            turn_sh(field, matrix(self.rotation));
        }
    }

    /// Maps points.
    pub(crate) fn points(&self) -> impl Fn([f32; 3]) -> [f64; 3] + use<> {
        let (turn, translation) = (self.turns(), self.translation);
        move |p| {
            let turned = turn(p);
            [0, 1, 2].map(|axis| turned[axis] + translation[axis])
        }
    }

    /// Maps differences of points.
    fn turns(&self) -> impl Fn([f32; 3]) -> [f64; 3] + use<> {
        let (matrix, scale) = (matrix(self.rotation), self.scale);
        move |v| [0, 1, 2].map(|row| scale * (0..3).map(|k| matrix[row][k] * f64::from(v[k])).sum::<f64>())
    }
}

/// Turns the colours: seen along `R d` they are what they were along `d`.
fn turn_sh(field: &mut Field, matrix: [[f64; 3]; 3]) {
    if field.sh_degree == 0 {
        return;
    }
    // Entry [m][k] is the integral of Y_m(d) Y_k(R^-1 d) over the sphere, 0 between different degrees.
    let mut turned = [[0.0; 16]; 16];
    for (z, weight) in NODES {
        for step in 0..AROUND {
            let angle = 2.0 * PI * (step as f64 + 0.5) / AROUND as f64;
            let radius = (1.0 - z * z).sqrt();
            let d = [radius * angle.cos(), radius * angle.sin(), z];
            let back = [0, 1, 2].map(|k| (0..3).map(|row| matrix[row][k] * d[row]).sum());
            let (at, before) = (basis(d), basis(back));
            let weight = weight * 2.0 * PI / AROUND as f64;
            for (row, y) in turned.iter_mut().zip(at) {
                row.iter_mut().zip(before).for_each(|(entry, x)| *entry += weight * y * x);
            }
        }
    }
    for row in field.sh.chunks_exact_mut(sh_coefficients(field.sh_degree)) {
        let old: Vec<[f64; 3]> = row.iter().map(|c| c.map(f64::from)).collect();
        for degree in 1..=field.sh_degree {
            let band = sh_coefficients(degree - 1)..sh_coefficients(degree);
            for m in band.clone() {
                row[m] = [0, 1, 2]
                    .map(|channel| band.clone().map(|k| turned[m][k] * old[k][channel]).sum::<f64>() as f32);
            }
        }
    }
}

/// The real spherical harmonics up to degree 3 with the Condon-Shortley phase, the order and signs of 3D Gaussian
/// Splatting.
fn basis([x, y, z]: [f64; 3]) -> [f64; 16] {
    let (xx, yy, zz) = (x * x, y * y, z * z);
    let n = |numerator: f64, denominator: f64| (numerator / (denominator * PI)).sqrt();
    [
        n(1.0, 4.0),
        -n(3.0, 4.0) * y,
        n(3.0, 4.0) * z,
        -n(3.0, 4.0) * x,
        n(15.0, 4.0) * x * y,
        -n(15.0, 4.0) * y * z,
        n(5.0, 16.0) * (2.0 * zz - xx - yy),
        -n(15.0, 4.0) * x * z,
        n(15.0, 16.0) * (xx - yy),
        -n(35.0, 32.0) * y * (3.0 * xx - yy),
        n(105.0, 4.0) * x * y * z,
        -n(21.0, 32.0) * y * (4.0 * zz - xx - yy),
        n(7.0, 16.0) * z * (2.0 * zz - 3.0 * xx - 3.0 * yy),
        -n(21.0, 32.0) * x * (4.0 * zz - xx - yy),
        n(105.0, 16.0) * z * (xx - yy),
        -n(35.0, 32.0) * x * (xx - 3.0 * yy),
    ]
}

/// Product of two quaternions w, x, y, z.
pub(crate) fn product(a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
    [
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    ]
}

/// Matrix of a unit quaternion w, x, y, z, row by row.
pub(crate) fn matrix([w, x, y, z]: [f64; 4]) -> [[f64; 3]; 3] {
    [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
}

/// Unit quaternion w, x, y, z of a rotation matrix, given row by row.
pub(crate) fn quaternion(m: [[f64; 3]; 3]) -> [f64; 4] {
    let trace = m[0][0] + m[1][1] + m[2][2];
    let squares =
        [1.0 + trace, 1.0 + 2.0 * m[0][0] - trace, 1.0 + 2.0 * m[1][1] - trace, 1.0 + 2.0 * m[2][2] - trace];
    let largest = (1..4).fold(0, |best, k| if squares[k] > squares[best] { k } else { best });
    let odd = [m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1]];
    let even = [m[2][1] + m[1][2], m[0][2] + m[2][0], m[1][0] + m[0][1]];
    let products = match largest {
        0 => [squares[0], odd[0], odd[1], odd[2]],
        1 => [odd[0], squares[1], even[2], even[1]],
        2 => [odd[1], even[2], squares[2], even[0]],
        _ => [odd[2], even[1], even[0], squares[3]],
    };
    products.map(|product| product / (2.0 * squares[largest].sqrt()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn color(sh: &[[f32; 3]], d: [f64; 3]) -> f64 {
        basis(d).iter().zip(sh).map(|(y, c)| y * f64::from(c[0])).sum()
    }

    #[test]
    fn colours_turn_with_the_field() {
        let sh: Vec<[f32; 3]> = (0..16).map(|k| [0.3 - 0.17 * k as f32, 0.0, 0.0]).collect();
        let mut field = Field {
            centers: vec![[1.0, 2.0, 3.0]],
            rotations: vec![[1.0, 0.0, 0.0, 0.0]],
            log_scales: vec![[0.0; 3]],
            opacities: vec![1.0],
            sh_degree: 3,
            sh: sh.clone(),
            near: 0.5,
            ..Field::default()
        };
        let norm = 30f64.sqrt();
        let rotation = [1.0, 2.0, 3.0, 4.0].map(|x: f64| x / norm);
        let similarity = Similarity { rotation, scale: 2.0, translation: [0.0, 0.0, 1.0] };
        similarity.apply(&mut field);
        let turned = |d: [f64; 3]| matrix(rotation).map(|row| (0..3).map(|k| row[k] * d[k]).sum::<f64>());
        for d in [[1.0, 0.0, 0.0], [0.0, 0.6, 0.8], [-0.48, 0.64, 0.6]] {
            let (before, after) = (color(&sh, d), color(&field.sh, turned(d)));
            assert!((before - after).abs() < 1e-6, "{d:?}: {after}, not {before}");
        }
        let [x, y, z] = turned([1.0, 2.0, 3.0]).map(|x| 2.0 * x as f32);
        let distance = [x, y, z + 1.0].iter().zip(&field.centers[0]).map(|(a, b)| (a - b).abs()).sum::<f32>();
        assert!(distance < 1e-5, "{:?}", field.centers);
        assert!((field.log_scales[0][1] - 2f32.ln()).abs() < 1e-6);
        assert_eq!(field.near, 1.0);
        assert_eq!(field.rotations[0], rotation.map(|x| x as f32));
    }

    #[test]
    fn the_shortest_turn_is_found_for_opposite_axes_too() {
        for (from, to) in [
            ([0.0, -1.0, 0.0], [0.0, 1.0, 0.0]),
            ([0.0, 0.0, 1.0], [0.0, 1.0, 0.0]),
            ([1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]),
            ([0.0, 1.0, 0.0], [0.0, 1.0, 0.0]),
        ] {
            let turn = matrix(Similarity::turning(from, to).rotation);
            let turned = turn.map(|row| (0..3).map(|k| row[k] * f64::from(from[k])).sum::<f64>() as f32);
            let distance: f32 = (0..3).map(|axis| (turned[axis] - to[axis]).abs()).sum();
            assert!(distance < 1e-6, "{from:?} goes to {turned:?}, not {to:?}");
        }
        assert_eq!(Similarity::turning([0.0, -1.0, 0.0], [0.0, 1.0, 0.0]).rotation, [0.0, 1.0, 0.0, 0.0]);
    }
}
