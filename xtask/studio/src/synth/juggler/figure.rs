//! The juggler at rest: his solids, their materials, and the bones that carry them.

use glam::{DQuat, DVec3, dvec3};

use super::light::{Albedo, soft, srgb};
use super::sample::{self, Sample};
use super::sdf::{Shape, on_segment, smooth_min};
use super::skeleton::{Bone, CHEST, FOOT, FOREARM, HAND, HEAD, PELVIS, Pose, SHIN, THIGH, UPPER_ARM, joined};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Material {
    Shirt,
    Sleeve,
    Trousers,
    Glove,
    Skin,
    Nose,
    Eye,
    Hair,
    Moustache,
    Mouth,
    Hat,
    Sock,
    Shoe,
    BowTie,
    Button,
}

use Material::{
    BowTie, Button, Eye, Glove, Hair, Hat, Moustache, Mouth, Nose, Shirt, Shoe, Skin, Sleeve, Sock, Trousers,
};

impl Material {
    const ALL: [Material; 15] = [
        Shirt, Sleeve, Trousers, Glove, Skin, Nose, Eye, Hair, Moustache, Mouth, Hat, Sock, Shoe, BowTie,
        Button,
    ];

    /// Distance of neighbouring Gaussians in metres: finer where viewers look.
    fn spacing(self) -> f64 {
        match self {
            Shirt => 0.0118,
            Sleeve => 0.0190,
            Trousers => 0.0190,
            Glove => 0.0135,
            Skin => 0.0100,
            Nose => 0.0055,
            Eye => 0.0030,
            Hair => 0.0115,
            Moustache | Mouth => 0.0042,
            Hat => 0.0115,
            Sock => 0.0100,
            Shoe => 0.0125,
            BowTie => 0.0065,
            Button => 0.0050,
        }
    }
}

/// A solid of the figure.
struct Part {
    shape: Shape,
    bone: Bone,
    material: Material,
}

/// Parts that blend into each other.
struct Group {
    parts: Vec<Part>,
    /// Rounding of the seams in metres.
    blend: f64,
    /// A point of a plane and its normal; the side of the normal is cut away.
    clip_plane: Option<(DVec3, DVec3)>,
    /// Bounding sphere of the parts.
    center: DVec3,
    radius: f64,
}

impl Group {
    fn new(blend: f64, clip_plane: Option<(DVec3, DVec3)>, parts: Vec<Part>) -> Group {
        let boxes: Vec<[DVec3; 2]> = parts.iter().map(|part| bounds(&part.shape)).collect();
        let low = boxes.iter().map(|b| b[0]).fold(DVec3::INFINITY, DVec3::min);
        let high = boxes.iter().map(|b| b[1]).fold(DVec3::NEG_INFINITY, DVec3::max);
        Group {
            parts,
            blend,
            clip_plane,
            center: 0.5 * (low + high),
            radius: 0.5 * (high - low).length() + blend,
        }
    }

    fn distance(&self, p: DVec3) -> f64 {
        let solid = self.parts.iter().map(|part| part.shape.distance(p));
        let solid = solid.reduce(|a, b| smooth_min(a, b, self.blend)).unwrap_or(f64::INFINITY);
        match self.clip_plane {
            Some((point, normal)) => solid.max((p - point).dot(normal)),
            None => solid,
        }
    }
}

/// Corners of the bounding box of a shape.
fn bounds(shape: &Shape) -> [DVec3; 2] {
    match *shape {
        Shape::Cone { from, to, radii } => {
            let r = radii[0].max(radii[1]);
            [from.min(to) - r, from.max(to) + r]
        }
        Shape::Ellipsoid { center, radii, .. } => {
            let r = radii.max_element();
            [center - r, center + r]
        }
    }
}

/// The figure in its rest pose.
pub(super) struct Figure {
    groups: Vec<Group>,
    /// Centre of the hat's rim, and the hat's axes.
    hat: (DVec3, DQuat),
    feet: [(DVec3, DQuat); 2],
}

impl Figure {
    /// Puts solids around the bones of the pose `rest`.
    pub(super) fn new(rest: &Pose) -> Figure {
        let head = rest[HEAD];
        let hat = (
            head.at(0.004, 0.222, -0.01),
            head.rotation * DQuat::from_rotation_z(-0.12) * DQuat::from_rotation_x(-0.14),
        );
        let mut groups = vec![shirt(rest), trousers(rest)];
        groups.extend(face(rest));
        groups.extend(hat_groups(hat));
        groups.extend(trimmings(rest));
        for side in 0..2 {
            groups.push(hand(rest, side));
            groups.extend(shoe(rest, side));
        }
        Figure { groups, hat, feet: FOOT.map(|bone| (rest[bone].origin, rest[bone].rotation)) }
    }

    /// Signed distance of a point from the figure.
    pub(super) fn distance(&self, p: DVec3) -> f64 {
        let mut nearest = f64::INFINITY;
        for group in &self.groups {
            if (p - group.center).length() - group.radius < nearest {
                nearest = nearest.min(group.distance(p));
            }
        }
        nearest
    }

    /// Points that cover the figure, each material at its own spacing.
    pub(super) fn samples(&self) -> Vec<Sample> {
        let mut samples = Vec::new();
        for material in Material::ALL {
            let of_material = || self.parts().filter(|part| part.material == material);
            let boxes: Vec<[DVec3; 2]> = of_material().map(|part| bounds(&part.shape)).collect();
            let low = boxes.iter().map(|b| b[0]).fold(DVec3::INFINITY, DVec3::min);
            let high = boxes.iter().map(|b| b[1]).fold(DVec3::NEG_INFINITY, DVec3::max);
            let margin = 0.03;
            samples.extend(sample::cover(
                &|p| self.distance(p),
                [low - margin, high + margin],
                &|p| of_material().map(|part| part.shape.distance(p)).fold(f64::INFINITY, f64::min),
                &|p| self.part_at(p).material == material,
                material.spacing(),
            ));
        }
        samples
    }

    /// Skinning weights of a point of the surface, which sum to 1.
    pub(super) fn skin(&self, p: DVec3) -> Vec<(Bone, f64)> {
        /// Distance from a joint within which both bones act, in metres.
        const SOFTNESS: f64 = 0.014;
        let nearest = self.part_at(p);
        let d = nearest.shape.distance(p);
        let mut skin: Vec<(Bone, f64)> = Vec::new();
        for part in self.parts().filter(|part| joined(part.bone, nearest.bone)) {
            let weight = (-(part.shape.distance(p) - d).max(0.0) / SOFTNESS).exp();
            match skin.iter_mut().find(|(bone, _)| *bone == part.bone) {
                Some((_, most)) => *most = most.max(weight),
                None => skin.push((part.bone, weight)),
            }
        }
        skin.retain(|(_, weight)| *weight > 0.01);
        skin.sort_by(|a, b| b.1.total_cmp(&a.1));
        let sum: f64 = skin.iter().map(|(_, weight)| weight).sum();
        skin.iter_mut().for_each(|(_, weight)| *weight /= sum);
        skin
    }

    /// Colour of a point of the surface.
    pub(super) fn paint(&self, p: DVec3, normal: DVec3) -> Albedo {
        let part = self.part_at(p);
        let spacing = part.material.spacing();
        // Equal stripes of two colours.
        let stripes = |along: f64, period: f64, a: Albedo, b: Albedo| {
            let in_a = 0.25 * period - ((along / period).rem_euclid(1.0) - 0.5).abs() * period;
            b.lerp(a, soft(in_a, spacing))
        };
        let (teal, cream, red) = (srgb(0x1f8a8c), srgb(0xf8ecd4), srgb(0xc9402f));
        match part.material {
            Shirt => {
                let suspender = soft(0.013 - (p.x.abs() - 0.078).abs(), spacing);
                stripes(p.y, 0.062, teal, cream).lerp(red, suspender)
            }
            Sleeve => {
                let Shape::Cone { from, to, .. } = part.shape else { unreachable!("sleeves are cones") };
                let along = on_segment(p, from, to).0 * (to - from).length();
                stripes(along, 0.062, teal, cream)
            }
            Trousers => srgb(0x3f4f8f).lerp(srgb(0x5a6aa8), soft(0.165 - p.y, spacing)),
            Glove => srgb(0xf7f3ea),
            Skin => {
                let blush =
                    (-((p.x.abs() - 0.062).powi(2) + (p.y - 1.548).powi(2)) / (2.0 * 0.018f64.powi(2))).exp();
                let blush = if normal.z > 0.2 && p.y > 1.45 { 0.75 * blush } else { 0.0 };
                srgb(0xf0bd94).lerp(srgb(0xe8604f), blush)
            }
            Nose => srgb(0xe2473c),
            Eye => {
                let glint = dvec3(0.35, 0.62, 0.7).normalize();
                if normal.dot(glint) > 0.93 { srgb(0xffffff) } else { srgb(0x1d1512) }
            }
            Hair => srgb(0x8c4420),
            Moustache => srgb(0x6e3317),
            Mouth => srgb(0x8f2a26),
            Hat => {
                let height = (self.hat.1.inverse() * (p - self.hat.0)).y;
                srgb(0x6b4478).lerp(srgb(0xe3a92f), soft(0.016 - (height - 0.026).abs(), spacing))
            }
            Sock => stripes(p.y, 0.03, red, cream),
            Shoe => {
                let (ankle, turn) = self.feet[usize::from(p.x < 0.0)];
                let toes = (turn.inverse() * (p - ankle)).z;
                let leather = srgb(0xa14a28).lerp(cream, soft(toes - 0.135, spacing));
                leather.lerp(srgb(0x3a2a22), soft(0.014 - p.y, spacing))
            }
            BowTie => srgb(0xf2b62c),
            Button => srgb(0xf2b62c),
        }
    }

    fn parts(&self) -> impl Iterator<Item = &Part> {
        self.groups.iter().flat_map(|group| &group.parts)
    }

    /// The part of the surface at `p`.
    fn part_at(&self, p: DVec3) -> &Part {
        let of_group = |group: &Group| match (p - group.center).length() - group.radius > 0.05 {
            true => f64::INFINITY,
            false => group.distance(p),
        };
        let group = self.groups.iter().min_by(|a, b| of_group(a).total_cmp(&of_group(b)));
        let parts = group.map_or(&[][..], |group| &group.parts);
        let part = parts.iter().min_by(|a, b| a.shape.distance(p).total_cmp(&b.shape.distance(p)));
        part.expect("every group has parts")
    }
}

fn cone(bone: Bone, material: Material, from: DVec3, to: DVec3, radii: [f64; 2]) -> Part {
    Part { shape: Shape::Cone { from, to, radii }, bone, material }
}

fn ellipsoid(bone: Bone, material: Material, center: DVec3, radii: [f64; 3], rotation: DQuat) -> Part {
    let radii = DVec3::from_array(radii);
    Part { shape: Shape::Ellipsoid { center, radii, rotation }, bone, material }
}

fn shirt(rest: &Pose) -> Group {
    let chest = rest[CHEST];
    let mut parts = vec![
        ellipsoid(CHEST, Shirt, chest.at(0.0, 0.19, 0.0), [0.152, 0.175, 0.106], chest.rotation),
        ellipsoid(PELVIS, Shirt, chest.at(0.0, 0.01, 0.006), [0.136, 0.13, 0.108], chest.rotation),
        cone(CHEST, Shirt, chest.at(-0.13, 0.315, -0.01), chest.at(0.13, 0.315, -0.01), [0.058; 2]),
    ];
    for side in 0..2 {
        let (upper, fore, hand) = (rest[UPPER_ARM[side]], rest[FOREARM[side]], rest[HAND[side]]);
        parts.push(cone(UPPER_ARM[side], Sleeve, upper.origin, fore.origin, [0.056, 0.046]));
        parts.push(cone(FOREARM[side], Sleeve, fore.origin, hand.origin, [0.047, 0.036]));
    }
    Group::new(0.035, None, parts)
}

fn trousers(rest: &Pose) -> Group {
    let pelvis = rest[PELVIS];
    let mut parts =
        vec![ellipsoid(PELVIS, Trousers, pelvis.at(0.0, 0.0, 0.0), [0.150, 0.112, 0.112], pelvis.rotation)];
    for side in 0..2 {
        let (thigh, shin, foot) = (rest[THIGH[side]], rest[SHIN[side]], rest[FOOT[side]]);
        let hem = shin.origin.lerp(foot.origin, 0.86);
        parts.push(cone(THIGH[side], Trousers, thigh.origin, shin.origin, [0.088, 0.066]));
        parts.push(cone(SHIN[side], Trousers, shin.origin, hem, [0.066, 0.057]));
        parts.push(cone(SHIN[side], Trousers, hem, shin.origin.lerp(foot.origin, 0.9), [0.063; 2]));
    }
    Group::new(0.03, None, parts)
}

fn face(rest: &Pose) -> Vec<Group> {
    let head = rest[HEAD];
    let turn = head.rotation;
    let on_head =
        |material, x: f64, y: f64, z: f64, radii| ellipsoid(HEAD, material, head.at(x, y, z), radii, turn);
    let line = |material, a: [f64; 3], b: [f64; 3], radii| {
        cone(HEAD, material, head.at(a[0], a[1], a[2]), head.at(b[0], b[1], b[2]), radii)
    };
    let skull = vec![
        on_head(Skin, 0.0, 0.135, 0.01, [0.100, 0.122, 0.108]),
        on_head(Skin, 0.0, 0.072, 0.038, [0.060, 0.055, 0.060]),
        line(Skin, [0.0, -0.07, -0.005], [0.0, 0.05, 0.0], [0.048, 0.046]),
        on_head(Skin, 0.101, 0.132, 0.0, [0.014, 0.028, 0.020]),
        on_head(Skin, -0.101, 0.132, 0.0, [0.014, 0.028, 0.020]),
    ];
    let hair = vec![on_head(Hair, 0.0, 0.158, -0.012, [0.106, 0.112, 0.108])];
    let part_of_hair = (head.at(0.0, 0.135, 0.022), turn * dvec3(0.0, -0.33, 1.0).normalize());
    let mut features = Vec::new();
    let mut moustache = Vec::new();
    for x in [1.0, -1.0] {
        features.push(on_head(Eye, 0.036 * x, 0.150, 0.107, [0.0105, 0.0175, 0.009]));
        features.push(line(Moustache, [0.022 * x, 0.193, 0.103], [0.054 * x, 0.186, 0.091], [0.0055, 0.004]));
        moustache.push(line(Moustache, [0.005 * x, 0.101, 0.117], [0.042 * x, 0.103, 0.104], [0.012, 0.008]));
        moustache.push(line(Moustache, [0.042 * x, 0.103, 0.104], [0.066 * x, 0.122, 0.090], [0.008, 0.003]));
    }
    let smile = |x: f64| [x, 0.066 + 14.0 * x * x, 0.0975 - 6.0 * x * x];
    for step in 0..6 {
        let x = (f64::from(step) - 3.0) * 0.009;
        features.push(line(Mouth, smile(x), smile(x + 0.009), [0.0045; 2]));
    }
    features.push(on_head(Nose, 0.0, 0.124, 0.126, [0.021, 0.020, 0.020]));
    vec![
        Group::new(0.02, None, skull),
        Group::new(0.01, Some(part_of_hair), hair),
        Group::new(0.002, None, features),
        Group::new(0.006, None, moustache),
    ]
}

fn hat_groups((center, turn): (DVec3, DQuat)) -> [Group; 2] {
    let dome = ellipsoid(HEAD, Hat, center, [0.110, 0.118, 0.117], turn);
    let brim = ellipsoid(HEAD, Hat, center, [0.158, 0.019, 0.170], turn);
    [Group::new(0.01, Some((center, turn * DVec3::NEG_Y)), vec![dome]), Group::new(0.01, None, vec![brim])]
}

/// Bow tie and buttons.
fn trimmings(rest: &Pose) -> Vec<Group> {
    let chest = rest[CHEST];
    let mut parts =
        vec![ellipsoid(CHEST, BowTie, chest.at(0.0, 0.338, 0.070), [0.012, 0.013, 0.013], chest.rotation)];
    for x in [1.0, -1.0] {
        let turn = chest.rotation * DQuat::from_rotation_z(0.25 * x) * DQuat::from_rotation_y(0.35 * x);
        parts.push(ellipsoid(CHEST, BowTie, chest.at(0.036 * x, 0.338, 0.064), [0.033, 0.023, 0.011], turn));
    }
    let buttons = [(0.255, 0.098), (0.185, 0.107), (0.115, 0.105)]
        .map(|(y, z)| ellipsoid(CHEST, Button, chest.at(0.0, y, z), [0.010, 0.010, 0.006], chest.rotation));
    vec![Group::new(0.004, None, parts), Group::new(0.001, None, buttons.into())]
}

fn hand(rest: &Pose, side: usize) -> Group {
    let (bone, hand) = (HAND[side], rest[HAND[side]]);
    // Palm up, the thumb points outwards: away from the other hand.
    let out = if side == 0 { -1.0 } else { 1.0 };
    let mut parts = vec![
        ellipsoid(bone, Glove, hand.at(0.068, -0.005, 0.0), [0.050, 0.018, 0.042], hand.rotation),
        cone(bone, Glove, hand.at(-0.014, 0.0, 0.0), hand.at(0.022, 0.0, 0.0), [0.038, 0.030]),
        cone(
            bone,
            Glove,
            hand.at(0.050, 0.0, 0.030 * out),
            hand.at(0.082, 0.024, 0.066 * out),
            [0.016, 0.014],
        ),
    ];
    for finger in [-0.028, 0.0, 0.028] {
        let (knuckle, tip) = (hand.at(0.103, -0.006, finger), hand.at(0.156, 0.018, 1.1 * finger));
        parts.push(cone(bone, Glove, knuckle, tip, [0.0155, 0.0140]));
    }
    Group::new(0.012, None, parts)
}

fn shoe(rest: &Pose, side: usize) -> [Group; 2] {
    let (bone, foot) = (FOOT[side], rest[FOOT[side]]);
    let parts = vec![
        ellipsoid(bone, Shoe, foot.at(0.0, -0.052, 0.100), [0.058, 0.056, 0.110], foot.rotation),
        ellipsoid(bone, Shoe, foot.at(0.0, -0.045, 0.0), [0.045, 0.056, 0.062], foot.rotation),
    ];
    let sock = vec![cone(bone, Sock, foot.at(0.0, -0.03, 0.0), foot.at(0.0, 0.08, -0.005), [0.040, 0.040])];
    let floor = Some((DVec3::ZERO, DVec3::NEG_Y));
    [Group::new(0.03, floor, parts), Group::new(0.01, None, sock)]
}

#[cfg(test)]
mod tests {
    use super::super::{cascade::Cascade, skeleton};
    use super::*;

    #[test]
    fn samples_lie_on_the_figure_and_have_bones() {
        let figure = Figure::new(&skeleton::pose(0.0, Cascade::new().rest()));
        let samples = figure.samples();
        assert!(samples.len() > 5000, "{} samples", samples.len());
        for sample in &samples {
            assert!(figure.distance(sample.point).abs() < 1e-3);
            assert!(sample.point.y > -1e-3, "above the floor");
            let weights: f64 = figure.skin(sample.point).iter().map(|(_, weight)| weight).sum();
            assert!((weights - 1.0).abs() < 1e-9);
        }
        let height = samples.iter().map(|s| s.point.y).fold(0.0, f64::max);
        assert!((1.7..1.9).contains(&height), "with his hat he is {height} m tall");
    }
}
