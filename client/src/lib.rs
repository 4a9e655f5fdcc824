//! Player of 4D Gaussian clips.
//!
//! [`content`] opens what plays, from a file, a server or the program itself. [`player`] keeps the segments of a take in GPU
//! memory that playing needs, and [`clips`] says which clip plays next. [`gpu`] holds segments and renders frames, `audio`
//! plays their sound. `headless` writes frames to images, `window` shows them on a screen, `headset` in a headset, whose
//! runtime is behind `xr`. Android has these two alone; `xr` also holds the library's entry point there.
//! Only [`gpu`] names the graphics API; it names neither files nor windows.

pub mod args;
mod audio;
pub mod clips;
pub mod clock;
pub mod content;
#[cfg(all(not(target_os = "android"), any(feature = "net", feature = "window", feature = "xr")))]
mod folders;
#[cfg(all(not(target_os = "android"), any(feature = "window", feature = "xr")))]
mod fonts;
pub mod gpu;
#[cfg(not(target_os = "android"))]
pub mod headless;
#[cfg(feature = "xr")]
pub mod headset;
#[cfg(any(feature = "window", feature = "xr"))]
mod notes;
pub mod pipeline_folder;
pub mod player;
mod regular_file;
#[cfg(any(feature = "window", feature = "xr"))]
mod state_file;
pub mod stats;
#[cfg(not(target_os = "android"))]
mod terminal;
#[cfg(test)]
mod test_fields;
pub mod view;
pub mod viewpoint;
#[cfg(feature = "window")]
pub mod window;
mod worker;
#[cfg(feature = "xr")]
pub mod xr;
