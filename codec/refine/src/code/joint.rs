//! [`JointRounding`]: rounds the numbers of Gaussians together, so that their errors cancel in pictures.
//!
//! A coder rounds each number to the nearest multiple of its step. Neighbouring Gaussians overlap, so the error of one
//! can make up for the error of another. Each round decodes the package, renders it in some views, backpropagates the
//! difference to pictures of the field, and moves the numbers that the coder is given a little against the gradient:
//!
//! ```text
//! field -> targets -> encode -> decoded field -> pictures - pictures of the field
//!             ^                                                  |
//!             +------------ targets - share g / h <-- backward --+
//! ```
//!
//! A target stays near the number of the field. It can be anywhere between two multiples, so that small gradients of
//! several rounds add up until it is rounded the other way. The rounds take turns with the views: with as many passes,
//! that gains more than all views in each of fewer rounds, in views that are not among them, too.
//!
//! The format does not change, and the decoder has no more work. A [`Backend`] renders and backpropagates. The CPU gives
//! the same numbers on all machines and for any number of threads; graphics devices do not, so packages by them are marked.

mod numbers;

use std::num::NonZero;

use codec::{ChunkForms, EncodeOptions, Field, Source, encode_rounded};

use super::error::CodeError;
use crate::fit::{Backend, DeviceError, FrameView, Parameters, Timeline};
use crate::reference::PosedView;
use numbers::Numbers;

/// Default number of rounds at a precision, with which `package` takes up to about twice as long; see
/// `codec/MEASURED.md`.
pub const JOINT_ROUNDS: usize = 3;

/// Number of parts that the views are split into; each round looks at one part.
const PARTS: usize = 5;

/// Part of the Gauss-Newton step of each number that a target moves in the first round; it falls linearly to 0 after the
/// last one. The steps ignore that neighbours move together: with a constant 0.03, the error of the guitar rises again
/// after 6 rounds, with 0.05 the error of spinach.
const SHARE: f64 = 0.03;

/// Addition to the curvature of a number, as a fraction of the mean of its column: numbers that hardly any picture shows
/// move slowly.
const DAMPING: f64 = 0.1;

/// Largest distance of a target from the number of the field, in root mean squares of the rounding errors of its row. A
/// rounding error has a root mean square of 0.29 steps, so this is 0.43 steps.
const DISTANCE_MAX: f64 = 1.5;

/// Largest move of a target in a round, in the same unit. The curvature is an estimate; where it is too low by chance,
/// this keeps the move small.
const MOVE_MAX: f64 = 0.3;

/// All of the clip's time is one interval.
const TIMELINE: Timeline = Timeline { frames: 2, intervals: 1.0 };

/// The pictures of one source that rounding looks at, the back end that renders them, and the number of rounds.
pub struct JointRounding<'a> {
    rounds: NonZero<usize>,
    backend: &'a mut dyn Backend,
    parts: [ViewPart; PARTS],
}

/// A part of the views.
#[derive(Default)]
struct ViewPart {
    views: Vec<PosedView>,
    /// Of each view; empty until the first round that looks at this part.
    pictures: Vec<Picture>,
}

/// A picture of the field.
struct Picture {
    /// Its place among all, which seeds its random signs.
    number: u64,
    /// Red, green and blue of the plate.
    plate: Option<Vec<[f32; 3]>>,
    /// Red, green and blue of the field before the plate.
    pixels: Vec<[f32; 3]>,
}

/// What the rounds at one precision leave to those at the next.
#[derive(Debug)]
pub(super) struct RoundingState {
    /// The numbers given to the coder.
    targets: Field,
    /// Sum of the squared derivatives over the pixels of the first part of the views, the diagonal of the Gauss-Newton
    /// matrix. Those of the other parts take as long again as the gradients, and the packages came out the same.
    curvature: Numbers,
    /// Number of rounds so far. Each looks at the next part of the views.
    rounds: usize,
    /// Choices of the first package, which do not depend on the precision; others would round all numbers anew.
    forms: Option<ChunkForms>,
}

impl RoundingState {
    /// The state before the first round.
    pub(super) fn new(field: &Field) -> RoundingState {
        RoundingState { targets: field.clone(), curvature: Numbers::zeros(field), rounds: 0, forms: None }
    }
}

impl<'a> JointRounding<'a> {
    /// Rounds `rounds` times at a precision, looking at `views`.
    pub fn new(
        views: Vec<PosedView>,
        rounds: NonZero<usize>,
        backend: &'a mut dyn Backend,
    ) -> JointRounding<'a> {
        let mut parts: [ViewPart; PARTS] = Default::default();
        views.into_iter().enumerate().for_each(|(i, view)| parts[i % PARTS].views.push(view));
        JointRounding { rounds, backend, parts }
    }

    /// Number of rounds at a precision.
    pub(super) fn rounds(&self) -> usize {
        self.rounds.get()
    }

    /// Packages the source with numbers rounded together, beginning with the targets of `state`. `on_round` is called
    /// after each round.
    ///
    /// # Errors
    /// Errors of [`codec::encode`], and of the back end.
    pub(super) fn round(
        &mut self,
        source: &Source,
        options: &EncodeOptions,
        state: &mut RoundingState,
        mut on_round: impl FnMut(),
    ) -> Result<Vec<u8>, CodeError> {
        let threads = NonZero::new(rayon::current_num_threads()).unwrap_or(NonZero::<usize>::MIN);
        let encode = |targets: &Field, forms: Option<&ChunkForms>| {
            let source = Source { field: targets, ..*source };
            encode_rounded(&source, options, forms, threads).map_err(CodeError::Encode)
        };
        let mut rounded = encode(&state.targets, state.forms.as_ref())?;
        let errors = Numbers::errors(source.field, &rounded.field);
        let rounds = self.rounds();
        for round in 0..rounds {
            let number = state.rounds % PARTS;
            let part = &mut self.parts[number];
            let curvature = (state.rounds == 0).then_some(&mut state.curvature);
            let gradient = part
                .take_pictures(number, source, self.backend)
                .and_then(|()| part.descent(&rounded.field, self.backend, curvature))
                .map_err(CodeError::Device)?;
            state.rounds += 1;
            let share = SHARE * (rounds - round) as f64 / rounds as f64;
            move_targets(&mut state.targets, source.field, &gradient, &state.curvature, &errors, share);
            rounded = encode(&state.targets, Some(&rounded.forms))?;
            on_round();
        }
        state.forms.get_or_insert(rounded.forms);
        Ok(rounded.package)
    }
}

impl ViewPart {
    /// Takes the pictures of part `number`, unless that has been done.
    fn take_pictures(
        &mut self,
        number: usize,
        source: &Source,
        backend: &mut dyn Backend,
    ) -> Result<(), DeviceError> {
        if self.pictures.len() == self.views.len() {
            return Ok(());
        }
        let views = frame_views(&self.views);
        let mut plates: Vec<Vec<[f32; 3]>> = Vec::new();
        if let Some(plate) = source.plate {
            backend.load(parameters(plate).into())?;
            let rgb = |[r, g, b, _]: &[f32; 4]| [*r, *g, *b];
            backend.render_each(&views, &mut |image| plates.push(image.pixels.iter().map(rgb).collect()))?;
        }
        let mut plates = plates.into_iter();
        backend.load(parameters(source.field).into())?;
        backend.render_each(&views, &mut |image| {
            let plate = plates.next();
            let shown = |(i, pixel)| before(pixel, behind(&plate, i));
            let pixels = (0..).zip(image.pixels).map(shown).collect();
            let number = (self.pictures.len() * PARTS + number) as u64;
            self.pictures.push(Picture { number, plate, pixels });
        })
    }

    /// Half the gradient of the squared error of a decoded field in the pictures. Adds to `curvature`, if given, the
    /// diagonal of `J^T J`, with the derivatives `J` of all pixels: the squares of `J^T s` for random signs `s` have it as
    /// their mean.
    fn descent(
        &self,
        decoded: &Field,
        backend: &mut dyn Backend,
        mut curvature: Option<&mut Numbers>,
    ) -> Result<Numbers, DeviceError> {
        let has_curvature = curvature.is_some();
        let of_pixels = |i: usize, pixels: &[[f32; 4]]| {
            let picture = &self.pictures[i];
            let errors = (0..).zip(&picture.pixels).zip(pixels).map(|((i, target), pixel)| {
                let behind = behind(&picture.plate, i);
                let shown = before(*pixel, behind);
                d_pixel([0, 1, 2].map(|c| shown[c] - target[c]), behind)
            });
            let mut d_images = vec![errors.collect()];
            if has_curvature {
                let mut signs = Signs(picture.number);
                let sign = |i| d_pixel([(); 3].map(|()| signs.next()), behind(&picture.plate, i));
                d_images.push((0..pixels.len()).map(sign).collect());
            }
            d_images
        };
        let mut sum = Numbers::zeros(decoded);
        backend.load(parameters(decoded).into())?;
        backend.gradients(&frame_views(&self.views), &of_pixels, &mut |gradients| {
            sum.add(&gradients[0], |g| g);
            if let Some((curvature, by_signs)) = curvature.as_mut().zip(gradients.get(1)) {
                curvature.add(by_signs, |g| g * g);
            }
        })?;
        Ok(sum)
    }
}

/// Moves targets by a part of their Gauss-Newton steps. `errors` are typical rounding errors of the numbers.
fn move_targets(
    targets: &mut Field,
    field: &Field,
    gradient: &Numbers,
    curvature: &Numbers,
    errors: &Numbers,
    share: f64,
) {
    let means = curvature.means();
    gradient.for_each_in(targets, field, |k, i, target, number| {
        let number_in = |numbers: &Numbers| numbers.columns[k][i];
        // A number in none of the pictures that the curvature is taken from is assumed to have the mean.
        let curvature = if number_in(curvature) > 0.0 { number_in(curvature) } else { means[k] };
        let step = share * number_in(gradient) / (curvature + DAMPING * means[k]);
        if step.is_finite() {
            let (move_max, distance) = (MOVE_MAX * number_in(errors), DISTANCE_MAX * number_in(errors));
            let moved = f64::from(*target) - step.clamp(-move_max, move_max);
            let number = f64::from(number);
            *target = moved.clamp(number - distance, number + distance) as f32;
        }
    });
}

fn parameters(field: &Field) -> Parameters<f32> {
    Parameters::from_field(field, TIMELINE)
}

fn frame_views(views: &[PosedView]) -> Vec<FrameView<'_>> {
    views.iter().map(|view| FrameView { camera: &view.camera, time: view.t * TIMELINE.intervals }).collect()
}

/// The colour behind pixel `i`.
fn behind(plate: &Option<Vec<[f32; 3]>>, i: usize) -> [f32; 3] {
    plate.as_ref().map_or([0.0; 3], |plate| plate[i])
}

/// A premultiplied pixel in front of a colour.
fn before([r, g, b, alpha]: [f32; 4], behind: [f32; 3]) -> [f32; 3] {
    let through = 1.0 - alpha;
    [r + through * behind[0], g + through * behind[1], b + through * behind[2]]
}

/// The gradient with respect to a premultiplied pixel, given the gradient with respect to the output of [`before`].
fn d_pixel(d: [f32; 3], behind: [f32; 3]) -> [f32; 4] {
    [d[0], d[1], d[2], -(d[0] * behind[0] + d[1] * behind[1] + d[2] * behind[2])]
}

/// Random signs, by SplitMix64.
struct Signs(u64);

impl Signs {
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        if (z ^ z >> 31) & 1 == 0 { 1.0 } else { -1.0 }
    }
}
