//! [`Loading`]: a clip on its way, on a thread of its own, up to where it can be drawn.
//!
//! Buffers are filled and pipelines are built there without a submission: what is to be copied goes
//! along with the next frame. Of a clip that arrives layer by layer, each better one is made ready
//! to take the place of the one before.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};
use std::thread::JoinHandle;

use codec::{Clip, ClipInfo};
use program::Fault;

use super::interaction::Subject;
use crate::clips::queue::{Brought, Entry, Queue, Terms, bring};
use crate::clips::{LoadEvent, Progress, clips_in, is_url, playlist};
use crate::gpu::{Gpu, GpuClip, Renderer, RuntimeFormat};

/// What to load.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Request {
    /// A path or an address, of a clip or of a playlist; `None` for the demo.
    pub(super) name: Option<String>,
    /// The folder in which clips from the network are kept.
    pub(super) kept: Option<PathBuf>,
    /// Layers without which a clip is not to be shown; `None` if all are needed.
    pub(super) layers: Option<usize>,
}

/// What to do with it.
pub(super) enum Order {
    /// Bring what it names.
    Named,
    /// Bring the first of these that can be had, in its name; whether somebody waits for it.
    Next(Vec<Entry>, Arc<AtomicBool>),
}

/// A clip that can be drawn.
pub(super) struct Loaded {
    /// Its path or address, `None` for the demo, and its number in its playlist.
    pub(super) entry: Entry,
    pub(super) subject: Subject,
    pub(super) renderer: Renderer,
    pub(super) info: ClipInfo,
    /// Gaussians in the first layer, the first two, and so on.
    pub(super) layer_ends: Vec<usize>,
    pub(super) gaussians: usize,
}

impl Loaded {
    /// Whether this is a version of the same clip, to go on with where that one stands.
    pub(super) fn goes_on(&self, before: &Loaded) -> bool {
        self.entry == before.entry && self.info == before.info
    }

    /// Whether it stands on the same stage as another clip: seen from the same viewpoints.
    pub(super) fn is_on_stage_of(&self, other: &Loaded) -> bool {
        let stage = |info: &ClipInfo| (info.up, info.metres_per_unit, info.viewpoints.clone());
        !self.info.viewpoints.is_empty() && stage(&self.info) == stage(&other.info)
    }

    fn new(gpu: &Gpu, entry: Entry, format: RuntimeFormat, clip: &Clip) -> Result<Loaded, Fault> {
        let on_gpu = Arc::new(GpuClip::upload(gpu, clip)?);
        Ok(Loaded {
            subject: Subject::of(clip),
            layer_ends: on_gpu.layer_ends(),
            renderer: Renderer::new(gpu, on_gpu, format.drawn(), 2)?,
            entry,
            info: clip.info.clone(),
            gaussians: clip.len() + clip.plate.as_ref().map_or(0, |plate| plate.len()),
        })
    }
}

/// What is told of a clip on its way.
pub(super) enum Told {
    /// The clip to play after it, also where it cannot be loaded.
    Next(Option<String>),
    /// The playlist that was named.
    List(Queue),
    /// A clip of the playlist could not be had.
    Skipped(Fault),
    Progress(Progress),
    Note(String),
    /// A clip to show, the first one or a better one of the same.
    Clip {
        loaded: Box<Loaded>,
        first: bool,
    },
    Failed(Fault),
    /// No more is to come.
    Done,
}

/// The clip after this one in its folder, by name, the first after the last; `None` where it is the
/// only one.
fn next_clip(path: &Path) -> Option<String> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut clips = clips_in(folder);
    clips.retain(|clip| clip.file_name() != path.file_name());
    let after = clips.iter().find(|clip| clip.file_name() > path.file_name());
    after.or(clips.first())?.to_str().map(String::from)
}

/// A thread that loads a clip.
pub(super) struct Loading {
    /// `None` once nobody listens any more.
    told: Option<Receiver<Told>>,
    thread: Option<JoinHandle<()>>,
}

impl Loading {
    /// Begins to load a clip, to be drawn for two eyes in `format`.
    ///
    /// # Errors
    /// [`Fault::Device`] if the system refuses another thread.
    pub(super) fn start(
        gpu: Arc<Gpu>,
        request: Request,
        order: Order,
        format: RuntimeFormat,
    ) -> Result<Loading, Fault> {
        let (tell, told) = channel();
        let run = move || {
            let last = match load(&gpu, request, order, format, &tell) {
                Ok(_) => Told::Done,
                Err(fault) => Told::Failed(fault),
            };
            // Nobody is left to tell where the session has ended.
            drop(tell.send(last));
        };
        let thread = std::thread::Builder::new()
            .name("loader".into())
            .spawn(run)
            .map_err(|error| Fault::Device(format!("cannot start a thread: {error}")))?;
        Ok(Loading { told: Some(told), thread: Some(thread) })
    }

    /// The next that is told of the clip, if there is anything. Does not wait. Nothing follows
    /// [`Told::Done`] and [`Told::Failed`].
    pub(super) fn poll(&self) -> Option<Told> {
        match self.told.as_ref()?.try_recv() {
            Ok(told) => Some(told),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => {
                let fault = "the clip could not be loaded: the thread that did ended early";
                Some(Told::Failed(Fault::Data(fault.into())))
            }
        }
    }
}

impl Drop for Loading {
    /// Waits for the thread, which ends with the next it has to tell: the graphics device must not
    /// go away below it.
    fn drop(&mut self) {
        self.told = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Loads a clip and tells of it, as long as someone listens.
fn load(
    gpu: &Gpu,
    request: Request,
    order: Order,
    format: RuntimeFormat,
    tell: &Sender<Told>,
) -> Result<ControlFlow<()>, Fault> {
    let Request { name, kept, layers } = request;
    let hear = |told| match tell.send(told) {
        Ok(()) => ControlFlow::Continue(()),
        Err(_) => ControlFlow::Break(()),
    };
    let (entries, awaited) = match order {
        Order::Next(entries, awaited) => (entries, awaited),
        Order::Named => {
            let Some(entries) = named(name, kept.clone(), &hear)? else { return Ok(ControlFlow::Break(())) };
            (entries, Arc::new(true.into()))
        }
    };
    bring(&entries, &Terms { kept, layers, awaited }, &mut |brought| {
        Ok(hear(match brought {
            Brought::Progress(progress) => Told::Progress(progress),
            Brought::Note(note) => Told::Note(note),
            Brought::Skipped(fault) => Told::Skipped(fault),
            Brought::Clip { entry, clip, first } => {
                Told::Clip { loaded: Box::new(Loaded::new(gpu, entry, format, &clip)?), first }
            }
        }))
    })
}

/// What a name means: a clip, or those of a playlist; `None` where nobody listens any more.
fn named(
    name: Option<String>,
    kept: Option<PathBuf>,
    hear: &dyn Fn(Told) -> ControlFlow<()>,
) -> Result<Option<Vec<Entry>>, Fault> {
    if let Some(name) = name.as_deref().filter(|name| playlist::is_playlist(name)) {
        let opened = playlist::open(name, kept, &mut |news| match news {
            LoadEvent::Progress(progress) => hear(Told::Progress(progress)),
            LoadEvent::Note(note) => hear(Told::Note(note)),
            LoadEvent::Clip(_) => ControlFlow::Continue(()),
        })?;
        let Some(opened) = opened else { return Ok(None) };
        let queue = Queue::new(opened);
        let entries = queue.all();
        return Ok(hear(Told::List(queue)).is_continue().then_some(entries));
    }
    let path = name.as_deref().filter(|name| !is_url(name));
    let next = path.and_then(|path| next_clip(Path::new(path)));
    Ok(hear(Told::Next(next)).is_continue().then(|| vec![Entry::alone(name)]))
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::*;

    #[test]
    fn clips_of_a_folder_follow_one_another() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        for name in ["b.aarc", "a.aarc", "c.aarc", "b.ply"] {
            std::fs::write(path(name), "").unwrap();
        }
        let after = |name: &str| next_clip(&path(name)).map(PathBuf::from);
        assert_eq!(after("a.aarc"), Some(path("b.aarc")));
        assert_eq!(after("b.aarc"), Some(path("c.aarc")));
        assert_eq!(after("c.aarc"), Some(path("a.aarc")));
        assert_eq!(after("b.other"), Some(path("c.aarc")), "of whatever name");
        assert_eq!(next_clip(Path::new("/nowhere/a.aarc")), None);
        for name in ["a.aarc", "b.aarc"] {
            std::fs::remove_file(path(name)).unwrap();
        }
        assert_eq!(after("c.aarc"), None);
    }
}
