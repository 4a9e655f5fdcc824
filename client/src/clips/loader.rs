//! [`load`]: carries out a [`LoadRequest`] on the loader's thread, up to clips that can be drawn.

use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use super::event::{LoadEvent, Version};
use super::folder::Neighbours;
use super::playlist;
use super::queue::{Entry, Queue};
use crate::content::{OpenEvent, OpenTake, SourceOptions, open, title};
use crate::player::Beginning;
use crate::worker::{OnEvent, Report, apart};
use program::{Fault, counted};

/// What can show clips: a window, a headset, or images.
pub(crate) trait ClipTarget: Clone + Send + 'static {
    /// A take that is ready to be shown.
    type Ready: Send + 'static;

    /// Makes a take ready, usually by uploading what its beginning needs. Runs on the loader's thread.
    ///
    /// # Errors
    /// Why it cannot be shown.
    fn prepare(
        &self,
        entry: &Entry,
        take: Arc<OpenTake>,
        beginning: Beginning<'_>,
    ) -> Result<Self::Ready, Fault>;
}

/// How clips are loaded.
#[derive(Clone, Debug)]
pub(crate) struct LoadOptions {
    /// Where they may come from.
    pub(crate) source: SourceOptions,
    /// Layers that a version must have to be shown. A clip with fewer fails.
    pub(crate) min_layers: usize,
    /// Whether to load only complete clips, as measuring needs.
    pub(crate) is_complete: bool,
}

/// What to load.
#[derive(Debug)]
pub(super) enum Selection {
    /// Paths and URLs of clips, playlists and folders; none for the demo.
    Named(Vec<String>),
    /// The first of these that can be loaded.
    FirstOf(Vec<Entry>),
}

/// A request to the loader.
pub(super) struct LoadRequest<T: ClipTarget> {
    /// What clips are made ready for.
    pub(super) target: T,
    pub(super) selection: Selection,
    pub(super) options: LoadOptions,
    /// Whether playback is blocked on the clip. Until it is, only the complete clip is reported.
    pub(super) is_blocking: Arc<AtomicBool>,
    /// Where it will be shown first, in seconds.
    pub(super) position_s: f64,
}

/// The events of a loader for the target `T`.
pub(super) type TargetEvent<T> = LoadEvent<<T as ClipTarget>::Ready>;

/// Whether to go on, or the fault of the clip.
type Flow = Result<ControlFlow<()>, Fault>;

/// Carries out a request.
pub(super) fn load<T: ClipTarget>(
    request: LoadRequest<T>,
    report: &Report<'_, TargetEvent<T>>,
) -> ControlFlow<()> {
    let LoadRequest { target, selection, options, is_blocking, position_s } = request;
    match (Loading { options, is_blocking, position_s, target, report }).load(selection) {
        Ok(ControlFlow::Continue(())) => (report.send)(LoadEvent::Done),
        Ok(ControlFlow::Break(())) => ControlFlow::Break(()),
        Err(fault) => (report.send)(LoadEvent::Failed(fault)),
    }
}

/// What names stand for.
enum Named {
    /// The clips of playlists and folders, or several clips.
    List(Queue),
    /// A clip and its neighbours, or the demo.
    Single(Option<String>, Neighbours),
}

impl Named {
    /// Looks at what is there; `None` if `on_event` breaks.
    fn find(
        names: Vec<String>,
        source: &SourceOptions,
        on_event: OnEvent<'_, OpenEvent>,
    ) -> Result<Option<Named>, Fault> {
        if playlist::is_list(&names) {
            let opened = playlist::open(&names, source, on_event)?;
            return Ok(opened.map(|list| Named::List(Queue::new(list.clips))));
        }
        let name = names.into_iter().next();
        let neighbours = Neighbours::find(name.as_deref());
        Ok(Some(Named::Single(name, neighbours)))
    }
}

/// A request under way.
struct Loading<'a, T: ClipTarget> {
    options: LoadOptions,
    is_blocking: Arc<AtomicBool>,
    position_s: f64,
    target: T,
    report: &'a Report<'a, TargetEvent<T>>,
}

impl<T: ClipTarget> Loading<'_, T> {
    fn load(&mut self, selection: Selection) -> Flow {
        match selection {
            Selection::FirstOf(entries) => self.first_of(&entries),
            Selection::Named(names) => {
                let source = self.options.source.clone();
                let named = self.apart(move |on_event| Named::find(names, &source, on_event))?;
                let (event, entries) = match named.transpose()?.flatten() {
                    None => return Ok(ControlFlow::Break(())),
                    Some(Named::List(queue)) => {
                        let entries = queue.all();
                        (LoadEvent::Playlist(queue), entries)
                    }
                    Some(Named::Single(name, neighbours)) => {
                        (LoadEvent::Neighbours(neighbours), vec![Entry::single(name)])
                    }
                };
                if (self.report.send)(event).is_break() {
                    return Ok(ControlFlow::Break(()));
                }
                self.first_of(&entries)
            }
        }
    }

    /// Does `work`, which may wait for a disk, on a thread of its own; `None` if the request was overtaken.
    fn apart<R: Send + 'static>(
        &self,
        work: impl FnOnce(OnEvent<'_, OpenEvent>) -> R + Send + 'static,
    ) -> Result<Option<R>, Fault> {
        apart(work, &mut |event| self.pass_on(event), self.report.is_overtaken)
            .map_err(|error| Fault::Device(format!("cannot start a thread: {error}")))
    }

    /// Loads the first of `entries` that can be loaded.
    ///
    /// # Errors
    /// The fault of the last entry if all fail; why no newer version follows one that was reported.
    fn first_of(&mut self, entries: &[Entry]) -> Flow {
        for (i, entry) in entries.iter().enumerate() {
            let mut is_first = true;
            let (name, source) = (entry.name.clone(), self.options.source.clone());
            let Some(arrival) = self.apart(move |_| open(name.as_deref(), &source))? else {
                return Ok(ControlFlow::Break(()));
            };
            match arrival.and_then(|arrival| self.versions(entry, arrival, &mut is_first)) {
                Err(fault) if is_first && i + 1 < entries.len() => {
                    if (self.report.send)(LoadEvent::Skipped(fault)).is_break() {
                        return Ok(ControlFlow::Break(()));
                    }
                }
                flow => return flow,
            }
        }
        Ok(ControlFlow::Continue(()))
    }

    /// Reports the versions of a take: each one while playback is blocked on it, else the complete one only.
    fn versions(
        &mut self,
        entry: &Entry,
        events: impl Iterator<Item = Result<OpenEvent, Fault>>,
        is_first: &mut bool,
    ) -> Flow {
        // The best version, until it is reported.
        let mut latest = None;
        for event in events {
            let mut flow = ControlFlow::Continue(());
            match event? {
                OpenEvent::Take(take) => latest = Some(take),
                event => flow = self.pass_on(event),
            }
            if flow.is_continue()
                && !self.options.is_complete
                && self.is_blocking.load(Ordering::Relaxed)
                && let Some(take) = latest.take()
            {
                flow = self.version(entry, take, is_first)?;
            }
            if flow.is_break() {
                return Ok(flow);
            }
        }
        latest.map_or(Ok(ControlFlow::Continue(())), |take| self.version(entry, take, is_first))
    }

    fn version(&mut self, entry: &Entry, take: Arc<OpenTake>, is_first: &mut bool) -> Flow {
        let min_layers = self.options.min_layers;
        if take.layer_count() < min_layers {
            return Err(too_few_layers(min_layers, &title(entry.name.as_deref()), take.layer_count()));
        }
        let is_blocking = self.is_blocking.load(Ordering::Relaxed) && !self.options.is_complete;
        let is_overtaken = self.report.is_overtaken;
        let beginning = Beginning { position_s: self.position_s, is_blocking, is_overtaken };
        let clip = self.target.prepare(entry, take, beginning)?;
        let version = Version { entry: entry.clone(), is_first: *is_first, clip };
        *is_first = false;
        Ok((self.report.send)(LoadEvent::Clip(version)))
    }

    /// Passes on an event of a source that holds no clip.
    fn pass_on(&self, event: OpenEvent) -> ControlFlow<()> {
        match event {
            OpenEvent::Progress(progress) => (self.report.send)(LoadEvent::Progress(progress)),
            OpenEvent::Note(note) => (self.report.send)(LoadEvent::Note(note)),
            OpenEvent::Take(_) => ControlFlow::Continue(()),
        }
    }
}

/// The fault of a clip with fewer than the `asked` layers; `subject` is its name, and `has` its number of layers.
pub(crate) fn too_few_layers(asked: usize, subject: &str, has: usize) -> Fault {
    let has = counted(has, "layer");
    Fault::Usage(format!("--layer {asked}: {subject} has {has}: give no larger number"))
}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;
    use std::path::Path;

    use codec::Limits;

    use super::*;
    use crate::clips::folder::Direction;

    const DEMO: &[u8] = include_bytes!("../../../assets/demo.aarc");

    /// Shows clips by their number of layers, except an entry that is too large for it.
    #[derive(Clone)]
    struct Target {
        too_large: Option<usize>,
    }

    impl ClipTarget for Target {
        type Ready = usize;

        fn prepare(&self, entry: &Entry, take: Arc<OpenTake>, _: Beginning<'_>) -> Result<usize, Fault> {
            match self.too_large == Some(entry.number) {
                true => Err(Fault::Device("too large".into())),
                false => Ok(take.layer_count()),
            }
        }
    }

    fn request(
        selection: Selection,
        min_layers: usize,
        is_blocking: bool,
        target: Target,
    ) -> LoadRequest<Target> {
        let options = LoadOptions { source: SourceOptions::default(), min_layers, is_complete: false };
        let is_blocking = Arc::new(is_blocking.into());
        LoadRequest { target, selection, options, is_blocking, position_s: 0.0 }
    }

    /// The events of a request: `x` for a skipped entry, the number of a clip, `!` for its first version,
    /// and the fault.
    fn events(
        selection: Selection,
        min_layers: usize,
        is_blocking: bool,
        too_large: Option<usize>,
    ) -> String {
        let text = RefCell::new(String::new());
        let send = &|event| {
            text.borrow_mut().push_str(&match event {
                LoadEvent::Clip(Version { entry, is_first, .. }) => {
                    format!("{}{}", entry.number, if is_first { "!" } else { "" })
                }
                LoadEvent::Skipped(_) => "x".into(),
                LoadEvent::Failed(fault) => format!(" {fault}"),
                LoadEvent::Playlist(queue) => format!("{} ", queue.len()),
                LoadEvent::Done => ".".into(),
                LoadEvent::Progress(_) | LoadEvent::Note(_) | LoadEvent::Neighbours(_) => String::new(),
            });
            ControlFlow::Continue(())
        };
        let report = Report { send, is_overtaken: &|| false };
        let _ = load(request(selection, min_layers, is_blocking, Target { too_large }), &report);
        text.into_inner()
    }

    fn entries(folder: &Path, names: &[&str]) -> Vec<Entry> {
        let clips = names.iter().map(|name| folder.join(name).to_str().unwrap().to_owned()).collect();
        Queue::new(clips).all()
    }

    #[test]
    fn the_first_entry_that_loads_is_reported_and_others_are_skipped() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("good.aarc"), DEMO).unwrap();
        std::fs::write(folder.path().join("bad.aarc"), "no clip").unwrap();
        let names = ["missing.aarc", "bad.aarc", "good.aarc", "good.aarc"];
        let all = entries(folder.path(), &names);
        for is_blocking in [true, false] {
            assert_eq!(events(Selection::FirstOf(all.clone()), 1, is_blocking, None), "xx2!.");
        }
        let failed = events(Selection::FirstOf(all[..2].to_vec()), 1, true, None);
        assert!(failed.starts_with("x ") && failed.contains("bad.aarc"), "the last one is the error");
        assert_eq!(events(Selection::FirstOf(Vec::new()), 1, true, None), ".");
        let list = folder.path().join("list.json");
        std::fs::write(&list, r#"{"version": 1, "clips": ["bad.aarc", "good.aarc"]}"#).unwrap();
        let named = Selection::Named(vec![list.to_str().unwrap().into()]);
        assert_eq!(events(named, 1, true, None), "2 x1!.");
    }

    #[test]
    fn a_clip_with_too_few_layers_fails() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("a.aarc"), DEMO).unwrap();
        let layers = codec::decode(DEMO, &Limits::default()).unwrap().layers.len();
        for is_blocking in [true, false] {
            let selection = || Selection::FirstOf(entries(folder.path(), &["a.aarc"]));
            assert_eq!(events(selection(), layers, is_blocking, None), "0!.");
            let events = events(selection(), 99, is_blocking, None);
            assert!(events.starts_with(" --layer 99: a.aarc has "), "{events}");
        }
    }

    #[test]
    fn a_clip_that_cannot_be_shown_is_skipped() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("a.aarc"), DEMO).unwrap();
        let all = entries(folder.path(), &["a.aarc", "a.aarc"]);
        assert_eq!(events(Selection::FirstOf(all.clone()), 1, false, Some(0)), "x1!.");
        assert_eq!(events(Selection::FirstOf(all[..1].to_vec()), 1, false, Some(0)), " too large");
    }

    #[test]
    fn the_neighbours_of_a_clip_are_reported_before_it_is_opened() {
        let folder = tempfile::tempdir().unwrap();
        let [a, b] = ["a.aarc", "b.aarc"].map(|name| folder.path().join(name).to_str().unwrap().to_owned());
        for path in [&a, &b] {
            std::fs::write(path, "").unwrap();
        }
        let neighbours = RefCell::new(None);
        let selection = Selection::Named(vec![a.clone()]);
        let send = &|event| {
            if let LoadEvent::Neighbours(beside) = event {
                *neighbours.borrow_mut() = Some(beside);
            }
            ControlFlow::Break(())
        };
        let report = Report { send, is_overtaken: &|| false };
        let _ = load(request(selection, 1, true, Target { too_large: None }), &report);
        let neighbours = neighbours.into_inner().expect("it is the first event");
        assert_eq!(neighbours.get(Direction::Forward), Some(&b));
    }
}
