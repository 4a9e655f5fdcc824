//! [`ReportPart`]: what a kind of measurement adds to a report.

use serde_json::{Map, Value};

/// A part of a report.
#[derive(Debug)]
pub struct ReportPart {
    /// Its title on the page, HTML.
    pub title: String,
    /// Its body on the page, HTML.
    pub body: String,
    /// What a terminal shows of it.
    pub text: String,
    /// All of its numbers.
    pub json: Map<String, Value>,
}
