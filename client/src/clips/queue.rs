//! [`Queue`]: which clip of a playlist plays and which comes next; [`List`], which holds the next one
//! ready; and [`bring`], which has one of them brought while another plays.

use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use codec::Clip;
use program::Fault;

use super::event::LoadEvent;
use super::playlist::Playlist;
use super::progress::Progress;
use super::{source, url};

/// A clip of a playlist, or one that is named alone.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Entry {
    /// Its number in the playlist, from 0.
    pub(crate) number: usize,
    /// Its path or address; `None` for the demo.
    pub(crate) name: Option<String>,
}

impl Entry {
    /// A clip alone.
    pub(crate) fn alone(name: Option<String>) -> Entry {
        Entry { number: 0, name }
    }
}

/// A playlist and where it stands.
#[derive(Clone, Debug)]
pub(crate) struct Queue {
    clips: Arc<[String]>,
    at: usize,
}

impl Queue {
    /// Of a playlist, which stands at its first clip.
    pub(crate) fn new(playlist: Playlist) -> Queue {
        Queue { clips: playlist.clips.into(), at: 0 }
    }

    /// Number of clips.
    pub(crate) fn len(&self) -> usize {
        self.clips.len()
    }

    /// Goes to a clip.
    pub(crate) fn go_to(&mut self, number: usize) {
        self.at = number.min(self.clips.len() - 1);
    }

    /// All clips, in the order in which they are tried at the start.
    pub(crate) fn all(&self) -> Vec<Entry> {
        (0..self.len()).map(|number| self.entry(number)).collect()
    }

    /// The clips that may come after the one that it stands at, in the order in which they are tried:
    /// all others, the first after the last.
    pub(crate) fn others(&self) -> Vec<Entry> {
        (1..self.len()).map(|step| self.entry((self.at + step) % self.len())).collect()
    }

    /// Whether clip `next` plays after the one that it stands at.
    pub(crate) fn goes_on_to(&self, next: usize, looping: bool) -> bool {
        looping || next > self.at
    }

    fn entry(&self, number: usize) -> Entry {
        Entry { number, name: Some(self.clips[number].clone()) }
    }
}

/// A playlist that is being played, and the next clip, as a display keeps it: at most one besides the one
/// that plays.
pub(crate) struct List<P> {
    queue: Queue,
    next: Next<P>,
}

/// How the next clip stands.
enum Next<P> {
    /// It was not asked for yet.
    Unasked,
    /// It is on its way; whether somebody waits for it.
    Coming(Arc<AtomicBool>),
    /// It is here, with its number.
    Ready(usize, P),
    /// None can be had, until the one that plays starts over.
    None,
}

impl<P> List<P> {
    /// Of a playlist of which one clip plays, the one that it stands at.
    pub(crate) fn new(queue: Queue) -> List<P> {
        List { queue, next: Next::Unasked }
    }

    /// Those to bring the next clip from, and where to say that it is waited for; once for each clip.
    pub(crate) fn ask(&mut self) -> Option<(Vec<Entry>, Arc<AtomicBool>)> {
        let Next::Unasked = self.next else { return None };
        let entries = self.queue.others();
        if entries.is_empty() {
            self.next = Next::None;
            return None;
        }
        let awaited = Arc::<AtomicBool>::default();
        self.next = Next::Coming(awaited.clone());
        Some((entries, awaited))
    }

    /// Whether the next clip is on its way.
    pub(crate) fn is_coming(&self) -> bool {
        matches!(self.next, Next::Coming(_))
    }

    /// Whether somebody waits for the next clip.
    #[cfg(feature = "xr")]
    pub(crate) fn is_awaited(&self) -> bool {
        matches!(&self.next, Next::Coming(awaited) if awaited.load(Ordering::Relaxed))
    }

    /// Whether there is a next clip, as far as is known.
    #[cfg(feature = "xr")]
    pub(crate) fn has_next(&self) -> bool {
        self.queue.len() > 1 && !matches!(self.next, Next::None)
    }

    /// Notes that another clip plays, of which the next one was not asked for yet.
    #[cfg(feature = "xr")]
    pub(crate) fn go_to(&mut self, number: usize) {
        self.queue.go_to(number);
        self.next = Next::Unasked;
    }

    /// Takes the next clip in.
    pub(crate) fn put(&mut self, number: usize, clip: P) {
        self.next = Next::Ready(number, clip);
    }

    /// The next clip, if it is ready.
    pub(crate) fn ready(&mut self) -> Option<&mut P> {
        if let Next::Ready(_, clip) = &mut self.next { Some(clip) } else { None }
    }

    /// No more comes of what was asked for.
    pub(crate) fn finish(&mut self) {
        if let Next::Coming(_) = self.next {
            self.next = Next::None;
        }
    }

    /// Notes that the clip that plays starts over: if no other could be had, they may be asked for again.
    pub(crate) fn start_over(&mut self) {
        if let Next::None = self.next {
            self.next = Next::Unasked;
        }
    }

    /// Forgets the next clip, which may be asked for again.
    #[cfg(any(feature = "window", feature = "xr", test))]
    pub(crate) fn forget_next(&mut self) {
        self.next = Next::Unasked;
    }

    /// Goes on to the next clip, if it is ready.
    pub(crate) fn take(&mut self) -> Option<P> {
        match std::mem::replace(&mut self.next, Next::Unasked) {
            Next::Ready(number, clip) => {
                self.queue.go_to(number);
                Some(clip)
            }
            next => {
                self.next = next;
                None
            }
        }
    }

    /// Notes that somebody waits for the next clip; whether that is news.
    pub(crate) fn awaits(&self) -> bool {
        if let Next::Coming(awaited) = &self.next { !awaited.swap(true, Ordering::Relaxed) } else { false }
    }

    /// Whether the clip that plays waits at its end for the next one. One of which the rest is still on its
    /// way does not if it loops: that may take long.
    pub(crate) fn goes_on(&self, looping: bool) -> bool {
        let next = (self.queue.at + 1) % self.queue.len();
        match &self.next {
            Next::Unasked => !looping && self.queue.goes_on_to(next, looping),
            Next::Coming(_) => self.queue.goes_on_to(next, looping),
            Next::Ready(number, _) => self.queue.goes_on_to(*number, looping),
            Next::None => false,
        }
    }

    /// The clip that plays, among all, in words.
    #[cfg(any(feature = "window", test))]
    pub(crate) fn place(&self) -> String {
        format!("{} of {}", self.queue.at + 1, self.queue.len())
    }
}

/// What is told while a clip is brought.
pub(crate) enum Brought {
    Progress(Progress),
    Note(String),
    /// One could not be had.
    Skipped(Fault),
    /// The clip `entry`, the first version of it or a better one.
    Clip {
        entry: Entry,
        clip: Box<Clip>,
        first: bool,
    },
}

/// Is told what is brought, and says whether to go on.
pub(crate) type Tell<'a> = &'a mut dyn FnMut(Brought) -> Result<ControlFlow<()>, Fault>;

/// How clips are brought.
#[derive(Clone, Debug)]
pub(crate) struct Terms {
    /// The folder in which clips from the network are kept.
    pub(crate) kept: Option<PathBuf>,
    /// Layers without which a clip is not to be shown; `None` if all are needed. One that has not as many
    /// cannot be had.
    pub(crate) layers: Option<usize>,
    /// Whether somebody waits for the clip: before that, only the whole one is told.
    pub(crate) awaited: Arc<AtomicBool>,
}

/// Brings the first of `entries` that can be had, from their first one on.
///
/// # Errors
/// Why the last one could not be had, if none could; what `tell` reports of a clip counts as that. Also
/// why no better version follows of one that was told.
pub(crate) fn bring(entries: &[Entry], terms: &Terms, tell: Tell<'_>) -> Result<ControlFlow<()>, Fault> {
    for (i, entry) in entries.iter().enumerate() {
        let mut first = true;
        match bring_one(entry, terms, &mut first, tell) {
            Err(fault) if first && i + 1 < entries.len() => {
                if tell(Brought::Skipped(fault))?.is_break() {
                    return Ok(ControlFlow::Break(()));
                }
            }
            result => return result,
        }
    }
    Ok(ControlFlow::Continue(()))
}

fn bring_one(
    entry: &Entry,
    terms: &Terms,
    first: &mut bool,
    tell: Tell<'_>,
) -> Result<ControlFlow<()>, Fault> {
    // The best version, if it was not told yet.
    let mut latest: Option<Box<Clip>> = None;
    let mut tell_version = |clip, tell: Tell<'_>| {
        let flow = tell(Brought::Clip { entry: entry.clone(), clip, first: *first })?;
        *first = false;
        Ok(flow)
    };
    for news in source::open(entry.name.as_deref(), terms.kept.clone())? {
        let mut flow = ControlFlow::Continue(());
        match news? {
            LoadEvent::Progress(progress) => flow = tell(Brought::Progress(progress))?,
            LoadEvent::Note(note) => flow = tell(Brought::Note(note))?,
            LoadEvent::Clip(clip) => latest = Some(clip),
        }
        let is_enough = |clip: &mut Box<Clip>| terms.layers.is_some_and(|layers| clip.layers.len() >= layers);
        if flow.is_continue()
            && terms.awaited.load(Ordering::Relaxed)
            && let Some(clip) = latest.take_if(is_enough)
        {
            flow = tell_version(clip, tell)?;
        }
        if flow.is_break() {
            return Ok(flow);
        }
    }
    match latest {
        Some(clip) => {
            let there = clip.layers.len();
            if let Some(layers) = terms.layers.filter(|&layers| layers > there) {
                let title = url::title(entry.name.as_deref());
                return Err(Fault::Usage(format!("--layer {layers}: {title} has {there} layers")));
            }
            tell_version(clip, tell)
        }
        None => Ok(ControlFlow::Continue(())),
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    const DEMO: &[u8] = include_bytes!("../../../assets/demo.aarc");

    fn queue(folder: &Path, names: &[&str]) -> Queue {
        let clips = names.iter().map(|name| folder.join(name).to_str().unwrap().to_owned()).collect();
        Queue::new(Playlist { clips })
    }

    fn numbers(entries: &[Entry]) -> Vec<usize> {
        entries.iter().map(|entry| entry.number).collect()
    }

    #[test]
    fn after_the_last_comes_the_first_if_it_loops() {
        let mut queue = queue(Path::new(""), &["a", "b", "c"]);
        assert_eq!((numbers(&queue.all()), numbers(&queue.others())), (vec![0, 1, 2], vec![1, 2]));
        queue.go_to(2);
        assert_eq!(numbers(&queue.others()), [0, 1]);
        assert!(queue.goes_on_to(0, true) && !queue.goes_on_to(0, false));
        queue.go_to(1);
        assert!(queue.goes_on_to(2, false));
        assert_eq!(queue.others()[0].name.as_deref(), Some("c"));
    }

    #[test]
    fn a_list_asks_for_the_next_clip_once_and_goes_on_with_it() {
        let mut list = List::new(queue(Path::new(""), &["a", "b", "c"]));
        assert!(list.goes_on(false) && !list.goes_on(true) && !list.awaits(), "nothing was asked for");
        let (entries, awaited) = list.ask().unwrap();
        assert_eq!(numbers(&entries), [1, 2]);
        assert!(list.ask().is_none() && list.goes_on(true) && list.take().is_none());
        assert!(list.awaits() && !list.awaits() && awaited.load(Ordering::Relaxed));
        list.put(2, "c");
        *list.ready().unwrap() = "a better c";
        list.finish();
        assert!(list.goes_on(false) && list.ask().is_none());
        assert_eq!((list.take(), list.place().as_str()), (Some("a better c"), "3 of 3"));
        assert!(!list.goes_on(false), "that was the last one");
        assert_eq!(numbers(&list.ask().unwrap().0), [0, 1]);
        assert!(!list.goes_on(false) && list.goes_on(true));
        list.finish();
        assert!(!list.goes_on(true) && list.ask().is_none(), "no other can be had");
        list.start_over();
        assert_eq!(numbers(&list.ask().unwrap().0), [0, 1], "they are tried again the next time round");
        list.start_over();
        assert!(list.is_coming() && list.ask().is_none(), "they are on their way");
        list.forget_next();
        assert!(list.ask().is_some());
        let mut single = List::<()>::new(queue(Path::new(""), &["a"]));
        assert!(single.ask().is_none() && !single.goes_on(true) && !single.goes_on(false));
    }

    /// What is told of bringing these, `x` for a clip that was skipped.
    fn told(entries: &[Entry], awaited: bool) -> (String, Result<ControlFlow<()>, Fault>) {
        let terms = Terms { kept: None, layers: Some(1), awaited: Arc::new(awaited.into()) };
        let mut told = String::new();
        let result = bring(entries, &terms, &mut |brought| {
            match brought {
                Brought::Clip { entry, first, .. } => {
                    told.push_str(&format!("{}{}", entry.number, if first { "!" } else { "" }));
                }
                Brought::Skipped(_) => told.push('x'),
                Brought::Progress(_) | Brought::Note(_) => {}
            }
            Ok(ControlFlow::Continue(()))
        });
        (told, result)
    }

    #[test]
    fn the_first_that_can_be_had_is_brought_and_others_are_told() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("good.aarc"), DEMO).unwrap();
        std::fs::write(folder.path().join("bad.aarc"), "no clip").unwrap();
        let queue = queue(folder.path(), &["missing.aarc", "bad.aarc", "good.aarc", "good.aarc"]);
        for awaited in [true, false] {
            let (text, result) = told(&queue.all(), awaited);
            assert_eq!((text.as_str(), result), ("xx2!", Ok(ControlFlow::Continue(()))));
        }
        let (text, result) = told(&queue.all()[..2], true);
        assert_eq!(text, "x", "the last one is the error");
        assert!(matches!(result, Err(Fault::Data(why)) if why.contains("bad.aarc")));
        assert!(told(&[], true).1.is_ok(), "there is nothing to bring");
    }

    #[test]
    fn one_without_the_layers_asked_for_cannot_be_had() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("a.aarc"), DEMO).unwrap();
        let queue = queue(folder.path(), &["a.aarc"]);
        for awaited in [true, false] {
            let terms = Terms { kept: None, layers: Some(99), awaited: Arc::new(awaited.into()) };
            let result = bring(&queue.all(), &terms, &mut |brought| {
                assert!(!matches!(brought, Brought::Clip { .. }));
                Ok(ControlFlow::Continue(()))
            });
            assert!(matches!(result, Err(Fault::Usage(why)) if why.starts_with("--layer 99: a.aarc has ")));
        }
    }

    #[test]
    fn one_that_cannot_be_shown_is_skipped() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("a.aarc"), DEMO).unwrap();
        let queue = queue(folder.path(), &["a.aarc", "a.aarc"]);
        let terms = Terms { kept: None, layers: None, awaited: Arc::default() };
        let mut skipped = 0;
        let result = bring(&queue.all(), &terms, &mut |brought| match brought {
            Brought::Clip { entry, .. } if entry.number == 0 => Err(Fault::Device("too large".into())),
            Brought::Skipped(fault) => {
                assert_eq!(fault, Fault::Device("too large".into()));
                skipped += 1;
                Ok(ControlFlow::Continue(()))
            }
            _ => Ok(ControlFlow::Continue(())),
        });
        assert_eq!((result, skipped), (Ok(ControlFlow::Continue(())), 1));
    }
}
