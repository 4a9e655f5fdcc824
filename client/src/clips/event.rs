//! [`LoadEvent`]: what loading a clip reports, from the network up to the window.

use std::sync::{Arc, OnceLock};

use codec::{Clip, Limits, Poster};

use super::folder::Neighbours;
use super::progress::Progress;
use super::queue::{Entry, Queue};
use crate::audio::SoundTrack;
use crate::takes::OpenTake;
use program::{Fault, Subject};

/// A version of a clip, as its source has it.
#[derive(Clone, Debug)]
pub struct ClipVersion {
    /// The layers that have arrived.
    pub clip: Arc<Clip>,
    /// Its sound, which versions that continue each other share.
    pub sound: SoundTrack,
    /// The time and view that stand for it, if it states them.
    pub poster: Option<Poster>,
    /// Whether it continues the version before: that has the same first layers.
    pub is_continued: bool,
    /// The upright frame of the first version, which those that continue it keep.
    subject: Arc<OnceLock<Subject>>,
}

impl ClipVersion {
    /// The first version of a clip, with what else its package holds: all of it, or a prefix that has its first layer.
    /// Sound or a poster that is damaged is left out.
    pub(crate) fn new(clip: Clip, package: &[u8], limits: &Limits) -> ClipVersion {
        let sound = SoundTrack::of_clip(package, limits);
        let poster = codec::poster(package, limits).ok().flatten();
        ClipVersion { sound, poster, ..ClipVersion::bare(clip) }
    }

    /// A clip that came without a package: silent, without a poster. A clip without viewpoints gets the viewpoint of
    /// its opening, which no further layer changes.
    pub(crate) fn bare(mut clip: Clip) -> ClipVersion {
        let subject = match clip.info.viewpoints.is_empty() {
            true => Subject::with_opening(&clip.surroundings(), &mut clip.info).into(),
            false => OnceLock::new(),
        };
        let (clip, sound) = (Arc::new(clip), SoundTrack::default());
        ClipVersion { clip, sound, poster: None, is_continued: false, subject: Arc::new(subject) }
    }

    /// The upright frame of the clip. Found by the first call, which belongs on a thread that loads.
    pub(crate) fn subject(&self) -> Subject {
        *self.subject.get_or_init(|| Subject::from_clip(&self.clip))
    }
}

/// A report about a clip that is being loaded. A source produces the first four; the loader adds the
/// others.
#[derive(Debug)]
pub enum LoadEvent<C = ClipVersion> {
    /// How much has arrived.
    Progress(Progress),
    /// A remark for the viewer.
    Note(String),
    /// A version of the clip that plays. Better ones may follow; the last one is the best.
    Clip(C),
    /// The name stands for a take, which loads while it plays. The only version.
    Take(Arc<OpenTake>),
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
