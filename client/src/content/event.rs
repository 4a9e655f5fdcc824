//! [`OpenEvent`]: what opening a take reports.

use std::sync::Arc;

use super::opened::OpenTake;
use super::progress::Progress;

/// A report about a take that is being opened.
#[derive(Debug)]
pub enum OpenEvent {
    /// How much has arrived.
    Progress(Progress),
    /// A remark for the viewer.
    Note(String),
    /// A take that plays, and loads while it plays. A newer version of it may follow.
    Take(Arc<OpenTake>),
}
