//! Player of 4D Gaussian clips.
//!
//! [`clips`] loads clips and orders those of a playlist, [`gpu`] uploads a decoded clip once and draws
//! frames of it, [`headless`] drives that into images, `window` onto a screen, `xr` into a headset. On
//! Android there is the headset alone, and `xr` also holds the entry point of the library. Only
//! [`gpu`] knows the graphics API; it knows nothing of files and windows.

pub mod args;
pub mod clips;
#[cfg(all(not(target_os = "android"), any(feature = "net", feature = "xr")))]
mod folders;
pub mod gpu;
#[cfg(not(target_os = "android"))]
pub mod headless;
#[cfg(feature = "net")]
pub mod net;
pub mod player;
pub mod stats;
#[cfg(not(target_os = "android"))]
mod terminal;
pub mod view;
pub mod viewpoint;
#[cfg(feature = "window")]
pub mod window;
#[cfg(feature = "xr")]
pub mod xr;
