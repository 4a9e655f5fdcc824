//! Sequences, glTF, `.ksplat` and FreeTimeGS: files that were written are read again, and bad ones have a sentence.

mod support;

use std::path::Path;

use codec::{ClipInfo, Field, Temporal};
use formats::{
    ImportError, ImportLimits, Imported, ImportedScene, SceneFiles, SequenceFrames, Similarity, import,
    write_field_file, write_glb, write_static_ply,
};
use support::{
    STATIC, ascii_ply, assert_close, assert_same_rotations, data, field, import_bytes, import_error,
};

/// Gaussians on cubics, some in windows.
fn on_cubics(rows: usize) -> Field {
    let mut noise = support::Noise(7);
    let fixed = Field { sh_degree: 0, ..field(rows, 0, None, false) };
    let temporal = Temporal {
        tau: (0..rows).map(|_| noise.uniform(0.2, 0.8)).collect(),
        s: (0..rows).map(|row| if row % 2 == 0 { f32::INFINITY } else { noise.uniform(0.1, 0.4) }).collect(),
        motion_order: 3,
        motion: (0..3 * rows).map(|_| noise.vector(-0.5, 0.5)).collect(),
        rotation_rates: None,
    };
    Field { temporal: Some(temporal), ..fixed }
}

/// Writes the 21 frames of a field into a folder.
fn write_frames(folder: &Path, field: &Field) {
    let info = info();
    let frames = SequenceFrames::new(field, &info, info.fps).unwrap();
    assert_eq!(frames.count(), 21);
    frames.files().for_each(|(name, ply)| std::fs::write(folder.join(name), ply).unwrap());
}

/// The notes on a field.
fn notes(imported: &Imported) -> String {
    imported.account.notes().collect::<Vec<_>>().join("; ")
}

/// Reads the field in a folder.
fn load(folder: &Path) -> Result<ImportedScene, ImportError> {
    SceneFiles::at(folder)?.read(ImportLimits::default())
}

fn info() -> ClipInfo {
    ClipInfo { duration_s: 1.0, fps: 20.0, ..support::info() }
}

#[test]
fn a_sequence_is_fitted_by_trajectories_and_windows() {
    let folder = tempfile::tempdir().unwrap();
    let original = on_cubics(60);
    write_frames(folder.path(), &original);
    let scene = load(folder.path()).unwrap();
    let found = &scene.subject.field;
    assert_eq!(scene.info, info());
    assert_eq!(scene.subject.hints.frames, Some(21));
    let note = notes(&scene.subject);
    assert!(note.contains("21 frames with 60 corresponding rows became"), "{note}");
    assert_eq!(found.len(), 60, "one Gaussian for each: {note}");
    let (mut farthest, mut fading) = (0f64, 0f64);
    for (row, t) in (0..60).flat_map(|row| (0..=20).map(move |k| (row, f64::from(k) / 20.0))) {
        let (a, b) = (original.opacity_at(row, t), found.opacity_at(row, t));
        fading = fading.max((a - b).abs());
        if a > 0.02 {
            let (p, q) = (original.position_at(row, t), found.position_at(row, t));
            let distance: f64 = (0..3).map(|axis| (p[axis] - q[axis]).powi(2)).sum();
            farthest = farthest.max(distance.sqrt());
        }
    }
    assert!(farthest < 2e-3 && fading < 0.01, "off by {farthest} units and {fading} of opacity; {note}");
}

#[test]
fn frames_that_do_not_correspond_keep_their_own_gaussians() {
    let folder = tempfile::tempdir().unwrap();
    for (k, rows) in [5, 6, 7].into_iter().enumerate() {
        let ply = write_static_ply(&field(rows, 0, None, false), None);
        std::fs::write(folder.path().join(format!("{k}.ply")), ply).unwrap();
    }
    let scene = load(folder.path()).unwrap();
    let note = notes(&scene.subject);
    assert!(note.starts_with("0.ply has 5 rows and 1.ply has 6, so every frame keeps its own"), "{note}");
    assert!(note.contains("18 in 3 frames, 4 times those of one"), "{note}");
    let found = &scene.subject.field;
    assert_eq!(found.len(), 18);
    let alive = |t: f64| {
        (0..18).filter(|&row| found.opacity_at(row, t) > 0.5 * f64::from(found.opacities[row])).count()
    };
    assert_eq!([alive(0.0), alive(0.5), alive(1.0)], [5, 6, 7]);
}

/// Writes a number that is none over the first coordinate of a row.
fn spoil(path: &Path, rows: &[usize]) {
    let mut bytes = std::fs::read(path).unwrap();
    let at = bytes.windows(11).position(|window| window == b"end_header\n").unwrap() + 11;
    let count = on_cubics(60).len();
    let stride = (bytes.len() - at) / count;
    rows.iter().for_each(|row| {
        bytes[at + row * stride..at + row * stride + 4].copy_from_slice(&f32::NAN.to_le_bytes());
    });
    std::fs::write(path, bytes).unwrap();
}

#[test]
fn rows_that_one_frame_spoils_are_filled_from_the_frames_beside() {
    let folder = tempfile::tempdir().unwrap();
    write_frames(folder.path(), &on_cubics(60));
    let whole = load(folder.path()).unwrap().subject.field;
    let path = |k: usize| folder.path().join(format!("frame_{k:04}.ply"));
    spoil(&path(8), &[3, 17]);
    spoil(&path(9), &[17]);
    spoil(&path(20), &[5]);
    let scene = load(folder.path()).unwrap();
    let (note, repairs) = (notes(&scene.subject), scene.subject.account.repairs.to_string());
    assert!(note.contains("21 frames with 60 corresponding rows"), "{note}");
    assert_eq!(repairs, "repaired 4 (not usable in a frame, filled from those beside: 4)");
    let found = &scene.subject.field;
    assert!(found.len() >= 60 && found.len() < 90, "{} Gaussians", found.len());
    assert_eq!(found.sh.len() / found.len(), whole.sh.len() / whole.len());
}

#[test]
fn rows_in_another_order_are_found_out() {
    let folder = tempfile::tempdir().unwrap();
    let original = field(40, 0, None, false);
    let backwards = original.select(&(0..40).rev().collect::<Vec<_>>());
    for (k, frame) in [&original, &original, &backwards].into_iter().enumerate() {
        std::fs::write(folder.path().join(format!("{k}.ply")), write_static_ply(frame, None)).unwrap();
    }
    let scene = load(folder.path()).unwrap();
    let note = notes(&scene.subject);
    assert!(note.starts_with("2.ply has other Gaussians in its rows than 1.ply"), "{note}");
    assert_eq!(scene.subject.field.len(), 120);
}

#[test]
fn missing_empty_and_broken_frames_are_filled_or_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = |k: usize| folder.path().join(format!("frame_{k:04}.ply"));
    write_frames(folder.path(), &on_cubics(30));
    std::fs::remove_file(path(5)).unwrap();
    std::fs::write(path(9), write_static_ply(&Field::default(), None)).unwrap();
    let scene = load(folder.path()).unwrap();
    let note = notes(&scene.subject);
    assert!(
        note.contains("frame 5 (counted from 0) missing") && note.contains("1 frames without Gaussians"),
        "{note}"
    );
    assert_eq!((scene.subject.hints.frames, scene.info.duration_s), (Some(21), 1.0));

    let error = || load(folder.path()).unwrap_err().to_string();
    let whole = std::fs::read(path(7)).unwrap();
    let other = String::from_utf8_lossy(&whole[..60]).replace("format", "comment aarc filter mip\nformat");
    std::fs::write(path(7), [other.as_bytes(), &whole[60..]].concat()).unwrap();
    assert!(error().contains("drawn with the filter mip"), "{}", error());
    std::fs::write(path(7), "ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nend_header\n")
        .unwrap();
    assert!(error().contains("frame_0007.ply") && error().contains("lacks the properties"), "{}", error());
    std::fs::write(path(7), write_field_file(&on_cubics(3), &info())).unwrap();
    assert!(error().contains("frame_0007.ply: this frame moves or fades by itself"), "{}", error());
    (7..20).for_each(|k| std::fs::remove_file(path(k)).unwrap());
    assert!(error().contains("7 of 21 frames are there"), "{}", error());
}

#[test]
fn a_glb_is_read_as_it_was_written() {
    let original = field(50, 3, None, false);
    let info = ClipInfo { up: [0.6, 0.0, 0.8], metres_per_unit: 2.0, ..info() };
    let imported = import_bytes("a.glb", &write_glb(&original, &info).unwrap()).unwrap();
    assert_eq!((imported.hints.up, imported.hints.metres_per_unit), (Some([0.0, 1.0, 0.0]), Some(1.0)));
    assert!(imported.account.sentences().is_empty(), "{:?}", imported.account);
    let mut back = imported.field;
    for (there, [x, _, z]) in back.centers.iter().zip(&original.centers) {
        assert!((there[1] - 2.0 * (0.6 * x + 0.8 * z)).abs() < 1e-4, "{there:?}: metres above the origin");
    }
    let turn = Similarity { scale: 0.5, ..Similarity::turning([0.0, 1.0, 0.0], info.up) };
    turn.apply(&mut back);
    assert_close("centre", back.centers.as_flattened(), original.centers.as_flattened(), |_| 1e-5);
    assert_close("scale", back.log_scales.as_flattened(), original.log_scales.as_flattened(), |_| 1e-5);
    assert_close("opacity", &back.opacities, &original.opacities, |_| 0.0);
    assert_close("sh", back.sh.as_flattened(), original.sh.as_flattened(), |_| 1e-5);
    assert_same_rotations(&back.rotations, &original.rotations, 1e-5);
}

/// The parts of a GLB: its JSON and its binary chunk.
fn parts(bytes: &[u8]) -> (serde_json::Value, Vec<u8>) {
    let length = u32::from_le_bytes(std::array::from_fn(|k| bytes[12 + k])) as usize;
    (serde_json::from_slice(&bytes[20..20 + length]).unwrap(), bytes[28 + length..].to_vec())
}

fn assembled(json: &serde_json::Value, binary: &[u8]) -> Vec<u8> {
    let mut text = json.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let length = (28 + text.len() + binary.len()) as u32;
    let words = |words: [u32; 2]| words.map(u32::to_le_bytes).concat();
    [
        &b"glTF"[..],
        &words([2, length]),
        &(text.len() as u32).to_le_bytes(),
        b"JSON",
        &text,
        &(binary.len() as u32).to_le_bytes(),
        b"BIN\0",
        binary,
    ]
    .concat()
}

#[test]
fn a_far_node_keeps_the_distances_of_its_gaussians() {
    let near = field(200, 1, None, false);
    let (mut json, binary) = parts(&write_glb(&near, &info()).unwrap());
    let read = |json: &serde_json::Value| import_bytes("a.glb", &assembled(json, &binary)).unwrap();
    let here = read(&json);
    assert_eq!(here.hints.origin, None);
    let translation = [6.4e6, 0.0, -4.8e6];
    json["nodes"][0]["translation"] = serde_json::json!(translation);
    let far = read(&json);
    let origin = far.hints.origin.expect("too far for f32");
    let note = format!("relative to {} {} {}", origin[0], origin[1], origin[2]);
    assert!(far.account.assumed.iter().any(|assumed| assumed.contains(&note)), "{:?}", far.account);
    for (a, b) in here.field.centers.iter().zip(&far.field.centers) {
        for axis in 0..3 {
            let there = f64::from(b[axis]) + origin[axis] - translation[axis];
            assert!((there - f64::from(a[axis])).abs() < 1e-6, "{a:?}, {b:?}");
        }
    }
    assert_eq!(here.field.sh, far.field.sh);
}

#[test]
fn a_gltf_with_something_else_has_a_sentence() {
    let (json, binary) = parts(&write_glb(&field(5, 1, None, false), &info()).unwrap());
    type Change = fn(&mut serde_json::Value);
    let cases: [(Change, &str); 10] = [
        (
            |j| _ = j["meshes"][0]["primitives"][0].as_object_mut().unwrap().remove("extensions"),
            "without KHR_gaussian_splatting",
        ),
        (|j| j["accessors"][2]["sparse"] = serde_json::json!({"count": 1}), "accessor 2 is sparse"),
        (|j| j["accessors"][0]["count"] = 4_000_000_000u64.into(), "of another attribute"),
        (
            |j| {
                j["accessors"]
                    .as_array_mut()
                    .unwrap()
                    .iter_mut()
                    .for_each(|a| a["count"] = 4_000_000_000u64.into())
            },
            "more than its buffer has",
        ),
        (|j| j["bufferViews"][2]["byteOffset"] = u64::MAX.into(), "more than its buffer has"),
        (|j| j["buffers"][0]["byteLength"] = 4_000_000_000u64.into(), "announces 4000000000 bytes"),
        (|j| j["buffers"][0]["uri"] = "../secret.bin".into(), "no file beside"),
        (
            |j| j["extensionsRequired"] = serde_json::json!(["EXT_meshopt_compression"]),
            "requires EXT_meshopt_compression",
        ),
        (
            |j| {
                j["meshes"][0]["primitives"][0]["extensions"]["KHR_gaussian_splatting"]["kernel"] =
                    "cube".into()
            },
            "the kernel `cube`",
        ),
        (|j| j["nodes"][0]["scale"] = serde_json::json!([1, 2, 3]), "scaled unequally"),
    ];
    for (change, text) in cases {
        let mut changed = json.clone();
        change(&mut changed);
        let error = import_error("a.glb", &assembled(&changed, &binary));
        assert!(error.contains(text), "{text}: {error}");
    }
    let whole = assembled(&json, &binary);
    let mut lies = whole.clone();
    lies[12..16].copy_from_slice(&u32::MAX.to_le_bytes());
    assert!(import_error("a.glb", &lies).contains("announces 4294967295 bytes"));
    assert!(import_error("a.glb", &whole[..whole.len() - 9]).contains("truncated GLB"));
    let mut beside = json.clone();
    let mesh = serde_json::json!({"primitives": [{"attributes": {"POSITION": 0}}]});
    beside["meshes"].as_array_mut().unwrap().push(mesh);
    beside["nodes"].as_array_mut().unwrap().push(serde_json::json!({"mesh": 1}));
    beside["scenes"][0]["nodes"] = serde_json::json!([0, 1]);
    let imported = import_bytes("a.glb", &assembled(&beside, &binary)).unwrap();
    assert_eq!((imported.field.len(), imported.account.lost.len()), (5, 1));
    assert!(imported.account.lost[0].starts_with("1 primitives without Gaussians"), "{:?}", imported.account);
}

#[test]
fn the_conformance_files_of_gltf_are_read() {
    let Some(folder) = data("format-fixtures/khr_gaussian_splatting") else { return };
    let binary = import(&folder.join("khr_conformance_matrix.glb")).unwrap();
    let text = import(&folder.join("khr_conformance_matrix.gltf")).unwrap();
    assert_eq!(binary.field, text.field);
    let field = &binary.field;
    assert_eq!((field.len(), field.sh_degree), (15, 3));
    assert!(field.centers.iter().all(|center| *center == [1.0, 2.0, 3.0]));
    // x, y, z, w = 1, 0, 0, 0 in floats, bytes and words.
    assert!(field.rotations.iter().all(|q| *q == [0.0, 1.0, 0.0, 0.0]), "{:?}", field.rotations);
    assert_eq!(field.log_scales[3], [0.2, -0.1, 0.7]);
    assert_eq!(
        &field.log_scales[4..8],
        [[1.0, -2.0, 3.0], [1.0, 0.0, -1.0], [2.0, -3.0, 4.0], [1.0, 0.0, -1.0]]
    );
    assert_eq!(&field.opacities[7..11], [0.25, 0.75, 64.0 / 255.0, 16384.0 / 65535.0]);
    // The only one whose colours are display-referred.
    assert_eq!(field.sh_of(3)[0], [0.1, 0.2, 0.3]);
    let slope =
        |k: usize, channel: usize| field.sh_of(14)[k][channel] / (k as f32 + 0.1 * (channel as f32 + 1.0));
    for (k, channel) in (1..16).flat_map(|k| (0..3).map(move |channel| (k, channel))) {
        assert!(
            (slope(k, channel) / slope(1, channel) - 1.0).abs() < 1e-5,
            "coefficient {k} is in its place"
        );
    }
    let notes = notes(&binary);
    assert!(notes.contains("logarithms") && notes.contains("linear colours"), "{notes}");
    let fallback = import(&folder.join("khr_extensible_fallback.gltf")).unwrap_err().to_string();
    assert!(fallback.contains("the kernel `customShape` is not drawn"), "{fallback}");
}

#[test]
fn ksplat_agrees_with_splat() {
    let Some(folder) = data("format-fixtures/splat-transform") else { return };
    let [ksplat, splat] = ["minimal.ksplat", "minimal.splat"].map(|name| import(&folder.join(name)).unwrap());
    assert_eq!((ksplat.field.len(), &ksplat.field.centers), (4, &splat.field.centers));
    assert_close(
        "scale",
        ksplat.field.log_scales.as_flattened(),
        splat.field.log_scales.as_flattened(),
        |_| 1e-5,
    );
    assert_eq!(ksplat.field.sh, splat.field.sh);
    assert_eq!(ksplat.field.opacities, splat.field.opacities);
    // A .splat has them in bytes.
    assert_same_rotations(&ksplat.field.rotations, &splat.field.rotations, 0.02);
    assert!(ksplat.account.repairs.is_empty(), "{}", ksplat.account.repairs);
}

/// A `.ksplat` of one section with these buckets and rows.
fn ksplat(compression: u16, sh_degree: u16, buckets: [u32; 4], body: &[u8], rows: u32) -> Vec<u8> {
    let mut bytes = vec![0; 4096 + 1024];
    let mut put = |at: usize, value: &[u8]| bytes[at..at + value.len()].copy_from_slice(value);
    put(1, &[1]);
    [4, 8].into_iter().for_each(|at| put(at, &1u32.to_le_bytes()));
    [12, 16].into_iter().for_each(|at| put(at, &rows.to_le_bytes()));
    put(20, &compression.to_le_bytes());
    let [capacity, count, full, partial] = buckets;
    for (at, word) in
        [(0, rows), (4, rows), (8, capacity), (12, count), (16, 4f32.to_bits()), (32, full), (36, partial)]
    {
        put(4096 + at, &word.to_le_bytes());
    }
    put(4096 + 20, &12u16.to_le_bytes());
    put(4096 + 40, &sh_degree.to_le_bytes());
    [&bytes, body].concat()
}

#[test]
fn compressed_ksplat_is_relative_to_its_buckets() {
    // Two rows in a full bucket, one in a partial one of length 1.
    let mut body = 1u32.to_le_bytes().to_vec();
    body.extend([10f32, 0.0, 0.0, 20.0, 0.0, 0.0].iter().flat_map(|x| x.to_le_bytes()));
    for x in [0u16, 65534, 32767] {
        body.extend([x, 32767, 32767].iter().flat_map(|x| x.to_le_bytes()));
        let halves = [1.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0].map(|x| half::f16::from_f32(x).to_le_bytes());
        body.extend(halves.as_flattened());
        body.extend([255, 128, 0, 255]);
        body.extend([0, 0, 0, 255, 255, 255, 0, 0, 255]);
    }
    let bytes = ksplat(2, 1, [2, 2, 1, 1], &body, 3);
    let imported = import_bytes("a.ksplat", &bytes).unwrap();
    let xs: Vec<f32> = imported.field.centers.iter().map(|center| center[0]).collect();
    assert_eq!(xs, [8.0, 12.0, 20.0]);
    assert_eq!(imported.field.sh_of(0)[1..], [[-1.5, 1.5, -1.5], [-1.5, 1.5, -1.5], [-1.5, 1.5, 1.5]]);
    assert!(imported.account.repairs.to_string().contains("zero scale: 3"), "{}", imported.account.repairs);
    let cut = import_bytes("a.ksplat", &bytes[..bytes.len() - 1]).unwrap();
    assert!(
        cut.field.len() == 2 && cut.account.repairs.to_string().contains("truncated payload: 1"),
        "{}",
        cut.account.repairs
    );
    for (change, text) in [
        (vec![(1, 9)], "version 0.9"),
        (vec![(20, 3)], "compression 3"),
        (vec![(7, 255)], "announces 4278190081 sections"),
        (vec![(4096 + 40, 4)], "SH degree 4"),
        (vec![(4096 + 20, 8)], "of 8 bytes, and 12 are read"),
    ] {
        let mut bytes = bytes.clone();
        change.into_iter().for_each(|(at, value)| bytes[at] = value);
        let error = import_error("a.ksplat", &bytes);
        assert!(error.contains(text), "{text}: {error}");
    }
    assert!(import_error("a.ksplat", &bytes[..99]).contains("its header has 4096"));
}

#[test]
fn freetime_has_linear_velocities_and_durations() {
    let row = "1 2 3 0 0 0 0 -1 -1 -1 1 0 0 0 4 5 6 0.5 0.25";
    let names = format!("{STATIC} vx vy vz time duration");
    let linear = import_bytes("a.ply", &ascii_ply(&names, &[row])).unwrap();
    let temporal = linear.field.temporal.as_ref().unwrap();
    assert_eq!((temporal.motion_order, temporal.motion_of(0)), (1, &[[4.0, 5.0, 6.0]][..]));
    assert_eq!((temporal.tau[0], temporal.s[0], linear.format), (0.5, 0.25, "FreeTimeGS PLY"));
    assert_eq!(linear.account.assumed.len(), 1);
    let short = "1 2 3 0 0 0 0 -1 -1 -1 1 0 0 0 4 5 6 0.5 -2";
    let names = format!("{STATIC} velocity_x velocity_y velocity_z t dt");
    let logarithms = import_bytes("a.ply", &ascii_ply(&names, &[row, short])).unwrap();
    let temporal = logarithms.field.temporal.as_ref().unwrap();
    assert_eq!(temporal.s, [0.25f32.exp(), (-2f32).exp()]);
    assert!(logarithms.account.assumed[1].contains("logarithms"), "{:?}", logarithms.account);
}
