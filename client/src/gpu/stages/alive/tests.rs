//! The stage against testing every row by hand.

use codec::{Camera, Temporal};

use super::*;
use crate::gpu::stages::sort::Sorter;

const ROWS: usize = 3000;

/// Rows scattered around the origin, most of them alive for a short while. Every row is in the one
/// layer and cell of a time index that excludes nothing.
fn moving() -> Field {
    let mut state = 3u32;
    let mut random = |low: f32, high: f32| {
        state = state.wrapping_mul(1664525).wrapping_add(1013904223);
        low + (high - low) * (state >> 8) as f32 / (1 << 24) as f32
    };
    let mut field = Field::default();
    let mut temporal = Temporal { motion_order: 2, ..Temporal::default() };
    for _ in 0..ROWS {
        field.centers.push([0; 3].map(|_| random(-4.0, 4.0)));
        field.rotations.push([1.0, 0.0, 0.0, 0.0]);
        field.log_scales.push([0; 3].map(|_| random(-6.0, -1.0)));
        field.opacities.push(random(0.0, 1.0));
        field.sh.push([0.0; 3]);
        temporal.tau.push(random(-0.1, 1.1));
        temporal.s.push(random(0.01, 0.2));
        temporal.motion.extend([0; 2].map(|_| [0; 3].map(|_| random(-2.0, 2.0))));
    }
    field.temporal = Some(temporal);
    field
}

fn rows(field: &Field) -> Rows {
    // All rows in the cell of the longest class and first bin: a candidate at any time.
    let mut counts = vec![0; 7 * 64];
    counts[0] = ROWS as u32;
    let mut time_index = TimeIndex::default();
    time_index.push_layer(&counts);
    Rows::new(&Field::default(), field, vec![LayerEnd { still: 0, moving: ROWS }], time_index)
}

fn camera() -> Camera {
    Camera::look_at([0.3, -0.2, -3.0], [0.0; 3], [0.0, -1.0, 0.0], 0.8, 200, 120)
}

fn order_of(mut items: Vec<Item>) -> Vec<u32> {
    let mut order = Vec::new();
    Sorter::new(items.len()).sort(&mut items, &mut order);
    order
}

#[test]
fn counts_what_is_alive() {
    let field = moving();
    let view = [View::from_camera(&camera())];
    let mut items = Vec::new();
    for t in [0.0, 0.21, 0.5, 1.0] {
        let expected = (0..ROWS).filter(|&row| field.opacity_at(row, t) >= ALPHA_MIN).count();
        let alive = rows(&field).alive(t, None, &view, SortOrder::Depth, &mut items);
        assert_eq!(alive as usize, expected, "t = {t}");
        assert!(expected > 100 && expected < ROWS * 2 / 3, "a case in which many are not alive: {expected}");
    }
}

/// Position in the axes of the camera.
fn in_view(camera: &Camera, p: [f64; 3]) -> [f64; 3] {
    camera.camera_from_world[..3]
        .iter()
        .map(|row| row[0] * p[0] + row[1] * p[1] + row[2] * p[2] + row[3])
        .collect::<Vec<_>>()
        .try_into()
        .expect("three coordinates")
}

#[test]
fn sorted_from_the_farthest_position_at_the_instant() {
    let (field, camera) = (moving(), camera());
    let view = [View::from_camera(&camera)];
    for sort in [SortOrder::Depth, SortOrder::Radial] {
        let mut items = Vec::new();
        rows(&field).alive(0.4, None, &view, sort, &mut items);
        let depth = |row: u32| {
            let p = in_view(&camera, field.position_at(row as usize, 0.4));
            match sort {
                SortOrder::Depth => p[2],
                SortOrder::Radial => p.iter().map(|x| x * x).sum::<f64>().sqrt(),
            }
        };
        let order = order_of(items);
        assert!(order.len() > 100);
        assert!(order.windows(2).all(|pair| depth(pair[0]) >= depth(pair[1]) - 1e-5));
    }
}

#[test]
fn what_is_left_out_cannot_be_seen() {
    let (field, camera) = (moving(), camera());
    let view = View::from_camera(&camera);
    let mut items = Vec::new();
    let alive = rows(&field).alive(0.4, None, &[view], SortOrder::Depth, &mut items);
    let kept = order_of(items);
    assert!(
        kept.len() < alive as usize * 3 / 4,
        "a case in which much is outside: {} of {alive}",
        kept.len()
    );
    for row in (0..ROWS).filter(|&row| field.opacity_at(row, 0.4) >= ALPHA_MIN) {
        if kept.contains(&(row as u32)) {
            continue;
        }
        // Samples of the ellipsoid at which alpha falls to 1/255 all project outside the image.
        let p = in_view(&camera, field.position_at(row, 0.4));
        let sigma = f64::from(field.log_scales[row].into_iter().fold(f32::MIN, f32::max).exp());
        let radius = sigma * (2.0 * (field.opacity_at(row, 0.4) / ALPHA_MIN).ln()).sqrt();
        for direction in 0..26 {
            let d = [direction % 3, direction / 3 % 3, direction / 9].map(|k| f64::from(k) - 1.0);
            let norm = d.iter().map(|x| x * x).sum::<f64>().sqrt().max(1.0);
            let q: [f64; 3] = std::array::from_fn(|axis| p[axis] + radius * d[axis] / norm);
            let (x, y) = (
                camera.k[0][0] * q[0] / q[2] + camera.k[0][2],
                camera.k[1][1] * q[1] / q[2] + camera.k[1][2],
            );
            let inside = q[2] > 0.05 && (0.0..200.0).contains(&x) && (0.0..120.0).contains(&y);
            assert!(!inside || p[2] < f64::from(shaders::NEAR), "row {row} reaches {x},{y}");
        }
    }
}

#[test]
fn a_second_eye_adds_what_only_it_sees() {
    let field = moving();
    let [left, right] = View::from_camera(&camera()).stereo_pair(1.0);
    let seen = |views: &[View]| {
        let mut items = Vec::new();
        rows(&field).alive(0.4, None, views, SortOrder::Depth, &mut items);
        let mut rows = order_of(items);
        rows.sort_unstable();
        rows
    };
    let (both, only_left, only_right) = (seen(&[left, right]), seen(&[left]), seen(&[right]));
    assert!(both.len() > only_left.len() && both.len() > only_right.len());
    let mut either = [only_left, only_right].concat();
    either.sort_unstable();
    either.dedup();
    assert_eq!(both, either);
}

#[test]
fn layers_are_prefixes() {
    let mut still = moving();
    still.temporal = None;
    still.opacities.fill(1.0);
    let layers = vec![LayerEnd { still: 10, moving: 0 }, LayerEnd { still: ROWS, moving: 0 }];
    let rows = Rows::new(&still, &Field::default(), layers, TimeIndex::default());
    let view = [View::from_camera(&camera())];
    let mut items = Vec::new();
    let mut alive = |layers| rows.alive(0.5, layers, &view, SortOrder::Depth, &mut items);
    assert_eq!([Some(0), Some(1), Some(2), Some(9), None].map(&mut alive), [0, 10, 3000, 3000, 3000]);
}
