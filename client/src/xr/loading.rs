//! [`Loading`]: a clip on its way, on a thread of its own, up to where it can be drawn.
//!
//! Buffers are filled and pipelines are built there without a submission: what is to be copied goes
//! along with the next frame.

use std::path::Path;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::thread::JoinHandle;

use super::interaction::Subject;
use crate::fault::Fault;
use crate::gpu::{Gpu, GpuClip, Renderer, RuntimeFormat};
use crate::source;

/// A clip that can be drawn.
pub(super) struct Loaded {
    /// Its path; `None` for the demo.
    pub(super) name: Option<String>,
    pub(super) subject: Subject,
    pub(super) renderer: Renderer,
    pub(super) duration_s: f64,
    pub(super) fps: f64,
    /// Gaussians in the first layer, the first two, and so on.
    pub(super) layer_ends: Vec<usize>,
    pub(super) gaussians: usize,
}

/// What came of loading a clip.
pub(super) struct Arrived {
    /// The clip to play after it, also where it cannot be loaded.
    pub(super) next: Option<String>,
    pub(super) clip: Result<Loaded, Fault>,
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
    arrived: Receiver<Arrived>,
    thread: Option<JoinHandle<()>>,
}

impl Loading {
    /// Begins to load the clip named on the command line, to be drawn for two eyes in `format`.
    ///
    /// # Errors
    /// [`Fault::Device`] if the system refuses another thread.
    pub(super) fn start(
        gpu: Arc<Gpu>,
        name: Option<String>,
        format: RuntimeFormat,
    ) -> Result<Loading, Fault> {
        let (deliver, arrived) = channel();
        let load = move |name: Option<String>| {
            let clip = source::load(name.as_deref())?;
            let on_gpu = Arc::new(GpuClip::upload(&gpu, &clip)?);
            Ok(Loaded {
                subject: Subject::of(&clip),
                layer_ends: on_gpu.layer_ends(),
                renderer: Renderer::new(&gpu, on_gpu, format.drawn(), 2)?,
                name,
                duration_s: clip.info.duration_s.into(),
                fps: clip.info.fps.into(),
                gaussians: clip.len() + clip.plate.as_ref().map_or(0, |plate| plate.len()),
            })
        };
        let run = move || {
            let next = name.as_deref().and_then(|name| next_clip(Path::new(name)));
            // Nobody is left to tell where the session has ended.
            drop(deliver.send(Arrived { next, clip: load(name) }));
        };
        let thread = std::thread::Builder::new()
            .name("loader".into())
            .spawn(run)
            .map_err(|error| Fault::Device(format!("cannot start a thread: {error}")))?;
        Ok(Loading { arrived, thread: Some(thread) })
    }

    /// The clip, or why it could not be loaded, once it is there. Does not wait.
    pub(super) fn poll(&self) -> Option<Arrived> {
        match self.arrived.try_recv() {
            Ok(arrived) => Some(arrived),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => {
                let fault = "the clip could not be loaded: the thread that did ended early";
                Some(Arrived { next: None, clip: Err(Fault::Data(fault.into())) })
            }
        }
    }
}

impl Drop for Loading {
    /// Waits for the thread: the graphics device must not go away below it.
    fn drop(&mut self) {
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
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
