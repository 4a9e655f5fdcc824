//! Compares the stage with a test of every row.

use codec::{ALPHA_MIN, Camera, Field, Temporal};

use super::*;
use crate::gpu::stages::sort::Sorter;

const ROWS: usize = 3000;

const ORIGIN: DVec3 = DVec3::new(0.5, -1.0, 2.0);

/// Rows scattered around the origin, most of them alive for a short while.
fn dynamic_field() -> Field {
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
    let run = LayerRun {
        fields: [&Field::default(), field],
        rows: [0..0, 0..ROWS],
        before: LayerEnd::default(),
        ends: vec![LayerEnd { static_count: 0, dynamic_count: ROWS }],
        time_index: TimeIndex::of_candidates(ROWS),
    };
    Rows::new(LayerRows::new(&run, ORIGIN), 0)
}

/// Replaces `items` by the rows to draw; returns how many are alive.
fn alive(rows: &Rows, t: f64, views: &FrameViews, settings: &RenderSettings, items: &mut Vec<Item>) -> u32 {
    alive_beyond(0.0, rows, t, views, settings, items)
}

/// As [`alive`], of a clip with a near distance.
fn alive_beyond(
    near: f32,
    rows: &Rows,
    t: f64,
    views: &FrameViews,
    settings: &RenderSettings,
    items: &mut Vec<Item>,
) -> u32 {
    let mut culler = Culler::new(views, settings, ORIGIN, near, items);
    rows.alive(t, 0, &mut culler);
    culler.alive
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
fn counts_alive_rows() {
    let field = dynamic_field();
    let view = [View::from_camera(&camera())];
    let mut items = Vec::new();
    for t in [0.0, 0.21, 0.5, 1.0] {
        let expected = (0..ROWS).filter(|&row| field.opacity_at(row, t) >= ALPHA_MIN).count();
        let found =
            alive(&rows(&field), t, &FrameViews::new(&view, None), &RenderSettings::default(), &mut items);
        assert_eq!(found as usize, expected, "t = {t}");
        assert!(expected > 100 && expected < ROWS * 2 / 3, "many rows are not alive: {expected}");
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
fn rows_are_sorted_back_to_front_at_the_instant() {
    let (field, camera) = (dynamic_field(), camera());
    let view = [View::from_camera(&camera)];
    for sort in [SortOrder::Depth, SortOrder::Radial] {
        let mut items = Vec::new();
        alive(
            &rows(&field),
            0.4,
            &FrameViews::new(&view, None),
            &RenderSettings { sort, ..RenderSettings::default() },
            &mut items,
        );
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
fn culled_rows_are_outside_the_image() {
    let (field, camera) = (dynamic_field(), camera());
    let view = View::from_camera(&camera);
    let mut items = Vec::new();
    let alive =
        alive(&rows(&field), 0.4, &FrameViews::new(&[view], None), &RenderSettings::default(), &mut items);
    let drawn = order_of(items);
    assert!(drawn.len() < alive as usize * 3 / 4, "many rows are outside: {} of {alive}", drawn.len());
    for row in (0..ROWS).filter(|&row| field.opacity_at(row, 0.4) >= ALPHA_MIN) {
        if drawn.contains(&(row as u32)) {
            continue;
        }
        // All samples of the surface at which alpha falls to 1/255 project outside the image.
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
            assert!(!inside || p[2] <= 0.0, "row {row} reaches {x},{y}");
        }
    }
}

#[test]
fn rows_that_are_faded_near_the_eye_are_culled() {
    let (field, camera) = (dynamic_field(), camera());
    let views = FrameViews::new(&[View::from_camera(&camera)], None);
    let drawn = |near: f32| {
        let mut items = Vec::new();
        alive_beyond(near, &rows(&field), 0.4, &views, &RenderSettings::default(), &mut items);
        order_of(items)
    };
    let depth = |row: &u32| in_view(&camera, field.position_at(*row as usize, 0.4))[2];
    let all = drawn(0.0);
    assert!(all.iter().all(|row| depth(row) > 0.0));
    for near in [1.0f32, 4.0] {
        let visible = |row: &&u32| codec::near_fade(depth(row), near.into()) >= ALPHA_MIN;
        let (expected, found) = (all.iter().filter(visible).count(), drawn(near));
        assert!(expected < all.len() && found.len() < all.len(), "{near}: some are too near");
        // None that shows is culled, and hardly one that does not is drawn.
        assert_eq!(found.iter().filter(visible).count(), expected, "{near}");
        assert!(found.len() < expected + 10, "{near}: {} of {expected}", found.len());
    }
}

#[test]
fn two_eyes_see_the_union() {
    let field = dynamic_field();
    let [left, right] = camera().stereo_pair(1.0).map(|eye| View::from_camera(&eye));
    let seen = |views: &[View]| {
        let mut items = Vec::new();
        alive(&rows(&field), 0.4, &FrameViews::new(views, None), &RenderSettings::default(), &mut items);
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

/// Whichever layers arrive together, the same rows are drawn in the same places, with any number of layers.
#[test]
fn layers_that_arrive_one_by_one_are_drawn_as_those_that_arrive_at_once() {
    let dynamic_field = dynamic_field();
    let static_field = Field { temporal: None, opacities: vec![1.0; ROWS], ..dynamic_field.clone() };
    let ends = [(100, 0), (100, 1000), (700, 1500), (ROWS, ROWS)]
        .map(|(static_count, dynamic_count)| LayerEnd { static_count, dynamic_count });
    let rows_of = |layers: Range<usize>| {
        let before = LayerEnd::before(&ends, layers.start);
        let mut time_index = TimeIndex::default();
        let mut row = before.dynamic_count;
        for end in &ends[layers.clone()] {
            time_index.append(TimeIndex::of_candidates(end.dynamic_count - row));
            row = end.dynamic_count;
        }
        let end = ends[layers.end - 1];
        let run = LayerRun {
            fields: [&static_field, &dynamic_field],
            rows: [before.static_count..end.static_count, before.dynamic_count..end.dynamic_count],
            before,
            ends: ends[layers].to_vec(),
            time_index,
        };
        LayerRows::new(&run, ORIGIN)
    };
    let first = |layers: Range<usize>| Rows::new(rows_of(layers), ROWS as u32);
    let at_once = first(0..4);
    let arrived = [
        first(0..1).followed_by(rows_of(1..2)).followed_by(rows_of(2..3)).followed_by(rows_of(3..4)),
        first(0..2).followed_by(rows_of(2..4)),
    ];
    let view = [View::from_camera(&camera())];
    let drawn = |rows: &Rows, layers| {
        let settings = RenderSettings { layers, ..RenderSettings::default() };
        let mut items = Vec::new();
        let count = alive(rows, 0.4, &FrameViews::new(&view, None), &settings, &mut items);
        let mut order = order_of(items);
        order.sort_unstable();
        (count, order)
    };
    for layers in [Some(0), Some(1), Some(2), Some(3), Some(4), Some(9), None] {
        let expected = drawn(&at_once, layers);
        assert_eq!(expected.1.is_empty(), layers == Some(0));
        assert!(arrived.iter().all(|rows| drawn(rows, layers) == expected), "{layers:?}");
    }
    let all: Vec<LayerEnd> = at_once.layer_ends().collect();
    assert!(all == ends && arrived.iter().all(|rows| rows.layer_ends().eq(ends)));
}

#[test]
fn rows_in_the_inset_are_marked() {
    let field = dynamic_field();
    let rows = rows(&field);
    let view = View::from_camera(&camera());
    let inset = FrameViews::new(&[view], Some(0.4)).divisions().unwrap()[0].inset;
    let drawn = |views: &FrameViews| {
        let mut items = Vec::new();
        alive(&rows, 0.4, views, &RenderSettings::default(), &mut items);
        order_of(items).into_iter().map(Item::split).collect::<Vec<_>>()
    };
    let marked: Vec<u32> = drawn(&FrameViews::new(&[view], Some(0.4)))
        .into_iter()
        .filter_map(|(row, is_in_inset)| is_in_inset.then_some(row))
        .collect();
    let alone: Vec<u32> = drawn(&FrameViews::new(&[inset], None)).into_iter().map(|(row, _)| row).collect();
    assert_eq!(marked, alone);
    let all = drawn(&FrameViews::new(&[view], None));
    assert!(
        all.iter().all(|(_, is_in_inset)| !is_in_inset) && alone.len() > 50 && 2 * alone.len() < all.len()
    );
}
