//! The reference renderer, on the CPU in f64: it defines what a clip looks like.
//!
//! It has one file per stage, named like the stages on the GPU: `alive` selects the Gaussians that are
//! alive at the instant, `evaluate` projects them, `sort` orders them by depth, and `splat` composites
//! them. The arithmetic is in `raster`, which fits run in f32. Tests compare the GPU with the reference, pruning
//! compares candidates by it, and tools draw with it where there is no GPU.
//!
//! Conventions follow gsplat, and so nearly all fitted fields: variances get the filter of the field,
//! alpha is limited to 0.999 and skipped below 1/255, and a pixel is finished before its transmittance
//! falls to 1e-4.
//!
//! Its pictures decide the content of packages, so they have the same bits on all machines.

mod alive;
mod colors;
mod contribution;
mod coverage;
mod evaluate;
mod held;
mod posed_view;
mod sensitivity;
mod sort;
mod splat;

use codec::{Camera, Clip, Field, span_holds};

pub(crate) use colors::Colors;
pub use contribution::{Contribution, contributions};
pub use coverage::{Coverage, Radius, coverage};
pub use held::render_held;
pub use posed_view::PosedView;
pub use sensitivity::{Sensitivities, sensitivities};
pub use sort::Order;

use crate::image::Image;
use crate::raster::Splat;

/// A scene to render: Gaussians that are sorted together, and plates behind them.
#[derive(Clone, Debug, Default)]
pub struct RenderScene<'a> {
    prefixes: Vec<FieldPrefix<'a>>,
    plates: Vec<FieldPrefix<'a>>,
}

/// The first `rows` rows of a field.
#[derive(Clone, Copy, Debug)]
struct FieldPrefix<'a> {
    field: &'a Field,
    rows: usize,
    /// Place of the field's clip in the scene; `None` if the scene has the field's time.
    span: Option<SceneSpan>,
}

impl<'a> FieldPrefix<'a> {
    fn whole(field: &'a Field) -> FieldPrefix<'a> {
        FieldPrefix { field, rows: field.len(), span: None }
    }

    /// Clip time of the field at clip time `t` of the scene; `None` while the field is not shown.
    fn clip_time(&self, t: f64) -> Option<f64> {
        self.span.map_or(Some(t), |span| span.clip_time(t))
    }
}

/// The part of a take during which a segment is shown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SceneSpan {
    /// Duration of the take in seconds.
    pub take_s: f64,
    /// Second of the take at which the segment's clip time is 0.
    pub start_s: f64,
    /// Seconds from the segment's clip time 0 to 1.
    pub duration_s: f64,
}

impl SceneSpan {
    /// Clip time of the segment at clip time `t` of the take, which is cut to `[0, 1]`; `None` while it is not shown.
    /// The rule is [`span_holds`].
    fn clip_time(&self, t: f64) -> Option<f64> {
        let SceneSpan { take_s, start_s, duration_s } = *self;
        let t_s = t.clamp(0.0, 1.0) * take_s;
        let holds = span_holds(start_s, start_s + duration_s, take_s, t_s);
        // Within the tolerance of the comparison it may be outside.
        holds.then_some(((t_s - start_s) / duration_s).clamp(0.0, 1.0))
    }
}

impl<'a> RenderScene<'a> {
    /// The first `layers` decoded layers of a clip, clamped to 1 and the number of layers, and its plate.
    pub fn from_layers(clip: &'a Clip, layers: usize) -> RenderScene<'a> {
        let plates = clip.plate.iter().map(FieldPrefix::whole).collect();
        let end = match clip.layers.get(layers.saturating_sub(1)).or(clip.layers.last()) {
            Some(end) => *end,
            None => return RenderScene { prefixes: Vec::new(), plates },
        };
        let prefix = |field, rows| FieldPrefix { field, rows, span: None };
        let prefixes = vec![
            prefix(&clip.static_field, end.static_count),
            prefix(&clip.dynamic_field, end.dynamic_count),
        ];
        RenderScene { prefixes, plates }
    }

    /// The same Gaussians in front of `plate`.
    pub fn with_plate(self, plate: &'a Field) -> RenderScene<'a> {
        RenderScene { plates: vec![FieldPrefix::whole(plate)], ..self }
    }

    /// The union of the `segments` of a take: each is shown during its span, and all that are shown are sorted
    /// together. The time of the scene is the time of the take; a segment that spans the take has that time, unrounded.
    pub fn of_take(segments: impl IntoIterator<Item = (SceneSpan, RenderScene<'a>)>) -> RenderScene<'a> {
        let mut union = RenderScene::default();
        for (span, scene) in segments {
            let span = Some(span).filter(|span| (span.start_s, span.duration_s) != (0.0, span.take_s));
            let placed = |prefix: FieldPrefix<'a>| FieldPrefix { span, ..prefix };
            union.prefixes.extend(scene.prefixes.into_iter().map(placed));
            union.plates.extend(scene.plates.into_iter().map(placed));
        }
        union
    }
}

impl<'a> From<&'a Field> for RenderScene<'a> {
    fn from(field: &'a Field) -> RenderScene<'a> {
        RenderScene { prefixes: vec![FieldPrefix::whole(field)], plates: Vec::new() }
    }
}

impl<'a> From<&'a Clip> for RenderScene<'a> {
    fn from(clip: &'a Clip) -> RenderScene<'a> {
        RenderScene::from_layers(clip, clip.layers.len())
    }
}

/// Renders `scene` from `camera` at clip time `t` over black. `camera` must satisfy [`Camera::check`].
///
/// The picture does not depend on the number of threads. No pixel is NaN, even if numbers of the scene or
/// `t` are not finite.
pub fn render(scene: &RenderScene, camera: &Camera, t: f64, order: Order) -> Image {
    let (mut splats, mut behind) = sorted(scene, camera, t, order);
    splats.append(&mut behind);
    splat::splat(&splats, camera.width, camera.height)
}

/// What [`render`] returns, and the alpha of the Gaussians before the plates alone, pixel by pixel: how much of the subject
/// each pixel shows.
pub fn render_with_subject(scene: &RenderScene, camera: &Camera, t: f64, order: Order) -> (Image, Vec<f64>) {
    let (mut splats, mut behind) = sorted(scene, camera, t, order);
    let subject = splat::splat(&splats, camera.width, camera.height);
    let alpha = subject.pixels.iter().map(|pixel| pixel[3]).collect();
    if behind.is_empty() {
        return (subject, alpha);
    }
    splats.append(&mut behind);
    (splat::splat(&splats, camera.width, camera.height), alpha)
}

/// The sorted splats of a scene, and the sorted splats of its plates.
fn sorted(scene: &RenderScene, camera: &Camera, t: f64, order: Order) -> (Vec<Splat<f64>>, Vec<Splat<f64>>) {
    let mut splats = evaluate_all(&scene.prefixes, camera, t);
    sort::sort(&mut splats, order);
    let mut behind = evaluate_all(&scene.plates, camera, t);
    sort::sort(&mut behind, order);
    (splats, behind)
}

fn evaluate_all(prefixes: &[FieldPrefix], camera: &Camera, t: f64) -> Vec<Splat<f64>> {
    let mut splats = Vec::new();
    for prefix in prefixes {
        if let Some(t) = prefix.clip_time(t) {
            let alive = alive::alive(prefix.field, prefix.rows, t);
            splats.extend(evaluate::evaluate(prefix.field, &alive, camera, t));
        }
    }
    splats
}

#[cfg(test)]
mod tests;
