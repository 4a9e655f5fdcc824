//! `cargo xtask inspect`: its numbers match the package, and bad packages are refused.

use std::fs;
use std::path::Path;

use crate::support::{field, info};
use crate::tool::aarc_studio;
use codec::{Coder, EncodeOptions, Field, Limits, Precision, SectionKind, Source};
use serde_json::Value;
use tempfile::{TempDir, tempdir};

/// A folder with `clip.aarc`, a package of the field in layers of 1000.
fn packaged(field: &Field, plate: Option<&Field>) -> (TempDir, Vec<u8>) {
    let source = Source { info: &info(), field, plate };
    let options = EncodeOptions { layers: vec![1000, 2000], ..EncodeOptions::default() };
    let bytes = codec::encode(&source, &options).expect("a sound field");
    let folder = tempdir().unwrap();
    fs::write(folder.path().join("clip.aarc"), &bytes).unwrap();
    (folder, bytes)
}

fn inspect(folder: &Path) -> Value {
    aarc_studio(folder, &["inspect", "clip.aarc", "--json"]).json()
}

#[test]
fn a_field_says_what_it_states_and_what_was_assumed() {
    let folder = tempdir().unwrap();
    let field = field(3, 0, None, false);
    fs::write(folder.path().join("a.ply"), formats::write_static_ply(&field, None)).unwrap();
    fs::write(folder.path().join("b.ply"), formats::write_static_ply(&field, Some(&info()))).unwrap();
    let read = |name: &str| aarc_studio(folder.path(), &["inspect", name, "--json"]).json();
    let [plain, stated] = ["a.ply", "b.ply"].map(read);
    assert_eq!(plain["gaussians"], 3);
    assert_eq!(plain["filter"], "blur");
    assert_eq!(plain["up"], serde_json::json!([0.0, -1.0, 0.0]));
    assert_eq!(plain["assumed"][0], "up");
    assert_eq!(stated["assumed"], serde_json::json!([]));
    assert_eq!(stated["duration_s"], info().duration_s);
}

/// A field in which every row has every optional part: window, cubic motion, rotation over time, SH degree 3.
fn everything(len: usize) -> Field {
    let mut field = field(len, 3, Some(3), true);
    field.opacities.iter_mut().for_each(|opacity| *opacity = opacity.max(0.1));
    let temporal = field.temporal.as_mut().unwrap();
    temporal.s.fill(0.04);
    temporal.tau.iter_mut().for_each(|tau| *tau = tau.clamp(0.0, 1.0));
    field
}

/// The same Gaussians with optional parts removed; the first `static_count` neither fade nor move.
fn reduced(from: &Field, static_count: usize, sh_degree: u8, motion_order: u8, rotates: bool) -> Field {
    let mut field = from.clone();
    let coefficients = codec::sh_coefficients(sh_degree);
    field.sh = (0..from.len()).flat_map(|i| from.sh_of(i)[..coefficients].to_vec()).collect();
    field.sh_degree = sh_degree;
    if static_count == from.len() {
        field.temporal = None;
        return field;
    }
    let temporal = field.temporal.as_mut().unwrap();
    let order = usize::from(motion_order);
    temporal.motion = temporal.motion.chunks(3).flat_map(|v| v[..order].to_vec()).collect();
    temporal.motion_order = motion_order;
    temporal.s[..static_count].fill(f32::INFINITY);
    temporal.motion[..static_count * order].fill([0.0; 3]);
    match &mut temporal.rotation_rates {
        Some(rates) if rotates => rates[..static_count].fill([0.0; 4]),
        rates => *rates = None,
    }
    field
}

fn total(object: &Value, list: &str, key: &str) -> u64 {
    object[list].as_array().unwrap().iter().map(|entry| entry[key].as_u64().unwrap()).sum()
}

#[test]
fn the_numbers_match_the_package() {
    let original = reduced(&everything(2500), 700, 1, 2, true);
    let plate = field(90, 0, None, false);
    let (folder, bytes) = packaged(&original, Some(&plate));
    let clip = codec::decode(&bytes, &Limits::default()).unwrap();
    let shown = inspect(folder.path());

    assert_eq!((clip.static_field.len(), clip.dynamic_field.len()), (700, 1800));
    for (key, expected) in [
        ("format_version", Value::from("1.0")),
        ("coder", "fixed".into()),
        ("gaussians", 2500.into()),
        ("still", 700.into()),
        ("moving", 1800.into()),
        ("bytes", bytes.len().into()),
        ("bytes_announced", bytes.len().into()),
        ("bytes_per_gaussian", (bytes.len() as f64 / 2500.0).into()),
        ("sh_degree", 1.into()),
        ("motion_order", 2.into()),
        ("rotation_rates", true.into()),
    ] {
        assert_eq!(shown[key], expected, "{key}");
    }
    let number = |key: &str| shown[key].as_f64().unwrap() as f32;
    assert_eq!((number("duration_s"), number("fps")), (info().duration_s, info().fps));
    assert_eq!(number("metres_per_unit"), info().metres_per_unit);
    assert_eq!(shown["plate"]["gaussians"], 90);
    assert_eq!(shown["plate"]["sh_degree"], 0);
    assert_eq!(shown["viewpoints"][1]["name"], "Übersicht");
    for (key, expected) in [("up", info().up), ("bounds", clip.bounds[0])] {
        let list = if key == "bounds" { &shown[key][0] } else { &shown[key] };
        let list: Vec<f32> = list.as_array().unwrap().iter().map(|x| x.as_f64().unwrap() as f32).collect();
        assert_eq!(list, expected, "{key}");
    }

    let layers = shown["layers"].as_array().unwrap();
    let gaussians: Vec<_> = layers.iter().map(|layer| layer["gaussians"].as_u64().unwrap()).collect();
    assert_eq!(gaussians, [1000, 2000, 2500]);
    assert_eq!(layers[2]["bytes"], bytes.len());
    assert!(layers.iter().all(|layer| layer["complete"] == true));
    let head = shown["head_bytes"].as_u64().unwrap();
    assert_eq!(head + total(&shown, "sections", "bytes"), bytes.len() as u64);
    assert!(!shown["left_out"].as_array().unwrap().iter().any(|part| part["part"] == "plate"));

    for instant in shown["alive"].as_array().unwrap() {
        let t = instant["time_s"].as_f64().unwrap() / f64::from(info().duration_s);
        let alive =
            |field: &Field| (0..field.len()).filter(|&i| field.opacity_at(i, t) >= 1.0 / 255.0).count();
        let expected = (alive(&clip.static_field) + alive(&clip.dynamic_field)) as u64;
        let (counted, candidates) =
            (instant["alive"].as_u64().unwrap(), instant["candidates"].as_u64().unwrap());
        // Seconds pass through 32 bits, so a Gaussian at the threshold may fall to either side.
        assert!(counted.abs_diff(expected) <= 1, "{instant}: {expected} expected");
        assert!(counted <= candidates && candidates < 2500, "{instant}");
    }
    assert_eq!(shown["alive"].as_array().unwrap().len(), 5);
}

#[test]
fn a_layer_plays_from_the_bytes_it_names() {
    let (folder, bytes) = packaged(&everything(2500), None);
    let layers = inspect(folder.path())["layers"].clone();
    for (number, layer) in layers.as_array().unwrap().iter().enumerate() {
        let length = layer["bytes"].as_u64().unwrap() as usize;
        let clip = codec::decode(&bytes[..length], &Limits::default()).unwrap();
        assert_eq!(clip.layers.len(), number + 1);
        assert_eq!(clip.len() as u64, layer["gaussians"].as_u64().unwrap());
        let short = codec::decode(&bytes[..length - 1], &Limits::default());
        assert!(short.map_or(0, |clip| clip.layers.len()) <= number);
    }
}

/// The bytes saved are the difference to a package in which every row has every part.
#[test]
fn bytes_saved_are_the_difference_to_a_complete_package() {
    let full = everything(2500);
    let (folder, bytes) = packaged(&full, None);
    let everything = inspect(folder.path());
    let raw_bytes = |bytes: &[u8]| -> usize {
        let sections = codec::contents(bytes, &Limits::default()).unwrap().sections;
        let chunks = sections.iter().filter(|section| section.kind == SectionKind::Gaussians);
        chunks.map(|section| section.raw_length).sum()
    };
    // Up to 16 ranges of 4 bytes open a chunk, and 10-bit columns are rounded up to bytes.
    let slack = |bytes: &[u8]| 80 * codec::contents(bytes, &Limits::default()).unwrap().sections.len();
    let names: Vec<_> =
        everything["left_out"].as_array().unwrap().iter().map(|part| part["part"].clone()).collect();
    assert_eq!(names, ["opacity compensation", "plate"]);

    for (static_count, degree, order, rotates) in [
        (0, 0, 3, true),
        (0, 3, 1, true),
        (0, 2, 0, false),
        (800, 3, 3, true),
        (900, 1, 2, false),
        (2500, 0, 0, false),
    ] {
        let (folder, smaller) = packaged(&reduced(&full, static_count, degree, order, rotates), None);
        let shown = inspect(folder.path());
        let case = format!(
            "{static_count} static, SH {degree}, order {order}, rotates {rotates}:\n{:#}",
            shown["left_out"]
        );
        assert_eq!(shown["still"], static_count, "{case}");
        let saved = total(&shown, "left_out", "bytes_saved") as usize;
        let difference = raw_bytes(&bytes) - raw_bytes(&smaller);
        assert!(difference.abs_diff(saved) <= slack(&smaller), "{difference} bytes {case}");
        let gpu_saved = total(&shown, "left_out", "gpu_bytes_saved");
        let gpu = |object: &Value| object["gpu_bytes"].as_u64().unwrap();
        assert_eq!(gpu(&everything) - gpu(&shown), gpu_saved, "{case}");
        assert!(saved > 0 && gpu_saved > 0, "{case}");
    }
}

#[test]
fn a_truncated_file_lists_its_playable_layers() {
    let (folder, bytes) = packaged(&everything(2500), None);
    let whole = inspect(folder.path());
    let second = whole["layers"][1]["bytes"].as_u64().unwrap() as usize;
    fs::write(folder.path().join("clip.aarc"), &bytes[..second + 10]).unwrap();
    let shown = inspect(folder.path());
    assert_eq!((shown["gaussians"].clone(), shown["bytes"].clone()), (2000.into(), (second + 10).into()));
    assert_eq!(shown["bytes_announced"], bytes.len());
    let complete: Vec<_> = (0..3).map(|layer| shown["layers"][layer]["complete"].clone()).collect();
    assert_eq!(complete, [true, true, false]);
    let words = aarc_studio(folder.path(), &["inspect", "clip.aarc"]);
    assert_eq!(words.code, Some(0));
    assert!(words.stdout.contains("first 2 of 3 layers"), "{}", words.stdout);

    let first = whole["layers"][0]["bytes"].as_u64().unwrap() as usize;
    fs::write(folder.path().join("clip.aarc"), &bytes[..first - 1]).unwrap();
    let error = aarc_studio(folder.path(), &["inspect", "clip.aarc"]).error(3);
    assert!(
        error.contains(&format!("clip.aarc: cut short, {} of {first} bytes are there", first - 1)),
        "{error}"
    );
}

#[test]
fn bad_files_are_refused() {
    let (folder, mut bytes) = packaged(&everything(1500), None);
    let path = folder.path().join("clip.aarc");
    let last = bytes.len() - 20;
    bytes[last] ^= 1;
    fs::write(&path, &bytes).unwrap();
    let error = aarc_studio(folder.path(), &["inspect", "clip.aarc"]).error(3);
    assert!(error.contains("CRC-32") && error.contains("at byte"), "damage in the last layer: {error}");
    let refuse = |bytes: &[u8]| {
        fs::write(&path, bytes).unwrap();
        aarc_studio(folder.path(), &["inspect", "clip.aarc", "--json"]).error(3)
    };
    assert!(refuse(b"").contains("clip.aarc"));
    assert!(refuse(b"ply\nformat ascii 1.0\n").contains("not an .aarc package"));
    let error = aarc_studio(folder.path(), &["inspect", "nothing.aarc"]).error(3);
    assert!(error.contains("nothing.aarc"), "{error}");
    let error = aarc_studio(folder.path(), &["inspect", "."]).error(3);
    assert!(error.contains("not a file"), "{error}");
}

#[test]
fn the_text_has_every_part() {
    let (folder, _) = packaged(&reduced(&everything(2500), 700, 0, 1, false), None);
    let words = aarc_studio(folder.path(), &["inspect", "clip.aarc"]).stdout;
    for part in [
        "2500 (700 motionless, 1800 moving or fading)",
        "\"front row\"",
        "SH degree 3",
        "motion of power 2",
        "rotation over time",
        "temporal columns of motionless Gaussians",
        "moving time index",
        "still gaussians",
        "share",
    ] {
        assert!(words.contains(part), "no {part} in:\n{words}");
    }
}

/// The coder `rans` learns that a column is zero, so that omitting it saves little.
#[test]
fn zeros_cost_the_adaptive_coder_little() {
    let mut full = reduced(&everything(5000), 0, 0, 0, false);
    let encoded = |field: &Field, psnr: f64| {
        let precision = Precision { psnr, ..Precision::default() };
        let options = EncodeOptions { coder: Coder::Rans, precision, ..EncodeOptions::default() };
        codec::encode(&Source { info: &info(), field, plate: None }, &options).expect("a sound field")
    };
    // The error is spread over all numbers of a row: 15 without the zeros, 60 with them.
    let without = encoded(&full, 60.0);
    full.sh = full.sh.iter().flat_map(|color| [vec![*color], vec![[0.0; 3]; 15]].concat()).collect();
    full.sh_degree = 3;
    // Too small to be coded, but it makes the column present.
    full.sh[15] = [1e-30; 3];
    let with = encoded(&full, 60.0 - 10.0 * (60.0f64 / 15.0).log10());
    let folder = tempdir().unwrap();
    fs::write(folder.path().join("clip.aarc"), &without).unwrap();
    let parts = inspect(folder.path())["left_out"].clone();
    let of_degree = |part: &&Value| part["part"].as_str().unwrap().starts_with("SH degree");
    let parts = parts.as_array().unwrap().iter().filter(of_degree);
    let saved: u64 = parts.map(|part| part["bytes_saved"].as_u64().unwrap()).sum();
    let difference = with.len() - without.len();
    assert_eq!(saved, 2 * 45 * 5);
    // Rows of more numbers also take other steps.
    assert!((45..=3 * saved as usize).contains(&difference), "{difference} bytes, {saved} expected");
}

/// The bytes per attribute add up to the file, and positions take less than their order-0 entropy.
#[test]
fn the_bytes_of_the_adaptive_coder_are_accounted_for() {
    let field = everything(2500);
    let source = Source { info: &info(), field: &field, plate: None };
    let options = EncodeOptions { coder: Coder::Rans, ..EncodeOptions::default() };
    let bytes = codec::encode(&source, &options).expect("a sound field");
    let folder = tempdir().unwrap();
    fs::write(folder.path().join("clip.aarc"), &bytes).unwrap();
    let shown = inspect(folder.path());
    let attributes = shown["attributes"].as_array().unwrap();
    let names: Vec<_> = attributes.iter().map(|part| part["attribute"].as_str().unwrap()).collect();
    for name in ["position", "scale", "rotation", "motion", "rotation rate", "color", "spherical harmonics"] {
        assert!(names.contains(&name), "no {name} in {names:?}");
    }
    // A chunk has 26 bytes before its symbols, and is padded to a byte.
    let coded = total(&shown, "attributes", "coded_bytes") as usize;
    let stored = total(&shown, "sections", "bytes") as usize;
    assert!(coded.abs_diff(stored) < stored / 500 + 40, "{coded} of {stored} bytes");
    let position = &attributes[0];
    let bytes_of = |key: &str| position[key].as_u64().unwrap();
    assert!(bytes_of("order_0_bytes") > bytes_of("coded_bytes") + 2000, "a free order saves: {position}");
    let words = aarc_studio(folder.path(), &["inspect", "clip.aarc"]).stdout;
    assert!(words.contains("order 0") && words.contains("spherical harmonics"), "{words}");
    let (folder, _) = packaged(&field, None);
    assert_eq!(inspect(folder.path())["attributes"], Value::Array(Vec::new()), "coder fixed");
}

/// `inspect | head` ends `inspect` once `head` has seen enough.
#[cfg(unix)]
#[test]
fn a_closed_pipe_ends_a_command_quietly() {
    use std::os::unix::process::ExitStatusExt;
    use std::process::{Command, Stdio};

    const SIGPIPE: i32 = 13;
    let (folder, _) = packaged(&everything(100), None);
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let mut command = Command::new(env!("CARGO_BIN_EXE_aarc-studio"));
    command.current_dir(folder.path()).args(["inspect", "clip.aarc"]).stderr(Stdio::piped());
    let output = command.stdout(writer).output().unwrap();
    assert_eq!(output.status.signal(), Some(SIGPIPE), "{}", output.status);
    assert!(output.stderr.is_empty(), "{}", String::from_utf8_lossy(&output.stderr));
}
