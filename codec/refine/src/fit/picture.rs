//! [`Picture`]: what a back end draws, and what the loss looks at.

/// A rectangle of pixels, row by row from the top left.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture<T> {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// `width * height` pixels: red, green, blue over black, that is premultiplied by alpha, and
    /// alpha. Alpha is in `[0, 1]`, colours are from 0 up and possibly above 1.
    pub pixels: Vec<[T; 4]>,
}
