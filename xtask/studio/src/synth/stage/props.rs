//! What stands still around the figure: a floor and a chair.

use glam::{DMat3, DVec3, dvec3};

use super::figure::{FigurePart, capsule, ellipsoid};
use super::solid::Solid;
use super::texture::Texture;

const FLOOR: Texture = Texture::Checks { side: 0.16, colors: [[0.55, 0.50, 0.45], [0.75, 0.72, 0.66]] };
const SEAT: Texture = Texture::Spots { width: 0.05, colors: [[0.70, 0.30, 0.25], [0.90, 0.75, 0.40]] };
const WOOD: Texture = Texture::Stripes { width: 0.05, colors: [[0.50, 0.33, 0.18], [0.70, 0.52, 0.32]] };

/// Height of the floor's middle and its semi-axes, in metres. The figure's soles stay above it.
const FLOOR_HEIGHT: f64 = -0.075;
const FLOOR_RADII: [f64; 2] = [0.54, 0.025];

/// Where the chair stands on the floor, and the direction it faces: degrees about the y axis from +z.
const CHAIR: [f64; 2] = [-0.36, -0.22];
const CHAIR_FACES: f64 = 58.0;

/// The parts, the same at every instant.
pub(super) fn props() -> Vec<FigurePart> {
    let part = |solid: Solid, texture: Texture, center: DVec3, axes: DMat3| FigurePart {
        solid,
        texture,
        center,
        axes,
    };
    let [radius, thickness] = FLOOR_RADII;
    let floor = dvec3(0.0, FLOOR_HEIGHT, 0.0);
    let mut parts = vec![part(ellipsoid(radius, thickness, radius), FLOOR, floor, DMat3::IDENTITY)];

    let (sin, cos) = libm::sincos(CHAIR_FACES.to_radians());
    let axes = DMat3::from_cols(dvec3(cos, 0.0, -sin), DVec3::Y, dvec3(sin, 0.0, cos));
    let origin = dvec3(CHAIR[0], FLOOR_HEIGHT, CHAIR[1]);
    let mut stand = |solid: Solid, texture: Texture, offset: DVec3| {
        parts.push(part(solid, texture, origin + axes * offset, axes));
    };
    stand(ellipsoid(0.15, 0.03, 0.14), SEAT, dvec3(0.0, 0.40, 0.0));
    stand(ellipsoid(0.14, 0.12, 0.025), SEAT, dvec3(0.0, 0.68, -0.11));
    for (x, z) in [(-0.10, 0.08), (0.10, 0.08)] {
        stand(capsule(0.38, 0.022), WOOD, dvec3(x, 0.22, z));
    }
    // The legs behind go up to the back.
    for x in [-0.10, 0.10] {
        stand(capsule(0.70, 0.022), WOOD, dvec3(x, 0.38, -0.10));
    }
    parts
}
