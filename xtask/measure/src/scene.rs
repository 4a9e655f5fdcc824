//! Procedural fields and cameras for tests: small, dense, with every column in use.

use std::f32::consts::{PI, TAU};

use codec::{
    Camera, Clip, ClipInfo, EncodeOptions, Field, Limits, Source, Temporal, Viewpoint, sh_coefficients,
};
use fastrand::Rng;

/// Which Gaussians of a field are windowed and move.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Motion {
    /// None: the field has no temporal columns.
    Static,
    /// All.
    Dynamic,
    /// Every other one; the rest are always on and motionless, in the same columns.
    Mixed,
}

/// What field to make.
#[derive(Clone, Copy, Debug)]
pub struct Recipe {
    /// Number of Gaussians.
    pub count: usize,
    /// Degree of the spherical harmonics, 0 to 3.
    pub sh_degree: u8,
    /// Which Gaussians move.
    pub motion: Motion,
    /// Highest power of time, 0 to 3; of no effect on a still field.
    pub motion_order: u8,
    /// Whether those that move also turn.
    pub turning: bool,
    /// Seed of the random numbers.
    pub seed: u64,
}

impl Recipe {
    /// A field of the recipe: Gaussians of all shapes, opacities and colours in the ball of radius
    /// 1 around the origin, which they do not leave far.
    pub fn field(&self) -> Field {
        let mut rng = Rng::with_seed(self.seed);
        let n = self.count;
        let coefficients = sh_coefficients(self.sh_degree);
        let mut field = Field { sh_degree: self.sh_degree, ..Field::default() };
        for _ in 0..n {
            let radius = rng.f32().cbrt();
            field.centers.push(direction(&mut rng).map(|x| x * radius));
            field.rotations.push(quaternion(&mut rng));
            // Standard deviations from 0.01 to 0.12, needles and discs among them.
            field.log_scales.push([0; 3].map(|_| (0.01f32).ln() + rng.f32() * 12.0f32.ln()));
            field.opacities.push(0.02 + 0.97 * rng.f32());
            field.sh.push([0; 3].map(|_| spread(&mut rng, 1.6)));
            field.sh.extend((1..coefficients).map(|_| [0; 3].map(|_| spread(&mut rng, 0.25))));
        }
        if self.motion != Motion::Static {
            field.temporal = Some(self.temporal(&mut rng));
        }
        field.check().expect("the recipe makes a valid field");
        field
    }

    fn temporal(&self, rng: &mut Rng) -> Temporal {
        let moves = |i: usize| self.motion == Motion::Dynamic || i.is_multiple_of(2);
        let mut temporal = Temporal { motion_order: self.motion_order, ..Temporal::default() };
        for i in 0..self.count {
            temporal.tau.push(if moves(i) { -0.1 + 1.2 * rng.f32() } else { 0.5 });
            temporal.s.push(if moves(i) { 0.03 + 0.4 * rng.f32() * rng.f32() } else { f32::INFINITY });
            for limit in [0.3, 0.9, 1.6].into_iter().take(self.motion_order.into()) {
                let v = [0; 3].map(|_| spread(rng, limit));
                temporal.motion.push(if moves(i) { v } else { [0.0; 3] });
            }
        }
        if self.turning {
            let rate =
                |i: usize, rng: &mut Rng| if moves(i) { [0; 4].map(|_| spread(rng, 2.0)) } else { [0.0; 4] };
            temporal.rotation_rates = Some((0..self.count).map(|i| rate(i, rng)).collect());
        }
        temporal
    }
}

/// A number in `[-limit, limit]`.
fn spread(rng: &mut Rng, limit: f32) -> f32 {
    (2.0 * rng.f32() - 1.0) * limit
}

/// A unit vector, evenly distributed.
fn direction(rng: &mut Rng) -> [f32; 3] {
    let (z, angle) = (spread(rng, 1.0), TAU * rng.f32());
    let r = (1.0 - z * z).sqrt();
    [r * angle.cos(), r * angle.sin(), z]
}

/// A unit quaternion, evenly distributed.
fn quaternion(rng: &mut Rng) -> [f32; 4] {
    let axis = direction(rng);
    let (sin, cos) = (0.5 * PI * rng.f32()).sin_cos();
    [cos, axis[0] * sin, axis[1] * sin, axis[2] * sin]
}

/// Two seconds at 30 frames a second, y up, in metres, watched from the front.
pub fn info() -> ClipInfo {
    ClipInfo {
        duration_s: 2.0,
        fps: 30.0,
        up: [0.0, 1.0, 0.0],
        metres_per_unit: 1.0,
        viewpoints: vec![Viewpoint {
            name: "front".into(),
            position: [0.0, 0.3, 3.2],
            target: [0.0, 0.0, 0.0],
            fov_y: 0.8,
        }],
    }
}

/// The bytes of a package of the field, with layers that end at the given numbers of Gaussians.
pub fn packaged(field: &Field, plate: Option<&Field>, layers: &[usize]) -> Vec<u8> {
    let options = EncodeOptions { layers: layers.to_vec(), ..EncodeOptions::default() };
    codec::encode(&Source { info: &info(), field, plate }, &options).expect("a valid field can be encoded")
}

/// A package of the field in one layer that lasts `duration_s` seconds, of `fps` captured frames each.
pub fn lasting(field: &Field, duration_s: f32, fps: f32) -> Vec<u8> {
    let info = ClipInfo { duration_s, fps, ..info() };
    let source = Source { info: &info, field, plate: None };
    codec::encode(&source, &EncodeOptions::default()).expect("a valid field can be encoded")
}

/// A ball of one colour in the middle of the picture, in front of everything.
pub fn ball(rgb: [f32; 3]) -> Field {
    // The constant spherical harmonic is this; colours are 0.5 more than its product.
    const Y0: f32 = 0.282_094_8;
    Field {
        centers: vec![[0.0; 3]],
        rotations: vec![[1.0, 0.0, 0.0, 0.0]],
        log_scales: vec![[(0.5f32).ln(); 3]],
        opacities: vec![0.99],
        sh: vec![rgb.map(|channel| (channel - 0.5) / Y0)],
        ..Field::default()
    }
}

/// The field as a player gets it: packaged and decoded.
pub fn decoded(field: &Field) -> Clip {
    decoded_with(field, None, &[])
}

/// As [`decoded`], with a plate and layers.
pub fn decoded_with(field: &Field, plate: Option<&Field>, layers: &[usize]) -> Clip {
    let bytes = packaged(field, plate, layers);
    codec::decode(&bytes, &Limits::default()).expect("what was encoded can be decoded")
}

/// Where a test looks at a field from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// The whole field in the middle of the picture.
    Whole,
    /// From inside: Gaussians behind, beside and right in front of the camera.
    Near,
    /// From far away: most Gaussians are smaller than a pixel.
    Far,
    /// The field on the edge of the frame, cut in half.
    Edge,
}

/// The camera of a place for a picture of the given size.
pub fn camera(place: Place, width: u32, height: u32) -> Camera {
    let (position, target, fov_y) = match place {
        Place::Whole => ([0.6, 0.5, 3.0], [0.0, 0.0, 0.0], 0.8),
        Place::Near => ([0.25, 0.1, 0.6], [-0.3, -0.1, -0.5], 1.3),
        Place::Far => ([6.0, 5.0, 30.0], [0.0, 0.0, 0.0], 0.2),
        Place::Edge => ([0.2, 0.4, 2.6], [1.2, 0.2, 0.0], 0.9),
    };
    Camera::look_at(position, target, [0.0, 1.0, 0.0], fov_y, width, height)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_recipe_is_repeatable_and_its_seed_matters() {
        let recipe = Recipe {
            count: 50,
            sh_degree: 3,
            motion: Motion::Mixed,
            motion_order: 2,
            turning: true,
            seed: 1,
        };
        assert_eq!(recipe.field(), recipe.field());
        assert_ne!(recipe.field(), Recipe { seed: 2, ..recipe }.field());
    }

    #[test]
    fn mixed_fields_hold_both_kinds() {
        let recipe = Recipe {
            count: 50,
            sh_degree: 0,
            motion: Motion::Mixed,
            motion_order: 3,
            turning: true,
            seed: 3,
        };
        let field = recipe.field();
        let temporal = field.temporal.as_ref().unwrap();
        let static_count =
            (0..field.len()).filter(|&i| temporal.is_motionless(i) && temporal.s[i].is_infinite()).count();
        assert_eq!(static_count, 25);
    }
}
