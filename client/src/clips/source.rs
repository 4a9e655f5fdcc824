//! [`open`]: a clip from a file, from a URL, or the built-in demo, as an [`Arrival`].

use std::path::Path;
use std::sync::Arc;

use codec::Limits;
use program::Fault;

use super::content::Content;
use super::demo;
use super::event::{ClipVersion, LoadEvent};
#[cfg(feature = "import")]
use super::field;
use super::file::{decode, load_version, truncation};
use super::source_options::SourceOptions;
use super::url::{UNKNOWN_SCHEME, is_url, redacted, scheme};
#[cfg(feature = "net")]
use crate::net::{self, Download};
use crate::takes::OpenTake;

/// A clip that is in memory or being downloaded, or a take. Iterating waits for the next event; it ends after the
/// complete clip or the first error.
#[derive(Debug)]
pub enum Arrival {
    /// In memory, until it is taken, after what there is to say of it.
    Loaded {
        /// A remark for the viewer.
        note: Option<String>,
        /// The clip.
        clip: Option<ClipVersion>,
    },
    /// A take, until it is taken, after what there is to say of it.
    Take {
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
    type Item = Result<LoadEvent, Fault>;

    fn next(&mut self) -> Option<Result<LoadEvent, Fault>> {
        match self {
            Arrival::Loaded { note, clip } => {
                let note = note.take().map(LoadEvent::Note);
                note.or_else(|| clip.take().map(LoadEvent::Clip)).map(Ok)
            }
            Arrival::Take { note, take } => {
                let note = note.take().map(LoadEvent::Note);
                note.or_else(|| take.take().map(LoadEvent::Take)).map(Ok)
            }
            #[cfg(feature = "net")]
            Arrival::Download(download) => download.next(),
        }
    }
}

impl Arrival {
    /// Waits for the complete clip, or for its first version with `layers` layers, or for a take. Passes every event
    /// up to then to `on_event`.
    ///
    /// # Errors
    /// Why the clip does not arrive.
    pub fn wait(
        &mut self,
        layers: Option<usize>,
        mut on_event: impl FnMut(&LoadEvent),
    ) -> Result<Content, Fault> {
        let mut latest = None;
        for event in self {
            let event = event?;
            on_event(&event);
            match event {
                LoadEvent::Clip(clip) => {
                    let is_enough = layers.is_some_and(|layers| clip.clip.layers.len() >= layers);
                    let clip = Content::Clip(clip);
                    if is_enough {
                        return Ok(clip);
                    }
                    latest = Some(clip);
                }
                LoadEvent::Take(take) => latest = Some(Content::Take(take)),
                _ => {}
            }
        }
        // A download ends with a clip or an error.
        latest.ok_or_else(|| Fault::Defect("no clip came: report this defect of the player".into()))
    }
}

/// Opens a clip: a path, which is read and decoded at once; a URL; or the demo clip where `name` is
/// `None`. With the feature `import`, a path may also name a field in the format of another program.
///
/// # Errors
/// As [`load_file`](super::file::load_file); [`Fault::Usage`] for a URL if this program was built without the feature `net`, or if
/// its scheme is another one.
pub fn open(name: Option<&str>, options: &SourceOptions) -> Result<Arrival, Fault> {
    let loaded = |note, clip| Arrival::Loaded { note, clip: Some(clip) };
    match name {
        None => decode(&demo::package()?, &options.limits)
            .map(|clip| loaded(None, ClipVersion::bare(clip)))
            .map_err(|error| Fault::Defect(format!("demo clip: {error}: install the player again"))),
        Some(name) if is_url(name) => download(name, options),
        Some(url) if scheme(url).is_some() => {
            Err(Fault::Usage(format!("{}: {UNKNOWN_SCHEME}", redacted(url))))
        }
        Some(path) => {
            let path = Path::new(path);
            #[cfg(feature = "import")]
            if field::is_field(path) {
                let field = field::load_field(path, &options.limits);
                return field.map(|(clip, note)| loaded(note, ClipVersion::bare(clip)));
            }
            if let Some(take) = open_take(path, &options.limits)? {
                return Ok(Arrival::Take { note: take.truncation(), take: Some(Arc::new(take)) });
            }
            load_version(path, &options.limits)
                .map(|version| loaded(truncation(path, &version.clip), version))
        }
    }
}

/// Opens a file if it is a take. What is wrong with other files, [`load_file`](super::file::load_file) says.
fn open_take(path: &Path, limits: &Limits) -> Result<Option<OpenTake>, Fault> {
    if path.is_file() { OpenTake::open(path, limits) } else { Ok(None) }
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
pub(super) fn net_options(options: &SourceOptions) -> net::Options {
    let cache = options.cache_dir.as_ref().map(|folder| net::Cache::new(folder, net::CACHE_BYTES));
    net::Options { cache, limits: options.limits, ..net::Options::default() }
}

#[cfg(not(feature = "net"))]
fn download(url: &str, _options: &SourceOptions) -> Result<Arrival, Fault> {
    Err(no_net(url))
}

/// The fault of a program that was built without the feature `net`.
#[cfg(not(feature = "net"))]
pub(super) fn no_net(url: &str) -> Fault {
    let url = redacted(url);
    Fault::Usage(format!("{url}: built without URLs: download it first, or build with the feature net"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_fields::{ball, field, package, sky, y_up};

    #[test]
    fn the_demo_clip_plays_and_offers_viewpoints() {
        let clip = open(None, &SourceOptions::default()).unwrap().wait(None, |_| ()).unwrap();
        assert!(!clip.is_static() && clip.duration_s() > 0.0 && !clip.info().viewpoints.is_empty());
    }

    #[test]
    fn a_clip_without_viewpoints_opens_with_its_content_in_view() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.aarc");
        let rows = [ball(), sky(30.0)].concat();
        std::fs::write(&path, package(&y_up(), &field(&rows))).unwrap();
        let clip = open(path.to_str(), &SourceOptions::default()).unwrap().wait(None, |_| ()).unwrap();
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
            assert!(!matches!(opened.unwrap(), Arrival::Loaded { .. }), "nothing is fetched yet");
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
