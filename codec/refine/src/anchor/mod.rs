//! The anchor: Gaussians on the surface that the cameras see, which refinement starts from.
//!
//! Depths per photograph, from whichever source there is, are brought to the scale of the cameras;
//! every pixel of the subject puts Gaussians on its ray (the paper's grounding equation).

mod depth_map;

pub use depth_map::DepthMap;
