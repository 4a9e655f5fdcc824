//! Reports as a page, text, tables for programs, and plots: size and quality of packages at every budget, the
//! ablation of fits; with the feature `measure` also the cost and quality of playing, packaging and fitting a clip, and the
//! stability of the renderer, and what a take costs over time.

pub mod ablation;
#[cfg(feature = "measure")]
mod coding;
mod file;
#[cfg(feature = "measure")]
pub mod fitting;
pub(crate) mod html;
#[cfg(feature = "measure")]
pub mod packaging;
#[cfg(feature = "measure")]
mod page;
pub(crate) mod plot;
pub mod rd;
#[cfg(feature = "measure")]
pub mod stability;
mod subject;

pub use file::ReportFile;
#[cfg(feature = "measure")]
pub(crate) use page::layers_parameter;
#[cfg(feature = "measure")]
pub use page::{Findings, LayerInstant, TakeFindings, TakeInstant, TakePhotographs, TakeSetup};
pub use subject::ReportSubject;
