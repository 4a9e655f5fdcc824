//! The stage as a rig of real cameras records it: videos with sound that are neither synchronous nor alike.
//!
//! ```text
//! settings -> what perturbs each camera (`perturbations`, `timing`)
//!          -> pictures at the camera's own times (`view`, before the `room`, through the `sensor`)
//!          -> its sound (`sound`) -> a video (`encode`, turned by `display_matrix`)
//! ```
//!
//! `write` adds a calibration and a file of truth, which only tests read. Every number drawn depends on the seed, the
//! camera and the quantity alone: switching one perturbation off leaves the others as they are. Equal settings give
//! equal pictures and equal sound; their bytes in a video are the encoder's.

mod calibration;
mod display_matrix;
mod draws;
mod encode;
mod perturbations;
mod room;
mod sensor;
mod settings;
mod sound;
mod timing;
mod truth;
mod view;
mod write;

pub use settings::{Perturbations, RigSettings};
pub use view::{Rig, RigPicture, RigView};
pub use write::write;
