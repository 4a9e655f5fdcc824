//! [`key`]: a hash of everything that an output depends on.

use std::fs::{self, File};
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use program::Fault;
use sha2::{Digest, Sha256};

use crate::capture::CaptureFiles;
use crate::messages::unreadable;
use crate::scene::{cameras_path, plate_path};

/// Bytes that are read at a time.
const BUFFER_BYTES: usize = 1 << 20;

/// Maximum nesting of folders; ends cycles of links.
const DEPTH_MAX: usize = 32;

/// SHA-256 over the version of this program, the command, its options as text, and the inputs: names and
/// contents of all files of a folder except hidden ones, and of the files that a capture in it lists, in
/// any folder; of a field file also the plate and the cameras beside it. The location of the inputs is not hashed.
///
/// # Errors
/// [`Fault::Data`] that names the file that cannot be read.
pub fn key(command: &str, options: &str, inputs: &[&Path]) -> Result<String, Fault> {
    let mut sum = Sha256::new();
    let mut add = |bytes: &[u8]| {
        sum.update((bytes.len() as u64).to_le_bytes());
        sum.update(bytes);
    };
    for text in [env!("CARGO_PKG_VERSION"), command, options] {
        add(text.as_bytes());
    }
    for input in inputs {
        let fault = |path: &Path, error: io::Error| unreadable(path, &error);
        let mut files = Vec::new();
        if input.is_dir() {
            find(input, 0, &mut files).map_err(|error| fault(input, error))?;
            // A folder that is no readable capture lists no files.
            if let Ok(capture_files) = CaptureFiles::open(input) {
                files.extend(capture_files.files());
            }
            files.sort();
            files.dedup();
        } else {
            files.push((*input).to_owned());
            files.extend([plate_path(input), cameras_path(input)].into_iter().filter(|path| path.is_file()));
        }
        add(&files.len().to_le_bytes());
        for path in files {
            let name = path.strip_prefix(input).ok().filter(|name| !name.as_os_str().is_empty());
            let name = name.unwrap_or(Path::new(path.file_name().unwrap_or_default()));
            add(name.as_os_str().as_encoded_bytes());
            add(&sum_of(&path).map_err(|error| fault(&path, error))?);
        }
    }
    Ok(hex(&sum.finalize()))
}

/// The SHA-256 of a file, as text.
pub(super) fn file_sum(path: &Path) -> io::Result<String> {
    sum_of(path).map(|sum| hex(&sum))
}

fn sum_of(path: &Path) -> io::Result<[u8; 32]> {
    let mut file = File::open(path)?;
    let mut buffer = vec![0; BUFFER_BYTES];
    let mut sum = Sha256::new();
    loop {
        match file.read(&mut buffer) {
            Ok(0) => return Ok(sum.finalize().into()),
            Ok(count) => sum.update(&buffer[..count]),
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Finds all files below a folder except hidden ones.
fn find(folder: &Path, depth: usize, files: &mut Vec<PathBuf>) -> io::Result<()> {
    if depth > DEPTH_MAX {
        return Err(io::Error::other(format!("folders nested more than {DEPTH_MAX} deep")));
    }
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        let hidden = path.file_name().is_some_and(|name| name.as_encoded_bytes().starts_with(b"."));
        if hidden {
            continue;
        } else if path.is_dir() {
            find(&path, depth + 1, files)?;
        } else if path.is_file() {
            files.push(path);
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_tells_contents_names_and_options_apart_and_not_places() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, text: &str| {
            let path = folder.path().join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        };
        for scene in ["a", "b"] {
            write(&format!("{scene}/field.ply"), "one");
            write(&format!("{scene}/images/0.png"), "two");
        }
        let package_key =
            |scene: &str, options: &str| key("package", options, &[&folder.path().join(scene)]).unwrap();
        let first = package_key("a", "x");
        assert_eq!((first.len(), &package_key("b", "x")), (64, &first));
        assert_ne!(package_key("a", "y"), first);
        assert_ne!(key("fit", "x", &[&folder.path().join("a")]).unwrap(), first);
        write("a/.hidden", "three");
        assert_eq!(package_key("a", "x"), first);
        write("b/images/0.png", "tw0");
        assert_ne!(package_key("b", "x"), first);
        fs::rename(folder.path().join("a/images/0.png"), folder.path().join("a/images/1.png")).unwrap();
        assert_ne!(package_key("a", "x"), first);
        write("one.ply", "one");
        write("one.spz", "one");
        assert_ne!(package_key("one.ply", "x"), package_key("one.spz", "x"), "the ending tells the format");
        let error = key("package", "", &[&folder.path().join("none")]).unwrap_err();
        assert!(error.exit_code() == 3 && error.to_string().contains("none: "), "{error}");
    }

    #[test]
    fn files_that_a_capture_lists_count_wherever_they_are() {
        let folder = tempfile::tempdir().unwrap();
        let take = folder.path().join("take");
        fs::create_dir(&take).unwrap();
        let paint = |red: u8| {
            let image = image::RgbImage::from_pixel(8, 6, image::Rgb([red, 0, 0]));
            image.save(folder.path().join("photo.png")).unwrap();
        };
        let absolute = folder.path().join("photo.png");
        for path in ["../photo.png", absolute.to_str().unwrap()] {
            let transforms = serde_json::json!({"fl_x": 8.0, "frames": [{
                "file_path": path,
                "transform_matrix": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 4], [0, 0, 0, 1]],
            }]});
            fs::write(take.join("transforms.json"), transforms.to_string()).unwrap();
            let fit_key = || key("fit", "", &[&take]).unwrap();
            paint(10);
            let first = fit_key();
            assert_eq!(fit_key(), first);
            paint(20);
            assert_ne!(fit_key(), first, "{path}");
        }
        let manifest = serde_json::json!({
            "frames": 1, "images": "../photo.png", "masks": "../mask.png", "plates": "../plate.png",
            "sound": {"file": "../sound.wav"},
            "cameras": [{"id": "a", "w": 8, "h": 6, "K": [[8, 0, 4], [0, 8, 3], [0, 0, 1]],
                "w2c": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 4], [0, 0, 0, 1]]}],
        });
        fs::write(take.join("capture.json"), manifest.to_string()).unwrap();
        let others = ["mask.png", "plate.png", "sound.wav"].map(|name| folder.path().join(name));
        others.iter().for_each(|path| fs::write(path, "one").unwrap());
        for path in &others {
            let first = key("fit", "", &[&take]).unwrap();
            fs::write(path, "two").unwrap();
            assert_ne!(key("fit", "", &[&take]).unwrap(), first, "{}", path.display());
        }
    }

    #[cfg(unix)]
    #[test]
    fn a_folder_within_itself_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        std::os::unix::fs::symlink(folder.path(), folder.path().join("loop")).unwrap();
        let error = key("package", "", &[folder.path()]).unwrap_err();
        assert_eq!(error.exit_code(), 3, "{error}");
    }
}
