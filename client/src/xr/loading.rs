//! [`Loading`]: a clip on its way, on a thread of its own, up to where it can be drawn.
//!
//! Buffers are filled and pipelines are built there without a submission: what is to be copied goes
//! along with the next frame. Of a clip that arrives layer by layer, each better one is made ready
//! to take the place of the one before.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};
use std::thread::JoinHandle;

use codec::{Clip, ClipInfo};

use super::interaction::Subject;
use crate::fault::Fault;
use crate::gpu::{Gpu, GpuClip, Renderer, RuntimeFormat};
use crate::progress::Progress;
use crate::source::{self, News};

/// What to load.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Request {
    /// A path or an address; `None` for the demo.
    pub(super) name: Option<String>,
    /// The folder in which clips from the network are kept.
    pub(super) kept: Option<PathBuf>,
    /// Layers without which a clip is not to be shown; `None` if all are needed.
    pub(super) layers: Option<usize>,
}

/// A clip that can be drawn.
pub(super) struct Loaded {
    /// Its path or address; `None` for the demo.
    pub(super) name: Option<String>,
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
        self.name == before.name && self.info == before.info
    }

    fn new(gpu: &Gpu, name: Option<String>, format: RuntimeFormat, clip: &Clip) -> Result<Loaded, Fault> {
        let on_gpu = Arc::new(GpuClip::upload(gpu, clip)?);
        Ok(Loaded {
            subject: Subject::of(clip),
            layer_ends: on_gpu.layer_ends(),
            renderer: Renderer::new(gpu, on_gpu, format.drawn(), 2)?,
            name,
            info: clip.info.clone(),
            gaussians: clip.len() + clip.plate.as_ref().map_or(0, |plate| plate.len()),
        })
    }
}

/// What is told of a clip on its way.
pub(super) enum Told {
    /// The clip to play after it, also where it cannot be loaded.
    Next(Option<String>),
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
    let mut clips = source::clips_in(folder);
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
    pub(super) fn start(gpu: Arc<Gpu>, request: Request, format: RuntimeFormat) -> Result<Loading, Fault> {
        let (tell, told) = channel();
        let run = move || {
            let last = match load(&gpu, request, format, &tell) {
                Ok(()) => Told::Done,
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
fn load(gpu: &Gpu, request: Request, format: RuntimeFormat, tell: &Sender<Told>) -> Result<(), Fault> {
    let Request { name, kept, layers } = request;
    let path = name.as_deref().filter(|name| !source::is_address(name));
    let is_heard = |told| tell.send(told).is_ok();
    if !is_heard(Told::Next(path.and_then(|path| next_clip(Path::new(path))))) {
        return Ok(());
    }
    let mut arrival = source::open(name.as_deref(), kept)?;
    let mut first = true;
    let mut ready = |clip: &Clip| -> Result<Told, Fault> {
        let loaded = Box::new(Loaded::new(gpu, name.clone(), format, clip)?);
        Ok(Told::Clip { loaded, first: std::mem::take(&mut first) })
    };
    // One that is not shown yet, because layers are missing.
    let mut latest = None;
    loop {
        let told = match arrival.next().transpose()? {
            Some(News::Progress(progress)) => Told::Progress(progress),
            Some(News::Note(note)) => Told::Note(note),
            Some(News::Clip(clip)) if layers.is_some_and(|layers| clip.layers.len() >= layers) => {
                ready(&clip)?
            }
            Some(News::Clip(clip)) => {
                latest = Some(clip);
                continue;
            }
            None => match latest.take() {
                Some(clip) => ready(&clip)?,
                None => return Ok(()),
            },
        };
        if !is_heard(told) {
            return Ok(());
        }
    }
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
