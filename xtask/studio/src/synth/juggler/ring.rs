//! The circus ring: floor, curb, podium, bunting. It is static, except for flags in a breeze.

use std::f64::consts::{PI, TAU};

use glam::{DMat3, DQuat, DVec2, DVec3, dvec2, dvec3};

use super::fit::{Gaussians, Surfel, SurfelPose, Windows};
use super::light::{Albedo, Light, OPEN, soft, srgb};
use super::{cascade, sample};

/// Radius of the floor in metres.
const FLOOR_RADIUS: f64 = 1.14;

/// The curb is half a torus: its major and minor radius.
const CURB_RADIUS: f64 = 1.22;
const CURB_SECTION: f64 = 0.085;

/// The podium: a truncated cone.
const PODIUM: DVec3 = DVec3::new(-0.72, 0.0, -0.52);
const PODIUM_HEIGHT: f64 = 0.42;
const PODIUM_RADII: [f64; 2] = [0.25, 0.20];

/// Balls on the podium, in its axes.
const SPARE_RADIUS: f64 = 0.06;

/// The poles of the bunting.
const POLE_X: f64 = 0.98;
const POLE_Z: f64 = -0.80;
const POLE_HEIGHT: f64 = 2.15;
const POLE_RADIUS: f64 = 0.018;

const RED: u32 = 0xc9402f;
const CREAM: u32 = 0xf6e7c8;
const GOLD: u32 = 0xe3a92f;
const TEAL: u32 = 0x1f8a8c;

/// Signed distance from the floor and the objects on it, without the bunting.
pub(super) fn distance(p: DVec3) -> f64 {
    let across = dvec2(p.x, p.z).length();
    let curb = dvec2(across - CURB_RADIUS, p.y).length() - CURB_SECTION;
    let spares = spares().map(|center| (p - center).length() - SPARE_RADIUS);
    let q = p - PODIUM;
    let radius =
        PODIUM_RADII[0] + (PODIUM_RADII[1] - PODIUM_RADII[0]) * (q.y / PODIUM_HEIGHT).clamp(0.0, 1.0);
    let podium = (dvec2(q.x, q.z).length() - radius).max(q.y - PODIUM_HEIGHT);
    spares.into_iter().fold(p.y.min(curb).min(podium), f64::min)
}

fn spares() -> [DVec3; 4] {
    let top = PODIUM + dvec3(0.0, PODIUM_HEIGHT, 0.0);
    let rest_radius = SPARE_RADIUS * 2.0 / 3f64.sqrt();
    let at = |turn: f64| top + dvec3(rest_radius * turn.cos(), SPARE_RADIUS, rest_radius * turn.sin());
    // Four equal balls in a heap: the height of the fourth above the others.
    let rise = SPARE_RADIUS * (1.0 + 2.0 * (2f64 / 3.0).sqrt());
    [at(0.4), at(0.4 + TAU / 3.0), at(0.4 - TAU / 3.0), top + dvec3(0.0, rise, 0.0)]
}

/// Adds the ring.
pub(super) fn build(light: &Light, gaussians: &mut Gaussians) {
    floor(light, gaussians);
    curb(light, gaussians);
    podium(light, gaussians);
    for (i, center) in spares().into_iter().enumerate() {
        let count = 150;
        let spacing = SPARE_RADIUS * (4.0 * PI / f64::from(count)).sqrt();
        for normal in sample::fibonacci_sphere(count) {
            let point = center + SPARE_RADIUS * normal;
            let albedo = cascade::paint(i % cascade::BALLS, DQuat::from_rotation_x(i as f64) * normal);
            let color = light.color(albedo, normal, light.occlusion(point, normal));
            gaussians.push_static_surfel(point, normal, spacing, color);
        }
    }
    bunting(light, gaussians);
}

/// A tile of a surface: standard deviations along `along`, across it and through it.
fn tile(
    light: &Light,
    gaussians: &mut Gaussians,
    point: DVec3,
    normal: DVec3,
    along: DVec3,
    size: [f64; 2],
    albedo: Albedo,
) {
    let rotation = DQuat::from_mat3(&DMat3::from_cols(along, normal.cross(along), normal));
    let scales = dvec3(0.68 * size[0], 0.68 * size[1], 0.002);
    let color = light.color(albedo, normal, light.occlusion(point, normal));
    gaussians.push_static(point, rotation, scales, color);
}

/// `count` directions around the y axis.
fn around(count: usize, offset: f64) -> impl Iterator<Item = (f64, DVec3)> {
    (0..count).map(move |i| {
        let angle = (i as f64 + offset) * TAU / count as f64;
        (angle, dvec3(angle.cos(), 0.0, angle.sin()))
    })
}

/// Sand with a star, in rings of tiles.
fn floor(light: &Light, gaussians: &mut Gaussians) {
    let rings = 31;
    let step = FLOOR_RADIUS / f64::from(rings);
    for ring in 0..rings {
        let radius = (f64::from(ring) + 0.5) * step;
        let count = (TAU * radius / 0.054).round().max(4.0) as usize;
        let length = TAU * radius / count as f64;
        for (_, out) in around(count, 0.37 * f64::from(ring)) {
            let along = DVec3::Y.cross(out);
            let point = radius * out;
            tile(
                light,
                gaussians,
                point,
                DVec3::Y,
                along,
                [length, step],
                floor_paint(dvec2(point.x, point.z)),
            );
        }
    }
}

fn floor_paint(p: DVec2) -> Albedo {
    let radius = p.length();
    // Eight points, two sizes.
    let angle = p.y.atan2(p.x) + PI / 2.0;
    let turn = (angle / (PI / 4.0)).rem_euclid(1.0) - 0.5;
    let points = 0.42 + 0.5 * (1.0 - 2.0 * turn.abs()).powi(2);
    let sand = srgb(0xe2bd84).lerp(srgb(0xd2604a), soft(0.5 * (points - radius), 0.035));
    let sand = sand.lerp(srgb(0xd98f3a), soft(0.30 - radius, 0.03));
    sand.lerp(srgb(TEAL), soft(0.035 - (radius - 1.055).abs(), 0.03))
}

/// A padded curb in panels.
fn curb(light: &Light, gaussians: &mut Gaussians) {
    let sections = 9;
    let count = 156;
    for section in 0..=sections {
        let lift = PI * f64::from(section) / f64::from(sections);
        for (angle, out) in around(count, 0.5 * f64::from(section % 2)) {
            let normal = lift.cos() * out + lift.sin() * DVec3::Y;
            let point = CURB_RADIUS * out + CURB_SECTION * normal;
            let panel = (angle / TAU * 24.0).rem_euclid(1.0);
            let even = (angle / TAU * 24.0).rem_euclid(2.0) < 1.0;
            let albedo = match even {
                _ if !(0.06..0.94).contains(&panel) => srgb(GOLD),
                true => srgb(RED),
                false => srgb(CREAM),
            };
            let length = TAU * CURB_RADIUS / count as f64;
            let width = PI * CURB_SECTION / f64::from(sections);
            tile(light, gaussians, point, normal, DVec3::Y.cross(out), [length, width], albedo);
        }
    }
}

fn podium(light: &Light, gaussians: &mut Gaussians) {
    let step = 0.024;
    let rows = (PODIUM_HEIGHT / step).round() as usize;
    let slant = dvec2(PODIUM_RADII[0] - PODIUM_RADII[1], PODIUM_HEIGHT).normalize();
    for row in 0..rows {
        let height = (row as f64 + 0.5) / rows as f64;
        let radius = PODIUM_RADII[0] + (PODIUM_RADII[1] - PODIUM_RADII[0]) * height;
        let count = 56;
        for (angle, out) in around(count, 0.5 * (row % 2) as f64) {
            let normal = slant.y * out + slant.x * DVec3::Y;
            let point = PODIUM + radius * out + DVec3::Y * (height * PODIUM_HEIGHT);
            // Diamonds between two golden bands.
            let across = 2.0 * ((angle / TAU * 8.0).rem_euclid(1.0) - 0.5).abs();
            let from_center = (height - 0.5).abs();
            let diamond = 0.80 - across - 2.0 * from_center;
            let albedo = srgb(TEAL).lerp(srgb(CREAM), soft(diamond, 0.25));
            let albedo = albedo.lerp(srgb(GOLD), soft(from_center - 0.41, 0.04));
            let length = TAU * radius / count as f64;
            tile(light, gaussians, point, normal, DVec3::Y.cross(out), [length, 1.05 * step], albedo);
        }
    }
    let rings = 8;
    let width = PODIUM_RADII[1] / f64::from(rings);
    for ring in 0..rings {
        let radius = (f64::from(ring) + 0.5) * width;
        let count = (TAU * radius / step).round().max(4.0) as usize;
        for (_, out) in around(count, 0.3 * f64::from(ring)) {
            let point = PODIUM + radius * out + DVec3::Y * PODIUM_HEIGHT;
            let albedo = srgb(if ring == rings - 1 { GOLD } else { RED });
            let length = TAU * radius / count as f64;
            tile(light, gaussians, point, DVec3::Y, DVec3::Y.cross(out), [length, width], albedo);
        }
    }
}

/// Two poles with a line of flags.
fn bunting(light: &Light, gaussians: &mut Gaussians) {
    for x in [POLE_X, -POLE_X] {
        let foot = dvec3(x, 0.0, POLE_Z);
        let rows = 36;
        let step = POLE_HEIGHT / f64::from(rows);
        for row in 0..rows {
            for (_, out) in around(6, 0.5 * f64::from(row % 2)) {
                let point = foot + POLE_RADIUS * out + DVec3::Y * ((f64::from(row) + 0.5) * step);
                let albedo = srgb(if row / 4 % 2 == 0 { RED } else { CREAM });
                tile(light, gaussians, point, out, DVec3::Y, [step, 0.02], albedo);
            }
        }
        let top = foot + DVec3::Y * (POLE_HEIGHT + 0.03);
        for normal in sample::fibonacci_sphere(60) {
            let color = light.color(srgb(GOLD), normal, OPEN);
            gaussians.push_static_surfel(top + 0.04 * normal, normal, 0.018, color);
        }
    }
    let whole = [Windows::whole()];
    let instants: Vec<f64> = whole[0].instants().flatten().collect();
    let flags = 9;
    let colors = [RED, CREAM, TEAL, GOLD].map(srgb);
    let rope = |u: f64| {
        let sag = 0.30 * (1.0 - (2.0 * u - 1.0).powi(2));
        dvec3(POLE_X * (2.0 * u - 1.0), POLE_HEIGHT - 0.04 - sag, POLE_Z)
    };
    for i in 0..90 {
        let (a, b) = (rope(f64::from(i) / 90.0), rope(f64::from(i + 1) / 90.0));
        let along = (b - a).normalize();
        tile(light, gaussians, 0.5 * (a + b), DVec3::Z, along, [(b - a).length(), 0.008], srgb(0x8a6a48));
    }
    for flag in 0..flags {
        let (from, to) = (f64::from(flag) + 0.1, f64::from(flag) + 0.9);
        let (a, b) = (rope(from / f64::from(flags)), rope(to / f64::from(flags)));
        // Neighbours are out of phase.
        let swing = 0.05 * (1.0 + 0.5 * f64::from(flag % 3)) * if flag % 2 == 0 { 1.0 } else { -1.0 };
        let (rows, spacing) = (10, 0.021);
        for row in 0..rows {
            let down = (f64::from(row) + 0.3) / f64::from(rows);
            let half = 0.5 * (1.0 - down);
            let columns = (2.0 * half * (b - a).length() / spacing).round().max(1.0) as usize;
            for column in 0..columns {
                let u = 0.5 + half * (2.0 * (column as f64 + 0.5) / columns as f64 - 1.0);
                let hung = a.lerp(b, u) - DVec3::Y * (0.21 * down);
                let bent = dvec3(0.0, 0.0, 0.02 * (TAU * u).sin() * down);
                let place = |_, _, instant: usize| SurfelPose {
                    position: hung + bent + DVec3::Z * (swing * down * cascade::sway(instants[instant])),
                    rotation: DQuat::IDENTITY,
                };
                let albedo = colors[flag as usize % 4];
                let color = |n| light.color(albedo, n, OPEN);
                let surfel = Surfel { normal: DVec3::Z, spacing, color: &color };
                gaussians.push_fitted(&surfel, &whole, &place);
            }
        }
    }
}
