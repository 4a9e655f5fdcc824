//! [`LoadEvent`]: what loading a clip reports, from the network up to the window.

use std::sync::Arc;

use super::folder::Neighbours;
use super::progress::Progress;
use super::queue::{Entry, Queue};
use crate::takes::OpenTake;
use program::Fault;

/// A report about a take that is being loaded. A source produces the first three; the loader adds the
/// others.
#[derive(Debug)]
pub enum LoadEvent<C = Arc<OpenTake>> {
    /// How much has arrived.
    Progress(Progress),
    /// A remark for the viewer.
    Note(String),
    /// A take that plays, and loads while it plays. A newer version of it may follow.
    Take(C),
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
