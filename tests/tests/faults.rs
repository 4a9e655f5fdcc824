//! What machines do to programs: disks that are full, memory that runs out, drivers that give up.
//! Each ends in a picture, or in one sentence and the exit code of its kind, and leaves nothing half
//! behind.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};
use std::sync::Arc;

use aarc_tests::display::{Display, Screenshot};
use aarc_tests::gpu::{self, Passes, device};
use aarc_tests::programs::{Outcome, client, example, run, studio};
use aarc_tests::scene::{Motion, Recipe, packaged};
use aarc_tests::server::Server;
use libtest_mimic::{Completion, Failed, Trial};
use tempfile::TempDir;

const USAGE: i32 = 2;
const DEVICE: i32 = 5;

fn main() -> ExitCode {
    gpu::run(vec![
        ignorable("a full disk keeps no clip and the clip plays", Some(small_disk), full_cache),
        ignorable("a full disk is one sentence", Some(small_disk), full_output),
        ignorable("too little memory for the graphics device is one sentence", None, little_memory),
        ignorable("a driver that gives up is one sentence", None, lost_headless),
        ignorable(
            "a driver that gives up ends the window with one sentence, or another goes on",
            None,
            lost_window,
        ),
    ])
}

/// A test that needs a graphics device, and what `needs` does not find wanting.
fn ignorable(
    name: &str,
    needs: Option<fn() -> Result<(), String>>,
    test: fn(&Room) -> Result<Completion, String>,
) -> Trial {
    Trial::ignorable_test(name, move || {
        if let Err(fault) = device(Passes::Shared) {
            return Ok(Completion::ignored_with(fault));
        }
        if let Some(Err(reason)) = needs.map(|needs| needs()) {
            return Ok(Completion::ignored_with(reason));
        }
        test(&Room::new()).map_err(Failed::from)
    })
}

/// Whether a program is there and does what it is called for.
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

/// A folder with a clip in it, and an empty one for a small disk.
struct Room(TempDir);

impl Room {
    fn new() -> Room {
        let room = Room(tempfile::tempdir().expect("temporary files can be made"));
        let put = |name: &str, bytes: &[u8]| fs::write(room.path(name), bytes).expect("files can be written");
        put("clip.aarc", &package());
        fs::create_dir(room.path("disk")).expect("folders can be made");
        room
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Runs a program with a line of arguments where `disk` has 64 KiB, and prints what is on it then.
    fn on_small_disk(&self, program: &Path, line: &str) -> Outcome {
        let script = "mount -t tmpfs -o size=64k none disk && \"$@\"; code=$?; \
                      [ ! -d disk/aarc ] || find disk/aarc -type f; \
                      find disk -maxdepth 1 -type f; exit $code";
        let mut command = Command::new("unshare");
        command.args(["--user", "--map-root-user", "--mount", "sh", "-c", script, "sh"]);
        command.arg(program).args(line.split_whitespace());
        run(command
            .current_dir(self.0.path())
            .env("XDG_CACHE_HOME", self.path("disk"))
            // The driver keeps things there, too.
            .env("MESA_SHADER_CACHE_DISABLE", "true"))
    }

    fn picture(&self, name: &str) -> Result<Vec<u8>, String> {
        fs::read(self.path(name)).map_err(|error| format!("{name}: {error}"))
    }
}

/// More than fits on a small disk.
const RECIPE: Recipe =
    Recipe { count: 2500, sh_degree: 2, motion: Motion::Moving, motion_order: 3, turning: false, seed: 5 };

fn package() -> Vec<u8> {
    packaged(&RECIPE.field(), None, &[500])
}

/// Checks that a program ended with `code` and one line that has `words` in it.
fn sentence(outcome: &Outcome, code: i32, words: &[&str]) -> Result<Completion, String> {
    let lines = outcome.stderr.trim_end().lines().count();
    let says = words.iter().all(|word| outcome.stderr.contains(word));
    if outcome.code == Some(code) && lines == 1 && says {
        return Ok(Completion::Completed);
    }
    Err(format!("exit code {code} and a line with {words:?} expected: {outcome:#?}"))
}

const HEADLESS: &str = "--headless --time 0.3 --size 96x64";

fn full_cache(room: &Room) -> Result<Completion, String> {
    let file: Arc<[u8]> = package().into();
    let served = file.clone();
    let server =
        Server::start(move |_, request, answer| answer.file(request, &served, "\"1\"", served.len()));
    let url = server.url("clip.aarc");
    let outcome = room.on_small_disk(client(), &format!("{url} {HEADLESS} --out fetched.png")).success();
    if !outcome.stdout.is_empty() {
        return Err(format!("left on the disk: {}", outcome.stdout));
    }
    run(Command::new(client())
        .current_dir(room.0.path())
        .args(format!("clip.aarc {HEADLESS} --out file.png").split_whitespace()))
    .success();
    match room.picture("fetched.png")? == room.picture("file.png")? {
        true => Ok(Completion::Completed),
        false => Err("another picture".into()),
    }
}

fn full_output(room: &Room) -> Result<Completion, String> {
    let large = "clip.aarc --headless --size 640x480 --out disk/frame.png";
    for (program, line) in [(client(), large), (studio(), "export clip.aarc --splatv -o disk/clip.splatv")] {
        let outcome = room.on_small_disk(program, line);
        if !outcome.stdout.lines().all(|line| !line.starts_with("disk/")) {
            return Err(format!("left on the disk: {}", outcome.stdout));
        }
        // What the tool tells before the end is no error.
        let errors = outcome.stderr.lines().filter(|line| line.starts_with("error:"));
        let stderr: String = errors.map(|line| format!("{line}\n")).collect();
        sentence(&Outcome { stderr, ..outcome }, USAGE, &["disk/", "No space left"])?;
    }
    Ok(Completion::Completed)
}

/// Has the driver give up under a command.
fn lossy(command: &mut Command, room: &Room, when: &str) {
    let library = example("lossy_driver");
    let layer = serde_json::json!({
        "file_format_version": "1.1.2",
        "layer": {
            "name": "VK_LAYER_AARC_lossy_driver", "type": "GLOBAL", "library_path": library,
            "api_version": "1.3.0", "implementation_version": "1", "description": "loses the device",
        },
    });
    fs::write(room.path("lossy.json"), layer.to_string()).expect("files can be written");
    command.env("VK_ADD_LAYER_PATH", room.0.path()).env("VK_INSTANCE_LAYERS", "VK_LAYER_AARC_lossy_driver");
    command.env("AARC_LOSE", when);
}

fn little_memory(room: &Room) -> Result<Completion, String> {
    // None at all; and none besides the block that small things are in, sooner or later.
    for when in ["memory:1", "memory:2", "memory:3"] {
        let mut command = Command::new(client());
        let line = "clip.aarc --headless --size 8000x6000 --out frame.png";
        lossy(command.args(line.split_whitespace()).current_dir(room.0.path()), room, when);
        sentence(&run(&mut command), DEVICE, &["enough memory"]).map_err(|what| format!("{when}: {what}"))?;
        if room.path("frame.png").exists() {
            return Err("a picture without memory".into());
        }
    }
    Ok(Completion::Completed)
}

fn lost_headless(room: &Room) -> Result<Completion, String> {
    // Refused, or lost while somebody waits; with the first frame, while reading it back, and later.
    for (when, frames) in [("submit:1", 1), ("submit:2", 1), ("wait:1", 1), ("wait:2", 1), ("wait:5", 4)] {
        let mut command = Command::new(client());
        let line = format!("clip.aarc --headless --frames 0..{frames} --size 96x64 --out out");
        lossy(command.args(line.split_whitespace()).current_dir(room.0.path()), room, when);
        sentence(&run(&mut command), DEVICE, &["stopped working"])
            .map_err(|what| format!("{when}: {what}"))?;
    }
    // Lost too late to matter, it does not: the layer is what loses it.
    let mut command = Command::new(client());
    let line = format!("clip.aarc {HEADLESS} --out late.png");
    lossy(command.args(line.split_whitespace()).current_dir(room.0.path()), room, "submit:1000");
    run(&mut command).success();
    Ok(Completion::Completed)
}

fn lost_window(room: &Room) -> Result<Completion, String> {
    let Some(display) = Display::start(1000, 700) else {
        return Ok(Completion::ignored_with("Xvfb is not installed"));
    };
    let player = |when| {
        let mut command = display.command(client());
        lossy(command.args(["clip.aarc", "--size", "720x400"]).current_dir(room.0.path()), room, when);
        command
    };
    // Lost over and over.
    for when in ["submit:1", "submit:20", "wait:20"] {
        sentence(&run(&mut player(when)), DEVICE, &["stopped working"])
            .map_err(|what| format!("{when}: {what}"))?;
    }
    // Lost once, when it has worked until then: the clip goes on.
    for when in ["submit:240:1", "wait:240:1"] {
        let told = room.path("told.txt");
        let told_to = fs::File::create(&told).map_err(|error| error.to_string())?;
        let player = display.open(player(when).stderr(told_to), "clip.aarc")?;
        let told = || fs::read_to_string(&told).unwrap_or_default();
        let is_told = |_: &Screenshot| told().contains("goes on with another");
        display.wait_until(player.window, is_told).ok_or_else(|| format!("{when}: {}", told()))?;
        let is_seen = |shot: &Screenshot| shot.colors() > 500;
        let first = display.wait_until(player.window, is_seen).ok_or(format!("{when}: nothing is seen"))?;
        let moved = |shot: &Screenshot| is_seen(shot) && shot.clip_changed(&first);
        display.wait_until(player.window, moved).ok_or(format!("{when}: it stands still"))?;
        player.close()?;
    }
    Ok(Completion::Completed)
}
