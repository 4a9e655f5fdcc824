//! Files of clips: bounded reading, and decoding on all cores.

use std::fs::File;
use std::io::Read;
use std::num::NonZero;
use std::path::Path;
use std::sync::Arc;
use std::thread;

use codec::{Clip, Error, FormatError, Limits, decode_parallel};
#[cfg(feature = "net")]
use codec::{Contents, Layers};
use program::{Fault, read_error};

use super::advice;
use super::event::ClipVersion;

/// Reads and decodes a package.
///
/// # Errors
/// [`Fault::Data`] with the path and the reason.
pub fn load_file(path: &Path, limits: &Limits) -> Result<Clip, Fault> {
    load_version(path, limits).map(|version| Arc::unwrap_or_clone(version.clip))
}

/// As [`load_file`], with its sound and poster.
///
/// # Errors
/// As there; not for damaged sound or a damaged poster.
pub(super) fn load_version(path: &Path, limits: &Limits) -> Result<ClipVersion, Fault> {
    let fault = |reason: String| Fault::Data(format!("{}: {reason}", path.display()));
    if path.is_dir() {
        return Err(fault("is a folder: name an .aarc file in it".into()));
    }
    let bytes = read(path, limits.max_bytes).map_err(fault)?;
    let clip = decode(&bytes, limits).map_err(|error| {
        fault(match error {
            Error::Format { error: FormatError::Magic, .. } => {
                format!("{}: {}", FormatError::Magic, remedy(path))
            }
            error => format!("{error}: {}", advice(&error, "copy it again")),
        })
    })?;
    Ok(ClipVersion::new(clip, &bytes, limits))
}

/// How to make a clip of a file that is none.
fn remedy(path: &Path) -> &'static str {
    const FIELDS: [&str; 6] = ["ply", "splatv", "spz", "splat", "sog", "glb"];
    let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default();
    match FIELDS.iter().any(|field| extension.eq_ignore_ascii_case(field)) {
        true => "make one of this field with aarc-studio package",
        false => "name a file that aarc-studio package made",
    }
}

/// Says that a package is cut short at the end of a layer, which plays without the others.
pub(super) fn truncation(path: &Path, clip: &Clip) -> Option<String> {
    let (layers, announced) = (clip.layers.len(), clip.layers_announced.len());
    (layers < announced).then(|| {
        let name = path.display();
        format!(
            "{name}: the file is cut short, {layers} of {announced} layers play: copy it again for the rest"
        )
    })
}

/// Reads a file of at most `max_bytes`.
///
/// # Errors
/// The reason, or that the file is larger.
pub(crate) fn read(path: &Path, max_bytes: usize) -> Result<Vec<u8>, String> {
    let file = File::open(path).map_err(|error| read_error(&error))?;
    let mut bytes = Vec::new();
    file.take(max_bytes as u64 + 1).read_to_end(&mut bytes).map_err(|error| read_error(&error))?;
    if bytes.len() > max_bytes {
        return Err(format!("larger than {} MiB, the most that is read: name another file", max_bytes >> 20));
    }
    Ok(bytes)
}

/// Decodes a package on all cores.
pub(crate) fn decode(bytes: &[u8], limits: &Limits) -> Result<Clip, Error> {
    decode_parallel(bytes, limits, cores())
}

/// Decodes the layers of a package from layer `first` on, without the layers before, on all cores.
#[cfg(feature = "net")]
pub(crate) fn decode_layers(
    head: &Contents,
    bytes: &[u8],
    first: usize,
    limits: &Limits,
) -> Result<Layers, Error> {
    head.decode_layers(bytes, first, limits, cores())
}

/// Number of threads that decode.
fn cores() -> NonZero<usize> {
    thread::available_parallelism().unwrap_or(NonZero::<usize>::MIN)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_name_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.aarc");
        for bytes in [None, Some(&b""[..]), Some(b"not a package")] {
            bytes.map_or(Ok(()), |bytes| std::fs::write(&path, bytes)).unwrap();
            let Err(Fault::Data(message)) = load_file(&path, &Limits::default()) else {
                panic!("{bytes:?} is bad data")
            };
            assert!(message.starts_with(&path.display().to_string()), "{message}");
        }
        assert!(matches!(load_file(folder.path(), &Limits::default()), Err(Fault::Data(_))));
    }

    #[test]
    fn a_file_of_another_format_has_a_next_step() {
        let folder = tempfile::tempdir().unwrap();
        for (name, step) in
            [("a.PLY", "of this field"), ("a.aarc", "that aarc-studio package made"), ("a", "made")]
        {
            let path = folder.path().join(name);
            std::fs::write(&path, b"ply\nformat binary_little_endian 1.0\n").unwrap();
            let message = load_file(&path, &Limits::default()).unwrap_err().to_string();
            assert!(message.contains("not an .aarc package: ") && message.contains(step), "{message}");
        }
    }

    #[test]
    fn a_package_that_is_cut_short_says_so() {
        let demo: &[u8] = include_bytes!("../../../assets/demo.aarc");
        let limits = Limits::default();
        let ends = codec::contents(demo, &limits).unwrap().layer_bytes();
        let note = |bytes: usize| truncation(Path::new("a"), &decode(&demo[..bytes], &limits).unwrap());
        assert_eq!(note(demo.len()), None);
        let all = ends.len();
        for bytes in [ends[0], ends[0] + 1, ends[1] - 1] {
            assert!(
                note(bytes).unwrap().starts_with(&format!("a: the file is cut short, 1 of {all} layers"))
            );
        }
        assert!(note(demo.len() - 1).unwrap().contains(&format!("{} of {all} layers", all - 1)));
    }
}
