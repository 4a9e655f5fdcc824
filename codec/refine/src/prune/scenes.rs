//! Small fields for the tests of pruning, and cameras around them.

use codec::{Camera, Field, Surroundings, Temporal};

/// Cameras of `size` pixels around `field`, which has +y up.
pub(crate) fn around(field: &Field, turn: f64, size: (u32, u32)) -> Vec<Camera> {
    Surroundings::new(field, None, [0.0, 1.0, 0.0]).stand_points(turn, size).content
}

/// Static grey balls with equal standard deviation and opacity.
pub(crate) fn balls(centers: &[[f32; 3]], sigma: f32, opacity: f32) -> Field {
    Field {
        centers: centers.to_vec(),
        rotations: vec![[1.0, 0.0, 0.0, 0.0]; centers.len()],
        log_scales: vec![[sigma.ln(); 3]; centers.len()],
        opacities: vec![opacity; centers.len()],
        sh: vec![[0.0; 3]; centers.len()],
        ..Field::default()
    }
}

/// Rotated, elongated Gaussians of all sizes that move and fade in a box of side 2.
pub(crate) fn cloud(seed: u64, len: usize) -> Field {
    let mut random = fastrand::Rng::with_seed(seed);
    let mut signed = |scale: f32| (random.f32() * 2.0 - 1.0) * scale;
    let mut field = Field { sh_degree: 1, ..Field::default() };
    let mut temporal = Temporal { motion_order: 2, ..Temporal::default() };
    for _ in 0..len {
        field.centers.push([signed(1.0), signed(1.0), signed(1.0)]);
        let q = [1.5 + signed(1.0), signed(1.0), signed(1.0), signed(1.0)];
        let norm = q.iter().map(|c| c * c).sum::<f32>().sqrt();
        field.rotations.push(q.map(|c| c / norm));
        field.log_scales.push([-2.8 + signed(1.0), -2.8 + signed(1.0), -2.8 + signed(1.0)]);
        field.opacities.push(0.52 + signed(0.48));
        field.sh.extend([[0.8 + signed(0.8); 3], [signed(0.2); 3], [signed(0.2); 3], [signed(0.2); 3]]);
        temporal.tau.push(0.5 + signed(0.6));
        temporal.s.push(0.25 + signed(0.2));
        temporal.motion.extend([[signed(0.3); 3], [signed(0.3); 3]]);
    }
    field.temporal = Some(temporal);
    field
}
