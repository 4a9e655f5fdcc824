//! Where clips come from: files, addresses, and the demo clip that is built in.

#[cfg(not(target_os = "android"))]
use std::borrow::Cow;
use std::fs::File;
use std::io::Read;
use std::num::NonZero;
use std::path::{Path, PathBuf};
use std::thread;

use codec::{Clip, Error, Limits, decode_parallel};

use crate::fault::Fault;
#[cfg(feature = "net")]
use crate::net::{self, Download};
use crate::progress::Progress;
#[cfg(target_os = "android")]
use crate::xr::demo;

/// The clip that plays when none is named.
#[cfg(not(target_os = "android"))]
fn demo() -> Result<Cow<'static, [u8]>, Fault> {
    Ok(Cow::Borrowed(include_bytes!("../../assets/demo.aarc")))
}

/// What is told of a clip on its way.
#[derive(Debug)]
pub enum News {
    /// How much of it has arrived.
    Progress(Progress),
    /// Something to know.
    Note(String),
    /// A clip that plays. Better ones may follow, the last one is the best.
    Clip(Box<Clip>),
}

/// A clip that is here, or on its way: iterating waits for news of it, and ends after the whole
/// clip or the first error.
#[derive(Debug)]
pub enum Arrival {
    /// Until it was asked for.
    Here(Option<Box<Clip>>),
    /// By the network.
    #[cfg(feature = "net")]
    Download(Box<Download>),
}

impl Iterator for Arrival {
    type Item = Result<News, Fault>;

    fn next(&mut self) -> Option<Result<News, Fault>> {
        match self {
            Arrival::Here(clip) => clip.take().map(|clip| Ok(News::Clip(clip))),
            #[cfg(feature = "net")]
            Arrival::Download(download) => download.next(),
        }
    }
}

impl Arrival {
    /// Waits for the whole clip, or for the first one with `layers` layers, and tells all news until
    /// then.
    ///
    /// # Errors
    /// If it does not come.
    pub fn wait(&mut self, layers: Option<usize>, mut tell: impl FnMut(&News)) -> Result<Clip, Fault> {
        let mut latest = None;
        for news in self {
            let news = news?;
            tell(&news);
            if let News::Clip(clip) = news {
                if layers.is_some_and(|layers| clip.layers.len() >= layers) {
                    return Ok(*clip);
                }
                latest = Some(clip);
            }
        }
        // What can be downloaded ends with a clip or an error.
        latest.map(|clip| *clip).ok_or_else(|| Fault::Data("there is no clip".into()))
    }
}

/// Opens the clip named on the command line: a path, which is read and decoded at once, or an
/// address; without a name the demo clip. Clips from the network are kept in the folder `kept`.
///
/// # Errors
/// As [`load_file`]; [`Fault::Usage`] for an address where this program was built without them.
pub fn open(name: Option<&str>, kept: Option<PathBuf>) -> Result<Arrival, Fault> {
    let here = |clip| Arrival::Here(Some(Box::new(clip)));
    match name {
        None => decode(&demo()?, &Limits::default())
            .map(here)
            .map_err(|error| Fault::Data(format!("demo clip: {error}"))),
        Some(name) if is_address(name) => download(name, kept),
        Some(path) => load_file(Path::new(path)).map(here),
    }
}

/// Where this user keeps clips from the network, if there is a place for them.
#[cfg(not(target_os = "android"))]
pub fn kept() -> Option<PathBuf> {
    #[cfg(feature = "net")]
    return crate::folders::cache().map(|folder| folder.join("clips"));
    #[cfg(not(feature = "net"))]
    return None;
}

#[cfg(feature = "net")]
fn download(url: &str, kept: Option<PathBuf>) -> Result<Arrival, Fault> {
    Ok(Arrival::Download(Box::new(Download::new(url, net_options(kept)))))
}

/// How files are fetched that are kept in the folder `kept`.
#[cfg(feature = "net")]
pub(crate) fn net_options(kept: Option<PathBuf>) -> net::Options {
    let cache = kept.map(|folder| net::Cache::new(&folder, net::CACHE_BYTES));
    net::Options { cache, ..net::Options::default() }
}

#[cfg(not(feature = "net"))]
fn download(url: &str, _kept: Option<PathBuf>) -> Result<Arrival, Fault> {
    Err(no_addresses(url))
}

/// Why nothing is fetched.
#[cfg(not(feature = "net"))]
pub(crate) fn no_addresses(url: &str) -> Fault {
    Fault::Usage(format!("{url}: built without addresses: download it first, or build with the feature net"))
}

/// Whether a name is an address, and not a path.
pub(crate) fn is_address(name: &str) -> bool {
    let starts = |scheme: &str| name.get(..scheme.len()).is_some_and(|s| s.eq_ignore_ascii_case(scheme));
    starts("http://") || starts("https://")
}

/// An address as it may be shown: without what may be secret in it, name, password and query.
pub(crate) fn shown(url: &str) -> String {
    let url = url.split(['?', '#']).next().unwrap_or_default();
    let Some((scheme, rest)) = url.split_once("://") else { return url.into() };
    let (host, path) = rest.split_at(rest.find('/').unwrap_or(rest.len()));
    format!("{scheme}://{}{path}", host.rsplit('@').next().unwrap_or_default())
}

/// What a clip is called: by its file, without a name the demo clip.
#[cfg(any(feature = "window", feature = "xr"))]
pub(crate) fn title(name: Option<&str>) -> String {
    let Some(name) = name else { return "demo".into() };
    let path = if is_address(name) { shown(name) } else { name.to_owned() };
    let file = Path::new(&path).file_name().map(|file| file.to_string_lossy().into_owned());
    file.unwrap_or(path)
}

/// The clips in a folder, by name.
#[cfg(feature = "xr")]
pub(crate) fn clips_in(folder: &Path) -> Vec<std::path::PathBuf> {
    let entries = folder.read_dir().into_iter().flatten().flatten();
    let mut clips: Vec<_> = entries
        .map(|entry| entry.path())
        .filter(|path| path.extension().is_some_and(|end| end == "aarc"))
        .collect();
    clips.sort();
    clips
}

/// Reads and decodes a package.
///
/// # Errors
/// [`Fault::Data`] that names the file and says what is wrong with it.
pub fn load_file(path: &Path) -> Result<Clip, Fault> {
    let limits = Limits::default();
    let fault = |what: String| Fault::Data(format!("{}: {what}", path.display()));
    if path.is_dir() {
        return Err(fault("is a folder: name an .aarc file".into()));
    }
    let bytes = read(path, limits.max_bytes).map_err(fault)?;
    decode(&bytes, &limits).map_err(|error| fault(error.to_string()))
}

/// The contents of a file of at most so many bytes.
///
/// # Errors
/// What the system says, or that there is more of it.
pub(crate) fn read(path: &Path, most: usize) -> Result<Vec<u8>, String> {
    let file = File::open(path).map_err(|error| error.to_string())?;
    let mut bytes = Vec::new();
    file.take(most as u64 + 1).read_to_end(&mut bytes).map_err(|error| error.to_string())?;
    if bytes.len() > most {
        return Err(format!("larger than {} MiB, the most that is read", most >> 20));
    }
    Ok(bytes)
}

/// Decodes a package on all cores.
pub(crate) fn decode(bytes: &[u8], limits: &Limits) -> Result<Clip, Error> {
    let threads = thread::available_parallelism().unwrap_or(NonZero::<usize>::MIN);
    decode_parallel(bytes, limits, threads)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_demo_clip_plays_and_offers_viewpoints() {
        let clip = open(None, None).unwrap().wait(None, |_| ()).unwrap();
        assert!(
            !clip.dynamic_field.is_empty() && clip.info.duration_s > 0.0 && !clip.info.viewpoints.is_empty()
        );
    }

    #[cfg(any(feature = "window", feature = "xr"))]
    #[test]
    fn a_clip_is_called_by_its_file() {
        assert_eq!(title(Some("a/b/clip.aarc")), "clip.aarc");
        assert_eq!(title(Some("..")), "..");
        assert_eq!(title(Some("https://host/a/clip.aarc?key=secret#t")), "clip.aarc");
    }

    #[test]
    fn addresses_are_told_from_paths() {
        for name in ["http://a/b.aarc", "https://a", "HTTPS://A"] {
            assert!(is_address(name), "{name}");
        }
        for name in ["a.aarc", "/https://a", "http:/a", "ftp://a", "https", "\u{e9}\u{e9}\u{e9}\u{e9}"] {
            assert!(!is_address(name), "{name}");
        }
        let opened = open(Some("http://a/b.aarc"), None);
        if cfg!(feature = "net") {
            assert!(!matches!(opened.unwrap(), Arrival::Here(_)), "nothing is fetched yet");
        } else {
            assert!(matches!(opened, Err(Fault::Usage(_))));
        }
    }

    #[test]
    fn what_may_be_secret_is_not_shown() {
        assert_eq!(shown("https://ann:pass@host:8443/a/b.aarc?key=1#x"), "https://host:8443/a/b.aarc");
        assert_eq!(shown("http://host"), "http://host");
        assert_eq!(shown("http://host/a@b"), "http://host/a@b");
    }

    #[test]
    fn faults_say_whose_they_are() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.aarc");
        for bytes in [None, Some(&b""[..]), Some(b"not a package")] {
            bytes.map_or(Ok(()), |bytes| std::fs::write(&path, bytes)).unwrap();
            let Err(Fault::Data(message)) = load_file(&path) else { panic!("{bytes:?} is bad data") };
            assert!(message.starts_with(&path.display().to_string()), "{message}");
        }
        assert!(matches!(load_file(folder.path()), Err(Fault::Data(_))));
    }
}
