//! Counts of a frame: [`FrameCounts`] on the CPU, [`Coverage`] on the GPU.

/// Counts and CPU times of one frame, plate included.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrameCounts {
    /// Gaussians whose opacity at the instant is at least 1/255.
    pub alive: u32,
    /// Gaussians sorted and handed to the GPU.
    pub sorted: u32,
    /// Time of the stage `alive` in milliseconds.
    pub alive_ms: f64,
    /// Time of the stage `sort` in milliseconds.
    pub sort_ms: f64,
}

/// Exact coverage of the drawn quads, see [`Renderer::count`](super::Renderer::count).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Coverage {
    /// Gaussians whose quad contains at least one pixel centre.
    pub drawn: u32,
    /// Pixel centres inside quads, summed over all Gaussians, eyes, and views of an eye.
    pub fragments: u64,
}
