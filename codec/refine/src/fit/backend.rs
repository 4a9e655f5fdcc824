//! [`Backend`]: who draws, and follows the derivatives back.

use super::{Gradient, Parameters, Picture, View, cpu};

/// Draws Gaussians over black and differentiates what it draws, by the conventions of
/// [`crate::reference`].
pub trait Backend {
    /// Name in logs.
    fn name(&self) -> &'static str;

    /// Draws a picture.
    fn draw(&mut self, parameters: &Parameters<f32>, view: &View) -> Picture<f32>;

    /// Draws a picture, gives it to `objective`, which returns the gradient by its pixels, and returns
    /// the gradient by the parameters. `detached`: see [`cpu::Drawing::backward`].
    fn gradient(
        &mut self,
        parameters: &Parameters<f32>,
        view: &View,
        detached: bool,
        objective: &mut dyn FnMut(&Picture<f32>) -> Vec<[f32; 4]>,
    ) -> Gradient<f32>;
}

/// All cores of the machine. The same bits for any number of them.
#[derive(Clone, Copy, Debug, Default)]
pub struct Cpu;

impl Backend for Cpu {
    fn name(&self) -> &'static str {
        "cpu"
    }

    fn draw(&mut self, parameters: &Parameters<f32>, view: &View) -> Picture<f32> {
        cpu::draw(parameters, view).picture
    }

    fn gradient(
        &mut self,
        parameters: &Parameters<f32>,
        view: &View,
        detached: bool,
        objective: &mut dyn FnMut(&Picture<f32>) -> Vec<[f32; 4]>,
    ) -> Gradient<f32> {
        let drawing = cpu::draw(parameters, view);
        let d_picture = objective(&drawing.picture);
        drawing.backward(parameters, view, &d_picture, detached)
    }
}
