//! [`Backend`]: the interface of the back ends, with their state, input and output.

use super::{DeviceError, Gradient};
use crate::capture::Response;
use crate::fit::cameras::CameraNumbers;
use crate::fit::density::ScreenGradients;
use crate::fit::loss::Lpips;
use crate::fit::optimizer::{LearningRates, Moments};
use crate::fit::parameters::{Bounds, Parameters};
use crate::fit::views::{FrameView, Photograph, RenderedImage};

/// The per-Gaussian state of a fit: parameters, Adam's moments, accumulated screen-space gradients. A
/// back end owns it while it steps.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TrainingState {
    pub(in crate::fit) parameters: Parameters<f32>,
    pub(in crate::fit) moments: Moments<f32>,
    pub(in crate::fit) screen_gradients: ScreenGradients,
}

impl From<Parameters<f32>> for TrainingState {
    /// The state before the first step.
    fn from(parameters: Parameters<f32>) -> TrainingState {
        TrainingState {
            moments: Moments::new(&parameters),
            screen_gradients: ScreenGradients::zeros(parameters.len()),
            parameters,
        }
    }
}

/// The configuration of one step.
pub struct StepConfig<'a> {
    pub(in crate::fit) rates: LearningRates,
    pub(in crate::fit) bounds: Bounds,
    /// See [`FitSettings::detach_tau`](crate::fit::FitSettings::detach_tau).
    pub(in crate::fit) detach_tau: bool,
    /// Weight of the fragment term, see `add_fragment_term`.
    pub(in crate::fit) fragment_weight: f64,
    /// The response of the camera; `None` for a photograph in the colours of the field whose camera is not learned.
    pub(in crate::fit) response: Option<Response>,
    /// The LPIPS term of the loss; left out without weights for it.
    pub(in crate::fit) lpips: Option<&'a Lpips<f32>>,
}

/// The outcome of one step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepReport {
    /// Loss on the training view before the step.
    pub loss: f64,
    /// Number of Gaussians rendered.
    pub drawn: usize,
    /// Number of Gaussians whose gradient was not finite; the step left them where they were.
    pub non_finite: usize,
    /// The gradient of the loss with respect to the camera: time in intervals, rotation vector, translation, logarithm of
    /// the focal lengths, colours, vignette. `None` if cameras are not learned and show the colours of the field.
    pub camera: Option<CameraNumbers>,
}

/// For the number of a view and the pixels of its image, the gradients of some losses with respect to these pixels.
pub type PixelGradients<'a> = dyn Fn(usize, &[[f32; 4]]) -> Vec<Vec<[f32; 4]>> + Sync + 'a;

/// Computes the steps of a fit, by the conventions of [`crate::reference`]. From [`Backend::load`] to
/// [`Backend::store`] the training state lives where the back end computes.
pub trait Backend {
    /// Name of the graphics device; `None` without one.
    fn device(&self) -> Option<&str>;

    /// Name for logs, including the name of the device if there is one.
    fn name(&self) -> String {
        self.device().map_or_else(|| "cpu".into(), |device| format!("gpu, {device}"))
    }

    /// Number of steps that may have begun and not ended when the next one begins.
    fn in_flight(&self) -> usize;

    /// Takes over a training state and drops its previous state.
    ///
    /// # Errors
    /// A [`DeviceError`] if the state does not fit on the device.
    fn load(&mut self, state: TrainingState) -> Result<(), DeviceError>;

    /// Renders the loaded Gaussians.
    ///
    /// # Errors
    /// A [`DeviceError`].
    ///
    /// # Panics
    /// If nothing is loaded.
    fn render(&mut self, view: &FrameView) -> Result<RenderedImage<f32>, DeviceError>;

    /// Renders the loaded Gaussians in each of `views`, and gives the images to `take`, in order.
    ///
    /// # Errors
    /// A [`DeviceError`].
    ///
    /// # Panics
    /// If nothing is loaded.
    fn render_each(
        &mut self,
        views: &[FrameView],
        take: &mut dyn FnMut(RenderedImage<f32>),
    ) -> Result<(), DeviceError>;

    /// Renders the loaded Gaussians in each of `views`, and backpropagates what `of_pixels` returns for its image. `take`
    /// gets the gradients of a view, in the order of the views.
    ///
    /// # Errors
    /// A [`DeviceError`].
    ///
    /// # Panics
    /// If nothing is loaded, or if a gradient and its image differ in length.
    fn gradients(
        &mut self,
        views: &[FrameView],
        of_pixels: &PixelGradients,
        take: &mut dyn FnMut(Vec<Gradient<f32>>),
    ) -> Result<(), DeviceError>;

    /// Begins one step: renders the view, compares the image with the photograph, backpropagates the
    /// loss and moves the Gaussians that were rendered. All that follows sees the Gaussians moved.
    ///
    /// # Errors
    /// A [`DeviceError`]; the loaded state may then be lost.
    ///
    /// # Panics
    /// If nothing is loaded, if the photograph has another size than the camera's image, or if more steps than
    /// [`in_flight`](Backend::in_flight) have begun and not ended.
    fn begin_step(
        &mut self,
        view: &FrameView,
        photograph: &Photograph,
        config: &StepConfig,
    ) -> Result<(), DeviceError>;

    /// Waits for the end of the oldest step that has begun and not ended.
    ///
    /// # Errors
    /// A [`DeviceError`]; the loaded state may then be lost.
    ///
    /// # Panics
    /// If there is none.
    fn end_step(&mut self) -> Result<StepReport, DeviceError>;

    /// Returns the training state.
    ///
    /// # Errors
    /// A [`DeviceError`]; the state is then lost.
    ///
    /// # Panics
    /// If nothing is loaded.
    fn store(&mut self) -> Result<TrainingState, DeviceError>;

    /// Peak device memory in bytes; `None` without a device.
    fn peak_device_bytes(&self) -> Option<u64>;
}
