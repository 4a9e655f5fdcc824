//! [`Gradient`]: how a loss changes with the Gaussians of one picture.

use super::Parameters;

/// The gradient of a loss of one picture by the parameters of the Gaussians in it. Those that are not
/// in it, because their window is closed or because they are outside the image, have none.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Gradient<T> {
    /// Rows of the Gaussians that were drawn, rising.
    pub rows: Vec<u32>,
    /// Row `i` is the gradient by row `rows[i]` of the parameters; the columns are theirs.
    pub values: Parameters<T>,
    /// Of each of `rows`, the length of the gradient by its centre in the image, which is counted
    /// from -1 to 1 along either side: what gsplat splits and clones by.
    pub screen: Vec<T>,
    /// How many of `rows` had a number in their gradient that is not finite; theirs is set to 0.
    pub non_finite: usize,
}
