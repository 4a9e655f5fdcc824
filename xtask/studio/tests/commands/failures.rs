//! What the tool answers where it cannot do as asked: one sentence on standard error that says what, where and what to
//! do next, the documented exit code, and no new file.

use std::fs;
use std::ops::Range;
use std::path::PathBuf;

use crate::small_stage;
use crate::support::{field, info};
#[cfg(any(feature = "gpu", feature = "onnx"))]
use crate::tool::outcome::DEVICE;
use crate::tool::outcome::{CHECK, DATA, Failure, USAGE, check_failures};
use crate::tool::{NO_DEVICE, aarc_studio, aarc_studio_with};
use codec::{Field, PixelFilter};
use formats::{import, write_field_file, write_splatv, write_static_ply};
use refine::capture::Holdout;
use studio::fields::{FitRecord, fitted_field_file};
use tempfile::TempDir;

const FAILURES: &[Failure] = &[
    // Fitting.
    ("fit nope", DATA, "nope: there is no such file or folder", "check the path"),
    ("fit field.ply", DATA, "field.ply: a file", "a capture is a folder, so name that"),
    (
        "fit bare",
        DATA,
        "bare: no capture: it has no capture.json, intri.yml",
        "xtask/CAPTURE.md describes them",
    ),
    ("fit manifest", DATA, "manifest/capture.json: missing field", "xtask/CAPTURE.md describes the layout"),
    (
        "fit unread",
        DATA,
        "unread/capture.json: camera 07: missing field `w2c` at line",
        "describes the layout",
    ),
    ("fit stage -o field.aarc", USAGE, "cannot write field.aarc", "ends in .ply; name it so"),
    (
        "fit stage -o folder --from field.ply",
        USAGE,
        "--from: a field folder starts from an anchor",
        "name a field file",
    ),
    (
        "fit stage -o folder --anchor none",
        USAGE,
        "--anchor none: a field folder starts from",
        "name a field file",
    ),
    (
        "fit stage -o folder --frames 0..1",
        USAGE,
        "folder: one frame to fit to has no time to slide",
        "name a field file",
    ),
    ("fit stage -o field.ply --split 1", USAGE, "--split 1: field.ply is one field", "leave --split out"),
    ("fit stage -o no/field.ply", USAGE, "cannot write no/field.ply", "make it first"),
    ("fit stage --frames 3..9", USAGE, "--frames 3..9: the capture has 0..5", "choose frames of those"),
    ("fit stage --cameras nobody", USAGE, "no camera \"nobody\"", "it has 00, 01, 02"),
    ("fit stage --held-cameras x", USAGE, "--held-cameras: the capture has no camera \"x\"", "it has 00, 01"),
    (
        "fit stage --set anchor-cameras=99",
        USAGE,
        "anchor-cameras: the capture has no camera",
        "it has 00, 01",
    ),
    ("fit stage --size 64x64", USAGE, "--size 64x64: camera 00 has 48x48", "choose a smaller size"),
    (
        "fit stage --set mirror=on",
        DATA,
        "no anchor: mirroring needs cameras on one side",
        "turn mirroring off",
    ),
    (
        "fit stage --cameras 00",
        DATA,
        "no anchor: a visual hull needs two cameras or more",
        "give more, or depth maps",
    ),
    ("fit stage --anchor bare", DATA, "no anchor: no depth map", "name them as the photographs"),
    ("fit stage --anchor nowhere", DATA, "no anchor: no depth map", "name them as the photographs"),
    ("fit stage --from nope.ply", DATA, "nope.ply: there is no such file", "check the path"),
    ("fit stage --from field.ply --set filter=mip", USAGE, "--set filter: a fit that starts", "leave it out"),
    ("fit stage --from field.ply", USAGE, "field.ply is of 50 frames", "select its frames with --frames"),
    (
        "fit stage --from late.ply",
        USAGE,
        "late.ply was fitted to frames 8..17, and stage has 0..5",
        "with all its frames",
    ),
    (
        "fit stage --from early.ply --frames 1..3",
        USAGE,
        "--frames 1..3: early.ply was fitted to frames 1..4",
        "leave --frames out",
    ),
    ("fit stage --from slow.ply", USAGE, "slow.ply was fitted to 1 to 9 s", "correct the capture's fps"),
    (
        "fit stage --from other.ply",
        USAGE,
        "other.ply was fitted to photographs at other times",
        "time_offset_s",
    ),
    ("fit stage -o begun.ply", DATA, "begun.checkpoint: no checkpoint of this version", "remove it to start"),
    (
        "fit stage --frames 0..1 --held-cameras 00,01,02,04,05,06,07",
        DATA,
        "all photographs are held out",
        "hold out fewer",
    ),
    (
        "fit stage --lpips-weights camera.json",
        DATA,
        "camera.json: damaged or no PyTorch weights",
        "name torchvision's vgg16-397923af.pth",
    ),
    ("fit --list nope.txt -o out", DATA, "nope.txt: there is no such file", "check the path"),
    ("fit --list empty.txt -o bare --anchor maps", USAGE, "--anchor: a folder has", "leave --list out"),
    ("fit --list empty.txt -o bare", DATA, "empty.txt: names no take", "write the path of one in each line"),
    // Options without effect.
    ("fit stage --set depth-scale=rig", USAGE, "depth-scale: there are no depth maps", "leave it out"),
    ("fit stage --anchor none --set mirror=off", USAGE, "mirror: --anchor none starts at", "leave it out"),
    ("fit stage --anchor none --set anchor-cameras=00", USAGE, "anchor-cameras: --anchor none", "leave it"),
    ("fit stage --anchor none --set motion-start=off", USAGE, "motion-start: --anchor none", "leave it out"),
    (
        "fit stage --from field.ply --set mirror=off",
        USAGE,
        "mirror: a fit that starts from a",
        "leave it out",
    ),
    ("fit stage --rule relocate --set floor=off", USAGE, "floor: --rule relocate keeps", "leave it out"),
    ("report stage --fit --rule relocate --set floor=off", USAGE, "floor: --rule relocate", "leave it out"),
    (
        "package field.ply --coder fixed --quality 50",
        USAGE,
        "--quality: --coder fixed",
        "leave one of them out",
    ),
    ("package field.ply --coder fixed --joint-rounds 1", USAGE, "--joint-rounds: --coder fixed", "leave one"),
    ("package field.ply --no-floor", USAGE, "not provided: <--budget <N>|--fragments <FRACTION>>", "--help"),
    ("package field.ply --audio none --audio-start 1", USAGE, "--audio-start: there is no sound", "leave it"),
    // Scenes and their packages.
    ("package nope.ply", DATA, "nope.ply: there is no such file or folder", "check the path"),
    ("package bare", DATA, "no field in bare", "put one there"),
    ("package two", DATA, "two holds several fields", "name one of them: a.ply, b.ply"),
    ("package clip.aarc", DATA, "clip.aarc: this is a package already", "play it with `aarc`"),
    ("package noise", DATA, "noise: not a known format (starts with 74 68 69 73)", "a field is one of: PLY"),
    ("package empty", DATA, "empty: the file is empty", "get it again"),
    (
        "package points.ply",
        DATA,
        "points.ply: PLY element vertex lacks the properties f_dc_0",
        "export Gaussians",
    ),
    ("package nothing.ply", DATA, "nothing.ply: no Gaussians", "export it again"),
    (
        "package quarter.ply",
        DATA,
        "the header announces 40 Gaussians and the file holds 9",
        "get the file again",
    ),
    ("package many.splatv", DATA, "the header announces 3999999", "get the file again"),
    ("package lod-meta.json", DATA, "lod-meta.json: a streamed SOG of 5 levels", "export it as one"),
    ("package meta.json", DATA, "meta.json: it states no version of SOG", "export it again"),
    ("package keys", DATA, "keys/scene.json: unknown field `colour`", "`package --help` shows its keys"),
    ("package moving", DATA, "moving/plate.ply: a background plate must be static", "`export --at`"),
    ("package field.ply -o no/clip.aarc", USAGE, "cannot write no/clip.aarc", "make it first"),
    // Not even root can make files there.
    #[cfg(target_os = "linux")]
    ("package field.ply -o /proc/clip.aarc", USAGE, "cannot write /proc/clip.aarc", "name another place"),
    (
        "package field.ply --refine 9",
        USAGE,
        "--refine takes the photographs",
        "name their folder with --capture",
    ),
    ("package field.ply --refine 9 --capture stage", USAGE, "field.ply is of 50 frames", "--frames"),
    (
        "package late.ply --refine 9 --capture stage",
        USAGE,
        "late.ply was fitted to frames 8..17",
        "with all its frames",
    ),
    ("package field.ply --size 24x24", USAGE, "select photographs", "add --refine, or leave them out"),
    ("package stage --refine 9 --capture stage", USAGE, "stage is a capture itself", "leave --capture out"),
    ("package --list nope.txt -o out", DATA, "nope.txt: there is no such file", "check the path"),
    // Takes.
    ("package later", DATA, "later/field.json: a field folder of version 2", "update it"),
    ("package versionless", DATA, "versionless/field.json: no version", "xtask/FIELD.md describes it"),
    (
        "package unordered",
        DATA,
        "segments[2], from 0.5 s, belongs before segments[1], from 1 s",
        "list segments by",
    ),
    ("package missing", DATA, "missing/b.ply: there is no such file", "check the path"),
    ("package outside", DATA, "\"../field.ply\" is no name of a file in this folder", "move the file there"),
    ("package elsewhere", DATA, "segments[0] lasts 1 s from 9 s, which is no part of 2 s", "correct it"),
    ("package mixed", DATA, "b: its filter is mip, and blur in a", "fit both with the same"),
    (
        "package take --refine 9",
        USAGE,
        "--refine: take: a take has the photographs of several",
        "leave it out",
    ),
    ("package take --split 1", USAGE, "--split: take: it is a take of segments already", "leave it out"),
    ("package take --holdout odd", USAGE, "--frames: take: a take looks at no photographs", "leave it out"),
    ("package take --budget 0", USAGE, "'0' for '--budget", "1 or more"),
    ("package take -o no/take.aarc", USAGE, "cannot write no/take.aarc", "make it first"),
    ("package field.ply --split 1", USAGE, "--split 1: a segment lasts twice that", "choose less"),
    ("package field.ply --split 0", USAGE, "'0' for '--split <S>'", "seconds from 0.01"),
    ("package stage --split 1", USAGE, "--split: stage is a capture", "fit a field first"),
    ("join nope.ply -o out", DATA, "nope.ply: there is no such file", "check the path"),
    (
        "join field.ply bare -o out",
        DATA,
        "bare: nothing to join in it",
        "name a package (.aarc), a folder with a field.json",
    ),
    ("join field.ply short.aarc -o out", DATA, "short.aarc: package cut short", "get the file again"),
    ("join field.ply flipped.aarc -o out", DATA, "flipped.aarc: damaged", "get the file again"),
    ("join field.ply up -o out", DATA, "up: up is [0.0, 1.0, 0.0]", "set it in a scene.json"),
    (
        "join field.ply scale -o out",
        DATA,
        "scale: 2 metres per unit, and 0.37 in field.ply",
        "set it in a scene.json",
    ),
    ("join field.ply mip.ply -o out", DATA, "mip.ply: its filter is mip, and blur in field.ply", "the same"),
    ("join later -o out", DATA, "later/field.json: a field folder of version 2", "update it"),
    ("join field.ply -o two", USAGE, "cannot write two: there is something already", "name another folder"),
    ("join field.ply -o no/out", USAGE, "cannot write no/out", "make it first"),
    ("join -o out", USAGE, "required arguments were not provided: <FIELD>", "--help"),
    ("trim nope.aarc --from 0 --to 1 -o a.aarc", DATA, "nope.aarc: there is no such file", "check the path"),
    (
        "trim field.ply --from 0 --to 1 -o a.aarc",
        DATA,
        "field.ply: not an .aarc package",
        "get the file again",
    ),
    (
        "trim take --from 0 --to 1 -o a.aarc",
        DATA,
        "take: a field folder, and no package yet",
        "package it first",
    ),
    (
        "trim clip.aarc --from 1 --to 1 -o a.aarc",
        USAGE,
        "--from 1 --to 1: choose a part",
        "the start before the end",
    ),
    (
        "trim clip.aarc --from 0 --to 9 -o a.aarc",
        USAGE,
        "--from 0 --to 9: choose a part",
        "the start before the end",
    ),
    (
        "trim clip.aarc --from -1 --to 1 -o a.aarc",
        USAGE,
        "--from -1 --to 1: choose a part",
        "the start before",
    ),
    ("trim clip.aarc --from 0 --to 1 -o no/a.aarc", USAGE, "cannot write no/a.aarc", "make it first"),
    ("render take --time 9 -o a.png", USAGE, "--time 9: choose a time in the clip", "from 0 to 2 s"),
    ("render missing -o a.png", DATA, "missing/b.ply: there is no such file", "check the path"),
    ("report take --rd", DATA, "take: 2 segments, where one field is expected", "name a field file in it"),
    ("fit stage --from take", DATA, "take: 2 segments", "name a field file in it"),
    ("inspect take", DATA, "take: a field folder, and no package yet", "package it first"),
    // Packages.
    ("inspect nope.aarc", DATA, "nope.aarc: there is no such file", "check the path"),
    ("inspect bare", DATA, "bare: not a file", "name a package (.aarc)"),
    ("inspect points.ply", DATA, "points.ply: PLY element vertex lacks", "export Gaussians"),
    ("inspect short.aarc", DATA, "short.aarc: package cut short", "get the file again"),
    ("inspect flipped.aarc", DATA, "flipped.aarc: damaged", "get the file again, or package its field again"),
    ("inspect version.aarc", DATA, "version.aarc: package version 99", "update this program"),
    ("render short.aarc -o a.png", DATA, "short.aarc: package cut short", "get the file again"),
    (
        "render clip.aarc -o a.png --time 99",
        USAGE,
        "--time 99: choose a time in the clip",
        "from 0 to 1.633 s",
    ),
    ("render clip.aarc -o a.png --view x", USAGE, "--view x: there is no such viewpoint", "0 \"front row\""),
    ("export clip.aarc --spz -o a.spz", USAGE, "SPZ holds no motion", "give a time with --at SECONDS"),
    (
        "export clip.aarc --ply --at 99 -o a.ply",
        USAGE,
        "--at 99: choose a time in the clip",
        "from 0 to 1.633 s",
    ),
    ("export clip.aarc --ply -o bare", USAGE, "cannot write bare", "name a file"),
    // Evaluation and reports.
    ("eval field.ply --capture nope", DATA, "nope: there is no such file or folder", "check the path"),
    ("eval clip.aarc --capture stage", USAGE, "clip.aarc is of 50 frames", "select its frames with --frames"),
    ("eval late.ply --capture stage", USAGE, "late.ply was fitted to frames 8..17", "with all its frames"),
    (
        "eval early.ply --capture stage --frames 0..5",
        USAGE,
        "early.ply was fitted to frames 1..4",
        "leave --frames out",
    ),
    ("eval nope.ply --capture stage", DATA, "nope.ply: there is no such file", "check the path"),
    (
        "eval field.ply clip.aarc --capture stage",
        USAGE,
        "2 SUBJECTs and 1 --capture",
        "name one --capture for each",
    ),
    ("report nope.ply --rd", DATA, "nope.ply: there is no such file", "check the path"),
    ("report points.ply --rd", DATA, "points.ply: PLY element vertex lacks", "export Gaussians"),
    #[cfg(feature = "measure")]
    ("report points.ply", DATA, "points.ply: PLY element vertex lacks", "export Gaussians"),
    ("report field.ply --rd -o clip.aarc", USAGE, "clip.aarc is a file", "name another folder"),
    ("report field.ply clip.aarc", USAGE, "a page is of one field", "name one, or choose --rd"),
    ("report field.ply --fit", DATA, "field.ply: a file", "a capture is a folder, so name that"),
    ("report stage --fit -o stage/report", USAGE, "would lie within stage", "name another --out"),
    ("report stage field.ply --fit", USAGE, "--fit is of one capture", "name one"),
    (
        "report field.ply --steps 9",
        USAGE,
        "the other options of fits need --fit",
        "add it, or leave them out",
    ),
    (
        "report stage --fit --compare a=bare",
        DATA,
        "--compare: bare holds no picture of a photograph",
        "such as bare/00/",
    ),
    (
        "report stage --fit --size 24x24 --compare a=stage/images",
        DATA,
        "but its camera has 24x24",
        "scale it",
    ),
    ("report stage --fit --compare a=nope", DATA, "nope: there is no such file or folder", "check the path"),
    (
        "report stage --fit --compare a=stage --compare a=stage",
        USAGE,
        "--compare: two methods are called a",
        "rename one",
    ),
    ("ingest nope -o other", DATA, "nope: there is no such file or folder", "check the path"),
    ("ingest field.ply -o other", DATA, "field.ply: a file", "a rig is a folder of videos, so name that"),
    (
        "ingest stage -o other",
        DATA,
        "stage: there is no video in it",
        "put one file for each camera there, of mp4, mov",
    ),
    ("ingest stage -o other --up 0,0,0", USAGE, "'0,0,0' for '--up", "it is no direction"),
    ("synth stage -o other --cameras 0", USAGE, "0 cameras", "use 1 to 256"),
    ("synth rig -o other --size 63x48", USAGE, "63x48 pixels", "videos have even sides, from 16 on"),
    ("synth rig -o other --perturb exposure=2", USAGE, "exposure 2", "use 0 to 0.9"),
    ("synth limbs -o /proc/limbs.ply", USAGE, "cannot write /proc/limbs.ply", "name another place"),
    ("synth clip -o no/clip.ply", USAGE, "cannot write no/clip.ply", "make it first"),
    // The command line.
    ("", USAGE, "no command was given", "--help lists what can be given"),
    ("pakcage field.ply", USAGE, "unrecognized subcommand 'pakcage'", "'package'"),
    ("package", USAGE, "required arguments were not provided: <SCENE>", "--help lists what can be given"),
    ("package field.ply --budgt 9", USAGE, "unexpected argument '--budgt'", "'--budget'"),
    ("package field.ply --quality least", USAGE, "'least' for '--quality <DB>'", "dB from 20 to 100"),
    // Failed checks.
    ("package far.ply --quality 60 --strict", CHECK, "far: 60 dB, and 6 dB less", "choose a lower --quality"),
    // Missing devices.
    #[cfg(feature = "gpu")]
    ("fit stage --backend gpu", DEVICE, "no graphics device was found", "install a Vulkan driver"),
    #[cfg(feature = "onnx")]
    (
        "depths stage --backbone net -o maps",
        DEVICE,
        "no ONNX Runtime",
        "(pip install onnxruntime, or libonnxruntime-dev of Debian 13) and set ORT_DYLIB_PATH",
    ),
];

/// A folder with a capture, a field, a package, and files that are none of these.
fn workshop() -> TempDir {
    let folder = small_stage::stage();
    let path = |name: &str| -> PathBuf { folder.path().join(name) };
    let write = |name: &str, bytes: &[u8]| fs::write(path(name), bytes).unwrap();
    let dynamic = write_field_file(&field(40, 0, Some(1), false), &info());
    write("field.ply", &dynamic);
    let fitted_to = |frames: Range<usize>, seconds, timing| {
        let record = FitRecord { frames: Some(frames), seconds, timing, ..FitRecord::default() };
        fitted_field_file(&field(40, 0, Some(1), false), &info(), &record)
    };
    write("late.ply", &fitted_to(8..17, None, None));
    write("early.ply", &fitted_to(1..4, None, None));
    write("slow.ply", &fitted_to(0..5, Some([1.0, 9.0]), None));
    write("other.ply", &fitted_to(0..5, None, Some(0)));
    let package = ["package", "field.ply", "-o", "clip.aarc", "--coder", "fixed"];
    assert_eq!(aarc_studio(folder.path(), &package).code, Some(0));
    let clip = fs::read(path("clip.aarc")).unwrap();
    write("short.aarc", &clip[..40]);
    let mut flipped = clip.clone();
    flipped[clip.len() / 3] ^= 0x10;
    write("flipped.aarc", &flipped);
    let mut version = clip;
    version[4] = 99;
    write("version.aarc", &version);
    ["bare", "two", "keys", "moving", "manifest", "unread", "net", "up", "scale"]
        .iter()
        .for_each(|name| fs::create_dir(path(name)).unwrap());
    write("bare/readme.txt", b"no field here");
    write("manifest/capture.json", b"{}");
    let unread = r#"{"cameras": [{"id": "07", "w": 2, "h": 2, "K": [[1, 0, 1], [0, 1, 1], [0, 0, 1]]}]}"#;
    write("unread/capture.json", unread.as_bytes());
    write("two/a.ply", &dynamic);
    write("two/b.ply", &dynamic);
    write("keys/field.ply", &dynamic);
    write("keys/scene.json", br#"{"colour": 1}"#);
    write("moving/field.ply", &dynamic);
    write("moving/plate.ply", &dynamic);
    write("up/field.ply", &dynamic);
    write("up/scene.json", br#"{"up": [0, 1, 0]}"#);
    write("scale/field.ply", &dynamic);
    write("scale/scene.json", br#"{"metres_per_unit": 2}"#);
    let mip = write_field_file(&Field { filter: PixelFilter::Mip, ..field(40, 0, Some(1), false) }, &info());
    write("mip.ply", &mip);
    // Field folders: version, and file and start of each segment of a second.
    type Starts = &'static [(&'static str, f64)];
    let takes: [(&str, &str, Starts); 7] = [
        ("take", r#""version": 1"#, &[("a.ply", 0.0), ("b.ply", 1.0)]),
        ("later", r#""version": 2"#, &[("a.ply", 0.0)]),
        ("versionless", r#""format": 1"#, &[("a.ply", 0.0)]),
        ("unordered", r#""version": 1"#, &[("a.ply", 0.0), ("a.ply", 1.0), ("b.ply", 0.5)]),
        ("missing", r#""version": 1"#, &[("a.ply", 0.0), ("b.ply", 1.0)]),
        ("outside", r#""version": 1"#, &[("a.ply", 0.0), ("../field.ply", 1.0)]),
        ("elsewhere", r#""version": 1"#, &[("a.ply", 9.0)]),
    ];
    for (name, version, segments) in takes {
        fs::create_dir(path(name)).unwrap();
        let segment = |(file, start_s): &(&str, f64)| {
            format!(r#"{{"file": "{file}", "start_s": {start_s}, "duration_s": 1}}"#)
        };
        let segments = segments.iter().map(segment).collect::<Vec<_>>().join(", ");
        let text = format!(r#"{{{version}, "duration_s": 2, "fps": 25, "segments": [{segments}]}}"#);
        write(&format!("{name}/field.json"), text.as_bytes());
        write(&format!("{name}/a.ply"), &dynamic);
        write(&format!("{name}/b.ply"), &dynamic);
    }
    fs::remove_file(path("missing/b.ply")).unwrap();
    fs::create_dir(path("mixed")).unwrap();
    write("mixed/a.ply", &dynamic);
    write("mixed/b.ply", &mip);
    fs::copy(path("take/field.json"), path("mixed/field.json")).unwrap();
    write("noise", b"this is not what you are looking for");
    write("empty", b"");
    write("empty.txt", b"# none\n");
    write("nothing.ply", &write_field_file(&Field::default(), &info()));
    let mut quarter = write_static_ply(&field(40, 0, None, false), None);
    // A Gaussian takes 68 bytes.
    quarter.truncate(quarter.len() - 31 * 68);
    write("quarter.ply", &quarter);
    let points =
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n";
    write("points.ply", format!("{points}end_header\n0 0 0\n").as_bytes());
    write("many.splatv", &with_size(&write_splatv(&field(40, 0, Some(1), false), &info()), 256_000_000_000));
    write("lod-meta.json", br#"{"lodLevels": 5}"#);
    write("meta.json", br#"{"lodLevels": 5}"#);
    // One Gaussian far away leaves the others too few of the 32 bits of a position.
    let mut far = field(300, 0, None, false);
    far.log_scales.fill([-3.0; 3]);
    far.centers[0] = [1e8; 3];
    write("far.ply", &write_field_file(&far, &info()));
    write("net/backbone.json", br#"{"width": 24, "height": 16}"#);
    write("net/a.onnx", b"is not read");
    write("camera.json", br#"{"width": 64}"#);
    write("begun.checkpoint", b"no checkpoint");
    folder
}

/// A .splatv file whose header announces a chunk of this size.
fn with_size(bytes: &[u8], size: u64) -> Vec<u8> {
    let payload = 8 + u32::from_le_bytes([bytes[4], bytes[5], bytes[6], bytes[7]]) as usize;
    let mut header: serde_json::Value = serde_json::from_slice(&bytes[8..payload]).unwrap();
    header[0]["size"] = size.into();
    let header = header.to_string().into_bytes();
    [&bytes[..4], &(header.len() as u32).to_le_bytes(), &header, &bytes[payload..]].concat()
}

#[test]
fn every_failure_says_what_where_and_what_to_do() {
    let folder = workshop();
    let run = |line: &str| {
        let args: Vec<&str> = line.split_whitespace().collect();
        aarc_studio_with(folder.path(), &args, &NO_DEVICE)
    };
    check_failures(FAILURES, folder.path(), run).unwrap_or_else(|wrong| panic!("{wrong}"));
}

#[test]
fn exports_say_in_one_line_what_they_lose() {
    let folder = tempfile::tempdir().unwrap();
    let record = FitRecord { holdout: Some(Holdout::Odd), frames: Some(2..9), ..FitRecord::default() };
    let bytes = fitted_field_file(&field(40, 1, Some(2), true), &info(), &record);
    fs::write(folder.path().join("field.ply"), bytes).unwrap();
    let mut args = vec!["export", "field.ply"];
    let mut export = |more: &[&'static str]| {
        args.truncate(2);
        args.extend(more);
        let outcome = aarc_studio(folder.path(), &args);
        assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
        outcome.stderr
    };
    let lost = "note: a.splatv does not hold view-dependent colour (SH above degree 0)\n";
    assert_eq!(export(&["--splatv", "-o", "a.splatv"]), lost);
    let lost =
        "note: a.spz does not hold the up axis, metres per unit, viewpoints, duration and frame rate\n";
    assert_eq!(export(&["--spz", "--at", "0.5", "-o", "a.spz"]), lost);
    assert_eq!(export(&["--ply", "--at", "0.5", "-o", "a.ply"]), "");
    assert_eq!(export(&["--ply", "-o", "whole.ply"]), "");
    let mip = Field { filter: PixelFilter::Mip, ..field(40, 0, Some(2), true) };
    let hints = import(&folder.path().join("whole.ply")).unwrap().hints;
    fs::write(folder.path().join("field.ply"), fitted_field_file(&mip, &info(), &record)).unwrap();
    assert_eq!(export(&["--splatv", "-o", "b.splatv"]), "note: b.splatv does not hold the mip filter\n");
    let lost = "note: b.ply does not hold the mip filter for other tools\n";
    assert_eq!(export(&["--ply", "--at", "0.5", "-o", "b.ply"]), lost);
    assert_eq!(export(&["--ply", "-o", "mip.ply"]), "");
    let lost = "note: b.spz does not hold the variance of the mip filter, the up axis, metres per unit, viewpoints, \
                duration and frame rate\n";
    assert_eq!(export(&["--spz", "--at", "0.5", "-o", "b.spz"]), lost);
    assert_eq!((FitRecord::from_hints(&hints).unwrap(), hints.viewpoints), (record, info().viewpoints));

    // SPZ says that opacities are compensated, and not for which variance.
    let imported = |input: &str| {
        let args =
            [&["export", input, "-o", "again.ply", "--ply"][..], &["package", input, "-o", "again.aarc"]];
        args.map(|args| {
            let outcome = aarc_studio(folder.path(), args);
            assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
            outcome.stderr.lines().filter(|line| line.contains("0.1 px^2")).count()
        })
    };
    assert_eq!((imported("a.spz"), imported("b.spz")), ([0, 0], [1, 1]));
}

#[test]
fn a_fitted_field_file_records_its_photographs() {
    let folder = tempfile::tempdir().unwrap();
    let read = |bytes: &[u8]| {
        let path = folder.path().join("field.ply");
        fs::write(&path, bytes).unwrap();
        studio::fields::import(&path)
    };
    let whole = FitRecord {
        has_mattes: true,
        origin: Some([500_000.0, 0.1, -20.5]),
        holdout: Some(Holdout::Odd),
        frames: Some(8..17),
        seconds: Some([8.0 / 30.0, 16.0 / 30.0]),
        timing: Some(0x00c0_ffee),
        device: Some("llvmpipe (LLVM 15.0.6, 256 bits)".into()),
    };
    let others = [
        FitRecord { seconds: None, ..whole.clone() },
        FitRecord { holdout: Some(Holdout::None), ..FitRecord::default() },
        FitRecord::default(),
    ];
    for record in [&[whole][..], &others].concat() {
        let bytes = fitted_field_file(&field(3, 0, None, false), &info(), &record);
        let hints = read(&bytes).expect("our own file").hints;
        assert_eq!(FitRecord::from_hints(&hints), Ok(record));
    }
    let bytes = write_field_file(&field(3, 0, None, false), &info());
    let end = bytes.windows(10).position(|window| window == b"end_header").unwrap();
    for wrong in [
        "holdout some",
        "frames 8",
        "frames 9..9",
        "seconds 1",
        "seconds nan 2",
        "seconds 2 1",
        "timing xy",
        "origin 1 2",
        "origin 1 2 inf",
    ] {
        let comment = format!("comment aarc {wrong}\n");
        let error = read(&[&bytes[..end], comment.as_bytes(), &bytes[end..]].concat()).unwrap_err();
        let fault = error.downcast_ref::<program::Fault>().expect("bad data is a fault");
        let (key, value) = wrong.split_once(' ').unwrap();
        assert!(fault.to_string().contains(&format!("comment aarc {key}: cannot use `{value}`")), "{fault}");
        assert_eq!((fault.exit_code(), fault.to_string().lines().count()), (3, 1));
    }
}
