//! What must hold of any bytes that the host tool or the player's downloader is given, and inputs to
//! start from.

pub mod capture;
pub mod import;
pub mod net;
pub mod scene;
pub mod seeds;

mod files;
mod parts;

// The downloader names what it is of the player.
#[path = "../../../client/src/progress.rs"]
pub mod progress;
