//! Measures what playing a clip costs and how stable the renderer is, for `report` and the tests.
//!
//! [`playing`] sweeps every parameter of the renderer and switches on every feature that a clip does
//! without. [`stability`] compares the GPU's pictures of stiff and extreme fields with the f64
//! reference's.

mod cameras;
pub mod device;
pub mod parameter;
pub mod playing;
pub mod resident;
pub mod scene;
pub mod stability;

pub use cameras::measured_cameras;
