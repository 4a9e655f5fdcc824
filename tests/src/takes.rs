//! Takes for tests: fields whose Gaussians live for a tenth of a second up to longer than the take, and the segments
//! that a straightforward reading of the grid of levels cuts them into.

use std::collections::BTreeMap;

use client::gpu::{Span, TakeLayout};
use codec::{ALPHA_MIN, Clip, ClipInfo, Field, Temporal};

use crate::scene::{Motion, Recipe};

/// A take of a synthetic field, and its segments.
pub struct SplitTake {
    /// The field unsplit; its clip time is the time of the take.
    pub field: Field,
    /// Duration in seconds.
    pub duration_s: f64,
    /// The segments.
    pub segments: Vec<(Span, Clip)>,
}

impl SplitTake {
    /// A take of `duration_s` seconds of the Gaussians of `recipe`, cut into levels whose lowest has a segment at every
    /// multiple of `unit_s` seconds.
    pub fn new(recipe: &Recipe, duration_s: f64, unit_s: f64) -> SplitTake {
        let field = many_lifetimes(recipe, duration_s);
        let segments = split(&field, duration_s, unit_s);
        let segments = segments.into_iter().map(|(span, field)| (span, clip_of(&field))).collect();
        SplitTake { field, duration_s, segments }
    }

    /// What a renderer of the take is built for, with room for `rows` Gaussians.
    pub fn layout(&self, rows: usize) -> TakeLayout {
        TakeLayout::for_clip(&clip_of(&self.field)).segmented(self.duration_s).with_rows(rows)
    }

    /// The most Gaussians of the segments that hold one instant.
    pub fn resident_max(&self) -> usize {
        let at = |t_s: f64| {
            let held = self.segments.iter().filter(|(span, _)| span.holds(t_s, self.duration_s));
            held.map(|(_, clip)| clip.len()).sum()
        };
        self.segments.iter().map(|(span, _)| at(span.start_s)).max().unwrap_or(0)
    }
}

/// The field of `recipe`, in which seven of eight Gaussians live for 0.1 to 60 of the `duration_s` seconds, evenly on a
/// logarithmic scale, and move as far in their life as the recipe's do in the clip. The others are static.
fn many_lifetimes(recipe: &Recipe, duration_s: f64) -> Field {
    let mut field = Recipe { motion: Motion::Dynamic, ..*recipe }.field();
    let mut temporal = field.temporal.take().expect("the recipe is dynamic");
    let order = usize::from(temporal.motion_order);
    let fraction = |row: usize, factor: f64| (row as f64 * factor).fract();
    for row in 0..field.len() {
        let motion = &mut temporal.motion[row * order..(row + 1) * order];
        if row % 8 == 0 {
            (temporal.tau[row], temporal.s[row]) = (0.5, f32::INFINITY);
            motion.fill([0.0; 3]);
            if let Some(rates) = &mut temporal.rotation_rates {
                rates[row] = [0.0; 4];
            }
            continue;
        }
        // Multiples of irrational numbers spread lengths and instants evenly.
        let life = 0.1 * 600f64.powf(fraction(row, 0.618_034)) / duration_s;
        temporal.tau[row] = (1.1 * fraction(row, 0.754_878) - 0.05) as f32;
        temporal.s[row] = (0.5 * life / support_radius(field.opacities[row])) as f32;
        for (power, v) in (1..).zip(motion) {
            *v = v.map(|x| (f64::from(x) * life.powi(-power)) as f32);
        }
        if let Some(rates) = &mut temporal.rotation_rates {
            rates[row] = rates[row].map(|x| (f64::from(x) / life) as f32);
        }
    }
    field.temporal = Some(temporal);
    field.check().expect("a valid field");
    field
}

/// Widths of a window from its centre to where its opacity falls to 1/255.
fn support_radius(opacity: f32) -> f64 {
    (2.0 * (f64::from(opacity) / ALPHA_MIN).ln()).sqrt()
}

/// Cuts `field` into segments: a Gaussian is in the lowest level whose segment at its birth holds its whole life.
fn split(field: &Field, duration_s: f64, unit_s: f64) -> Vec<(Span, Field)> {
    let temporal = field.temporal.as_ref().expect("it has lifetimes");
    let mut rows = BTreeMap::<(i32, u32), Vec<usize>>::new();
    for row in 0..field.len() {
        let half = f64::from(temporal.s[row]) * support_radius(field.opacities[row]);
        let center = f64::from(temporal.tau[row]);
        let [birth, death] = [center - half, center + half].map(|t| (t * duration_s).clamp(0.0, duration_s));
        let segment = (0..).find_map(|level| {
            let step = unit_s * 2f64.powi(level);
            let k = (birth / step) as u32;
            let is_top = 2.0 * step >= duration_s;
            (is_top || death <= f64::from(k + 2) * step).then_some((level, if is_top { 0 } else { k }))
        });
        rows.entry(segment.expect("the top holds every life")).or_default().push(row);
    }
    let cut = |((level, k), rows): ((i32, u32), Vec<usize>)| {
        let step = unit_s * 2f64.powi(level);
        let start_s = f64::from(k) * step;
        let span = Span { start_s, duration_s: (2.0 * step).min(duration_s - start_s) };
        (span, retimed(&field.select(&rows), duration_s, span))
    };
    rows.into_iter().map(cut).collect()
}

/// `field` of a take of `duration_s` seconds in the clip time of the segment that lasts `span`.
fn retimed(field: &Field, duration_s: f64, span: Span) -> Field {
    let mut field = field.clone();
    let Temporal { tau, s, motion_order, motion, rotation_rates } =
        field.temporal.as_mut().expect("it has lifetimes");
    let scale = duration_s / span.duration_s;
    let scaled = |x: f32, power: i32| (f64::from(x) * scale.powi(power)) as f32;
    for (tau, s) in tau.iter_mut().zip(s) {
        if s.is_finite() {
            *tau = ((f64::from(*tau) * duration_s - span.start_s) / span.duration_s) as f32;
            *s = scaled(*s, 1);
        }
    }
    for (i, v) in motion.iter_mut().enumerate() {
        let power = i as i32 % i32::from(*motion_order) + 1;
        *v = v.map(|x| scaled(x, -power));
    }
    for rate in rotation_rates.iter_mut().flatten() {
        *rate = rate.map(|x| scaled(x, -1));
    }
    field
}

/// `field` as a clip of one layer, without the rounding of a package.
pub fn clip_of(field: &Field) -> Clip {
    let temporal = field.temporal.as_ref().expect("it has temporal columns");
    let (fixed, dynamic): (Vec<usize>, Vec<usize>) =
        (0..field.len()).partition(|&row| temporal.s[row].is_infinite() && temporal.is_motionless(row));
    let static_field = Field { temporal: None, ..field.select(&fixed) };
    Clip::of_one_layer(ClipInfo::default(), field.bounds(), static_field, field.select(&dynamic), None)
}
