//! [`PeerRenderer`]: the interface of players in Rust.

use crate::workload::WorkFrame;

/// A player with an open field.
pub(super) trait PeerRenderer {
    /// Name and driver of the device.
    fn device(&self) -> String;

    /// Draws a frame and waits until it is done.
    fn draw(&mut self, frame: &WorkFrame) -> anyhow::Result<()>;

    /// Red, green, blue of every pixel of the last drawn frame, in rows from the top.
    fn read(&mut self) -> anyhow::Result<Vec<u8>>;
}
