//! The programs as a user runs them: from a field to images, and with bad input.
//!
//! Bad input gets one line on stderr and the exit code of its kind, and leaves no file behind: no
//! output, no partial output, no temporary file.

use std::fs;
use std::process::Command;

use ::studio::cli::Cli;
use aarc_tests::gpu::{self, Passes};
use aarc_tests::outcome::{DATA, USAGE};
use aarc_tests::programs::{client, run, studio};
use aarc_tests::scene::{Place, camera, packaged};
use clap::CommandFactory;
use client::gpu::Gpu;
use libtest_mimic::{Failed, Trial};
use refine::reference::{Order, RenderScene, render};
use serde_json::Value;
use xtask::workspace;

use crate::workshop::{RECIPE, Workshop, bad_files};

/// The tests of this file.
pub(crate) fn trials() -> Vec<Trial> {
    let plain = |name: &str, test: fn() -> Result<(), String>| {
        Trial::test(name, move || test().map_err(Failed::from))
    };
    vec![
        gpu::trial("from a field to images", Passes::Shared, field_to_pictures),
        gpu::trial("the demo scene", Passes::Shared, demo_scene),
        gpu::trial("a camera file gives the reference's image", Passes::Shared, camera_file),
        gpu::trial("stereo and statistics", Passes::Shared, stereo_and_statistics),
        gpu::trial("one time or many", Passes::Shared, one_time_or_many),
        gpu::trial("a clip that is cut short plays and says so", Passes::Shared, cut_short),
        plain("bad input to package", bad_input_to_package),
        plain("bad input to inspect", bad_input_to_inspect),
        plain("bad input to render and export", bad_input_to_render_and_export),
        plain("cargo xtask hands the host tool's commands over", xtask_hands_over),
        Trial::test("the player starts without a sound library", || {
            starts_without_a_sound_library().map_err(Failed::from)
        })
        .with_ignored_flag(!cfg!(all(
            target_os = "linux",
            target_env = "gnu",
            target_arch = "x86_64"
        ))),
    ]
}

/// The libraries that the system loads before the player starts.
fn starts_without_a_sound_library() -> Result<(), String> {
    let listed = run(Command::new(client()).env("LD_TRACE_LOADED_OBJECTS", "1")).success().stdout;
    if !listed.contains("libc.so") || listed.contains("libasound") {
        return Err(format!("needs libasound, or lists nothing:\n{listed}"));
    }
    Ok(())
}

fn field_to_pictures(_: &Gpu) -> Result<(), String> {
    let workshop = Workshop::new();
    let report =
        workshop.run(studio(), "package field.ply -o made.aarc --budget 300 --json").success().stdout;
    let report: Value = serde_json::from_str(&report).map_err(|error| error.to_string())?;
    let shown = workshop.run(studio(), "inspect made.aarc --json").success().stdout;
    let shown: Value = serde_json::from_str(&shown).map_err(|error| error.to_string())?;
    let size = fs::metadata(workshop.path("made.aarc")).map_err(|error| error.to_string())?.len();
    for (what, value, expected) in [
        ("gaussians_in", &report["gaussians_in"], 500),
        ("gaussians_out", &report["gaussians_out"], 300),
        ("bytes of the report", &report["bytes"], size),
        ("gaussians", &shown["gaussians"], 300),
        ("bytes", &shown["bytes"], size),
        ("sh_degree", &shown["sh_degree"], 1),
        ("motion_order", &shown["motion_order"], 3),
    ] {
        if *value != expected {
            return Err(format!("{what} is {value}, not {expected}"));
        }
    }
    workshop.run(client(), "made.aarc --headless --time 1.0 --size 96x64 --out frame.png").success();
    let picture = workshop.image("frame.png")?;
    let lit = picture.pixels().filter(|pixel| pixel.0.iter().any(|&c| c > 40)).count();
    if picture.dimensions() == (96, 64) && lit > 500 { Ok(()) } else { Err(format!("{lit} lit pixels")) }
}

/// The commands behind `cargo xtask demo`.
fn demo_scene(_: &Gpu) -> Result<(), String> {
    let workshop = Workshop::new();
    workshop.run(studio(), "synth clip -o juggler.ply").success();
    workshop.run(studio(), "package juggler.ply -o juggler.aarc").success();
    workshop.run(client(), "juggler.aarc --headless --time 0,1 --size 160x90 --out frames").success();
    let [first, second] = ["frames/frame_0000.png", "frames/frame_0001.png"].map(|name| workshop.image(name));
    if first? == second? { Err("nothing moves within a second".into()) } else { Ok(()) }
}

/// The player draws the reference renderer's image for a camera and a time.
fn camera_file(_: &Gpu) -> Result<(), String> {
    let workshop = Workshop::new();
    let view = camera(Place::Whole, 120, 90);
    workshop.write("camera.json", &serde_json::to_vec(&view).map_err(|error| error.to_string())?);
    let line = "clip.aarc --headless --time 0.9 --camera camera.json --target 16 --out";
    workshop.run(client(), &format!("{line} gpu.png")).success();
    workshop.run(studio(), "render clip.aarc --time 0.9 --camera camera.json -o cpu.png").success();
    let (gpu, cpu) = (workshop.image("gpu.png")?, workshop.image("cpu.png")?);
    let expected = render(&RenderScene::from(&decoded_clip()), &view, 0.45, Order::Depth).to_rgb8();
    if cpu.as_raw() != &expected {
        return Err("cargo xtask render and the library disagree".into());
    }
    let worst = gpu.as_raw().iter().zip(cpu.as_raw()).map(|(a, b)| a.abs_diff(*b)).max();
    if gpu.dimensions() != (120, 90) || worst > Some(2) {
        return Err(format!("{:?}, off by up to {worst:?}", gpu.dimensions()));
    }
    // `--size` scales the camera's image.
    workshop.run(client(), &format!("{line} large.png --size 240x180")).success();
    let large = workshop.image("large.png")?;
    if large.dimensions() == (240, 180) { Ok(()) } else { Err(format!("{:?}", large.dimensions())) }
}

fn decoded_clip() -> codec::Clip {
    codec::decode(&packaged(&RECIPE.field(), None, &[100, 200]), &codec::Limits::default())
        .expect("a valid package")
}

fn stereo_and_statistics(_: &Gpu) -> Result<(), String> {
    let workshop = Workshop::new();
    let line =
        "clip.aarc --headless --frames 0..5 --fps 10 --stereo --size 80x60 --out eyes --stats stats.json";
    workshop.run(client(), line).success();
    let picture = workshop.image("eyes/frame_0004.png")?;
    if picture.dimensions() != (160, 60) {
        return Err(format!("{:?}", picture.dimensions()));
    }
    let half = |x: u32| image::imageops::crop_imm(&picture, x, 0, 80, 60).to_image();
    if half(0) == half(80) {
        return Err("both eyes see the same".into());
    }
    let stats = workshop.json("stats.json")?;
    let frames = stats["frames"].as_array().ok_or("no frames")?;
    for (i, frame) in frames.iter().enumerate() {
        let number = |key: &str| frame[key].as_f64().ok_or(format!("no {key} in {frame}"));
        let (alive, sorted, drawn) = (number("alive")?, number("sorted")?, number("drawn")?);
        if !(alive >= sorted && sorted > 0.0 && drawn > 0.0 && number("fragments")? >= drawn) {
            return Err(format!("{frame}"));
        }
        if number("sort_ms")? < 0.0
            || number("draw_ms")? <= 0.0
            || (number("time")? - 0.1 * i as f64).abs() > 1e-9
        {
            return Err(format!("{frame}"));
        }
    }
    let texts =
        ["adapter", "driver"].iter().all(|key| stats[*key].as_str().is_some_and(|text| !text.is_empty()));
    if frames.len() == 5 && texts && stats["f16"].is_boolean() { Ok(()) } else { Err(format!("{stats:#}")) }
}

/// Several times make a folder, one makes a file; one layer shows less than the whole clip.
fn one_time_or_many(_: &Gpu) -> Result<(), String> {
    let workshop = Workshop::new();
    workshop.run(client(), "clip.aarc --headless --time 0.5,1.5 --size 64x48 --out many").success();
    workshop.run(client(), "clip.aarc --headless --time 1.5 --size 64x48 --out one.png").success();
    if workshop.image("many/frame_0001.png")? != workshop.image("one.png")? {
        return Err("an image depends on those before it".into());
    }
    workshop
        .run(client(), "clip.aarc --headless --time 1.5 --size 64x48 --layer 1 --out layer.png")
        .success();
    workshop
        .run(client(), "clip.aarc --headless --time 1.5 --size 64x48 --view front --out named.png")
        .success();
    if workshop.image("layer.png")? == workshop.image("one.png")? {
        return Err("one layer looks like all".into());
    }
    if workshop.image("named.png")? != workshop.image("one.png")? {
        return Err("the first viewpoint is not where it starts".into());
    }
    workshop.run(client(), "clip.aarc --headless --frames 1..2 --fps 1 --size 64x48 --out frame").success();
    if !workshop.path("frame/frame_0000.png").is_file() {
        return Err("--frames writes a folder, also of one frame".into());
    }
    let files = fs::read_dir(workshop.path("many")).map_err(|error| error.to_string())?.count();
    if files == 2 { Ok(()) } else { Err(format!("{files} files in the folder")) }
}

fn cut_short(_: &Gpu) -> Result<(), String> {
    let workshop = Workshop::new();
    let clip = workshop.folder.read("clip.aarc")?;
    workshop.write("cut.aarc", &clip[..clip.len() - 1]);
    workshop.write("list.json", br#"{"version": 1, "clips": ["cut.aarc"]}"#);
    let options = "--headless --size 64x48 --out";
    workshop.run(client(), &format!("clip.aarc --layer 2 {options} two.png")).success();
    for name in ["cut.aarc", "list.json"] {
        let outcome = workshop.run(client(), &format!("{name} {options} cut.png")).success();
        let note = "cut.aarc: the file is cut short, 2 of 3 layers play: copy it again for the rest";
        let (cut, two) = (workshop.image("cut.png")?, workshop.image("two.png")?);
        let worst = cut.as_raw().iter().zip(two.as_raw()).map(|(a, b)| a.abs_diff(*b)).max();
        if outcome.stderr.trim() != note || worst > Some(2) {
            return Err(format!("off by {worst:?}: {outcome:?}"));
        }
    }
    Ok(())
}

fn bad_input_to_package() -> Result<(), String> {
    let bad = bad_files();
    for (input, mention) in [
        ("missing.ply", "missing.ply"),
        ("bare", "bare"),
        ("empty", "empty"),
        ("noise", "noise"),
        ("points.ply", "opacity"),
        ("nothing.ply", "nothing.ply"),
        ("cut.ply --strict", "truncated"),
    ] {
        bad.refuses(studio(), &format!("package {input} -o out.aarc"), DATA, mention)?;
    }
    for (line, mention) in [
        ("package field.ply -o absent/out.aarc", "absent"),
        ("package field.ply -o bare", "bare"),
        ("package field.ply -o noise/out.aarc", "noise"),
        ("package field.ply -o out.aarc --budget 0", "not a number of Gaussians, 1 or more"),
        ("package field.ply -o out.aarc --coder magic", "magic"),
    ] {
        bad.refuses(studio(), line, USAGE, mention)?;
    }
    Ok(())
}

fn bad_input_to_inspect() -> Result<(), String> {
    let bad = bad_files();
    for file in ["missing.aarc", "bare", "empty", "noise", "short.aarc", "flipped.aarc", "version.aarc"] {
        bad.refuses(studio(), &format!("inspect {file}"), DATA, file)?;
    }
    Ok(())
}

fn bad_input_to_render_and_export() -> Result<(), String> {
    let bad = bad_files();
    for file in ["missing.aarc", "bare", "empty", "noise", "flipped.aarc", "points.ply"] {
        bad.refuses(studio(), &format!("render {file} -o frame.png"), DATA, file)?;
        bad.refuses(studio(), &format!("export {file} --ply -o frozen.ply"), DATA, file)?;
    }
    for (line, mention) in [
        ("render clip.aarc --time nan -o frame.png", "NaN"),
        ("render clip.aarc --size 0x0 -o frame.png", "0x0"),
        ("render clip.aarc --view nowhere -o frame.png", "nowhere"),
        ("render clip.aarc -o absent/frame.png", "absent"),
        ("export clip.aarc --ply -o absent/frozen.ply", "absent"),
        ("synth clip -o absent/clip.ply", "absent"),
    ] {
        bad.refuses(studio(), line, USAGE, mention)?;
    }
    Ok(())
}

/// `cargo xtask` lists the commands of the host tool, runs them, and passes on their exit codes.
fn xtask_hands_over() -> Result<(), String> {
    let xtask = workspace::build("xtask", "dev").map_err(|fault| fault.to_string())?;
    let workshop = Workshop::new().seal();
    let help = workshop.run(&xtask, "--help").success().stdout;
    for command in Cli::command().get_subcommands().map(|command| command.get_name()) {
        if !help.lines().any(|line| line.trim_start().starts_with(&format!("{command} "))) {
            return Err(format!("{command} is missing in:\n{help}"));
        }
    }
    for (line, handed_over) in [
        ("inspect clip.aarc --json", "inspect clip.aarc --json"),
        ("help inspect", "inspect --help"),
        ("--version", "--version"),
    ] {
        let expected = workshop.run(studio(), handed_over).success().stdout;
        if workshop.run(&xtask, line).success().stdout != expected {
            return Err(format!("{line} differs from aarc-studio {handed_over}"));
        }
    }
    // Wrong usage is refused in one line, before anything is built.
    for (line, what, step) in [
        ("pakcage field.ply", "unrecognized subcommand 'pakcage'", "'package'"),
        ("", "no command was given", "--help"),
        ("ci --ful", "unexpected argument '--ful'", "'--full'"),
        ("demo a", "unexpected argument 'a'", "--help"),
        ("help nothing", "unrecognized subcommand 'nothing'", "--help"),
    ] {
        let mut command = workshop.folder.command(&xtask, line);
        let outcome = run(command.env("CARGO", workshop.path("no-cargo")));
        workshop.refused(&outcome, USAGE, what, step).map_err(|why| format!("cargo xtask {line}: {why}"))?;
    }
    workshop.refuses(&xtask, "inspect missing.aarc", DATA, "missing.aarc")
}
