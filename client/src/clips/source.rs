//! [`open`]: a clip from a file, from a URL, or the built-in demo, as an [`Arrival`].

use std::path::{Path, PathBuf};

use codec::{Clip, Limits};
use program::Fault;

use super::demo;
use super::event::LoadEvent;
use super::file::{decode, load_file};
use super::url::is_url;
#[cfg(feature = "net")]
use crate::net::{self, Download};

/// A clip that is in memory or being downloaded. Iterating waits for the next event; it ends after the
/// complete clip or the first error.
#[derive(Debug)]
pub enum Arrival {
    /// In memory, until it is taken.
    Loaded(Option<Box<Clip>>),
    /// From the network.
    #[cfg(feature = "net")]
    Download(Box<Download>),
}

impl Iterator for Arrival {
    type Item = Result<LoadEvent, Fault>;

    fn next(&mut self) -> Option<Result<LoadEvent, Fault>> {
        match self {
            Arrival::Loaded(clip) => clip.take().map(|clip| Ok(LoadEvent::Clip(clip))),
            #[cfg(feature = "net")]
            Arrival::Download(download) => download.next(),
        }
    }
}

impl Arrival {
    /// Waits for the complete clip, or for its first version with `layers` layers. Passes every event up to
    /// then to `on_event`.
    ///
    /// # Errors
    /// Why the clip does not arrive.
    pub fn wait(
        &mut self,
        layers: Option<usize>,
        mut on_event: impl FnMut(&LoadEvent),
    ) -> Result<Clip, Fault> {
        let mut latest = None;
        for event in self {
            let event = event?;
            on_event(&event);
            if let LoadEvent::Clip(clip) = event {
                if layers.is_some_and(|layers| clip.layers.len() >= layers) {
                    return Ok(*clip);
                }
                latest = Some(clip);
            }
        }
        // A download ends with a clip or an error.
        latest.map(|clip| *clip).ok_or_else(|| Fault::Data("there is no clip".into()))
    }
}

/// Opens a clip: a path, which is read and decoded at once; a URL; or the demo clip where `name` is
/// `None`. Downloads are cached in `cache_dir`; `limits` are those of the clip.
///
/// # Errors
/// As [`load_file`]; [`Fault::Usage`] for a URL if this program was built without the feature `net`.
pub fn open(name: Option<&str>, cache_dir: Option<PathBuf>, limits: Limits) -> Result<Arrival, Fault> {
    let loaded = |clip| Arrival::Loaded(Some(Box::new(clip)));
    match name {
        None => decode(&demo::package()?, &limits)
            .map(loaded)
            .map_err(|error| Fault::Data(format!("demo clip: {error}"))),
        Some(name) if is_url(name) => download(name, cache_dir, limits),
        Some(path) => load_file(Path::new(path), &limits).map(loaded),
    }
}

/// The folder in which this user's downloads are cached; `None` if the system has no place for them.
#[cfg(not(target_os = "android"))]
pub fn cache_dir() -> Option<PathBuf> {
    #[cfg(feature = "net")]
    return crate::folders::cache().map(|folder| folder.join("clips"));
    #[cfg(not(feature = "net"))]
    return None;
}

#[cfg(feature = "net")]
fn download(url: &str, cache_dir: Option<PathBuf>, limits: Limits) -> Result<Arrival, Fault> {
    let options = net::Options { limits, ..net_options(cache_dir) };
    Ok(Arrival::Download(Box::new(Download::new(url, options))))
}

/// Options of downloads that are cached in `cache_dir`.
#[cfg(feature = "net")]
pub(super) fn net_options(cache_dir: Option<PathBuf>) -> net::Options {
    let cache = cache_dir.map(|folder| net::Cache::new(&folder, net::CACHE_BYTES));
    net::Options { cache, ..net::Options::default() }
}

#[cfg(not(feature = "net"))]
fn download(url: &str, _cache_dir: Option<PathBuf>, _limits: Limits) -> Result<Arrival, Fault> {
    Err(no_net(url))
}

/// The fault of a program that was built without the feature `net`.
#[cfg(not(feature = "net"))]
pub(super) fn no_net(url: &str) -> Fault {
    Fault::Usage(format!("{url}: built without URLs: download it first, or build with the feature net"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_demo_clip_plays_and_offers_viewpoints() {
        let clip = open(None, None, Limits::default()).unwrap().wait(None, |_| ()).unwrap();
        assert!(
            !clip.dynamic_field.is_empty() && clip.info.duration_s > 0.0 && !clip.info.viewpoints.is_empty()
        );
    }

    #[test]
    fn a_url_is_not_fetched_before_it_is_iterated() {
        let opened = open(Some("http://a/b.aarc"), None, Limits::default());
        if cfg!(feature = "net") {
            assert!(!matches!(opened.unwrap(), Arrival::Loaded(_)), "nothing is fetched yet");
        } else {
            assert!(matches!(opened, Err(Fault::Usage(_))));
        }
    }
}
