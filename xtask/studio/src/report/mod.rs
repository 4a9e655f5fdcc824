//! Reports: what playing, packaging and fitting a clip costs and keeps, what packages of every
//! budget do, and how stable the renderer is, measured, as a page or text to read, tables for
//! programs, and plots.

pub mod fitting;
pub mod knob;
pub mod packaging;
mod page;
pub mod playing;
mod plot;
pub mod rd;
pub mod stability;
mod subject;

pub use page::Findings;
pub use subject::Subject;

/// A file of a report.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ReportFile {
    /// Name in the report's folder.
    pub name: String,
    /// Contents.
    pub text: String,
}
