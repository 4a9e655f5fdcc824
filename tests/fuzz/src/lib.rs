//! What must hold of any bytes that the host tool or the player's downloader is given, and inputs to
//! start from.

pub mod capture;
pub mod import;
pub mod net;
pub mod scene;
pub mod seeds;

mod files;
mod parts;

#[path = "../../../client/src/clips/progress.rs"]
mod progress;

/// What the downloader uses of the player's module of this name.
pub mod clips {
    pub use crate::progress::Progress;
}
