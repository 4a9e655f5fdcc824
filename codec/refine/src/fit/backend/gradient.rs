//! [`Gradient`]: derivatives of a loss of one image.

use crate::fit::cameras::ViewGradient;
use crate::fit::parameters::Parameters;

/// The gradient of a loss of one image with respect to the Gaussians rendered in it. Gaussians outside
/// the image or outside their window have no gradient and no row.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Gradient<T> {
    /// Rows of the rendered Gaussians in the parameters, ascending.
    pub rows: Vec<u32>,
    /// Row `i` is the gradient with respect to row `rows[i]` of the parameters.
    pub values: Parameters<T>,
    /// Norm of the gradient with respect to the projected centre, one per entry of `rows`, in units of
    /// the loss per half image: the image spans `[-1, 1]` along both axes. The densification criterion
    /// of 3D Gaussian Splatting (Kerbl et al. 2023, section 5.2), scaled as in gsplat.
    pub screen: Vec<T>,
    /// The gradient with respect to the view, without the Gaussians counted as non-finite.
    pub view: ViewGradient<T>,
    /// Number of `rows` with a non-finite number in their gradient; those gradients are set to 0.
    pub non_finite: usize,
}
