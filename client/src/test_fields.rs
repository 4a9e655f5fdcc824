//! Made-up fields for tests: a ball under a sky, a person, and a room.

use codec::{ClipInfo, EncodeOptions, Field, Source, Temporal, encode};
use glam::{DVec3, dvec3};

/// A row: centre and standard deviation.
pub(crate) type Row = (DVec3, f64);

/// Rows of a ball, a person, and a sky.
const COUNT: usize = 1500;

/// Metadata with y up and without viewpoints.
pub(crate) fn y_up() -> ClipInfo {
    ClipInfo { up: [0.0, 1.0, 0.0], ..ClipInfo::default() }
}

/// Numbers from 0 to 1, evenly by multiples of an irrational `step`.
fn even(i: usize, step: f64) -> f64 {
    (i as f64 * step).fract()
}

/// Directions evenly over a sphere, by the golden angle.
fn direction(i: usize, count: usize) -> DVec3 {
    let y = 2.0 * (i as f64 + 0.5) / count as f64 - 1.0;
    let (sin, cos) = (2.399963 * i as f64).sin_cos();
    let level = (1.0 - y * y).sqrt();
    dvec3(level * cos, y, level * sin)
}

/// A solid ball of radius 1 around the origin.
pub(crate) fn ball() -> Vec<Row> {
    (0..COUNT).map(|i| (direction(i, COUNT) * even(i, 0.754878).cbrt(), 0.04)).collect()
}

/// Half a sphere of large Gaussians around the origin.
pub(crate) fn sky(radius: f64) -> Vec<Row> {
    let raised = |direction: DVec3| DVec3 { y: direction.y.abs(), ..direction };
    (0..COUNT).map(|i| (radius * raised(direction(i, COUNT)), 0.06 * radius)).collect()
}

/// A person of 1.8 units who stands on the ground at `feet`, y up.
pub(crate) fn person(feet: DVec3) -> Vec<Row> {
    let row = |i: usize| {
        let (sin, cos) = (2.399963 * i as f64).sin_cos();
        (feet + dvec3(0.25 * cos, 1.8 * even(i, 0.754878), 0.15 * sin), 0.03)
    };
    (0..COUNT).map(row).collect()
}

/// Floor and walls of a room of 8 units and 3 units of height, on the ground around the origin.
pub(crate) fn room() -> Vec<Row> {
    let row = |i: usize| {
        let (a, b) = (even(i, 0.754878) - 0.5, even(i, 0.569840) - 0.5);
        let (along, high) = (8.0 * a, 1.5 + 3.0 * b);
        let center = match i % 6 {
            0 | 1 => dvec3(along, 0.0, 8.0 * b),
            2 => dvec3(along, high, -4.0),
            3 => dvec3(along, high, 4.0),
            4 => dvec3(-4.0, high, along),
            _ => dvec3(4.0, high, along),
        };
        (center, 0.15)
    };
    (0..COUNT).map(row).collect()
}

/// The field of `rows`.
pub(crate) fn field(rows: &[Row]) -> Field {
    Field {
        centers: rows.iter().map(|(center, _)| center.as_vec3().to_array()).collect(),
        rotations: vec![[1.0, 0.0, 0.0, 0.0]; rows.len()],
        log_scales: rows.iter().map(|(_, scale)| [scale.ln() as f32; 3]).collect(),
        opacities: vec![0.9; rows.len()],
        sh: vec![[0.5; 3]; rows.len()],
        ..Field::default()
    }
}

/// The field of `rows`, which move by `by` in clip time.
pub(crate) fn moving_field(rows: &[Row], by: DVec3) -> Field {
    let temporal = Temporal {
        tau: vec![0.0; rows.len()],
        s: vec![f32::INFINITY; rows.len()],
        motion_order: 1,
        motion: vec![by.as_vec3().to_array(); rows.len()],
        rotation_rates: None,
    };
    Field { temporal: Some(temporal), ..field(rows) }
}

/// A package of `field` in two layers, the first with every second row.
pub(crate) fn package(info: &ClipInfo, field: &Field) -> Vec<u8> {
    let order: Vec<usize> = (0..field.len()).step_by(2).chain((1..field.len()).step_by(2)).collect();
    let options = EncodeOptions { layers: vec![field.len().div_ceil(2)], ..EncodeOptions::default() };
    encode(&Source { info, field: &field.select(&order), plate: None }, &options).expect("a field")
}
