//! Tests of plans: takes of one segment up to 10,000, in both directions, with and without a loop.

use codec::{Limits, SegmentLayer, contents};

use super::*;

const DEMO: &[u8] = include_bytes!("../../../../assets/demo.aarc");

/// A take of segments (start, duration, Gaussians in each layer).
fn take(duration_s: f64, segments: &[(f64, f64, &[usize])]) -> Take {
    let mut take = Take::from(&contents(DEMO, &Limits::default()).unwrap());
    let first = take.segments[0].clone();
    take.duration_s = duration_s;
    take.segments = segments
        .iter()
        .map(|&(start_s, duration_s, ends)| Segment {
            start_s,
            duration_s,
            layers: ends
                .iter()
                .enumerate()
                .map(|(i, &gaussians)| SegmentLayer { bytes: 100 * (i + 1), gaussians })
                .collect(),
            ..first.clone()
        })
        .collect();
    take
}

/// A take on the grid of the levels: of `count` times `unit_s` seconds, with segments twice as long.
fn dyadic(unit_s: f64, count: u32) -> Take {
    let duration_s = unit_s * f64::from(count);
    let mut segments: Vec<(f64, f64, &[usize])> = vec![(0.0, duration_s, &[40, 90])];
    let mut step_s = unit_s;
    while 2.0 * step_s < duration_s {
        let starts = (0..).map(|k| f64::from(k) * step_s).take_while(|start_s| *start_s < duration_s);
        segments.extend(starts.map(|start_s| (start_s, 2.0 * step_s, &[100, 200][..])));
        step_s *= 2.0;
    }
    segments[1..].sort_by(|a, b| a.0.total_cmp(&b.0).then(b.1.total_cmp(&a.1)));
    take(duration_s, &segments)
}

/// Clips one after the other, whose ends are sums.
fn joined(durations: &[f64]) -> Take {
    let mut start_s = 0.0;
    let segments: Vec<(f64, f64, &[usize])> = durations
        .iter()
        .map(|&duration_s| {
            let segment = (start_s, duration_s, &[7, 9, 30][..]);
            start_s += duration_s;
            segment
        })
        .collect();
    take(start_s, &segments)
}

fn all_layers(take: &Take) -> Vec<usize> {
    take.segments.iter().map(|segment| segment.layers.len()).collect()
}

fn plan(take: &Take, t_s: f64, direction: Direction, looping: bool) -> Plan {
    Plan::new(take, &all_layers(take), Playhead { t_s, direction, looping, speed: 1.0 }, usize::MAX)
}

fn takes() -> Vec<Take> {
    vec![
        take(1.0 / 30.0, &[(0.0, 1.0 / 30.0, &[5])]),
        take(2.0, &[(0.0, 2.0, &[5, 9])]),
        dyadic(1.0, 8),
        dyadic(0.7, 13),
        joined(&[1.1, 0.3, 2.7, 0.1, 1.0 / 3.0, 1.0 / 3.0, 5.0]),
        // Of a longer take.
        take(
            3.0,
            &[(-1.0, 9.0, &[9]), (-1.0, 2.0, &[1, 3]), (0.0, 2.0, &[3]), (1.0, 2.0, &[3]), (2.0, 2.0, &[3])],
        ),
        // With a gap, in which nothing is seen.
        take(4.0, &[(0.0, 1.0, &[3]), (3.0, 1.0, &[4])]),
    ]
}

#[test]
fn what_holds_the_instant_comes_first_and_its_first_layers_before_all() {
    for take in takes() {
        for step in 0..=100 {
            let t_s = take.duration_s * f64::from(step) / 100.0;
            let plan = plan(&take, t_s, Direction::Forward, true);
            let holds = |index: &usize| span(&take.segments[*index]).holds(t_s, take.duration_s);
            let held: Vec<usize> = (0..take.segments.len()).filter(holds).collect();
            assert_eq!(plan.held(), held, "{t_s}");
            let firsts: Vec<Want> =
                held.iter().map(|&segment| Want { segment, from: 0, layers: 1 }).collect();
            assert_eq!(plan.wants[..held.len()], firsts, "{t_s}");
            let deep = held.iter().filter(|segment| take.segments[**segment].layers.len() > 1);
            let rest: Vec<Want> = deep
                .map(|&segment| Want { segment, from: 1, layers: take.segments[segment].layers.len() })
                .collect();
            assert_eq!(plan.wants[held.len()..][..rest.len()], rest, "{t_s}");
        }
    }
}

/// Plays `take` in steps, and checks that nothing is reached that was not in the plan before.
fn plays_without_waiting(take: &Take, direction: Direction, looping: bool, step_s: f64) {
    let duration_s = take.duration_s;
    let (mut t_s, sign) = match direction {
        Direction::Forward => (0.0, 1.0),
        Direction::Backward => (duration_s, -1.0),
    };
    let mut before = plan(take, t_s, direction, looping);
    let steps = (if looping { 2.2 } else { 1.0 } * duration_s / step_s) as usize;
    for _ in 0..steps.max(3) {
        t_s += sign * step_s;
        t_s = match looping {
            true => t_s.rem_euclid(duration_s),
            false => t_s.clamp(0.0, duration_s),
        };
        let now = plan(take, t_s, direction, looping);
        let surprise = now.held().iter().find(|&&segment| !before.wants(segment));
        assert_eq!(surprise, None, "{direction:?} at {t_s} of {duration_s}, loop: {looping}");
        before = now;
    }
}

#[test]
fn playing_reaches_only_what_was_planned() {
    for take in takes() {
        // The shortest segment, over twice the speed: no step skips two cuts.
        let shortest = take.segments.iter().map(|segment| segment.duration_s).fold(take.duration_s, f64::min);
        for direction in [Direction::Forward, Direction::Backward] {
            for looping in [false, true] {
                for part in [0.5, 0.9, 0.05] {
                    plays_without_waiting(&take, direction, looping, part * shortest.min(0.5));
                }
            }
        }
    }
}

#[test]
fn on_a_grid_four_of_the_lowest_level_are_planned() {
    let take = dyadic(1.0, 64);
    for step in 0..200 {
        let t_s = 2.0 + 0.3 * f64::from(step);
        for direction in [Direction::Forward, Direction::Backward] {
            let plan = plan(&take, t_s, direction, false);
            let lowest =
                (0..take.segments.len()).filter(|i| take.segments[*i].duration_s == 2.0 && plan.wants(*i));
            let count = lowest.count();
            assert!((2..=4).contains(&count), "{count} at {t_s}");
        }
    }
}

#[test]
fn the_next_segments_are_in_the_order_of_play() {
    let take = joined(&[1.0; 6]);
    let order = |t_s, direction, looping| {
        let plan = plan(&take, t_s, direction, looping);
        let mut order: Vec<usize> = plan.wants.iter().map(|want| want.segment).collect();
        order.dedup();
        order
    };
    assert_eq!(order(2.5, Direction::Forward, false), [2, 3, 4]);
    assert_eq!(order(2.5, Direction::Backward, false), [2, 1, 0]);
    assert_eq!(order(5.5, Direction::Forward, false), [5]);
    assert_eq!(order(5.5, Direction::Forward, true), [5, 0, 1]);
    assert_eq!(order(0.5, Direction::Backward, true), [0, 5, 4]);
    assert_eq!(order(2.0, Direction::Backward, false), [2, 1, 0], "at a cut");
    assert_eq!(order(6.0, Direction::Backward, false), [5, 4, 3], "at the end");
    // Anything is an instant of the take.
    assert_eq!(order(f64::NAN, Direction::Forward, false), [0, 1, 2]);
    assert_eq!(order(-3.0, Direction::Forward, false), [0, 1, 2]);
    assert_eq!(order(99.0, Direction::Forward, false), [5]);
}

#[test]
fn segments_ahead_take_no_more_rows_than_there_are() {
    let take = joined(&[1.0; 6]);
    let layers = all_layers(&take);
    let head = Playhead { t_s: 2.5, ..Playhead::default() };
    let count = |rows| {
        let plan = Plan::new(&take, &layers, head, rows);
        (0..6).filter(|segment| plan.wants(*segment)).count()
    };
    assert_eq!([0, 30, 59, 60, 89, 90].map(count), [1, 1, 1, 2, 2, 3], "what holds is always wanted");
}

#[test]
fn as_many_rows_as_are_wanted_cut_no_plan() {
    for take in takes() {
        let (layers, rows) = (all_layers(&take), rows_wanted(&take));
        let mut largest = 0;
        for step in 0..=997 {
            for direction in [Direction::Forward, Direction::Backward] {
                let t_s = take.duration_s * f64::from(step) / 997.0;
                let head = Playhead { t_s, direction, looping: true, speed: 1.0 };
                let plan = Plan::new(&take, &layers, head, rows);
                assert_eq!(plan, Plan::new(&take, &layers, head, usize::MAX), "{head:?}");
                let sum = (0..layers.len()).filter(|segment| plan.wants(*segment));
                largest = largest.max(sum.map(|segment| take.segments[segment].gaussians()).sum());
            }
        }
        assert!(largest <= rows && rows <= 2 * largest, "{largest} of {rows}");
    }
}

#[test]
fn what_is_needed_are_the_segments_ahead() {
    let take = joined(&[1.0; 20]);
    let rate = |layers, t_s, direction, looping| {
        needs(&take, layers, &Playhead { t_s, direction, looping, speed: 1.0 }).bytes
    };
    let forward = [1, 2, 3, 9].map(|layers| rate(layers, 2.5, Direction::Forward, false));
    assert_eq!(forward, [100.0, 200.0, 300.0, 300.0]);
    assert_eq!(rate(2, 10.5, Direction::Backward, false), 200.0);
    for (t_s, direction) in [(19.5, Direction::Forward), (0.5, Direction::Backward)] {
        assert_eq!((rate(2, t_s, direction, false), rate(2, t_s, direction, true)), (0.0, 200.0));
    }
    let fast = Playhead { t_s: 2.5, speed: 2.0, ..Playhead::default() };
    assert_eq!(needs(&take, 1, &fast), Needs { bytes: 200.0, segments: 2.0 });
    assert_eq!(needs(&take, 1, &Playhead::default()), Needs::default());
}

#[test]
fn only_layers_that_are_not_there_are_missing() {
    let plan = plan(&joined(&[1.0; 3]), 0.5, Direction::Forward, false);
    let missing = |resident: [usize; 3]| {
        let wants = plan.missing(|segment| resident[segment]).into_iter();
        wants.map(|Want { segment, from, layers }| (segment, from, layers)).collect::<Vec<_>>()
    };
    assert_eq!(missing([0, 0, 0]), [(0, 0, 1), (0, 1, 3), (1, 0, 3), (2, 0, 3)]);
    assert_eq!(missing([1, 0, 3]), [(0, 1, 3), (1, 0, 3)]);
    assert_eq!(missing([2, 1, 3]), [(0, 2, 3), (1, 1, 3)]);
    assert_eq!(missing([3; 3]), []);
}

#[test]
fn a_plan_is_for_all_instants_between_two_cuts() {
    for take in takes() {
        for looping in [false, true] {
            let mut before: Option<Plan> = None;
            let mut kept = 0;
            for step in 0..=2000 {
                let t_s = take.duration_s * f64::from(step) / 2000.0;
                let now = plan(&take, t_s, Direction::Forward, looping);
                if let Some(before) = before.filter(|before| before.is_for(t_s)) {
                    assert_eq!(before, now, "{t_s} of {}", take.duration_s);
                    kept += 1;
                }
                before = Some(now);
            }
            assert!(kept > 1500, "{kept}");
        }
    }
}

#[test]
fn missing_and_damaged_segments_are_left_out() {
    let take = dyadic(1.0, 8);
    let mut layers = all_layers(&take);
    let head = Playhead { t_s: 3.5, ..Playhead::default() };
    let held = Plan::new(&take, &layers, head, usize::MAX).held().to_vec();
    (layers[held[0]], layers[held[1]]) = (0, 1);
    let plan = Plan::new(&take, &layers, head, usize::MAX);
    assert_eq!(plan.held(), &held[1..]);
    let of_damaged: Vec<usize> =
        plan.wants.iter().filter(|want| want.segment == held[1]).map(|want| want.layers).collect();
    assert_eq!(of_damaged, [1], "its first layer alone");
    layers.fill(0);
    assert_eq!(Plan::new(&take, &layers, head, usize::MAX).wants, []);
}

#[test]
fn the_least_urgent_segment_makes_room_and_never_one_that_is_drawn() {
    let take = joined(&[1.0; 8]);
    let plan = plan(&take, 2.5, Direction::Forward, false);
    // Wanted: 2, 3, 4.
    assert!([0, 2, 3, 4].contains(&2) && plan.victim(&[0, 2, 3, 4], 2) == Some(0), "played");
    assert_eq!(plan.victim(&[2, 3, 7], 4), Some(7), "far ahead");
    assert_eq!(plan.victim(&[2, 4], 3), Some(4), "later");
    assert_eq!(plan.victim(&[2, 3], 4), None, "earlier");
    assert_eq!(plan.victim(&[3, 4], 2), Some(4));
    assert_eq!(plan.victim(&[2], 2), None, "its own first layers");
    assert_eq!(plan.victim(&[], 2), None);
    let both = dyadic(1.0, 4);
    let plan = self::plan(&both, 1.5, Direction::Forward, false);
    assert!(plan.held().len() > 2 && plan.victim(plan.held(), plan.held()[0]).is_none());
}

#[test]
fn ten_thousand_segments_are_planned_anywhere() {
    let take = dyadic(1.0, 5000);
    assert!(take.segments.len() > 9_900, "{}", take.segments.len());
    let rows = rows_wanted(&take);
    // At most four segments of each of the twelve levels, and the segment that spans the take.
    assert!(rows <= 12 * 4 * 200 + 90, "{rows}");
    for step in 0..200 {
        let t_s = 4999.9 * f64::from(step * 37 % 200) / 200.0;
        let plan = plan(&take, t_s, Direction::Forward, false);
        assert!((13..=25).contains(&plan.held().len()) && plan.wants.len() < 90, "{t_s}");
    }
    plays_without_waiting(&dyadic(1.0, 300), Direction::Forward, true, 0.9);
}
