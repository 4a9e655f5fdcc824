//! [`Subject`]: the upright frame of a clip: where its ground and its front are, and how large it is.

use codec::{Clip, Field, Viewpoint};
use glam::{DMat3, DQuat, DVec3, dvec3};

/// Fraction of the Gaussians beyond each side of the box of a subject: captures have far outliers.
const STRAY: f64 = 0.01;

/// Least peak opacity of a Gaussian that counts for the box.
const OPAQUE: f32 = 0.1;

/// The upright frame of a clip, and its size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Subject {
    /// Rotation from the clip to axes with +y up and the front towards +z.
    pub upright_from_clip: DQuat,
    /// At least the smallest positive normal number.
    pub metres_per_unit: f64,
    /// The ground below the center, in units of the clip.
    pub ground: DVec3,
    /// Level distance from the center to the sides, in metres.
    pub radius_m: f64,
    /// Height above the ground, in metres.
    pub height_m: f64,
    /// First viewpoint relative to the ground below the center, upright, in metres.
    pub eye_m: DVec3,
}

impl Subject {
    /// The subject of a clip.
    pub fn of(clip: &Clip) -> Subject {
        let info = &clip.info;
        Subject::from_parts(Subject::centers(clip), info.up, info.metres_per_unit, &clip.viewpoints()[0])
    }

    /// The centres of `clip` that [`Subject::of`] counts.
    pub fn centers(clip: &Clip) -> impl Iterator<Item = DVec3> {
        visible_centers(&clip.static_field).chain(visible_centers(&clip.dynamic_field))
    }

    /// The subject whose Gaussians are at `centers`, see [`Subject::of`]; `up` and `metres_per_unit` are those of the
    /// clip.
    pub fn from_parts(
        centers: impl Iterator<Item = DVec3>,
        up: [f32; 3],
        metres_per_unit: f32,
        viewpoint: &Viewpoint,
    ) -> Subject {
        let up = DVec3::from(up.map(f64::from)).try_normalize().unwrap_or(DVec3::Y);
        let eye = DVec3::from(viewpoint.position.map(f64::from));
        let target = DVec3::from(viewpoint.target.map(f64::from));
        // Towards the viewpoint, level.
        let front = (eye - target).reject_from_normalized(up);
        let front = front.try_normalize().unwrap_or_else(|| up.any_orthonormal_vector());
        let upright_from_clip =
            DQuat::from_mat3(&DMat3::from_cols(up.cross(front), up, front)).inverse().normalize();

        let centers: Vec<DVec3> = centers.map(|center| upright_from_clip * center).collect();
        let upright_target = upright_from_clip * target;
        let side = |axis: usize| {
            let mut along: Vec<f64> = centers.iter().map(|center| center[axis]).collect();
            along.sort_by(f64::total_cmp);
            let stray = (STRAY * along.len() as f64) as usize;
            match along.len() {
                0 => (upright_target[axis], upright_target[axis]),
                count => (along[stray], along[count - 1 - stray]),
            }
        };
        let (x, y, z) = (side(0), side(1), side(2));
        let ground = dvec3(0.5 * (x.0 + x.1), y.0, 0.5 * (z.0 + z.1));
        let metres_per_unit = f64::from(metres_per_unit);
        let metres_per_unit = if metres_per_unit.is_normal() { metres_per_unit.abs() } else { 1.0 };
        Subject {
            upright_from_clip,
            metres_per_unit,
            ground: upright_from_clip.inverse() * ground,
            radius_m: 0.5 * metres_per_unit * (x.1 - x.0).max(z.1 - z.0),
            height_m: metres_per_unit * (y.1 - y.0),
            eye_m: metres_per_unit * (upright_from_clip * eye - ground),
        }
    }

    /// The point `upright_m`, in metres from the ground below the center with +y up and the front towards +z, in
    /// the clip.
    pub fn in_clip(&self, upright_m: DVec3) -> DVec3 {
        self.upright_from_clip.inverse() * (upright_m / self.metres_per_unit) + self.ground
    }
}

/// Position of each Gaussian at the instant of its highest opacity; Gaussians that stay transparent are left
/// out.
fn visible_centers(field: &Field) -> impl Iterator<Item = DVec3> {
    (0..field.len()).filter_map(|i| {
        let t = field.temporal.as_ref().map_or(0.0, |temporal| f64::from(temporal.tau[i]).clamp(0.0, 1.0));
        let visible = field.opacities[i] >= OPAQUE && field.opacity_at(i, t) >= f64::from(OPAQUE);
        visible.then(|| DVec3::from(field.position_at(i, t)))
    })
}
