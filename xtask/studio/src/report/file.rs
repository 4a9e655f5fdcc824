//! [`ReportFile`]: a text file that a report consists of.

/// A text file of a report.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ReportFile {
    /// File name in the report's folder.
    pub name: String,
    /// Contents.
    pub text: String,
}
