//! [`open`]: a take from a file, from a URL, or the built-in demo, as an [`Arrival`].

use std::path::Path;
use std::sync::Arc;

use program::Fault;

use super::demo;
#[cfg(feature = "net")]
use super::download::Download;
use super::event::OpenEvent;
#[cfg(feature = "formats")]
use super::field;
use super::opened::OpenTake;
use super::source::TakeSource;
use super::source_options::SourceOptions;
#[cfg(feature = "net")]
use super::transfer::{CACHE_BYTES, Cache, Options};
use super::url::{UNKNOWN_SCHEME, is_url, redacted, scheme};

/// A take that is open or being downloaded. Iterating waits for the next event; it ends after the complete file or the
/// first error.
#[derive(Debug)]
pub enum Arrival {
    /// Open, until it is taken, after what there is to say of it.
    Open {
        /// A remark for the viewer.
        note: Option<String>,
        /// The take.
        take: Option<Arc<OpenTake>>,
    },
    /// From the network.
    #[cfg(feature = "net")]
    Download(Box<Download>),
}

impl Iterator for Arrival {
    type Item = Result<OpenEvent, Fault>;

    fn next(&mut self) -> Option<Result<OpenEvent, Fault>> {
        match self {
            Arrival::Open { note, take } => {
                let note = note.take().map(OpenEvent::Note);
                note.or_else(|| take.take().map(OpenEvent::Take)).map(Ok)
            }
            #[cfg(feature = "net")]
            Arrival::Download(download) => download.next(),
        }
    }
}

impl Arrival {
    /// Waits for the complete file, unless it is read in parts. Passes every event up to then to `on_event`.
    ///
    /// # Errors
    /// Why it does not arrive.
    pub fn wait(&mut self, mut on_event: impl FnMut(&OpenEvent)) -> Result<Arc<OpenTake>, Fault> {
        let mut latest = None;
        for event in self {
            let event = event?;
            on_event(&event);
            if let OpenEvent::Take(take) = event {
                latest = Some(take);
            }
        }
        // A download ends with a take or an error.
        latest.ok_or_else(|| Fault::Defect("no clip came: report this defect of the player".into()))
    }
}

/// Opens a clip or a take: a path, whose head is read at once; a URL; or the demo where `name` is
/// `None`. With the feature `formats`, a path may also name a field in the format of another program.
///
/// # Errors
/// As [`OpenTake::open`]; [`Fault::Usage`] for a URL if this program was built without the feature `net`, or if
/// its scheme is another one.
pub fn open(name: Option<&str>, options: &SourceOptions) -> Result<Arrival, Fault> {
    let limits = &options.limits;
    let opened = |note: Option<String>, take| Arrival::Open { note, take: Some(Arc::new(take)) };
    match name {
        None => OpenTake::from_source(TakeSource::Memory("demo clip".into(), demo::package()?), limits)
            .map(|take| opened(None, take))
            .map_err(|fault| Fault::Defect(format!("{fault}: install the player again"))),
        Some(name) if is_url(name) => download(name, options),
        Some(url) if scheme(url).is_some() => {
            Err(Fault::Usage(format!("{}: {UNKNOWN_SCHEME}", redacted(url))))
        }
        Some(name) => {
            let path = Path::new(name);
            #[cfg(feature = "formats")]
            if field::is_field(path) {
                let (clip, note) = field::load_field(path, options)?;
                return Ok(opened(note, OpenTake::from_clip(name.into(), clip, limits)?));
            }
            OpenTake::open(path, limits).map(|take| opened(take.truncation(), take))
        }
    }
}

/// The folder in which this user's downloads are cached; `None` if the system has no place for them.
#[cfg(not(target_os = "android"))]
pub fn cache_dir() -> Option<std::path::PathBuf> {
    #[cfg(feature = "net")]
    return crate::folders::cache().map(|folder| folder.join("clips"));
    #[cfg(not(feature = "net"))]
    return None;
}

#[cfg(feature = "net")]
fn download(url: &str, options: &SourceOptions) -> Result<Arrival, Fault> {
    Ok(Arrival::Download(Box::new(Download::new(url, net_options(options)))))
}

/// The options of a download.
#[cfg(feature = "net")]
pub(crate) fn net_options(options: &SourceOptions) -> Options {
    let cache = options.cache_dir.as_ref().map(|folder| Cache::new(folder, CACHE_BYTES));
    Options { cache, limits: options.limits, ..Options::default() }
}

#[cfg(not(feature = "net"))]
fn download(url: &str, _options: &SourceOptions) -> Result<Arrival, Fault> {
    Err(no_net(url))
}

/// The fault of a program that was built without the feature `net`.
#[cfg(not(feature = "net"))]
pub(crate) fn no_net(url: &str) -> Fault {
    let url = redacted(url);
    Fault::Usage(format!("{url}: built without URLs: download it first, or build with the feature net"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_fields::{ball, field, package, sky, y_up};

    #[test]
    fn the_demo_clip_plays_and_offers_viewpoints() {
        let clip = open(None, &SourceOptions::default()).unwrap().wait(|_| ()).unwrap();
        assert!(!clip.is_static() && clip.duration_s() > 0.0 && !clip.info().viewpoints.is_empty());
    }

    #[test]
    fn a_clip_without_viewpoints_opens_with_its_content_in_view() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.aarc");
        let rows = [ball(), sky(30.0)].concat();
        std::fs::write(&path, package(&y_up(), &field(&rows))).unwrap();
        let clip = open(path.to_str(), &SourceOptions::default()).unwrap().wait(|_| ()).unwrap();
        let [opening] = &clip.info().viewpoints[..] else { panic!("{:?}", clip.info().viewpoints) };
        let camera = opening.camera(clip.info().up, 100, 100);
        let [x, y, depth] = camera.camera_from_world[..3] else { unreachable!("it has three rows") };
        assert!(
            x[3].abs() < 0.2 && y[3].abs() < 0.2,
            "the ball around the origin is in the middle: {opening:?}"
        );
        let radius = camera.k[1][1] / depth[3];
        assert!((30.0..55.0).contains(&radius), "the ball fills the view: {radius} pixels of 50");
    }

    #[test]
    fn a_url_is_not_fetched_before_it_is_iterated() {
        let opened = open(Some("http://a/b.aarc"), &SourceOptions::default());
        if cfg!(feature = "net") {
            assert!(!matches!(opened.unwrap(), Arrival::Open { .. }), "nothing is fetched yet");
        } else {
            assert!(matches!(opened, Err(Fault::Usage(_))));
        }
    }

    #[test]
    fn other_urls_are_no_paths() {
        let opened = open(Some("ftp://ann:key@a/b.aarc?key"), &SourceOptions::default());
        let Err(Fault::Usage(message)) = opened else { panic!("{opened:?}") };
        assert!(message.starts_with("ftp://a/b.aarc: ") && message.contains("http://"), "{message}");
        assert!(!message.contains("key"), "{message}");
    }
}
