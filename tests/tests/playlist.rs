//! Playlists, as a user plays them: pictures, a window, files and addresses, and clips that fail.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use aarc_tests::display::{self, Display, Screenshot};
use aarc_tests::gpu::{self, Passes};
use aarc_tests::programs::{Outcome, client, run};
use aarc_tests::scene::{Motion, Recipe, ball, lasting, packaged};
use aarc_tests::server::Server;
use client::gpu::Gpu;
use tempfile::TempDir;

const USAGE: i32 = 2;
const DATA: i32 = 3;

fn main() -> ExitCode {
    gpu::run(vec![
        gpu::trial(
            "the last picture of a clip is followed by the first of the next",
            Passes::Shared,
            pictures,
        ),
        gpu::trial("from an address, and again without the network", Passes::Shared, addresses),
        gpu::trial("what is wrong is one sentence and an exit code", Passes::Shared, faults),
        display::trial("in a window nothing comes between two clips, over and over", window),
    ])
}

/// A folder with clips and a playlist in which players run.
struct Place {
    folder: TempDir,
}

impl Place {
    fn new() -> Place {
        Place { folder: tempfile::tempdir().expect("temporary files can be made") }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn write(&self, name: &str, bytes: &[u8]) {
        fs::write(self.path(name), bytes).expect("temporary files can be written");
    }

    /// Writes `list.json`.
    fn list(&self, names: &[&str]) {
        self.write("list.json", list(names).as_bytes());
    }

    /// Runs the player here for pictures.
    fn player(&self, clip: &str, line: &str) -> Outcome {
        let mut command = Command::new(client());
        command.current_dir(self.folder.path()).env("XDG_CACHE_HOME", self.path("cache")).arg(clip);
        run(command.args(["--headless", "--size", "96x64"]).args(line.split_whitespace()))
    }

    /// The pictures in a folder, in order.
    fn pictures(&self, folder: &str) -> Vec<Vec<u8>> {
        let entries = self.path(folder).read_dir().expect("pictures were written");
        let mut paths: Vec<PathBuf> = entries.map(|entry| entry.expect("a file").path()).collect();
        paths.sort();
        paths.iter().map(|path| fs::read(path).expect("a picture")).collect()
    }
}

fn list(names: &[&str]) -> String {
    serde_json::json!({"version": 1, "clips": names}).to_string()
}

/// Half a second that moves, captured at 8 frames per second: instants are exact in binary.
fn moving(seed: u64) -> Vec<u8> {
    let recipe =
        Recipe { count: 300, sh_degree: 0, motion: Motion::Moving, motion_order: 2, turning: false, seed };
    lasting(&recipe.field(), 0.5, 8.0)
}

fn pictures(_: &Gpu) -> Result<(), String> {
    let place = Place::new();
    place.write("a.aarc", &moving(1));
    place.write("b c.aarc", &moving(2));
    place.write("broken.aarc", b"no clip");
    for (clip, out) in [("a.aarc", "a"), ("b c.aarc", "b")] {
        place.player(clip, &format!("--frames 0..5 --out {out}")).success();
    }
    place.list(&["missing.aarc", "a.aarc", "broken.aarc", "b c.aarc"]);
    let outcome = place.player("list.json", "--frames 0..9 --out both").success();
    // The end of the one is the beginning of the other.
    let (a, b, both) = (place.pictures("a"), place.pictures("b"), place.pictures("both"));
    if a[3] == b[0] || both != [&a[..4], &b[..]].concat() {
        return Err(format!("{} pictures: {outcome:?}", both.len()));
    }
    let told: Vec<&str> = outcome.stderr.lines().collect();
    let [first, second] = told[..] else { return Err(format!("{outcome:?}")) };
    for (line, clip) in [(first, "missing.aarc"), (second, "broken.aarc")] {
        if !(line.starts_with(clip) && line.ends_with("; skipped")) {
            return Err(format!("{outcome:?}"));
        }
    }
    // One instant of the second clip alone.
    place.player("list.json", "--time 0.75 --out one.png").success();
    if fs::read(place.path("one.png")).map_err(|error| error.to_string())? != b[2] {
        return Err("another picture".into());
    }
    // One that cannot be drawn as asked for is skipped as well.
    let field =
        Recipe { count: 300, sh_degree: 0, motion: Motion::Still, motion_order: 0, turning: false, seed: 6 };
    place.write("layers.aarc", &packaged(&field.field(), None, &[100]));
    place.player("layers.aarc", "--layer 2 --out alone.png").success();
    place.list(&["a.aarc", "layers.aarc"]);
    let outcome = place.player("list.json", "--layer 2 --out listed.png").success();
    if outcome.stderr.trim() != "a.aarc: --layer 2: the clip has 1 layers; skipped" {
        return Err(format!("{outcome:?}"));
    }
    let [alone, listed] =
        ["alone.png", "listed.png"].map(|name| fs::read(place.path(name)).expect("a picture"));
    if alone != listed {
        return Err("another picture of two layers".into());
    }
    Ok(())
}

fn addresses(_: &Gpu) -> Result<(), String> {
    const ETAG: &str = "\"one\"";
    let place = Place::new();
    let clips = [moving(3), moving(4)];
    for (name, clip) in ["a.aarc", "b.aarc"].iter().zip(&clips) {
        place.write(name, clip);
    }
    place.list(&["a.aarc", "b.aarc"]);
    place.player("list.json", "--frames 0..9 --out files").success();
    let server = Server::start(move |_, request, answer| {
        let relative = list(&["x y/a.aarc", "none.aarc", "/b.aarc?"]);
        let file: &[u8] = match request.path.as_str() {
            "/show/list.json?key=1" => relative.as_bytes(),
            "/show/x%20y/a.aarc" => &clips[0],
            "/b.aarc%3F" => &clips[1],
            _ => return answer.head(404, &[("Content-Length", "0")]),
        };
        if request.header("if-none-match") == Some(ETAG) {
            answer.head(304, &[("ETag", ETAG)]);
        } else {
            answer.file(request, file, ETAG, file.len());
        }
    });
    let url = server.url("show/list.json?key=1");
    let outcome = place.player(&url, "--frames 0..9 --out fetched").success();
    if !outcome.stderr.contains("none.aarc: there is no such file (404 Not Found); skipped") {
        return Err(format!("{outcome:?}"));
    }
    place.player(&url, "--frames 0..9 --out again").success();
    if server.sent().len() != 3 {
        return Err(format!("sent again: {:?}", server.requests()));
    }
    drop(server);
    let alone = place.player(&url, "--frames 0..9 --out alone").success();
    if !alone.stderr.contains("list.json: the server takes no connections; the version cached") {
        return Err(format!("{alone:?}"));
    }
    let expected = place.pictures("files");
    for folder in ["fetched", "again", "alone"] {
        if place.pictures(folder) != expected {
            return Err(format!("other pictures: {folder}"));
        }
    }
    Ok(())
}

fn faults(_: &Gpu) -> Result<(), String> {
    let place = Place::new();
    place.write("a.aarc", &moving(5));
    let refused = |text: &str, line: &str, code: i32, sentence: &str| {
        place.write("list.json", text.as_bytes());
        let outcome = place.player("list.json", &format!("{line} --out b.png"));
        let lines: Vec<&str> = outcome.stderr.lines().collect();
        let told = lines.len() == 1 && lines[0].starts_with("error: ") && lines[0].contains(sentence);
        if outcome.code != Some(code) || !told || place.path("b.png").exists() {
            return Err(format!("{text}: {outcome:?}"));
        }
        Ok(())
    };
    refused("{}", "", DATA, "list.json: no playlist")?;
    refused(&list(&[]), "", DATA, "has no clip")?;
    refused(&list(&["missing.aarc"]), "", DATA, "missing.aarc")?;
    refused(&list(&["list.json"]), "", DATA, "a playlist itself")?;
    refused(&list(&["a.aarc"]), "--stats s.json", USAGE, "of one clip")?;
    refused(&list(&["a.aarc", "a.aarc"]), "--time 1.5", USAGE, "lasts 1 s")?;
    refused(&list(&["a.aarc"]), "--time -1", USAGE, "before the start")
}

/// What the middle of a window shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Seen {
    Red,
    Blue,
    Other([u8; 3]),
}

fn seen(shot: &Screenshot) -> Seen {
    let at = 3 * (shot.height / 2 * shot.width + shot.width / 2) as usize;
    match shot.rgb[at..at + 3] {
        [r, _, b] if r > 180 && b < 60 => Seen::Red,
        [r, _, b] if b > 180 && r < 60 => Seen::Blue,
        [r, g, b] => Seen::Other([r, g, b]),
        _ => unreachable!("three channels"),
    }
}

/// Looks at the window as often as it can while it plays red, what is broken, blue, and red again.
fn window(display: &Display) -> Result<(), String> {
    let place = Place::new();
    place.write("red.aarc", &lasting(&ball([1.0, 0.0, 0.0]), 0.7, 10.0));
    place.write("blue.aarc", &lasting(&ball([0.0, 0.0, 1.0]), 0.7, 10.0));
    place.write("broken.aarc", b"no clip");
    place.list(&["red.aarc", "broken.aarc", "blue.aarc"]);
    let mut command = display.command(client());
    command
        .arg(place.path("list.json"))
        .args(["--size", "800x600"])
        .current_dir(Path::new(place.folder.path()));
    let player = display.open(command.stderr(Stdio::inherit()), "red.aarc")?;
    let window = player.window;
    display.wait_until(window, |shot| seen(shot) == Seen::Red).ok_or("the first clip is not seen")?;
    let (mut order, mut titles, mut shots) = (vec![Seen::Red], Vec::new(), 0);
    let start = Instant::now();
    while order.len() < 6 {
        if start.elapsed() > Duration::from_secs(60) {
            return Err(format!("it does not go on: {order:?} {titles:?}"));
        }
        let title = display.title(window);
        if titles.last() != Some(&title) {
            titles.push(title);
        }
        let shot = display.screenshot(window).ok_or("the window went away")?;
        shots += 1;
        match seen(&shot) {
            Seen::Other(color) => return Err(format!("{color:?} between two clips, {order:?}")),
            seen if order.last() != Some(&seen) => order.push(seen),
            _ => {}
        }
        sleep(Duration::from_millis(2));
    }
    println!("{shots} looks at the window, {order:?}");
    // On a busy machine the first one seen may be that of any clip.
    let is_known = |title: &String| ["red.aarc", "blue.aarc"].contains(&title.as_str());
    if titles.len() < 2 || !titles.iter().all(is_known) {
        return Err(format!("{titles:?}"));
    }
    player.close()
}
