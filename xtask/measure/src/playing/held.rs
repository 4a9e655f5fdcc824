//! A simulated parameter that the renderer does not have: the number of frames that share one sort.
//!
//! The reference renders the effect of a held order, and the effect is added to the player's images:
//! `player + (reference in the held order - reference)`. The saved time is the share of the stages `alive` and
//! `sort` that a frame skips.

use crate::parameter::{FlowStage, ImageErrors, Parameter, ParameterValue, Quartiles};
use anyhow::Context;
use refine::image::Image;
use refine::reference::PosedView;
use refine::reference::{Order, RenderScene, render, render_held};

use super::errors::Expected;
use super::measured::{FrameTiming, MeasuredVariant};
use super::views::{ViewSet, earlier};

/// Numbers of frames that share one order.
const FRAMES: [usize; 3] = [2, 4, 8];

/// Number of images that [`parameter`] renders.
pub(super) fn pictures(views: &ViewSet) -> usize {
    views.turn.len() + FRAMES.len() * (views.pictures.len() + views.turn.len())
}

/// Measures the parameter against `base`, the player with its default settings, on a clip of `duration_s` seconds.
/// Calls `on_picture` for each of [`pictures`]. Also returns an image in the order that was held longest.
pub(super) fn parameter(
    whole: &RenderScene,
    views: &ViewSet,
    duration_s: f64,
    expected: &Expected,
    base: &MeasuredVariant,
    on_picture: &mut dyn FnMut(),
) -> anyhow::Result<(Parameter, Image)> {
    let mut take = |posed_view: &PosedView, made: &PosedView| {
        on_picture();
        match posed_view == made {
            true => render(whole, &posed_view.camera, posed_view.t, Order::Depth),
            false => {
                render_held(whole, &posed_view.camera, posed_view.t, Order::Depth, (&made.camera, made.t))
            }
        }
    };
    // The turn in `expected` is sorted by distance; held orders are sorted by depth.
    let turn = views.turn.iter().map(|posed_view| take(posed_view, posed_view)).collect::<Vec<_>>();
    let mut points = vec![base.to_value("1", true)];
    let mut longest = None;
    for frames in FRAMES {
        let last = views.pictures.len().saturating_sub(1).max(1);
        let mut pictures = Vec::new();
        for (i, posed_view) in views.pictures.iter().enumerate() {
            // Ages of the order, evenly spaced over the views; the first view has the oldest.
            let since = ((last - i.min(last)) * (frames - 1) + last / 2) / last;
            let held = take(posed_view, &earlier(posed_view, since, duration_s));
            pictures.push(on_top(&base.inspection.images[i], &held, &expected.pictures[i]));
        }
        let mut turned = Vec::new();
        for (i, posed_view) in views.turn.iter().enumerate() {
            let held = take(posed_view, &views.turn[i - i % frames]);
            turned.push(on_top(&base.inspection.turn[i], &held, &turn[i]));
        }
        points.push(held_point(frames, base, expected.errors(&pictures, &turned)?));
        longest = pictures.into_iter().next();
    }
    let parameter = Parameter {
        stage: FlowStage::Playing,
        name: "frames to a sort".into(),
        about: "Number of frames that share the sort order and the alive Gaussians of the first of them. The player \
                sorts in every frame. The change of the image is taken from the reference; the saved time is the \
                share of the stages `alive` and `sort`."
            .into(),
        why_default: "Gaussians change places while the head moves, and an older order shows it".into(),
        cost: "ms a frame".into(),
        points,
    };
    Ok((parameter.mark_front(), longest.context("a simulation without images")?))
}

fn held_point(frames: usize, base: &MeasuredVariant, errors: ImageErrors) -> ParameterValue {
    let share = 1.0 / frames as f64;
    let quartiles =
        |value: fn(&FrameTiming) -> f64| Quartiles::new(base.timings.iter().map(value).map(|ms| ms * share));
    let saved = |sample: &FrameTiming| (1.0 - share) * (sample.alive_ms + sample.sort_ms);
    let frame_ms = Quartiles::new(base.timings.iter().map(|sample| sample.frame_ms - saved(sample)));
    let mut point = base.to_value(&frames.to_string(), false);
    point.errors = errors;
    (point.cost, point.run_time_ms) = (frame_ms, Some(frame_ms));
    point.stages_ms.insert("alive".into(), quartiles(|sample| sample.alive_ms));
    point.stages_ms.insert("sort".into(), quartiles(|sample| sample.sort_ms));
    point.counts.entry("sorted_keys".into()).and_modify(|keys| *keys *= share);
    point
}

/// `picture` plus the difference between `held` and `exact`.
fn on_top(picture: &Image, held: &Image, exact: &Image) -> Image {
    let pixels = picture.pixels.iter().zip(held.pixels.iter().zip(&exact.pixels));
    let sum = |(a, (b, c)): (&[f64; 4], (&[f64; 4], &[f64; 4]))| [0, 1, 2, 3].map(|i| a[i] + b[i] - c[i]);
    Image { width: picture.width, height: picture.height, pixels: pixels.map(sum).collect() }
}
