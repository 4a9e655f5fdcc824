//! [`ReportFile`]: a file of a report.

/// A file of a report.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ReportFile {
    /// Name in the report's folder.
    pub name: String,
    /// Contents.
    pub text: String,
}
