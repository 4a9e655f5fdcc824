//! Player of 4D Gaussian clips.
//!
//! [`clips`] loads clips and orders the clips of a playlist, [`takes`] loads the segments of a take. [`gpu`] uploads a
//! decoded clip once and renders its frames. `audio` plays their sound. `headless` writes them to images, `window`
//! shows them on a screen, `xr` in a headset. Android has `xr` alone, which also holds the library's entry point there.
//! Only [`gpu`] names the graphics API; it names neither files nor windows.

pub mod args;
mod audio;
pub mod clips;
#[cfg(all(not(target_os = "android"), any(feature = "net", feature = "window", feature = "xr")))]
mod folders;
pub mod gpu;
#[cfg(not(target_os = "android"))]
pub mod headless;
#[cfg(feature = "net")]
pub mod net;
pub mod pipeline_folder;
pub mod player;
#[cfg(any(feature = "window", feature = "xr"))]
mod state_file;
pub mod stats;
pub mod takes;
#[cfg(not(target_os = "android"))]
mod terminal;
#[cfg(test)]
mod test_fields;
pub mod view;
pub mod viewpoint;
#[cfg(feature = "window")]
pub mod window;
#[cfg(feature = "xr")]
pub mod xr;
