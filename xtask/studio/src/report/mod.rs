//! Reports, as a page or text to read, tables for programs, and plots: what packages of every budget
//! cost and keep, and with the feature `measure` what playing, packaging and fitting a clip costs and
//! keeps, and how stable the renderer is.

mod file;
#[cfg(feature = "measure")]
pub mod fitting;
#[cfg(feature = "measure")]
pub mod packaging;
#[cfg(feature = "measure")]
mod page;
mod plot;
pub mod rd;
#[cfg(feature = "measure")]
pub mod stability;
mod subject;

pub use file::ReportFile;
#[cfg(feature = "measure")]
pub use page::Findings;
pub use subject::ReportSubject;
