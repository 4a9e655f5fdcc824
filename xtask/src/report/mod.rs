//! Reports: what the packages of a field cost and what they keep, and how stable the renderer is,
//! measured, as text to read, tables for programs, and plots.

mod plot;
pub mod rd;
pub mod stability;
mod subject;

pub use subject::Subject;

/// A file of a report.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ReportFile {
    /// Name in the report's folder.
    pub name: String,
    /// Contents.
    pub text: String,
}
