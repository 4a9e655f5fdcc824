//! Mattes by difference: what a still camera shows besides its clean plate.
//!
//! ```text
//! pictures over time -> Plate: colours and noise                     plate, gain
//! plate, picture     -> pixels that differ and are no shadow         difference, box_mean
//!                    -> regions, without islands and holes           regions
//!                    -> alpha, whose edges follow the picture's edges   alpha, guided, box_mean
//! ```
//!
//! Colours are 8-bit and display-referred. Display curves are powers, nearly, so a shadow and a change of exposure multiply
//! displayed colours by a factor just as they do linear ones. Lengths are parts of the square root of the number of
//! pixels, areas are parts of that number. Constants were chosen on composites of `tests/matte.rs`, whose IoU is given
//! where it tells.

mod alpha;
mod box_mean;
mod difference;
mod gain;
mod guided;
mod plate;
mod regions;

pub use gain::GAIN_MAX;
pub use plate::Plate;
