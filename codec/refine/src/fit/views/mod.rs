//! The images of a fit: cameras at a frame, the photographs they took, and what is rendered from there.

mod frame_view;
mod photograph;
mod rendered_image;
mod training_view;

pub use frame_view::FrameView;
pub use photograph::Photograph;
pub use rendered_image::RenderedImage;
pub use training_view::TrainingView;
