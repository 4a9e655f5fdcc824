//! Loads LPIPS from the weights that people have: torchvision's trunk and the `lpips` package's heads, as PyTorch
//! writes them (a zip archive, the older stream of pickles, or the tar archive before that), or safetensors.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::Read;
use std::path::{Path, PathBuf};

use program::Fault;
use pytorch_reader::{DType, PytorchReader};
use refine::fit::{Lpips, WeightTensor};
use safetensors::{Dtype, SafeTensors};

use crate::messages::unreadable;

/// The next step after every error.
const ADVICE: &str = "name torchvision's vgg16-397923af.pth or alexnet-owt-7be5be79.pth, a comma, and the vgg.pth or alex.pth of \
     lpips/weights/v0.1";

/// First letters of the names of the tensors that LPIPS has. The others, 494 MB of VGG16, are not read.
const PREFIXES: [&str; 2] = ["features.", "lin"];

/// Tensors by name.
type Tensors = BTreeMap<String, WeightTensor>;

/// Loads the network whose tensors are in these files together.
///
/// # Errors
/// [`Fault::Data`] that names the file, what is wrong with it and what to name instead.
pub fn load_lpips(files: &[PathBuf]) -> Result<Lpips<f32>, Fault> {
    let mut tensors = Tensors::new();
    for path in files {
        tensors.append(&mut read(path)?);
    }
    let names: Vec<String> = files.iter().map(|path| path.display().to_string()).collect();
    Lpips::new(&tensors).map_err(|error| Fault::Data(format!("{}: {error}; {ADVICE}", names.join(","))))
}

/// The tensors of a file that LPIPS has.
fn read(path: &Path) -> Result<Tensors, Fault> {
    let bad = |what: String| Fault::Data(format!("{}: {what}; {ADVICE}", path.display()));
    let mut start = Vec::new();
    let file = File::open(path).and_then(|file| file.take(9).read_to_end(&mut start));
    file.map_err(|error| unreadable(path, &error))?;
    // A safetensors file begins with the length of its header, in JSON.
    match start.get(8) {
        Some(b'{') => {
            let bytes = fs::read(path).map_err(|error| unreadable(path, &error))?;
            read_safetensors(&bytes).map_err(bad)
        }
        _ => read_pytorch(path).map_err(bad),
    }
}

fn read_safetensors(bytes: &[u8]) -> Result<Tensors, String> {
    let file = SafeTensors::deserialize(bytes)
        .map_err(|error| format!("damaged or no safetensors file ({})", one_line(&error.to_string())))?;
    let read = |name: &str| {
        let found = file.tensor(name).map_err(|error| error.to_string())?;
        match found.dtype() {
            Dtype::F32 => Ok((name.into(), tensor(found.shape(), found.data()))),
            other => Err(no_floats(name, &format!("{other:?}"))),
        }
    };
    file.names().into_iter().filter(|name| is_of_lpips(name)).map(read).collect()
}

fn read_pytorch(path: &Path) -> Result<Tensors, String> {
    let unreadable = |error: String| format!("damaged or no PyTorch weights ({})", one_line(&error));
    let file = PytorchReader::new(path).map_err(|error| unreadable(error.to_string()))?;
    let read = |(name, found): (&String, &pytorch_reader::Tensor)| match found.dtype() {
        DType::F32 => {
            let bytes = found.read().map_err(|error| unreadable(error.to_string()))?;
            Ok((name.clone(), tensor(found.shape(), &bytes)))
        }
        other => Err(no_floats(name, &format!("{other:?}"))),
    };
    file.tensors().iter().filter(|(name, _)| is_of_lpips(name)).map(read).collect()
}

/// A reason on one line, as short as an error of this program.
fn one_line(reason: &str) -> String {
    let line = reason.split_whitespace().collect::<Vec<_>>().join(" ");
    match line.char_indices().nth(200) {
        Some((end, _)) => format!("{}…", &line[..end]),
        None => line,
    }
}

fn no_floats(name: &str, kind: &str) -> String {
    format!("the tensor {name} holds {kind} instead of 32-bit floats")
}

fn is_of_lpips(name: &str) -> bool {
    PREFIXES.iter().any(|prefix| name.starts_with(prefix))
}

fn tensor(shape: &[usize], bytes: &[u8]) -> WeightTensor {
    let values = bytes.as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes));
    WeightTensor { shape: shape.to_vec(), values: values.collect() }
}

#[cfg(test)]
mod tests {
    use refine::fit::LpipsNetwork;
    use safetensors::tensor::{TensorView, serialize};
    use tempfile::{TempDir, tempdir};

    use super::*;

    /// Files that `tests/lpips_weights/write.py` writes with Python's own pickle and zipfile.
    fn fixture(name: &str) -> PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/lpips_weights").join(name)
    }

    fn pattern([along, down, by_channel, period]: [usize; 4]) -> Vec<[f32; 4]> {
        let color = |i: usize, c: usize| (i % 72 * along + i / 72 * down + c * by_channel) % period;
        let level = |i: usize, c: usize| (color(i, c) as f64 / (period - 1) as f64) as f32;
        (0..72 * 60).map(|i| [level(i, 0), level(i, 1), level(i, 2), 1.0]).collect()
    }

    fn distance(lpips: &Lpips<f32>) -> f64 {
        lpips.distance(&pattern([7, 13, 29, 64]), &pattern([5, 11, 17, 32]), 72)
    }

    /// Distance by the same network in NumPy, as in the tests of `refine`.
    const DISTANCE_BY_NUMPY: f64 = 1.995_343_607_914_339_2;

    #[test]
    fn pytorch_files_give_the_network_of_an_independent_program() {
        let lpips = load_lpips(&[fixture("alexnet.pth"), fixture("alex.pth")]).unwrap();
        assert_eq!(lpips.network(), LpipsNetwork::Alex);
        let found = distance(&lpips);
        assert!((found - DISTANCE_BY_NUMPY).abs() < 1e-5 * DISTANCE_BY_NUMPY, "{found}");
    }

    /// Writes tensors as safetensors.
    fn write(folder: &TempDir, name: &str, tensors: &Tensors) -> PathBuf {
        let bytes: BTreeMap<&str, Vec<u8>> = tensors
            .iter()
            .map(|(name, tensor)| {
                (name.as_str(), tensor.values.iter().flat_map(|x| x.to_le_bytes()).collect())
            })
            .collect();
        let views = bytes.iter().map(|(name, bytes)| {
            (name.to_string(), TensorView::new(Dtype::F32, tensors[*name].shape.clone(), bytes).unwrap())
        });
        let path = folder.path().join(name);
        fs::write(&path, serialize(views, None).unwrap()).unwrap();
        path
    }

    #[test]
    fn safetensors_hold_one_part_or_both() {
        let folder = tempdir().unwrap();
        let mut tensors = read(&fixture("alexnet.pth")).unwrap();
        let trunk = write(&folder, "trunk.safetensors", &tensors);
        tensors.append(&mut read(&fixture("alex.pth")).unwrap());
        let both = write(&folder, "both.safetensors", &tensors);
        let distance_by = |files: &[PathBuf]| distance(&load_lpips(files).unwrap());
        assert_eq!(distance_by(&[both]), distance_by(&[trunk, fixture("alex.pth")]));
        assert!(tensors.keys().all(|name| !name.starts_with("classifier")), "left on disk");
    }

    #[track_caller]
    fn error(files: &[PathBuf]) -> String {
        let Err(fault) = load_lpips(files) else { panic!("accepted") };
        let text = fault.to_string();
        assert!(fault.exit_code() == 3 && !text.contains('\n') && text.len() < 600, "{text}");
        text
    }

    #[test]
    fn errors_say_what_to_name() {
        let folder = tempdir().unwrap();
        let file = |name: &str, bytes: &[u8]| {
            let path = folder.path().join(name);
            fs::write(&path, bytes).unwrap();
            path
        };
        let heads = error(&[fixture("alexnet.pth")]);
        assert!(
            heads.contains("alexnet.pth: the LPIPS weights lack the tensor lin0.model.1.weight; name"),
            "{heads}"
        );
        let trunk = error(&[fixture("alex.pth")]);
        assert!(
            trunk.contains("lack the tensor features.0.weight; name torchvision's vgg16-397923af.pth"),
            "{trunk}"
        );
        for bytes in [&b""[..], b"<!doctype html><html>not found</html>", &[0; 64]] {
            let text = error(&[file("page.pth", bytes)]);
            assert!(text.contains("page.pth: damaged or no PyTorch weights"), "{text}");
        }
        let mut tensors = read(&fixture("alexnet.pth")).unwrap();
        let whole = fs::read(write(&folder, "whole.safetensors", &tensors)).unwrap();
        let text = error(&[file("cut.safetensors", &whole[..5000])]);
        assert!(text.contains("cut.safetensors: damaged or no safetensors file"), "{text}");
        tensors.get_mut("features.3.bias").unwrap().values[7] = f32::NAN;
        let text = error(&[write(&folder, "nan.safetensors", &tensors), fixture("alex.pth")]);
        assert!(text.contains("features.3.bias") && text.contains("not finite"), "{text}");
        let view = TensorView::new(Dtype::F16, vec![2], &[0; 4]).unwrap();
        let half = file("half.safetensors", &serialize([("features.0.bias", view)], None).unwrap());
        assert!(error(&[half]).contains("features.0.bias holds F16 instead of 32-bit floats"));
        assert!(error(&[folder.path().join("none.pth")]).contains("none.pth: there is no such file"));
        error(&[folder.path().to_owned()]);
    }

    /// Every prefix of both formats, and every flipped byte of the older one.
    #[test]
    fn damage_is_an_error_or_other_weights() {
        let folder = tempdir().unwrap();
        let path = folder.path().join("damaged.pth");
        let stream = fs::read(fixture("alex.pth")).unwrap();
        let archive = fs::read(fixture("alexnet.pth")).unwrap();
        for (whole, step) in [(&stream, 7), (&archive, 997)] {
            for end in (0..whole.len()).step_by(step) {
                fs::write(&path, &whole[..end]).unwrap();
                assert!(read(&path).is_err(), "cut at {end} of {}", whole.len());
            }
        }
        for at in 0..900 {
            let mut flipped = stream.clone();
            flipped[at] ^= 0x41;
            fs::write(&path, &flipped).unwrap();
            let _ = read(&path);
        }
    }

    #[test]
    fn the_published_heads_are_read() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/lpips/weights/v0.1");
        let trunk = read(&fixture("alexnet.pth")).unwrap();
        let Ok(mut tensors) = read(&folder.join("alex.pth")) else {
            assert!(!folder.exists(), "the published heads cannot be read");
            eprintln!("skipped: {} is not there", folder.display());
            return;
        };
        let positive = |tensor: &WeightTensor| tensor.values.iter().all(|x| *x >= 0.0);
        assert!(tensors.len() == 5 && tensors.values().all(positive));
        assert!(tensors.values().all(|tensor| tensor.values.iter().any(|x| *x > 0.1)));
        tensors.extend(trunk);
        assert!(distance(&Lpips::new(&tensors).unwrap()) > 0.0);
        let vgg = read(&folder.join("vgg.pth")).unwrap();
        assert_eq!(vgg["lin4.model.1.weight"].shape, [1, 512, 1, 1]);
    }
}
