//! [`Rig`]: the cameras of a rig; [`RigView`]: what one of them sees.

use codec::Camera;
use glam::DVec3;
use program::Fault;
use rayon::prelude::*;

use super::draws::{Draw, draw};
use super::perturbations::{CameraErrors, camera_errors};
use super::room;
use super::sensor::Sensor;
use super::settings::{RigSettings, STARTS_MAX_S};
use super::sound::Sound;
use crate::synth::stage::{self, Motion, PixelSamples, Rays, is_shaded, sample_pixel, split_mix};

/// Seconds of the figure's movement before second 0, so that equal times show equal poses in all rigs.
const LEAD_S: f64 = STARTS_MAX_S;

/// Part of the key of a camera's noise, which separates it from everything drawn.
const NOISE_KEY: u64 = 0x6e6f_6973_6500;

/// Cameras, what perturbs them, and what happens before them.
#[derive(Clone, Debug)]
pub struct Rig {
    pub(super) settings: RigSettings,
    pub(super) cameras: Vec<Camera>,
    pub(super) errors: Vec<CameraErrors>,
    pub(super) sound: Sound,
    motion: Motion,
}

impl Rig {
    /// The rig with these settings.
    ///
    /// # Errors
    /// [`Fault::Usage`] if a setting is out of range.
    pub fn new(settings: &RigSettings) -> Result<Rig, Fault> {
        settings.check()?;
        let errors = camera_errors(settings);
        let end_s = errors.iter().map(|errors| errors.frame_time_s(errors.frames - 1)).fold(0.0, f64::max);
        let place = [0, 1, 2].map(|axis| draw(settings.seed, 0, Draw::Place(axis)));
        Ok(Rig {
            settings: *settings,
            cameras: stage::rig(&settings.stage()),
            errors,
            sound: Sound::at(place, settings.seed),
            // More than 33 frames; their first blows are always the same.
            motion: Motion::new(((LEAD_S + end_s) * f64::from(stage::FPS)).ceil() as usize + 34),
        })
    }

    /// Number of pictures of all cameras.
    pub fn pictures(&self) -> usize {
        self.errors.iter().map(|errors| errors.frames).sum()
    }

    /// What the camera with this number sees.
    ///
    /// # Panics
    /// If there is no such camera.
    pub fn view(&self, camera: usize) -> RigView<'_> {
        let rays = Rays::new(&self.cameras[camera]);
        let errors = &self.errors[camera];
        let key = split_mix(split_mix(self.settings.seed ^ NOISE_KEY) ^ camera as u64);
        RigView {
            rig: self,
            camera,
            rays,
            background: background(&self.cameras[camera], &rays),
            sensor: Sensor { gains: errors.gains, noise: errors.noise, key },
        }
    }
}

/// What a camera sees: the figure before a room that does not move.
#[derive(Clone, Debug)]
pub struct RigView<'a> {
    rig: &'a Rig,
    camera: usize,
    rays: Rays,
    background: Vec<BackgroundPixel>,
    sensor: Sensor,
}

/// Means over the samples of a pixel: the room's colour without the sun, and what the sun adds.
#[derive(Clone, Copy, Debug)]
struct BackgroundPixel {
    ambient: [f32; 3],
    sun: [f32; 3],
}

/// A picture in rows from the top left, upright.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RigPicture {
    /// Red, green, blue.
    pub colors: Vec<u8>,
    /// Fraction of a pixel that the figure covers, times 255.
    pub mask: Vec<u8>,
}

impl RigView<'_> {
    /// The picture that the camera takes as its frame with this number.
    pub fn picture(&self, frame: usize) -> RigPicture {
        let (settings, errors) = (&self.rig.settings, &self.rig.errors[self.camera]);
        let at = (LEAD_S + errors.frame_time_s(frame)) * f64::from(stage::FPS);
        let parts = stage::subject(&settings.stage(), &self.rig.motion, at);
        let [width, height] = settings.size;
        let (mut colors, mut mask) = (Vec::with_capacity(self.background.len()), Vec::new());
        let mut near = Vec::new();
        for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
            let mut in_shadow = 0;
            let samples = sample_pixel(&parts, &self.rays, [x, y], &mut near, |direction| {
                in_shadow += u32::from(settings.shadow && self.is_in_shadow(&parts, direction));
            });
            let missed = PixelSamples::COUNT - samples.hits;
            let behind = &self.background[colors.len()];
            let color = |c: usize| {
                let [ambient, sun] = [behind.ambient, behind.sun].map(|light| f64::from(light[c]));
                let of_room = ambient * f64::from(missed) + sun * f64::from(missed - in_shadow);
                (samples.color[c] + of_room) / f64::from(PixelSamples::COUNT)
            };
            colors.push([0, 1, 2].map(color));
            mask.push(samples.mask());
        }
        RigPicture { colors: self.sensor.expose(&colors, frame), mask }
    }

    /// Red, green and blue of the picture that the camera would take of the empty room, with noise of its own.
    pub fn plate(&self) -> Vec<u8> {
        let light = |pixel: &BackgroundPixel| {
            std::array::from_fn(|c| f64::from(pixel.ambient[c]) + f64::from(pixel.sun[c]))
        };
        let colors: Vec<[f64; 3]> = self.background.iter().map(light).collect();
        self.sensor.expose(&colors, usize::MAX)
    }

    /// Whether a ray meets the floor where the figure shades it.
    fn is_in_shadow(&self, parts: &[stage::FigurePart], direction: DVec3) -> bool {
        let hit = room::hit(self.rays.origin, direction);
        hit.is_on_floor() && is_shaded(parts, hit.point)
    }
}

/// The room as a camera sees it.
fn background(camera: &Camera, rays: &Rays) -> Vec<BackgroundPixel> {
    let pixel = |index: u32| {
        let mut sums = [[0.0; 3]; 2];
        for direction in rays.of_pixel(index % camera.width, index / camera.width) {
            let color = room::hit(rays.origin, direction).color();
            (0..3).for_each(|c| {
                sums[0][c] += color.ambient[c];
                sums[1][c] += color.sun[c];
            });
        }
        let [ambient, sun] = sums.map(|sum| sum.map(|c| (c / f64::from(PixelSamples::COUNT)) as f32));
        BackgroundPixel { ambient, sun }
    };
    (0..camera.width * camera.height).into_par_iter().map(pixel).collect()
}
