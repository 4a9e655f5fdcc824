//! [`Loading`]: a clip on its way, on a thread of its own, up to where it can be drawn.
//!
//! Buffers are filled and pipelines are built there without a submission: what is to be copied goes
//! along with the next frame.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::thread::JoinHandle;

use super::interaction::Subject;
use crate::fault::Fault;
use crate::gpu::{Gpu, GpuClip, Renderer, RuntimeFormat};
use crate::source;

/// A clip that can be drawn.
pub(super) struct Loaded {
    pub(super) subject: Subject,
    pub(super) renderer: Renderer,
    pub(super) duration_s: f64,
    pub(super) fps: f64,
    pub(super) layers: usize,
    pub(super) gaussians: usize,
}

/// A thread that loads a clip.
pub(super) struct Loading {
    loaded: Receiver<Result<Loaded, Fault>>,
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
        let (deliver, loaded) = channel();
        let load = move || {
            let clip = source::load(name.as_deref())?;
            let on_gpu = Arc::new(GpuClip::upload(&gpu, &clip)?);
            Ok(Loaded {
                subject: Subject::of(&clip),
                renderer: Renderer::new(&gpu, on_gpu, format.drawn(), 2)?,
                duration_s: clip.info.duration_s.into(),
                fps: clip.info.fps.into(),
                layers: clip.layers.len(),
                gaussians: clip.len() + clip.plate.as_ref().map_or(0, |plate| plate.len()),
            })
        };
        let thread = std::thread::Builder::new()
            .name("loader".into())
            // Nobody is left to tell where the session has ended.
            .spawn(move || drop(deliver.send(load())))
            .map_err(|error| Fault::Device(format!("cannot start a thread: {error}")))?;
        Ok(Loading { loaded, thread: Some(thread) })
    }

    /// The clip, or why it could not be loaded, once it is there. Does not wait.
    pub(super) fn poll(&self) -> Option<Result<Loaded, Fault>> {
        match self.loaded.try_recv() {
            Ok(loaded) => Some(loaded),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => {
                Some(Err(Fault::Data("the clip could not be loaded: the thread that did ended early".into())))
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
