//! [`Backend`]: who draws, follows the derivatives back, and moves what is fitted.

use std::fmt;

use super::density::Pulls;
use super::{Bounds, Lpips, Moments, Parameters, Picture, Rates, Shot, Step, View};

/// The Gaussians of a fit, and what its steps remember of each: what a back end holds while it steps.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Gaussians {
    pub(super) parameters: Parameters<f32>,
    pub(super) moments: Moments<f32>,
    pub(super) pulls: Pulls,
}

impl From<Parameters<f32>> for Gaussians {
    /// Gaussians that have not moved yet.
    fn from(parameters: Parameters<f32>) -> Gaussians {
        Gaussians { moments: Moments::new(&parameters), pulls: Pulls::none(parameters.len()), parameters }
    }
}

/// How a step is taken.
pub struct Pace<'a> {
    pub(super) rates: Rates,
    pub(super) bounds: Bounds,
    /// See [`Drawing::backward`](super::cpu::Drawing::backward).
    pub(super) detached: bool,
    /// A part of the loss, where there are weights for it.
    pub(super) lpips: Option<&'a Lpips<f32>>,
}

/// Fits Gaussians by the conventions of [`crate::reference`]. Between [`Backend::load`] and
/// [`Backend::store`] they are where it computes.
pub trait Backend {
    /// Name in logs, with that of the device where there is one.
    fn name(&self) -> String;

    /// Takes Gaussians, in place of those that it had.
    ///
    /// # Errors
    /// A [`DeviceError`], where they do not fit on the device.
    fn load(&mut self, gaussians: Gaussians) -> Result<(), DeviceError>;

    /// Draws what was loaded.
    ///
    /// # Errors
    /// A [`DeviceError`].
    ///
    /// # Panics
    /// If nothing was loaded; so do the others.
    fn draw(&mut self, view: &View) -> Result<Picture<f32>, DeviceError>;

    /// Takes a step: draws what the camera of `shot` sees, compares it with the photograph, follows the
    /// difference back, and moves the Gaussians that are in the picture.
    ///
    /// # Errors
    /// A [`DeviceError`]; the Gaussians may then be lost.
    fn step(&mut self, shot: &Shot, pace: &Pace) -> Result<Step, DeviceError>;

    /// Gives the Gaussians back.
    ///
    /// # Errors
    /// A [`DeviceError`]; the Gaussians are then lost.
    fn store(&mut self) -> Result<Gaussians, DeviceError>;

    /// Most memory of a device that it held at once, in bytes; `None` without one.
    fn peak_device_bytes(&self) -> Option<u64>;
}

/// Why a device cannot go on.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum DeviceError {
    /// There is none.
    Missing(String),
    /// It has no buffers of the size that is needed.
    TooLarge {
        /// Its name.
        device: String,
        /// What it was to hold.
        what: &'static str,
        /// Bytes.
        bytes: u64,
        /// Bytes that it can hold in one piece.
        limit: u64,
    },
    /// It has not enough memory.
    Memory {
        /// Its name.
        device: String,
        /// What it was to hold.
        what: &'static str,
    },
    /// It stopped working.
    Lost {
        /// Its name.
        device: String,
        /// What it said.
        message: String,
    },
}

impl fmt::Display for DeviceError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            DeviceError::Missing(what) => f.write_str(what),
            DeviceError::TooLarge { device, what, bytes, limit } => write!(
                f,
                "graphics device {device}: no room for {what}: {} MB, of at most {} MB in one piece; \
                 fewer Gaussians or smaller photographs do",
                bytes.div_ceil(1_000_000),
                limit / 1_000_000
            ),
            DeviceError::Memory { device, what } => {
                write!(f, "graphics device {device}: not enough memory for {what}")
            }
            DeviceError::Lost { device, message } => write!(f, "graphics device {device}: {message}"),
        }
    }
}

impl std::error::Error for DeviceError {}
