//! [`Gaussian`]: a row of a field, and fields made of such rows.

use codec::{Field, Temporal};
use fastrand::Rng;

/// A Gaussian; the default is a static ball in the middle of the default image.
#[derive(Clone, Copy, Debug)]
pub(super) struct Gaussian {
    pub(super) center: [f32; 3],
    pub(super) rotation: [f32; 4],
    /// Natural logarithms of the standard deviations.
    pub(super) log_scales: [f32; 3],
    pub(super) opacity: f32,
    pub(super) color: [f32; 3],
    pub(super) tau: f32,
    pub(super) s: f32,
    pub(super) motion: [[f32; 3]; 3],
    pub(super) rate: [f32; 4],
}

impl Default for Gaussian {
    fn default() -> Gaussian {
        Gaussian {
            center: [0.0; 3],
            rotation: [1.0, 0.0, 0.0, 0.0],
            log_scales: [0.3f32.ln(); 3],
            opacity: 0.8,
            color: [0.9, 0.5, 0.2],
            tau: 0.5,
            s: f32::INFINITY,
            motion: [[0.0; 3]; 3],
            rate: [0.0; 4],
        }
    }
}

impl Gaussian {
    /// The same with these standard deviations.
    pub(super) fn sized(self, scales: [f32; 3]) -> Gaussian {
        Gaussian { log_scales: scales.map(f32::ln), ..self }
    }
}

/// The field of `rows`, without temporal columns that carry no information.
pub(super) fn field(rows: &[Gaussian]) -> Field {
    let y0 = 0.5 / std::f32::consts::PI.sqrt();
    let order = (1..=3).rev().find(|&power| rows.iter().any(|row| row.motion[power - 1] != [0.0; 3]));
    let order = order.unwrap_or(0);
    let turns = rows.iter().any(|row| row.rate != [0.0; 4]);
    let fades = rows.iter().any(|row| row.s.is_finite());
    let temporal = Temporal {
        tau: rows.iter().map(|row| row.tau).collect(),
        s: rows.iter().map(|row| row.s).collect(),
        motion_order: order as u8,
        motion: rows.iter().flat_map(|row| row.motion[..order].to_vec()).collect(),
        rotation_rates: turns.then(|| rows.iter().map(|row| row.rate).collect()),
    };
    Field {
        centers: rows.iter().map(|row| row.center).collect(),
        rotations: rows.iter().map(|row| row.rotation).collect(),
        log_scales: rows.iter().map(|row| row.log_scales).collect(),
        opacities: rows.iter().map(|row| row.opacity).collect(),
        sh_degree: 0,
        sh: rows.iter().map(|row| row.color.map(|c| (c - 0.5) / y0)).collect(),
        temporal: (order > 0 || turns || fades).then_some(temporal),
        ..Field::default()
    }
}

/// Ordinary Gaussians around the origin, two thirds of them dynamic. They accompany the extreme Gaussians of a case,
/// which must not change their image.
pub(super) fn crowd(count: usize) -> Vec<Gaussian> {
    let mut rng = Rng::with_seed(5);
    let mut spread = move |half_range: f32| (2.0 * rng.f32() - 1.0) * half_range;
    let row = |i: usize| {
        let mut vector = |half_range: f32| [0; 3].map(|_| spread(half_range));
        let (center, size, color) = (vector(1.2), vector(0.8), vector(0.45));
        let is_static = i.is_multiple_of(3);
        Gaussian {
            center,
            rotation: normalized([0; 4].map(|_| vector(1.0)[0])),
            log_scales: size.map(|x| x - 2.4),
            opacity: 0.5 + 0.4 * vector(1.0)[0],
            color: color.map(|c| 0.5 + c),
            tau: 0.5 + 0.6 * vector(1.0)[0],
            s: if is_static { f32::INFINITY } else { 0.3 + 0.25 * vector(1.0)[0] },
            motion: if is_static { [[0.0; 3]; 3] } else { [vector(0.4), vector(0.8), vector(1.2)] },
            rate: [0.0; 4],
        }
    };
    (0..count).map(row).collect()
}

/// The same Gaussians, all static.
pub(super) fn static_crowd(count: usize) -> Vec<Gaussian> {
    let to_static = |row| Gaussian { s: f32::INFINITY, motion: [[0.0; 3]; 3], ..row };
    crowd(count).into_iter().map(to_static).collect()
}

/// A quaternion of length 1.
pub(super) fn normalized(q: [f32; 4]) -> [f32; 4] {
    let norm = q.iter().map(|x| x * x).sum::<f32>().sqrt();
    q.map(|x| x / norm)
}
