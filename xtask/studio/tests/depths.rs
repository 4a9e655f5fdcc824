//! `cargo xtask depths` with small networks built here, on the ONNX Runtime that ORT_DYLIB_PATH names. Without
//! one, only the test of error messages runs.

mod tool;

use std::fs;
use std::path::Path;
use std::process::ExitCode;

use libtest_mimic::{Arguments, Completion, Trial};
use serde_json::json;
use tempfile::{TempDir, tempdir};
use tool::{Outcome, aarc_studio};

const SIZE: [usize; 2] = [24, 16];

fn main() -> ExitCode {
    let trials = vec![
        Trial::test("errors of bad folders", || {
            bad_folders();
            Ok(())
        }),
        with_runtime("stages pass values by name", stages_pass_values),
        with_runtime("a network takes all photographs of an instant", photographs_together),
        with_runtime("errors of bad networks", bad_networks),
    ];
    libtest_mimic::run(&Arguments::from_args(), trials).exit_code()
}

fn with_runtime(name: &str, test: fn()) -> Trial {
    Trial::ignorable_test(name, move || {
        // A path where there is no runtime fails the test.
        if std::env::var_os("ORT_DYLIB_PATH").is_none() {
            let reason = "ORT_DYLIB_PATH names no ONNX Runtime; cargo xtask ci gets one";
            return Ok(Completion::ignored_with(reason));
        }
        test();
        Ok(Completion::Completed)
    })
}

/// Encodes ONNX files (Protocol Buffers): messages are sequences of fields.
mod onnx {
    fn varint(mut number: u64) -> Vec<u8> {
        let mut bytes = Vec::new();
        while number >= 0x80 {
            bytes.push(number as u8 | 0x80);
            number >>= 7;
        }
        bytes.push(number as u8);
        bytes
    }

    fn number(field: u64, value: u64) -> Vec<u8> {
        [varint(field << 3), varint(value)].concat()
    }

    fn bytes(field: u64, value: &[u8]) -> Vec<u8> {
        [varint(field << 3 | 2), varint(value.len() as u64), value.to_vec()].concat()
    }

    /// A tensor of a graph's inputs or outputs. A side of 0 is arbitrary.
    fn value(name: &str, element: u64, sides: &[u64]) -> Vec<u8> {
        let side = |i: usize| match sides[i] {
            0 => bytes(1, &bytes(2, format!("{name}_{i}").as_bytes())),
            side => bytes(1, &number(1, side)),
        };
        let shape: Vec<u8> = (0..sides.len()).flat_map(side).collect();
        let tensor = [number(1, element), bytes(2, &shape)].concat();
        [bytes(1, name.as_bytes()), bytes(2, &bytes(1, &tensor))].concat()
    }

    pub(crate) const FLOAT: u64 = 1;
    pub(crate) const INT64: u64 = 7;
    pub(crate) const FLOAT16: u64 = 10;

    /// Name, element type and shape of a model's input or output.
    pub(crate) type ValueInfo<'a> = (&'a str, u64, &'a [u64]);

    /// A model of one operator.
    pub(crate) fn model(
        operator: &str,
        attributes: &[Vec<u8>],
        inputs: &[ValueInfo],
        output: ValueInfo,
    ) -> Vec<u8> {
        let names = inputs.iter().flat_map(|(name, ..)| bytes(1, name.as_bytes()));
        let mut node: Vec<u8> = names.collect();
        node.extend(bytes(2, output.0.as_bytes()));
        node.extend(bytes(4, operator.as_bytes()));
        attributes.iter().for_each(|attribute| node.extend(bytes(5, attribute)));
        let mut graph = [bytes(1, &node), bytes(2, b"stage")].concat();
        for (i, (name, element, sides)) in inputs.iter().enumerate() {
            // An operator may take a value twice, but a graph declares it once.
            if inputs[..i].iter().all(|(other, ..)| other != name) {
                graph.extend(bytes(11, &value(name, *element, sides)));
            }
        }
        graph.extend(bytes(12, &value(output.0, output.1, output.2)));
        [number(1, 8), bytes(7, &graph), bytes(8, &number(2, 17))].concat()
    }

    /// An integer attribute.
    pub(crate) fn integer(name: &str, value: u64) -> Vec<u8> {
        [bytes(1, name.as_bytes()), number(3, value), number(20, 2)].concat()
    }

    /// An attribute with a list of integers.
    pub(crate) fn integers(name: &str, values: &[u64]) -> Vec<u8> {
        let list: Vec<u8> = values.iter().flat_map(|value| number(8, *value)).collect();
        [bytes(1, name.as_bytes()), list, number(20, 7)].concat()
    }
}

/// A stage that takes the mean over a dimension, and keeps it with size 1 or removes it.
fn mean(input: onnx::ValueInfo, output: onnx::ValueInfo, axis: u64, keep: bool) -> Vec<u8> {
    let attributes = [onnx::integers("axes", &[axis]), onnx::integer("keepdims", u64::from(keep))];
    onnx::model("ReduceMean", &attributes, &[input], output)
}

/// A folder with a capture of two cameras and three frames, and a backbone whose manifest has the keys of
/// `manifest` besides its size.
fn studio(manifest: serde_json::Value) -> TempDir {
    let folder = tempdir().unwrap();
    let [width, height] = SIZE;
    let size = format!("{width}x{height}");
    let stage = ["synth", "stage", "-o", "stage", "--cameras", "2", "--frames", "3", "--size", &size];
    assert_eq!(aarc_studio(folder.path(), &stage).code, Some(0));
    fs::create_dir(folder.path().join("net")).unwrap();
    let mut all = json!({"width": width, "height": height});
    all.as_object_mut().unwrap().extend(manifest.as_object().unwrap().clone());
    fs::write(folder.path().join("net/backbone.json"), all.to_string()).unwrap();
    folder
}

fn write(folder: &TempDir, stage: &str, model: &[u8]) {
    fs::write(folder.path().join("net").join(stage), model).unwrap();
}

const ARGS: [&str; 8] = ["depths", "stage", "--holdout", "odd", "--backbone", "net", "-o", "maps"];

fn depths(folder: &TempDir) -> Outcome {
    aarc_studio(folder.path(), &ARGS)
}

/// Values of a PFM file, in rows from the top.
fn read(path: &Path) -> Vec<f32> {
    let bytes = fs::read(path).unwrap();
    let head = format!("Pf\n{} {}\n-1.0\n", SIZE[0], SIZE[1]);
    let body = bytes.strip_prefix(head.as_bytes()).expect("a map of the network's size");
    let values: Vec<f32> = body.as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect();
    values.chunks(SIZE[0]).rev().flatten().copied().collect()
}

/// Mean of the normalised channels at each pixel of a photograph.
fn expected(path: &Path, mean: [f32; 3], std: [f32; 3]) -> Vec<f32> {
    let image = image::open(path).unwrap().into_rgb8();
    let pixel = |p: &image::Rgb<u8>| {
        (0..3).map(|c| (f32::from(p.0[c]) / 255.0 - mean[c]) / std[c]).sum::<f32>() / 3.0
    };
    image.pixels().map(pixel).collect()
}

#[track_caller]
fn assert_close(found: &[f32], expected: &[f32]) {
    assert_eq!(found.len(), expected.len());
    for (found, expected) in found.iter().zip(expected) {
        assert!((found - expected).abs() < 1e-4, "{found} {expected}");
    }
}

const IMAGE: onnx::ValueInfo = ("image", onnx::FLOAT, &[0, 3, 0, 0]);

fn stages_pass_values() {
    let (mean_of, std_of) = ([0.5, 0.25, 0.0], [0.5, 1.0, 2.0]);
    let folder = studio(json!({"mean": mean_of, "std": std_of, "output": "metres"}));
    let gray: onnx::ValueInfo = ("gray", onnx::FLOAT, &[0, 1, 0, 0]);
    let twice: onnx::ValueInfo = ("twice", onnx::FLOAT, &[0, 1, 0, 0]);
    // Stages run in the order of their names, not of writing. Each may take any earlier output, integers
    // included, and the photograph.
    write(
        &folder,
        "3_depth.onnx",
        &onnx::model("Add", &[], &[gray, twice], ("metres", onnx::FLOAT, &[0, 1, 0, 0])),
    );
    write(&folder, "1_gray.onnx", &mean(IMAGE, gray, 1, true));
    write(&folder, "2_twice.onnx", &onnx::model("Add", &[], &[gray, gray], twice));
    write(&folder, "0_shape.onnx", &onnx::model("Shape", &[], &[IMAGE], ("shape", onnx::INT64, &[4])));
    write(
        &folder,
        "4_again.onnx",
        &onnx::model("Identity", &[], &[("shape", onnx::INT64, &[4])], ("same", onnx::INT64, &[4])),
    );
    fs::write(folder.path().join("net/weights.bin"), "not a stage").unwrap();
    let outcome = depths(&folder);
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    assert!(outcome.stdout.contains("4 depth maps of 24x16 in maps"), "{}", outcome.stdout);
    for name in ["00/000000", "00/000002", "01/000000", "01/000002"] {
        let photograph = folder.path().join(format!("stage/images/{name}.png"));
        let three: Vec<f32> = expected(&photograph, mean_of, std_of).iter().map(|x| 3.0 * x).collect();
        assert_close(&read(&folder.path().join(format!("maps/{name}.pfm"))), &three);
    }
    assert!(!folder.path().join("maps/00/000001.pfm").exists(), "a held-out frame needs none");
}

/// A network with a dimension for scenes gets both photographs of a frame; each map is written to its path, and
/// a fit reads them.
fn photographs_together() {
    let folder = studio(json!({"together": true}));
    let image: onnx::ValueInfo = ("image", onnx::FLOAT, &[1, 2, 3, 0, 0]);
    write(&folder, "net.onnx", &mean(image, ("depth", onnx::FLOAT, &[1, 2, 0, 0]), 2, false));
    assert_eq!(depths(&folder).code, Some(0));
    for name in ["00/000000", "01/000002"] {
        let photograph = folder.path().join(format!("stage/images/{name}.png"));
        let expected = expected(&photograph, [0.0; 3], [1.0; 3]);
        assert_close(&read(&folder.path().join(format!("maps/{name}.pfm"))), &expected);
    }
    let fit = ["fit", "stage", "-o", "field.ply", "--anchor", "maps", "--steps", "1", "--gaussians", "50"];
    let outcome = aarc_studio(folder.path(), &fit);
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
}

fn bad_networks() {
    let error = |stages: &[(&str, Vec<u8>)]| {
        let folder = studio(json!({}));
        stages.iter().for_each(|(name, model)| write(&folder, name, model));
        let error = depths(&folder).error(3);
        assert!(!folder.path().join("maps").exists(), "no partial output is left");
        error
    };
    let depth: onnx::ValueInfo = ("depth", onnx::FLOAT, &[0, 1, 0, 0]);
    let features: onnx::ValueInfo = ("features", onnx::FLOAT, &[0, 1, 0, 0]);
    let unknown = error(&[("a.onnx", onnx::model("Identity", &[], &[features], depth))]);
    assert!(
        unknown.contains("a.onnx: it takes \"features\"") && unknown.contains("rename it to one of image"),
        "{unknown}"
    );
    let unnamed = error(&[("a.onnx", mean(IMAGE, features, 1, true))]);
    assert!(unnamed.contains("net: no stage gives \"depth\""), "{unnamed}");
    let small: onnx::ValueInfo = ("image", onnx::FLOAT, &[1, 3, 8, 8]);
    let sides = error(&[("a.onnx", mean(small, ("depth", onnx::FLOAT, &[1, 1, 8, 8]), 1, true))]);
    assert!(sides.contains("a.onnx: ") && sides.contains("image"), "{sides}");
    let channels =
        error(&[("a.onnx", onnx::model("Identity", &[], &[IMAGE], ("depth", onnx::FLOAT, &[0, 3, 0, 0])))]);
    assert!(channels.contains("has the shape [1, 3, 16, 24]"), "{channels}");
    let to_half = [onnx::integer("to", onnx::FLOAT16)];
    let half = error(&[(
        "a.onnx",
        onnx::model("Cast", &to_half, &[IMAGE], ("depth", onnx::FLOAT16, &[0, 3, 0, 0])),
    )]);
    assert!(half.contains("a.onnx: \"depth\" is neither float32 nor int64"), "{half}");
    let shape = error(&[("a.onnx", onnx::model("Shape", &[], &[IMAGE], ("depth", onnx::INT64, &[4])))]);
    assert!(shape.contains("\"depth\" is not float32"), "{shape}");
    let broken = error(&[("a.onnx", b"no model".to_vec())]);
    assert!(broken.contains("a.onnx: "), "{broken}");
}

fn bad_folders() {
    let folder = studio(json!({}));
    let error = || depths(&folder).error(3);
    assert!(error().contains("net: no stage is there"));
    let manifest = folder.path().join("net/backbone.json");
    for (text, what) in [
        ("{", "backbone.json"),
        (r#"{"width": 24}"#, "height"),
        (r#"{"width": 24, "height": 0}"#, "24x0 pixels"),
        (r#"{"width": 24, "height": 16, "std": [1, 0, 1]}"#, "three positive ones"),
        (r#"{"width": 24, "height": 16, "layout": "NHWC"}"#, "layout"),
        (r#"{"width": 24, "height": 16, "output": ""}"#, "names"),
    ] {
        fs::write(&manifest, text).unwrap();
        assert!(error().contains(what), "{what}: {}", error());
    }
    fs::remove_file(manifest).unwrap();
    assert!(error().contains("net/backbone.json"));
}
