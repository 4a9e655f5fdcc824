//! Properties of the host tool's readers and the player's downloader on any bytes, and the initial corpus.

pub mod capture;
pub mod content;
pub mod import;
pub mod net;
pub mod scene;
pub mod seeds;

mod files;
mod kinds;
mod parts;
