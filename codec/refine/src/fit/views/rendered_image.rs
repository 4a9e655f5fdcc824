//! [`RenderedImage`]: the output of a back end, the input of the loss.

/// An image rendered over black.
#[derive(Clone, Debug, PartialEq)]
pub struct RenderedImage<T> {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// `width * height` pixels, row by row from the top left: red, green and blue premultiplied by
    /// alpha, at least 0 and possibly above 1; and alpha in `[0, 1]`.
    pub pixels: Vec<[T; 4]>,
}
