//! [`Rig`]: the cameras of a fit, and what it learns of them beside the field.
//!
//! A photograph is compared with the field as its camera shows it: at the camera's own time, from its pose, in its
//! colours. The derivatives of the loss with respect to these are closed forms, so a fit learns them as it learns
//! the Gaussians, two photographs later: a device still computes the last ones.
//!
//! Some of it cannot be told from the field itself: a field that starts later under cameras that are all late, or a
//! redder field under cameras that all show less red. So the mean of the clocks and the mean brightness over the cameras,
//! and the mean of the exposures over the photographs, stay as calibrated, and the first camera keeps its pose.

use std::collections::VecDeque;
use std::ops::Range;

use codec::Camera;
use glam::{DMat3, DQuat, DVec3};
use serde::{Deserialize, Serialize};

use super::numbers::{
    CAMERA_NUMBERS, COLOR, CameraNumbers, FOCAL, ROTATION, TIME, TRANSLATION, VIGNETTE, is_gain,
};
use crate::capture::Response;
use crate::fit::optimizer::{BETA1, BETA2, EPSILON};
use crate::fit::views::{FrameView, TrainingView};

/// Learning rate of the time in intervals. Swept from 0.01 to 0.03 on eight cameras that were up to 1.5 frames off: the
/// worst is 0.038 to 0.027 frames off at the end.
const TIME_RATE: f64 = 3e-2;

/// Learning rate of the rotation vectors in radians, and of the logarithms of the focal lengths.
const ANGLE_RATE: f64 = 1e-4;

/// Learning rate of the translations, in extents of the scene.
const TRANSLATION_RATE: f64 = 1e-4;

/// Learning rate of the colours, the vignettes and the logarithms of the exposures, and weight in the loss of half their
/// squares: it decides where the photographs do not. Swept together: faster or freer ones take shading of the scene for
/// differences of cameras that are alike, others learn nothing.
const COLOR_RATE: f64 = 2e-3;
const COLOR_WEIGHT: f64 = 1e-3;

/// Mean of the squared distances of pixels from the centre of an image, 1 in the corners.
const SQUARE_MEAN: f64 = 1.0 / 3.0;

/// Largest deviation from the calibration: intervals, radians, extents of the scene, logarithm of the focal length.
/// Whatever is further off needs a calibration, not a correction.
const TIME_MAX: f64 = 8.0;
const ANGLE_MAX: f64 = 0.2;
const TRANSLATION_MAX: f64 = 0.2;

/// Largest deviation of a factor of colours, of a vignette and of the logarithm of an exposure.
const COLOR_MAX: f64 = 0.9;

/// What a fit learns of its cameras, beside the field.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Learned {
    /// When each camera takes its photographs.
    pub offsets: bool,
    /// Gain and offset of each colour channel of each camera, and its vignette.
    pub gains: bool,
    /// An affine transform of the colours of each camera, and its vignette. It includes the gains.
    pub colors: bool,
    /// The exposure of each photograph.
    pub exposures: bool,
    /// Small corrections of the pose of each camera.
    pub poses: bool,
    /// Small corrections of the focal length of each camera.
    pub focals: bool,
}

impl Learned {
    /// Whether nothing is learned.
    pub fn is_nothing(self) -> bool {
        self == Learned::default()
    }
}

/// The cameras of a fit, by their numbers in the capture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Rig {
    learned: Learned,
    /// The responses that the capture states.
    responses: Vec<Response>,
    /// The camera that keeps its pose.
    fixed: usize,
    /// [`CAMERA_NUMBERS`] of each camera.
    cameras: Learning,
    /// Logarithms of the exposures, by the place of the photograph in the fit.
    exposures: Learning,
    /// What is to be learned from the last photographs, oldest first.
    lessons: VecDeque<Lesson>,
}

/// What a rig learns from one photograph.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Lesson {
    camera: usize,
    /// Place of the photograph in the fit.
    place: usize,
    /// Multiplies all learning rates.
    factor: f64,
    /// The gradient of the loss with respect to the numbers of the camera as it was seen; `None` until the step ends.
    by_seen: Option<CameraNumbers>,
}

/// A photograph's view as the rig has it.
pub(in crate::fit) struct SeenView {
    pub(in crate::fit) camera: Camera,
    /// In intervals.
    pub(in crate::fit) time: f64,
    pub(in crate::fit) response: Response,
}

impl SeenView {
    pub(in crate::fit) fn view(&self) -> FrameView<'_> {
        FrameView { camera: &self.camera, time: self.time }
    }
}

impl Rig {
    /// Cameras with these responses. `learned` says which numbers are learned; `fixed` is the number of the first
    /// camera that the field is fitted to.
    pub fn new(learned: Learned, responses: Vec<Response>, fixed: usize) -> Rig {
        let cameras =
            Learning::zeros(if learned.is_nothing() { 0 } else { responses.len() * CAMERA_NUMBERS });
        Rig { learned, responses, fixed, cameras, exposures: Learning::default(), lessons: VecDeque::new() }
    }

    /// What is learned.
    pub fn learned(&self) -> Learned {
        self.learned
    }

    /// Whether photographs are taken as the calibration says, in the colours of the field.
    pub(in crate::fit) fn is_neutral(&self) -> bool {
        self.learned.is_nothing() && self.responses.iter().all(Response::is_neutral)
    }

    /// Whether the numbers of columns agree; a damaged file may deserialise into a rig in which they do not.
    pub(in crate::fit) fn is_consistent(&self) -> bool {
        let count = if self.learned.is_nothing() { 0 } else { self.responses.len() * CAMERA_NUMBERS };
        let is_of_rig = |lesson: &Lesson| lesson.camera < self.responses.len() && lesson.by_seen.is_some();
        self.cameras.values.len() == count
            && self.cameras.is_consistent()
            && self.exposures.is_consistent()
            && self.lessons.iter().all(is_of_rig)
    }

    /// Intervals by which a camera takes its photographs later than its calibration says.
    pub fn late(&self, camera: usize) -> f64 {
        self.numbers(camera)[TIME]
    }

    /// A camera with its learned pose and focal length.
    pub fn corrected(&self, camera: usize, calibrated: &Camera) -> Camera {
        let numbers = self.numbers(camera);
        let mut corrected = calibrated.clone();
        let factor = libm::exp(numbers[FOCAL]);
        corrected.k[0][0] *= factor;
        corrected.k[1][1] *= factor;
        let turned = DMat3::from_quat(DQuat::from_scaled_axis(DVec3::from_slice(&numbers[ROTATION])));
        let moved = DVec3::from_slice(&numbers[TRANSLATION]);
        for column in 0..4 {
            let before = DVec3::from_array([0, 1, 2].map(|row| calibrated.camera_from_world[row][column]));
            let after = turned * before + if column == 3 { moved } else { DVec3::ZERO };
            (0..3).for_each(|row| corrected.camera_from_world[row][column] = after[row]);
        }
        corrected
    }

    /// The response of a camera, as stated and as learned.
    pub fn response(&self, camera: usize) -> Response {
        let Response { mut color, mut vignette } = self.responses[camera];
        let numbers = self.numbers(camera);
        color.as_flattened_mut().iter_mut().zip(&numbers[COLOR]).for_each(|(x, by)| *x += by);
        vignette += numbers[VIGNETTE];
        Response { color, vignette }
    }

    /// The rig with these numbers of a camera.
    #[cfg(test)]
    pub(in crate::fit) fn with_numbers(mut self, camera: usize, numbers: &CameraNumbers) -> Rig {
        self.cameras.values[camera * CAMERA_NUMBERS..][..CAMERA_NUMBERS].copy_from_slice(numbers);
        self
    }

    fn numbers(&self, camera: usize) -> CameraNumbers {
        let numbers = self.cameras.values.get(camera * CAMERA_NUMBERS..(camera + 1) * CAMERA_NUMBERS);
        numbers.map_or([0.0; CAMERA_NUMBERS], |numbers| numbers.try_into().expect("a camera's numbers"))
    }

    /// The view of a photograph; `place` is its place among the photographs of the fit, `None` for a held-out
    /// photograph, whose exposure is not known.
    pub(in crate::fit) fn seen(&self, view: &TrainingView, place: Option<usize>) -> SeenView {
        let mut response = self.response(view.camera_id);
        let log_exposure = place.and_then(|place| self.exposures.values.get(place)).copied().unwrap_or(0.0);
        let exposure = libm::exp(log_exposure);
        response.color.as_flattened_mut().iter_mut().for_each(|x| *x *= exposure);
        SeenView {
            camera: self.corrected(view.camera_id, &view.camera),
            time: view.time + self.late(view.camera_id),
            response,
        }
    }

    /// A step on a photograph begins: its place in the fit, and the factor of all learning rates.
    pub(in crate::fit) fn begin(&mut self, camera: usize, place: usize, factor: f64) {
        if !self.learned.is_nothing() {
            self.lessons.push_back(Lesson { camera, place, factor, by_seen: None });
        }
    }

    /// The oldest step that began and has not ended ends with this gradient with respect to the numbers of its camera.
    ///
    /// # Panics
    /// If there is none.
    pub(in crate::fit) fn end(&mut self, by_seen: CameraNumbers) {
        if !self.learned.is_nothing() {
            let lesson = self.lessons.iter_mut().find(|lesson| lesson.by_seen.is_none());
            lesson.expect("a step has begun").by_seen = Some(by_seen);
        }
    }

    /// Learns from all photographs but the last `rest`, whose steps have ended. `extent` is the size of the scene. Returns
    /// the number of gradients that were not finite.
    pub(in crate::fit) fn learn_but(&mut self, rest: usize, extent: f64) -> u64 {
        let mut non_finite = 0;
        while self.lessons.len() > rest {
            let lesson = self.lessons.pop_front();
            let Some(Lesson { camera, place, factor, by_seen: Some(by_seen) }) = lesson else {
                panic!("the step has ended")
            };
            non_finite += u64::from(!self.learn(camera, place, &by_seen, factor, extent));
        }
        non_finite
    }

    /// A step against the gradient of the loss of one photograph with respect to the numbers of its camera as it was
    /// [seen](Rig::seen). `factor` multiplies all learning rates, `extent` is the size of the scene. Returns whether the
    /// gradient was finite; the step is left out otherwise.
    fn learn(
        &mut self,
        camera: usize,
        place: usize,
        by_seen: &CameraNumbers,
        factor: f64,
        extent: f64,
    ) -> bool {
        if !by_seen.iter().all(|x| (x * x).is_finite()) {
            return false;
        }
        let mut by = *by_seen;
        if self.learned.exposures {
            self.learn_exposure(camera, place, &mut by, factor);
        }
        let Learned { offsets, gains, colors, poses, focals, .. } = self.learned;
        let is_free = camera != self.fixed;
        let first = camera * CAMERA_NUMBERS;
        let parts = [
            (offsets, TIME..TIME + 1, TIME_RATE, TIME_MAX, 0.0),
            (poses && is_free, ROTATION, ANGLE_RATE, ANGLE_MAX, 0.0),
            (poses && is_free, TRANSLATION, TRANSLATION_RATE * extent, TRANSLATION_MAX * extent, 0.0),
            (focals, FOCAL..FOCAL + 1, ANGLE_RATE, ANGLE_MAX, 0.0),
            (colors || gains, COLOR, COLOR_RATE, COLOR_MAX, COLOR_WEIGHT),
            (colors || gains, VIGNETTE..VIGNETTE + 1, COLOR_RATE, COLOR_MAX, COLOR_WEIGHT),
        ];
        for (_, numbers, rate, most, weight) in parts.into_iter().filter(|(is_learned, ..)| *is_learned) {
            for number in numbers.filter(|number| colors || !COLOR.contains(number) || is_gain(*number)) {
                let to_zero = weight * self.cameras.values[first + number];
                let most = most * self.stated_gain(camera, number).min(1.0);
                self.cameras.step(first + number, by[number] + to_zero, factor * rate, most);
            }
        }
        if offsets {
            self.center(TIME..TIME + 1);
        }
        if colors || gains {
            self.center(COLOR);
            self.keep_brightness();
        }
        true
    }

    /// The gain that the capture states of the channel of a number; 1 if it is not of a colour. The factor of a colour stays
    /// above 0 if it is changed by less.
    fn stated_gain(&self, camera: usize, number: usize) -> f64 {
        let channel = COLOR.contains(&number).then(|| (number - COLOR.start) / 4);
        channel.map_or(1.0, |channel| self.responses[camera].color[channel][channel].abs())
    }

    /// Learns the exposure of a photograph, and takes it out of the gradient with respect to the camera's colours.
    fn learn_exposure(&mut self, camera: usize, place: usize, by: &mut CameraNumbers, factor: f64) {
        self.exposures.grow(place + 1);
        let exposure = libm::exp(self.exposures.values[place]);
        let Response { color, .. } = self.response(camera);
        by[COLOR].iter_mut().for_each(|by| *by *= exposure);
        let by_exposure: f64 = color.as_flattened().iter().zip(&by[COLOR]).map(|(x, by)| x * by).sum();
        let to_zero = COLOR_WEIGHT * self.exposures.values[place];
        self.exposures.step(place, by_exposure + to_zero, factor * COLOR_RATE, COLOR_MAX);
        let known = || self.exposures.visits.iter().filter(|visits| **visits > 0).count();
        let mean = self.exposures.values.iter().sum::<f64>() / known() as f64;
        let Learning { values, visits, .. } = &mut self.exposures;
        values.iter_mut().zip(visits).filter(|(_, visits)| **visits > 0).for_each(|(x, _)| *x -= mean);
    }

    /// Makes up for the light that the vignettes take: in the mean, photographs stay as bright as the field. A camera without
    /// photographs has the mean vignette of the others.
    fn keep_brightness(&mut self) {
        let mean = self.cameras.mean_over_cameras(VIGNETTE);
        let Learning { values, visits, .. } = &mut self.cameras;
        // The same for all: `center` takes out a mean.
        let lost = SQUARE_MEAN * mean;
        for first in (0..visits.len()).step_by(CAMERA_NUMBERS) {
            let is_known = visits[first + VIGNETTE] > 0;
            for diagonal in COLOR.step_by(5) {
                let gain = &mut values[first + diagonal];
                *gain = if is_known { *gain - lost } else { -lost };
            }
            if !is_known {
                values[first + VIGNETTE] = mean;
            }
        }
    }

    /// Takes the mean of some numbers over the cameras that are learned out of each.
    fn center(&mut self, numbers: Range<usize>) {
        for number in numbers {
            let mean = self.cameras.mean_over_cameras(number);
            let Learning { values, visits, .. } = &mut self.cameras;
            let places = (number..visits.len()).step_by(CAMERA_NUMBERS).filter(|place| visits[*place] > 0);
            places.for_each(|place| values[place] -= mean);
        }
    }
}

/// Numbers that are learned by Adam, each with a memory of its own.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Learning {
    values: Vec<f64>,
    first: Vec<f64>,
    second: Vec<f64>,
    /// Number of gradients of each.
    visits: Vec<u32>,
}

impl Learning {
    fn zeros(count: usize) -> Learning {
        let mut learning = Learning::default();
        learning.grow(count);
        learning
    }

    /// Appends zeros up to `count` numbers.
    fn grow(&mut self, count: usize) {
        if count > self.values.len() {
            [&mut self.values, &mut self.first, &mut self.second]
                .into_iter()
                .for_each(|x| x.resize(count, 0.0));
            self.visits.resize(count, 0);
        }
    }

    /// Mean of a number over the cameras that have learned it; 0 if none has.
    fn mean_over_cameras(&self, number: usize) -> f64 {
        let places =
            || (number..self.visits.len()).step_by(CAMERA_NUMBERS).filter(|place| self.visits[*place] > 0);
        places().map(|place| self.values[place]).sum::<f64>() / places().count().max(1) as f64
    }

    fn is_consistent(&self) -> bool {
        let count = self.values.len();
        self.first.len() == count && self.second.len() == count && self.visits.len() == count
    }

    /// Moves a number against its gradient, and keeps it within `most` of 0.
    fn step(&mut self, at: usize, gradient: f64, rate: f64, most: f64) {
        self.visits[at] = self.visits[at].saturating_add(1);
        let visits = f64::from(self.visits[at]);
        self.first[at] += (1.0 - BETA1) * (gradient - self.first[at]);
        self.second[at] += (1.0 - BETA2) * (gradient * gradient - self.second[at]);
        let first = self.first[at] / (1.0 - libm::pow(BETA1, visits));
        let second = self.second[at] / (1.0 - libm::pow(BETA2, visits));
        self.values[at] = (self.values[at] - rate * first / (second.sqrt() + EPSILON)).clamp(-most, most);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gains_are_the_gain_and_the_offset_of_each_channel() {
        let learned = Learned { gains: true, ..Learned::default() };
        let mut rig = Rig::new(learned, vec![Response::NEUTRAL; 2], 0);
        for camera in [0, 1] {
            let by = [if camera == 0 { 1.0 } else { -1.0 }; CAMERA_NUMBERS];
            assert!(rig.learn(camera, 0, &by, 1.0, 1.0));
        }
        let Response { color, vignette } = rig.response(0);
        assert!(vignette != 0.0);
        for (channel, row) in color.into_iter().enumerate() {
            for (column, x) in row.into_iter().enumerate() {
                let neutral = f64::from(u8::from(column == channel));
                let is_learned = column == channel || column == 3;
                assert_eq!(x != neutral, is_learned, "{channel} {column}: {x}");
            }
        }
        assert_eq!(rig.corrected(1, &camera()), camera(), "nothing else is learned");
        assert_eq!(rig.late(1), 0.0);
    }

    /// The first of two cameras darkens its corners; the third has no photographs.
    #[test]
    fn vignettes_keep_the_brightness_and_cameras_without_photographs_have_the_mean_one() {
        let learned = Learned { gains: true, ..Learned::default() };
        let stated = [1.2, 0.8, 1.0].map(|gain| Response {
            color: [[gain, 0.0, 0.0, 0.0], [0.0, gain, 0.0, 0.0], [0.0, 0.0, gain, 0.0]],
            ..Response::NEUTRAL
        });
        let mut rig = Rig::new(learned, stated.into(), 0);
        let mut by = [0.0; CAMERA_NUMBERS];
        for _ in 0..100 {
            by[VIGNETTE] = 1.0;
            assert!(rig.learn(0, 0, &by, 1.0, 1.0));
            by[VIGNETTE] = 0.0;
            assert!(rig.learn(1, 1, &by, 1.0, 1.0));
        }
        let [a, b, c] = [0, 1, 2].map(|camera| rig.response(camera));
        assert!(a.vignette < -0.1 && b.vignette.abs() < 1e-3, "{} {}", a.vignette, b.vignette);
        assert!((c.vignette - 0.5 * (a.vignette + b.vignette)).abs() < 1e-12);
        let gains = [a, b, c].map(|response| response.color[1][1]);
        for (gain, stated) in gains.into_iter().zip([1.2, 0.8, 1.0]) {
            assert!((gain * (1.0 + SQUARE_MEAN * c.vignette) - stated).abs() < 0.01, "{gain} for {stated}");
        }
    }

    fn camera() -> Camera {
        Camera::look_at([0.0, 0.0, -2.0], [0.0; 3], [0.0, -1.0, 0.0], 1.0, 8, 8)
    }
}
