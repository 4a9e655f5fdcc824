//! Where clips come from: files, and the demo clip that is built in.

#[cfg(not(target_os = "android"))]
use std::borrow::Cow;
use std::fs::File;
use std::io::Read;
use std::num::NonZero;
use std::path::Path;
use std::thread;

use codec::{Clip, Error, Limits, decode_parallel};

use crate::fault::Fault;
#[cfg(target_os = "android")]
use crate::xr::demo;

/// The clip that plays when none is named.
#[cfg(not(target_os = "android"))]
fn demo() -> Result<Cow<'static, [u8]>, Fault> {
    Ok(Cow::Borrowed(include_bytes!("../../assets/demo.aarc")))
}

/// Reads and decodes the clip named on the command line, a path; without a name the demo clip.
///
/// # Errors
/// [`Fault::Network`] for a URL, and as [`load_file`].
pub fn load(name: Option<&str>) -> Result<Clip, Fault> {
    match name {
        None => decode(&demo()?).map_err(|error| Fault::Data(format!("demo clip: {error}"))),
        Some(url) if url.starts_with("http://") || url.starts_with("https://") => {
            Err(Fault::Network(format!("{url}: addresses are not supported yet: download it first")))
        }
        Some(path) => load_file(Path::new(path)),
    }
}

/// What a clip is called: by its file, without a name the demo clip.
#[cfg(any(feature = "window", feature = "xr"))]
pub(crate) fn title(name: Option<&str>) -> String {
    name.map_or("demo".into(), |path| {
        Path::new(path).file_name().map_or(path.into(), |file| file.to_string_lossy().into_owned())
    })
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
    let file = File::open(path).map_err(|error| fault(error.to_string()))?;
    let mut bytes = Vec::new();
    let most = limits.max_bytes as u64;
    file.take(most + 1).read_to_end(&mut bytes).map_err(|error| fault(error.to_string()))?;
    if bytes.len() as u64 > most {
        return Err(fault(format!("larger than {} MiB, the most that is read", most >> 20)));
    }
    decode(&bytes).map_err(|error| fault(error.to_string()))
}

/// Decodes a package on all cores.
fn decode(bytes: &[u8]) -> Result<Clip, Error> {
    let threads = thread::available_parallelism().unwrap_or(NonZero::<usize>::MIN);
    decode_parallel(bytes, &Limits::default(), threads)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_demo_clip_plays_and_offers_viewpoints() {
        let clip = load(None).unwrap();
        assert!(!clip.moving.is_empty() && clip.info.duration_s > 0.0 && !clip.info.viewpoints.is_empty());
    }

    #[cfg(any(feature = "window", feature = "xr"))]
    #[test]
    fn a_clip_is_called_by_its_file() {
        assert_eq!(title(Some("a/b/clip.aarc")), "clip.aarc");
        assert_eq!(title(Some("..")), "..");
    }

    #[test]
    fn faults_say_whose_they_are() {
        assert!(matches!(load(Some("https://example.org/a.aarc")), Err(Fault::Network(_))));
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
