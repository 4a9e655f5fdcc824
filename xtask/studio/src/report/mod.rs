//! Reports, as a page, as text for a terminal, and as JSON: size and quality of packages at every budget, the ablation of
//! fits; with the feature `measure` also the cost and quality of playing, packaging and fitting a clip, the stability of the
//! renderer, and what a take costs over time.

pub mod ablation;
#[cfg(feature = "measure")]
pub mod fitting;
#[cfg(feature = "measure")]
pub mod packaging;
#[cfg(feature = "measure")]
mod page;
mod part;
pub mod rd;
#[cfg(feature = "measure")]
pub mod stability;
mod subject;

#[cfg(feature = "measure")]
pub(crate) use page::layers_parameter;
#[cfg(feature = "measure")]
pub use page::{Findings, LayerInstant, TakeFindings, TakeInstant, TakePhotographs, TakeSetup};
pub use part::ReportPart;
pub use subject::ReportSubject;
