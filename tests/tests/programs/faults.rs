//! Failing machines: full disks, too little memory, drivers that lose the device. Each run ends with an
//! image, or with one sentence and the exit code of its kind, and leaves no partial file.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Arc;

use aarc_tests::display::{Display, Screenshot};
use aarc_tests::gpu::{Passes, device};
use aarc_tests::lossy::lossy;
use aarc_tests::outcome::{DEVICE, Outcome, USAGE};
use aarc_tests::programs::{Folder, client, run, studio};
use aarc_tests::scene::{Motion, Recipe, lasting, packaged};
use aarc_tests::server::Server;
use libtest_mimic::{Completion, Failed, Trial};

/// The tests of this file.
pub(crate) fn trials() -> Vec<Trial> {
    vec![
        ignorable("a clip plays although the disk of the cache is full", Some(small_disk), full_cache),
        ignorable("a full disk is one sentence", Some(small_disk), full_output),
        ignorable("too little graphics memory is one sentence", None, little_memory),
        ignorable("a lost device is reopened once, then one sentence", None, lost_headless),
        ignorable("a device lost while the next clip is uploaded is reopened", None, lost_in_playlist),
        ignorable("a window reopens a lost device once, and then ends with one sentence", None, lost_window),
    ]
}

/// A test that needs a graphics device, and what `needs` checks.
fn ignorable(
    name: &str,
    needs: Option<fn() -> Result<(), String>>,
    test: fn(&Folder) -> Result<Completion, String>,
) -> Trial {
    Trial::ignorable_test(name, move || {
        if let Err(fault) = device(Passes::Shared) {
            return Ok(Completion::ignored_with(fault));
        }
        if let Some(Err(reason)) = needs.map(|needs| needs()) {
            return Ok(Completion::ignored_with(reason));
        }
        test(&folder_with_clip()).map_err(Failed::from)
    })
}

/// `Ok` if the command succeeds, else `what`.
fn works(what: &str, command: &mut Command) -> Result<(), String> {
    let status = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).status();
    match status {
        Ok(status) if status.success() => Ok(()),
        _ => Err(what.to_owned()),
    }
}

fn small_disk() -> Result<(), String> {
    let mut command = Command::new("unshare");
    command.args([
        "--user",
        "--map-root-user",
        "--mount",
        "mount",
        "-t",
        "tmpfs",
        "-o",
        "size=64k",
        "none",
        "/mnt",
    ]);
    works("no small disk can be made here", &mut command)
}

/// A folder with a clip and a mount point for a small disk.
fn folder_with_clip() -> Folder {
    let folder = Folder::default();
    folder.write("clip.aarc", &package());
    fs::create_dir(folder.path("disk")).expect("folders can be made");
    folder
}

/// Runs a program while `disk` is a disk of 64 KiB. Stdout lists the files on it afterwards.
fn on_small_disk(folder: &Folder, program: &Path, line: &str) -> Outcome {
    let script = "mount -t tmpfs -o size=64k none disk && \"$@\"; code=$?; \
                      [ ! -d disk/aarc ] || find disk/aarc -type f; \
                      find disk -maxdepth 1 -type f; exit $code";
    let mut command = Command::new("unshare");
    command.args(["--user", "--map-root-user", "--mount", "sh", "-c", script, "sh"]);
    command.arg(program).args(line.split_whitespace());
    run(command
        .current_dir(folder.path(""))
        .env("XDG_CACHE_HOME", folder.path("disk"))
        // Mesa caches shaders in the same folder.
        .env("MESA_SHADER_CACHE_DISABLE", "true"))
}

/// A clip that does not fit on the small disk.
const RECIPE: Recipe =
    Recipe { count: 2500, sh_degree: 2, motion: Motion::Dynamic, motion_order: 3, turning: false, seed: 5 };

fn package() -> Vec<u8> {
    packaged(&RECIPE.field(), None, &[500])
}

const HEADLESS: &str = "--headless --time 0.3 --size 96x64";

fn full_cache(folder: &Folder) -> Result<Completion, String> {
    let file: Arc<[u8]> = package().into();
    let served = file.clone();
    let server = Server::start(move |_, request, answer| answer.file(request, &served, "\"1\""));
    let url = server.url("clip.aarc");
    let outcome = on_small_disk(folder, client(), &format!("{url} {HEADLESS} --out fetched.png")).success();
    // Of the parts of the clip, some have room.
    if !outcome.stdout.lines().all(|line| line.ends_with(".clip")) {
        return Err(format!("left on the disk: {}", outcome.stdout));
    }
    run(&mut folder.command(client(), &format!("clip.aarc {HEADLESS} --out file.png"))).success();
    // A clip from a server is packed around its first layer: the last digits of positions differ.
    let pixels = |name: &str| -> Result<Vec<u8>, String> {
        let image =
            image::load_from_memory(&folder.read(name)?).map_err(|error| format!("{name}: {error}"))?;
        Ok(image.into_rgb8().into_raw())
    };
    let (fetched, file) = (pixels("fetched.png")?, pixels("file.png")?);
    let is_close = fetched.iter().zip(&file).all(|(a, b)| a.abs_diff(*b) <= 1);
    match fetched.len() == file.len() && is_close {
        true => Ok(Completion::Completed),
        false => Err("another image".into()),
    }
}

fn full_output(folder: &Folder) -> Result<Completion, String> {
    let large = "clip.aarc --headless --size 640x480 --out disk/frame.png";
    for (program, line) in [(client(), large), (studio(), "export clip.aarc --splatv -o disk/clip.splatv")] {
        let outcome = on_small_disk(folder, program, line);
        if !outcome.stdout.lines().all(|line| !line.starts_with("disk/")) {
            return Err(format!("left on the disk: {}", outcome.stdout));
        }
        // Progress is no error.
        let errors = outcome.stderr.lines().filter(|line| line.starts_with("error:"));
        let stderr: String = errors.map(|line| format!("{line}\n")).collect();
        Outcome { stderr, stdout: String::new(), ..outcome }.refuses(USAGE, "disk/", "No space left")?;
    }
    Ok(Completion::Completed)
}

fn little_memory(folder: &Folder) -> Result<Completion, String> {
    // The first, second or third allocation of device memory fails.
    for when in ["memory:1", "memory:2", "memory:3"] {
        let mut command = folder.command(client(), "clip.aarc --headless --size 8000x6000 --out frame.png");
        lossy(&mut command, &folder.path(""), when);
        run(&mut command).refuses(DEVICE, "enough memory", "").map_err(|what| format!("{when}: {what}"))?;
        if folder.path("frame.png").exists() {
            return Err("an image without memory".into());
        }
    }
    Ok(Completion::Completed)
}

fn lost_headless(folder: &Folder) -> Result<Completion, String> {
    // Lost at a submission or during a wait: with the first frame, while reading it back, and later.
    for (when, frames) in [("submit:1", 1), ("submit:2", 1), ("wait:1", 1), ("wait:2", 1), ("wait:5", 4)] {
        let line = format!("clip.aarc --headless --frames 0..{frames} --size 96x64 --out out");
        let mut command = folder.command(client(), &line);
        lossy(&mut command, &folder.path(""), when);
        run(&mut command).refuses(DEVICE, "stopped working", "").map_err(|what| format!("{when}: {what}"))?;
    }
    // The layer itself is harmless: lost after the last frame, nothing fails.
    let mut command = folder.command(client(), &format!("clip.aarc {HEADLESS} --out late.png"));
    lossy(&mut command, &folder.path(""), "submit:1000");
    run(&mut command).success();
    // The first device is lost after 150 submissions or waits: another draws the same images.
    let frames = |out: &str, when: &str| {
        let line = format!("clip.aarc --headless --frames 0..120 --fps 60 --size 96x64 --out {out}");
        let mut command = folder.command(client(), &line);
        lossy(&mut command, &folder.path(""), when);
        let outcome = run(&mut command).success();
        let images = (0..120).map(|i| folder.read(&format!("{out}/frame_{i:04}.png")));
        images.collect::<Result<Vec<_>, _>>().map(|images| (outcome, images))
    };
    let (_, expected) = frames("never", "submit:100000")?;
    for (out, when) in [("submit", "submit:150:1"), ("wait", "wait:150:1")] {
        let (outcome, images) = frames(out, when)?;
        if images != expected || !outcome.stderr.contains("goes on with another") {
            return Err(format!("{when}: {outcome:?}"));
        }
    }
    Ok(Completion::Completed)
}

/// A playlist whose second clip is larger than anything before it: its upload loses the device.
fn lost_in_playlist(folder: &Folder) -> Result<Completion, String> {
    let small = Recipe { count: 50, sh_degree: 0, ..RECIPE };
    folder.write("small.aarc", &lasting(&small.field(), 1.0, 60.0));
    let large = Recipe { count: 20_000, ..RECIPE };
    folder.write("large.aarc", &lasting(&large.field(), 1.0, 60.0));
    folder.write("list.json", br#"{"version": 1, "clips": ["small.aarc", "large.aarc"]}"#);
    let player = |out: &str, when: &str| {
        let line = format!("list.json --headless --frames 0..64 --size 96x64 --out {out}");
        let mut command = folder.command(client(), &line);
        lossy(&mut command, &folder.path(""), when);
        run(&mut command)
    };
    let images = |out: &str| -> Result<Vec<_>, String> {
        (0..64).map(|i| folder.read(&format!("{out}/frame_{i:04}.png"))).collect()
    };
    // Opening a device takes a buffer of half a megabyte.
    player("never", "upload:100000000").success();
    let outcome = player("lost", "upload:600000:1").success();
    if images("lost")? != images("never")? || !outcome.stderr.contains("goes on with another") {
        return Err(format!("{outcome:?}"));
    }
    let outcome = player("always", "upload:600000");
    let last = outcome.stderr.lines().last().unwrap_or_default();
    if outcome.code != Some(DEVICE) || !last.starts_with("error: ") || outcome.stderr.contains("skipped") {
        return Err(format!("{outcome:?}"));
    }
    Ok(Completion::Completed)
}

fn lost_window(folder: &Folder) -> Result<Completion, String> {
    let Some(display) = Display::start(1000, 700) else {
        return Ok(Completion::ignored_with("Xvfb is not installed"));
    };
    let player = |when| {
        let mut command = display.command(client());
        lossy(
            command.args(["clip.aarc", "--size", "720x400"]).current_dir(folder.path("")),
            &folder.path(""),
            when,
        );
        command
    };
    // Every device is lost.
    for when in ["submit:1", "submit:20", "wait:20"] {
        run(&mut player(when))
            .refuses(DEVICE, "stopped working", "")
            .map_err(|what| format!("{when}: {what}"))?;
    }
    // The first device is lost after 240 submissions or waits: the clip continues on another.
    for when in ["submit:240:1", "wait:240:1"] {
        let log = folder.path("log.txt");
        let stderr = fs::File::create(&log).map_err(|error| error.to_string())?;
        let player = display.open(player(when).stderr(stderr), "clip.aarc")?;
        let log = || fs::read_to_string(&log).unwrap_or_default();
        let is_reported = |_: &Screenshot| log().contains("goes on with another");
        display.wait_until(player.window, is_reported).ok_or_else(|| format!("{when}: {}", log()))?;
        let is_drawn = |screen: &Screenshot| screen.colors() > 500;
        let first = display.wait_until(player.window, is_drawn).ok_or(format!("{when}: nothing is drawn"))?;
        let moved = |screen: &Screenshot| is_drawn(screen) && screen.clip_changed(&first);
        display.wait_until(player.window, moved).ok_or(format!("{when}: the clip is frozen"))?;
        player.close()?;
    }
    Ok(Completion::Completed)
}
