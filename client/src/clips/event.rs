//! [`LoadEvent`]: what loading a clip reports.

use super::folder::Neighbours;
use super::queue::{Entry, Queue};
use crate::content::Progress;
use program::Fault;

/// A report about clips that are being loaded.
#[derive(Debug)]
pub(crate) enum LoadEvent<C> {
    /// How much has arrived.
    Progress(Progress),
    /// A remark for the viewer.
    Note(String),
    /// A clip that can be shown. A newer version of it may follow.
    Clip(Version<C>),
    /// The request names this playlist.
    Playlist(Queue),
    /// The request names a clip, and these are beside it in its folder; reported before the clip is read.
    Neighbours(Neighbours),
    /// An entry cannot be loaded; the loader tries the next one.
    Skipped(Fault),
    /// The request failed. No event follows.
    Failed(Fault),
    /// The request is complete. No event follows.
    Done,
}

/// A version of an entry, ready to be shown.
#[derive(Debug)]
pub(crate) struct Version<C> {
    pub(crate) entry: Entry,
    /// Whether it is the request's first version of this entry.
    pub(crate) is_first: bool,
    pub(crate) clip: C,
}
