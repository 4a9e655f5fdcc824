//! The desktop window on a display in memory: screenshots and key presses.

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use aarc_tests::display::{CONTROLS, Display, Player, Screenshot, Window, trial};
use aarc_tests::outcome::DEVICE;
use aarc_tests::programs::{client, run};
use aarc_tests::scene::{Motion, Recipe, packaged};
use aarc_tests::server::Server;
use aarc_tests::take_files::{SegmentFile, take_package};
use libtest_mimic::{Failed, Trial};

const SPACE: u32 = 0x20;
const RIGHT: u32 = 0xff53;
const PAGE_UP: u32 = 0xff55;
const PAGE_DOWN: u32 = 0xff56;
const O: u32 = 'o' as u32;
const P: u32 = 'p' as u32;
const U: u32 = 'u' as u32;

/// The tests of this file.
pub(crate) fn trials() -> Vec<Trial> {
    vec![
        trial("a clip plays, pauses, steps and is saved as an image", plays),
        trial("a static clip rests", rests),
        trial("a covered window draws nothing", rests_covered),
        trial("other clips are opened from the folder and by a dialog", opens_others),
        trial("files that are dropped together are a playlist", opens_dropped),
        trial("a window closes while its dialog is open", closes_with_dialog),
        trial("a window closes while a server is silent", closes_with_silent_server),
        trial(
            "a window opens and closes while the server is silent about its first clip",
            opens_with_silent_server,
        ),
        trial("a window opens at once, and closes while nothing of its first clip comes", opens_without_clip),
        trial("a file that fails while the first clip is opened ends nothing", opens_another_first),
        Trial::test("without a display", || without_display().map_err(Failed::from)),
    ]
}

/// Writes a clip that moves throughout.
fn write_clip(path: &Path) {
    let recipe = Recipe {
        count: 300,
        sh_degree: 1,
        motion: Motion::Dynamic,
        motion_order: 3,
        turning: false,
        seed: 3,
    };
    fs::write(path, packaged(&recipe.field(), None, &[])).expect("temporary files can be written");
}

fn plays(display: &Display) -> Result<(), String> {
    let folder = tempfile::tempdir().map_err(|error| error.to_string())?;
    let clip = folder.path().join("dancers.aarc");
    write_clip(&clip);
    let mut command = display.command(client());
    command.arg(&clip).args(["--size", "800x600"]).stderr(Stdio::inherit());
    let pictures = pictures_of(&mut command, folder.path())?;
    let player = display.open(&mut command, "dancers.aarc")?;
    let window = player.window;
    let look = |what: &str, condition: &dyn Fn(&Screenshot) -> bool| {
        display.wait_until(window, condition).ok_or(format!("the window never {what}"))
    };

    let first = look("shows an image", &|screen| screen.colors() > 500)?;
    if (first.width, first.height) != (800, 600) {
        return Err(format!("the window has {}x{} pixels", first.width, first.height));
    }
    look("moves", &|screen| screen.clip_changed(&first))?;

    display.focus(window);
    display.press(SPACE);
    let paused = unchanging(display, window).ok_or("it does not pause on the space bar")?;
    display.press(RIGHT);
    look("steps to another frame", &|screen| screen.clip_changed(&paused))?;
    // The first screenshot may show half of a frame.
    let stepped = unchanging(display, window).ok_or("it moves on after a step")?;
    if !stepped.clip_changed(&paused) {
        return Err("it steps back after a step".into());
    }
    display.press(SPACE);
    look("plays on", &|screen| screen.clip_changed(&stepped))?;

    let controls =
        |screen: &Screenshot| screen.rgb[(3 * screen.width * (screen.height - CONTROLS)) as usize..].to_vec();
    let with = controls(&stepped);
    display.press(U);
    look("hides its controls", &|screen| controls(screen) != with)?;

    display.press(P);
    let saved = wait_for_image(&pictures).ok_or("the key P saves no image")?;
    let size = image::image_dimensions(&saved).map_err(|error| error.to_string())?;
    if size.0 < 800 || size.1 < 600 {
        return Err(format!("{} has {size:?} pixels", saved.display()));
    }

    player.close()
}

/// Gives the user of a player a home in `root`. Returns the folder for pictures there.
fn pictures_of(command: &mut Command, root: &Path) -> Result<PathBuf, String> {
    let pictures = root.join("Pictures");
    fs::create_dir(&pictures).map_err(|error| error.to_string())?;
    command.env("HOME", root).env_remove("XDG_CONFIG_HOME");
    Ok(pictures)
}

/// A static clip is drawn once; from then on the window waits for input.
fn rests(display: &Display) -> Result<(), String> {
    let folder = tempfile::tempdir().map_err(|error| error.to_string())?;
    let clip = folder.path().join("statue.aarc");
    let recipe =
        Recipe { count: 300, sh_degree: 1, motion: Motion::Static, motion_order: 0, turning: false, seed: 3 };
    fs::write(&clip, packaged(&recipe.field(), None, &[])).map_err(|error| error.to_string())?;
    let mut command = display.command(client());
    let player = display.open(command.arg(&clip).args(["--size", "800x600"]), "statue.aarc")?;
    let is_drawn = |screen: &Screenshot| screen.colors() > 500;
    display.wait_until(player.window, is_drawn).ok_or("the window never shows an image")?;
    unchanging(display, player.window).ok_or("it changes")?;
    rests_for_two_seconds(&player, 0.1)?;
    player.close()
}

/// Fails if the player keeps a processor busy for more than `most_s` of two seconds.
fn rests_for_two_seconds(player: &Player<'_>, most_s: f64) -> Result<(), String> {
    let before_s = player.cpu_s()?;
    sleep(Duration::from_secs(2));
    let busy_s = player.cpu_s()? - before_s;
    match busy_s > most_s {
        true => Err(format!("it keeps a processor busy for {busy_s:.2} of 2 s")),
        false => Ok(()),
    }
}

/// Nobody sees a window that another one covers.
fn rests_covered(display: &Display) -> Result<(), String> {
    let folder = tempfile::tempdir().map_err(|error| error.to_string())?;
    let clip = folder.path().join("dancers.aarc");
    write_clip(&clip);
    let mut command = display.command(client());
    let player = display.open(command.arg(&clip).args(["--size", "800x600"]), "dancers.aarc")?;
    display
        .wait_until(player.window, |screen| screen.colors() > 500)
        .ok_or("the window never shows an image")?;
    display.cover();
    // The frame that is being drawn is finished.
    sleep(Duration::from_secs(1));
    rests_for_two_seconds(&player, 0.2)?;
    player.close()
}

/// The clips beside the clip on display, the dialog, and the list of recent clips.
fn opens_others(display: &Display) -> Result<(), String> {
    let folder = tempfile::tempdir().map_err(|error| error.to_string())?;
    let root = folder.path();
    for name in ["a.aarc", "b.aarc", "c.aarc"] {
        write_clip(&root.join(name));
    }
    let chosen = format!("echo '{}'", root.join("c.aarc").display());
    let mut command = with_dialog(display, root, &chosen)?;
    let player = display.open(&mut command, "a.aarc")?;
    let window = player.window;
    display.wait_until(window, |screen| screen.colors() > 500).ok_or("it shows no image")?;
    display.focus(window);
    let shows = |title: &str| {
        let shown = display.wait_until(window, |_| display.title(window) == title);
        shown.ok_or_else(|| format!("{} instead of {title}", display.title(window)))
    };
    display.press(PAGE_DOWN);
    shows("b.aarc")?;
    display.press(PAGE_UP);
    shows("a.aarc")?;
    // The second counts from the clip that the first opens.
    display.press(PAGE_UP);
    display.press(PAGE_UP);
    shows("b.aarc")?;
    display.press(PAGE_UP);
    shows("a.aarc")?;

    display.press(O);
    shows("c.aarc")?;
    player.close()?;
    let recent =
        fs::read_to_string(root.join("state/aarc/recent.json")).map_err(|error| error.to_string())?;
    let recent: serde_json::Value = serde_json::from_str(&recent).map_err(|error| error.to_string())?;
    let expected = ["c.aarc", "a.aarc", "b.aarc"].map(|name| root.join(name));
    if recent["clips"] != serde_json::json!(expected) {
        return Err(format!("it remembers {recent}"));
    }
    Ok(())
}

/// Files that are dropped together play one after another, and so do the clips of a folder.
fn opens_dropped(display: &Display) -> Result<(), String> {
    let folder = tempfile::tempdir().map_err(|error| error.to_string())?;
    let root = folder.path();
    fs::create_dir(root.join("more")).map_err(|error| error.to_string())?;
    for name in ["a.aarc", "b.aarc", "c.aarc", "more/d.aarc", "more/e.aarc"] {
        write_clip(&root.join(name));
    }
    let mut command = display.command(client());
    let player = display.open(command.arg(root.join("a.aarc")).args(["--size", "800x600"]), "a.aarc")?;
    let window = player.window;
    display.wait_until(window, |screen| screen.colors() > 500).ok_or("it shows no image")?;
    let shows = |title: &str| {
        let shown = display.wait_until(window, |_| display.title(window) == title);
        shown.ok_or_else(|| format!("{} instead of {title}", display.title(window)))
    };
    for (dropped, [first, last]) in
        [(&["c.aarc", "b.aarc"][..], ["b.aarc", "c.aarc"]), (&["more"], ["d.aarc", "e.aarc"])]
    {
        let paths: Vec<PathBuf> = dropped.iter().map(|name| root.join(name)).collect();
        display.drop_files(window, &paths);
        for title in [first, last, first] {
            shows(title)?;
        }
    }
    player.close()
}

/// The program waits neither for the dialog nor for what is chosen in it.
fn closes_with_dialog(display: &Display) -> Result<(), String> {
    let folder = tempfile::tempdir().map_err(|error| error.to_string())?;
    let root = folder.path();
    write_clip(&root.join("a.aarc"));
    let opened = root.join("opened");
    // Open for as long as this test runs.
    let dialog = format!("touch '{0}'; while [ -e '{0}' ]; do sleep 0.1; done", opened.display());
    let mut command = with_dialog(display, root, &dialog)?;
    let player = display.open(&mut command, "a.aarc")?;
    display.wait_until(player.window, |screen| screen.colors() > 500).ok_or("it shows no image")?;
    display.focus(player.window);
    display.press(O);
    display.wait_until(player.window, |_| opened.exists()).ok_or("no dialog opens")?;
    let closed = player.close();
    fs::remove_file(&opened).map_err(|error| error.to_string())?;
    closed
}

/// The next clip is on a server that takes requests and sends nothing.
fn closes_with_silent_server(display: &Display) -> Result<(), String> {
    let folder = tempfile::tempdir().map_err(|error| error.to_string())?;
    write_clip(&folder.path().join("a.aarc"));
    let server = Server::start(|_, _, answer| answer.wait_until_closed());
    let mut command = display.command(client());
    command.arg("a.aarc").arg(server.url("b.aarc")).args(["--size", "800x600"]).current_dir(folder.path());
    command.env("XDG_CACHE_HOME", folder.path()).env("XDG_STATE_HOME", folder.path());
    let player = display.open(&mut command, "a.aarc")?;
    display.wait_until(player.window, |screen| screen.colors() > 500).ok_or("it shows no image")?;
    display.focus(player.window);
    display.press(PAGE_DOWN);
    let is_asked = |_: &Screenshot| !server.requests().is_empty();
    display.wait_until(player.window, is_asked).ok_or("it asks for nothing")?;
    closes_at_once(display, player)
}

/// The first clip is a take whose head comes, and no segment.
fn opens_with_silent_server(display: &Display) -> Result<(), String> {
    let folder = tempfile::tempdir().map_err(|error| error.to_string())?;
    write_clip(&folder.path().join("a.aarc"));
    let package = fs::read(folder.path().join("a.aarc")).map_err(|error| error.to_string())?;
    let segment = |start_s: f64| SegmentFile { start_s, duration_s: 2.0, package: package.clone() };
    let (file, _) = take_package(4.0, 30.0, &[segment(0.0), segment(2.0)]);
    let server = Server::start(move |number, request, answer| match number {
        0 => answer.file(request, &file, "\"one\""),
        _ => answer.wait_until_closed(),
    });
    let mut command = display.command(client());
    command.arg(server.url("take.aarc")).args(["--size", "800x600"]);
    command.env("XDG_CACHE_HOME", folder.path()).env("XDG_STATE_HOME", folder.path());
    let player = display.open(&mut command, "take.aarc")?;
    display.wait_until(player.window, |_| server.requests().len() > 1).ok_or("it asks for no segment")?;
    closes_at_once(display, player)
}

/// Fails if a player whose window shows its controls does not close at once.
fn closes_at_once(display: &Display, player: Player<'_>) -> Result<(), String> {
    display.wait_until(player.window, |screen| screen.colors() > 20).ok_or("it shows no controls")?;
    let start = Instant::now();
    player.close()?;
    match start.elapsed() {
        took if took > Duration::from_secs(5) => Err(format!("it closes after {took:?}")),
        _ => Ok(()),
    }
}

/// The first clip is on a server that takes requests and sends nothing.
fn opens_without_clip(display: &Display) -> Result<(), String> {
    let folder = tempfile::tempdir().map_err(|error| error.to_string())?;
    let server = Server::start(|_, _, answer| answer.wait_until_closed());
    let mut command = display.command(client());
    command.arg(server.url("a.aarc")).args(["--size", "800x600"]).env("XDG_CACHE_HOME", folder.path());
    closes_at_once(display, display.open(&mut command, "a.aarc")?)
}

/// What the viewer opens takes the place of a clip that does not come.
fn opens_another_first(display: &Display) -> Result<(), String> {
    let folder = tempfile::tempdir().map_err(|error| error.to_string())?;
    let [good, broken] = ["good.aarc", "broken.aarc"].map(|name| folder.path().join(name));
    write_clip(&good);
    fs::write(&broken, b"not a clip").map_err(|error| error.to_string())?;
    let server = Server::start(|_, _, answer| answer.wait_until_closed());
    let mut command = display.command(client());
    command.arg(server.url("a.aarc")).args(["--size", "800x600", "--view", "of the first clip"]);
    command.env("XDG_CACHE_HOME", folder.path()).env("XDG_STATE_HOME", folder.path());
    let player = display.open(&mut command, "a.aarc")?;
    let window = player.window;
    display.wait_until(window, |screen| screen.colors() > 20).ok_or("it shows no controls")?;
    display.drop_files(window, &[broken]);
    sleep(Duration::from_secs(1));
    display.drop_files(window, &[good]);
    let is_good = |screen: &Screenshot| display.title(window) == "good.aarc" && screen.colors() > 500;
    display.wait_until(window, is_good).ok_or("what is opened is not drawn")?;
    player.close()
}

/// A command that plays `a.aarc` in `root`, with a script in place of the desktop's dialog and with folders of its own.
fn with_dialog(display: &Display, root: &Path, script: &str) -> Result<Command, String> {
    let program = root.join("zenity");
    fs::write(&program, format!("#!/bin/sh\n{script}\n")).map_err(|error| error.to_string())?;
    fs::set_permissions(&program, fs::Permissions::from_mode(0o755)).map_err(|error| error.to_string())?;
    let mut command = display.command(client());
    let path = std::env::var("PATH").unwrap_or_default();
    command.arg("a.aarc").args(["--size", "800x600"]).current_dir(root);
    command.env("PATH", format!("{}:{path}", root.display())).env_remove("DBUS_SESSION_BUS_ADDRESS");
    command.env("XDG_CACHE_HOME", root.join("cache")).env("XDG_STATE_HOME", root.join("state"));
    Ok(command)
}

/// Waits until the clip has not changed for half a second.
fn unchanging(display: &Display, window: Window) -> Option<Screenshot> {
    let start = Instant::now();
    while start.elapsed() < Duration::from_secs(20) {
        let before = display.screenshot(window)?;
        sleep(Duration::from_millis(500));
        let after = display.screenshot(window)?;
        if !before.clip_changed(&after) {
            return Some(after);
        }
    }
    None
}

/// Waits for a PNG in the folder.
fn wait_for_image(folder: &Path) -> Option<PathBuf> {
    let start = Instant::now();
    while start.elapsed() < Duration::from_secs(20) {
        let entries = fs::read_dir(folder).ok()?;
        let is_image = |path: &PathBuf| path.extension().is_some_and(|end| end == "png");
        if let Some(path) = entries.flatten().map(|entry| entry.path()).find(is_image) {
            return Some(path);
        }
        sleep(Duration::from_millis(50));
    }
    None
}

/// The error names `--headless` as the alternative.
fn without_display() -> Result<(), String> {
    let folder = tempfile::tempdir().map_err(|error| error.to_string())?;
    let clip = folder.path().join("clip.aarc");
    write_clip(&clip);
    let mut command = Command::new(client());
    command.arg(&clip).env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY").env_remove("WAYLAND_SOCKET");
    run(&mut command).refuses(DEVICE, "display", "--headless")
}
