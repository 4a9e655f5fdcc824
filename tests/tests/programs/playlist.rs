//! Playlists, as a user plays them: images, a window, files and URLs, and clips that fail.

use std::fs;
use std::path::PathBuf;
use std::process::Stdio;
use std::thread::sleep;
use std::time::{Duration, Instant};

use aarc_tests::display::{self, Display, Screenshot};
use aarc_tests::gpu::{self, Passes};
use aarc_tests::outcome::{Outcome, USAGE};
use aarc_tests::programs::{Folder, client, run};
use aarc_tests::scene::{Motion, Recipe, ball, lasting, packaged};
use aarc_tests::server::Server;
use client::gpu::Gpu;
use libtest_mimic::Trial;

/// The tests of this file.
pub(crate) fn trials() -> Vec<Trial> {
    vec![
        gpu::trial("the last image of a clip is followed by the first of the next", Passes::Shared, images),
        gpu::trial("from a URL, and again without the network", Passes::Shared, urls),
        gpu::trial("a time beyond the end of a clip is refused", Passes::Shared, beyond_the_end),
        display::trial("in a window nothing comes between two clips, over and over", window),
        display::trial("a window prints each remark on a clip once", remarks),
    ]
}

/// Plays without a window, with the cache in the folder.
fn play(folder: &Folder, clip: &str, line: &str) -> Outcome {
    let mut command = folder.command(client(), &format!("--headless --size 96x64 {line}"));
    run(command.env("XDG_CACHE_HOME", folder.path("cache")).arg(clip))
}

/// The images in a folder of the folder, in order.
fn images_in(folder: &Folder, name: &str) -> Vec<Vec<u8>> {
    let entries = folder.path(name).read_dir().expect("images were written");
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.expect("a file").path()).collect();
    paths.sort();
    paths.iter().map(|path| fs::read(path).expect("an image")).collect()
}

fn write_list(folder: &Folder, names: &[&str]) {
    folder.write("list.json", list(names).as_bytes());
}

/// A playlist of these clips.
fn list(names: &[&str]) -> String {
    serde_json::json!({"version": 1, "clips": names}).to_string()
}

/// A dynamic clip of 0.5 s at 8 frames per second, whose instants are exact in binary.
fn dynamic(seed: u64) -> Vec<u8> {
    let recipe =
        Recipe { count: 300, sh_degree: 0, motion: Motion::Dynamic, motion_order: 2, turning: false, seed };
    lasting(&recipe.field(), 0.5, 8.0)
}

fn images(_: &Gpu) -> Result<(), String> {
    let folder = Folder::default();
    folder.write("a.aarc", &dynamic(1));
    folder.write("b c.aarc", &dynamic(2));
    folder.write("broken.aarc", b"no clip");
    for (clip, out) in [("a.aarc", "a"), ("b c.aarc", "b")] {
        play(&folder, clip, &format!("--frames 0..5 --out {out}")).success();
    }
    write_list(&folder, &["missing.aarc", "a.aarc", "broken.aarc", "b c.aarc"]);
    let outcome = play(&folder, "list.json", "--frames 0..9 --out both").success();
    // The end of one clip is the beginning of the next.
    let (a, b, both) = (images_in(&folder, "a"), images_in(&folder, "b"), images_in(&folder, "both"));
    if a[3] == b[0] || both != [&a[..4], &b[..]].concat() {
        return Err(format!("{} images: {outcome:?}", both.len()));
    }
    let lines: Vec<&str> = outcome.stderr.lines().collect();
    let [first, second] = lines[..] else { return Err(format!("{outcome:?}")) };
    for (line, clip) in [(first, "missing.aarc"), (second, "broken.aarc")] {
        if !(line.starts_with(clip) && line.ends_with("; skipped")) {
            return Err(format!("{outcome:?}"));
        }
    }
    // One instant of the second clip alone.
    play(&folder, "list.json", "--time 0.75 --out one.png").success();
    if fs::read(folder.path("one.png")).map_err(|error| error.to_string())? != b[2] {
        return Err("another image".into());
    }
    // A clip without the requested layer is skipped too.
    let field =
        Recipe { count: 300, sh_degree: 0, motion: Motion::Static, motion_order: 0, turning: false, seed: 6 };
    folder.write("layers.aarc", &packaged(&field.field(), None, &[100]));
    play(&folder, "layers.aarc", "--layer 2 --out alone.png").success();
    write_list(&folder, &["a.aarc", "layers.aarc"]);
    let outcome = play(&folder, "list.json", "--layer 2 --out listed.png").success();
    if outcome.stderr.trim() != "a.aarc: --layer 2: the clip has 1 layer: give no larger number; skipped" {
        return Err(format!("{outcome:?}"));
    }
    let [alone, listed] =
        ["alone.png", "listed.png"].map(|name| fs::read(folder.path(name)).expect("an image"));
    if alone != listed {
        return Err("another image of two layers".into());
    }
    Ok(())
}

fn urls(_: &Gpu) -> Result<(), String> {
    const ETAG: &str = "\"one\"";
    let folder = Folder::default();
    let clips = [dynamic(3), dynamic(4)];
    for (name, clip) in ["a.aarc", "b.aarc"].iter().zip(&clips) {
        folder.write(name, clip);
    }
    write_list(&folder, &["a.aarc", "b.aarc"]);
    play(&folder, "list.json", "--frames 0..9 --out files").success();
    let server = Server::start(move |_, request, answer| {
        let relative = list(&["x y/a.aarc", "none.aarc", "/b.aarc?"]);
        let three = list(&["x y/a.aarc", "/b.aarc?", "c.aarc"]);
        let file: &[u8] = match request.path.as_str() {
            "/show/three.json" => three.as_bytes(),
            "/show/list.json?key=1" => relative.as_bytes(),
            "/show/x%20y/a.aarc" => &clips[0],
            "/b.aarc%3F" => &clips[1],
            _ => return answer.head(404, &[("Content-Length", "0")]),
        };
        if request.header("if-none-match") == Some(ETAG) {
            answer.head(304, &[("ETag", ETAG)]);
        } else {
            answer.file(request, file, ETAG);
        }
    });
    let url = server.url("show/list.json?key=1");
    let outcome = play(&folder, &url, "--frames 0..9 --out fetched").success();
    if !outcome.stderr.contains("none.aarc: there is no such file (404 Not Found): check the URL; skipped") {
        return Err(format!("{outcome:?}"));
    }
    play(&folder, &url, "--frames 0..9 --out again").success();
    if server.sent().len() != 3 {
        return Err(format!("sent again: {:?}", server.requests()));
    }
    let url_of_three = server.url("show/three.json");
    play(&folder, &url_of_three, "--frames 0..6 --out two").success();
    if server.requests().iter().any(|request| request.path == "/show/c.aarc") {
        return Err("a clip was loaded that no image needs".into());
    }
    drop(server);
    let alone = play(&folder, &url, "--frames 0..9 --out alone").success();
    let note = "list.json: the server takes no connections: check the network, or try again later; the version cached";
    if !alone.stderr.contains(note) {
        return Err(format!("{alone:?}"));
    }
    let expected = images_in(&folder, "files");
    for name in ["fetched", "again", "alone"] {
        if images_in(&folder, name) != expected {
            return Err(format!("other images: {name}"));
        }
    }
    Ok(())
}

fn beyond_the_end(_: &Gpu) -> Result<(), String> {
    let folder = Folder::default();
    folder.write("a.aarc", &dynamic(5));
    folder.write("list.json", list(&["a.aarc", "a.aarc"]).as_bytes());
    play(&folder, "list.json", "--time 1.5 --out b.png").refuses(USAGE, "give 0 to 1 s", "")
}

/// Colour at the center of a window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum CenterColor {
    Red,
    Blue,
    Other([u8; 3]),
}

pub(crate) fn center_color(screen: &Screenshot) -> CenterColor {
    let at = 3 * (screen.height / 2 * screen.width + screen.width / 2) as usize;
    match screen.rgb[at..at + 3] {
        [r, _, b] if r > 180 && b < 60 => CenterColor::Red,
        [r, _, b] if b > 180 && r < 60 => CenterColor::Blue,
        [r, g, b] => CenterColor::Other([r, g, b]),
        _ => unreachable!("three channels"),
    }
}

/// Takes screenshots as fast as it can while a red, a broken and a blue clip play in a loop.
fn window(display: &Display) -> Result<(), String> {
    let folder = Folder::default();
    folder.write("red.aarc", &lasting(&ball([1.0, 0.0, 0.0]), 0.7, 10.0));
    folder.write("blue.aarc", &lasting(&ball([0.0, 0.0, 1.0]), 0.7, 10.0));
    folder.write("broken.aarc", b"no clip");
    write_list(&folder, &["red.aarc", "broken.aarc", "blue.aarc"]);
    let mut command = display.command(client());
    command.arg(folder.path("list.json")).args(["--size", "800x600"]).current_dir(folder.path(""));
    let player = display.open(command.stderr(Stdio::inherit()), "red.aarc")?;
    let window = player.window;
    display
        .wait_until(window, |screen| center_color(screen) == CenterColor::Red)
        .ok_or("the first clip is not drawn")?;
    let (mut order, mut titles, mut screenshots) = (vec![CenterColor::Red], Vec::new(), 0);
    let start = Instant::now();
    while order.len() < 6 {
        if start.elapsed() > Duration::from_secs(60) {
            return Err(format!("the next clip does not come: {order:?} {titles:?}"));
        }
        let title = display.title(window);
        if titles.last() != Some(&title) {
            titles.push(title);
        }
        let screen = display.screenshot(window).ok_or("the window went away")?;
        screenshots += 1;
        match center_color(&screen) {
            CenterColor::Other(color) => return Err(format!("{color:?} between two clips, {order:?}")),
            color if order.last() != Some(&color) => order.push(color),
            _ => {}
        }
        sleep(Duration::from_millis(2));
    }
    println!("{screenshots} screenshots, {order:?}");
    // On a busy machine the first title may be any clip's.
    let is_known = |title: &String| ["red.aarc", "blue.aarc"].contains(&title.as_str());
    if titles.len() < 2 || !titles.iter().all(is_known) {
        return Err(format!("{titles:?}"));
    }
    player.close()
}

/// Plays a playlist whose second clip is cut short and whose third is broken until all have been loaded again.
fn remarks(display: &Display) -> Result<(), String> {
    let folder = Folder::default();
    folder.write("a.aarc", &lasting(&ball([1.0, 0.0, 0.0]), 0.4, 10.0));
    let recipe = Recipe {
        count: 300,
        sh_degree: 0,
        motion: Motion::Dynamic,
        motion_order: 2,
        turning: false,
        seed: 9,
    };
    let clip = packaged(&recipe.field(), None, &[100, 200]);
    folder.write("cut.aarc", &clip[..clip.len() - 1]);
    folder.write("broken.aarc", b"no clip");
    write_list(&folder, &["a.aarc", "cut.aarc", "broken.aarc"]);
    let log = folder.path("log.txt");
    let stderr = fs::File::create(&log).map_err(|error| error.to_string())?;
    let mut command = display.command(client());
    command.arg("list.json").args(["--size", "720x400"]).current_dir(folder.path(""));
    let player = display.open(command.stderr(stderr), "a.aarc")?;
    let start = Instant::now();
    // Titles change with the clips.
    let (mut title, mut changes) = (String::from("a.aarc"), 0);
    while changes < 4 {
        let now = display.title(player.window);
        if now != title {
            (title, changes) = (now, changes + 1);
        }
        if start.elapsed() > Duration::from_secs(60) {
            return Err(format!("{changes} changes of clips"));
        }
        sleep(Duration::from_millis(20));
    }
    player.close()?;
    let log = fs::read_to_string(&log).map_err(|error| error.to_string())?;
    let count = |text: &str| log.lines().filter(|line| line.contains(text)).count();
    match (count("cut.aarc: the file is cut short"), count("broken.aarc: "), log.lines().count()) {
        (1, 1, 2) => Ok(()),
        _ => Err(log),
    }
}
