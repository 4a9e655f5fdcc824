//! Takes, as a user plays them: images at any instant, and files that are damaged or cut short.

use std::process::Stdio;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread::sleep;
use std::time::{Duration, Instant};

use aarc_tests::display::{self, Display};
use aarc_tests::gpu::{self, Passes};
use aarc_tests::image::{Tolerance, check, difference};
use aarc_tests::lossy::lossy;
use aarc_tests::outcome::{DATA, NETWORK, Outcome, USAGE};
use aarc_tests::programs::{Folder, client, run, studio};
use aarc_tests::scene::{Motion, Recipe, ball, info, lasting};
use aarc_tests::server::{Answer, Request, Server};
use aarc_tests::take_files::{SegmentFile, take_package};
use client::gpu::Gpu;
use codec::{ClipInfo, EncodeOptions, Source};
use libtest_mimic::Trial;
use refine::image::Image;
use serde_json::Value;

use crate::playlist::{CenterColor, center_color};

/// Centres of a take have another origin than centres of its clips, so their rounding differs; images have 8 bits.
const TOLERANCE: Tolerance = Tolerance { max_diff: 2.0, diff_pixels: 40, psnr: 54.0 };

/// Start and duration of the clips of the take, in seconds. Nothing is seen between the second and the third.
const CLIPS: [(f64, f64); 3] = [(0.0, 1.0), (1.0, 1.0), (2.5, 1.0)];
const DURATION_S: f64 = 3.5;

const RECIPE: Recipe =
    Recipe { count: 300, sh_degree: 1, motion: Motion::Dynamic, motion_order: 2, turning: false, seed: 1 };

/// The tests of this file.
pub(crate) fn trials() -> Vec<Trial> {
    vec![
        gpu::trial("each segment is shown as its clip alone, at any instant", Passes::Shared, as_alone),
        gpu::trial("the player and the reference count alike", Passes::Shared, counted_alike),
        gpu::trial("a damaged segment is one sentence, and the rest plays", Passes::Shared, damaged),
        gpu::trial("a file that is cut short plays as far as it goes", Passes::Shared, truncated),
        gpu::trial("a take that is cut short on a server says so", Passes::Shared, truncated_on_server),
        gpu::trial("files that play not at all are one sentence", Passes::Shared, refused),
        gpu::trial("a take in a playlist follows a clip", Passes::Shared, in_playlist),
        gpu::trial("from a URL only what is seen is fetched, and once", Passes::Shared, from_url),
        gpu::trial("a server without ranges plays as well", Passes::Shared, without_ranges),
        gpu::trial("a server that breaks off is asked for the rest", Passes::Shared, breaking_off),
        gpu::trial("a take goes on with another device", Passes::Shared, lost),
        gpu::trial("servers that fail are one sentence", Passes::Shared, failing_servers),
        display::trial("in a window nothing comes between two segments, over and over", window),
        display::trial("a take that is replaced while it plays is opened again", replaced),
    ]
}

/// The clip packages of the take. All but the first have a plate.
fn clips() -> Vec<Vec<u8>> {
    let recipe = Recipe {
        count: 300,
        sh_degree: 1,
        motion: Motion::Dynamic,
        motion_order: 2,
        turning: false,
        seed: 1,
    };
    let field = |seed: usize| Recipe { seed: seed as u64, ..recipe }.field();
    let plate = Recipe { motion: Motion::Static, count: 100, seed: 9, ..recipe }.field();
    let clip = |(i, (_, duration_s)): (usize, &(f64, f64))| {
        let info = ClipInfo { duration_s: *duration_s as f32, fps: 8.0, ..info() };
        let source = Source { info: &info, field: &field(i), plate: (i > 0).then_some(&plate) };
        codec::encode(&source, &EncodeOptions::default()).expect("a valid field can be encoded")
    };
    CLIPS.iter().enumerate().map(clip).collect()
}

/// The take, and the offsets of its segments.
fn take() -> (Vec<u8>, Vec<usize>) {
    let segment = |(package, &(start_s, duration_s))| SegmentFile { start_s, duration_s, package };
    let segments: Vec<SegmentFile> = clips().into_iter().zip(&CLIPS).map(segment).collect();
    take_package(DURATION_S, 8.0, &segments)
}

fn play(folder: &Folder, clip: &str, line: &str) -> Outcome {
    run(folder.command(client(), &format!("--headless --size 96x64 {line}")).arg(clip))
}

/// The image of `clip` at `time_s`, and what the player says.
fn image(folder: &Folder, clip: &str, time_s: f64) -> Result<(Image, String), String> {
    let outcome = play(folder, clip, &format!("--time {time_s} --out image.png")).success();
    Ok((read(folder, "image.png")?, outcome.stderr))
}

fn read(folder: &Folder, name: &str) -> Result<Image, String> {
    let decoded = image::load_from_memory(&folder.read(name)?).map_err(|error| format!("{name}: {error}"))?;
    let rgb = decoded.to_rgb8();
    let mut read = Image::new(rgb.width(), rgb.height());
    for (pixel, bytes) in read.pixels.iter_mut().zip(rgb.pixels()) {
        *pixel = [0, 1, 2, 3].map(|c| if c < 3 { f64::from(bytes.0[c]) / 255.0 } else { 1.0 });
    }
    Ok(read)
}

fn is_black(image: &Image) -> bool {
    image.pixels.iter().all(|pixel| pixel[..3] == [0.0; 3])
}

/// Keys that both programs write have one meaning, in both eyes and with segments that no instant needs.
fn counted_alike(_: &Gpu) -> Result<(), String> {
    let folder = Folder::default();
    folder.write("take.aarc", &take().0);
    let line = "--time 0.25,1.5 --size 96x64 --stereo --out";
    run(&mut folder.command(client(), &format!("take.aarc --headless {line} player --stats player.json")))
        .success();
    run(&mut folder.command(studio(), &format!("render take.aarc {line} reference --stats reference.json")))
        .success();
    let read = |name: &str| {
        serde_json::from_slice::<Value>(&folder.read(name)?).map_err(|error| format!("{name}: {error}"))
    };
    let (player, reference) = (read("player.json")?, read("reference.json")?);
    if !player["gaussians"].is_u64() || player["gaussians"] != reference["gaussians"] {
        return Err(format!("{} Gaussians, and {}", player["gaussians"], reference["gaussians"]));
    }
    for i in 0..2 {
        let [player, reference] = [&player, &reference].map(|stats| &stats["frames"][i]);
        let number = |frame: &Value, key: &str| frame[key].as_f64().unwrap_or(f64::NAN);
        // Single precision decides otherwise at a few edges of quads.
        for (key, tolerance) in [("time", 0.0), ("alive", 0.0), ("drawn", 0.02), ("fragments", 0.02)] {
            let (found, expected) = (number(player, key), number(reference, key));
            if (found - expected).abs() > tolerance * expected || found.is_nan() || expected.is_nan() {
                return Err(format!("{key}: {found}, and {expected}"));
            }
        }
        if number(reference, "drawn") > number(reference, "alive") {
            return Err(format!("more are drawn than are alive: {reference}"));
        }
    }
    Ok(())
}

fn as_alone(_: &Gpu) -> Result<(), String> {
    let folder = Folder::default();
    folder.write("take.aarc", &take().0);
    for (i, (clip, (start_s, _))) in clips().iter().zip(CLIPS).enumerate() {
        folder.write("clip.aarc", clip);
        for time_s in [0.0, 0.25, 0.625, 0.95] {
            let (alone, _) = image(&folder, "clip.aarc", time_s)?;
            let (shown, said) = image(&folder, "take.aarc", start_s + time_s)?;
            check(&format!("take, segment {i}, {time_s} s"), &shown, &alone, TOLERANCE)?;
            if is_black(&alone) || !said.is_empty() {
                return Err(format!("segment {i}: {said}"));
            }
        }
    }
    // The end belongs to the last segment.
    let (alone, _) = image(&folder, "clip.aarc", 1.0)?;
    let (shown, _) = image(&folder, "take.aarc", DURATION_S)?;
    check("take, end", &shown, &alone, TOLERANCE)?;
    if !is_black(&image(&folder, "take.aarc", 2.25)?.0) {
        return Err("nothing is seen in the gap".into());
    }
    // Forwards and back in one run, with counts.
    let line = "--time 3,0.25,2.75,1.25,0.25 --out images --stats stats.json";
    play(&folder, "take.aarc", line).success();
    let (first, again) = (read(&folder, "images/frame_0001.png")?, read(&folder, "images/frame_0004.png")?);
    let stats = serde_json::from_slice::<serde_json::Value>(&folder.read("stats.json")?);
    let stats = stats.map_err(|error| error.to_string())?;
    let counts = &stats["take"];
    if difference(&first, &again).max_diff > 0.0 || counts["segments"] != 3 || counts["loaded"] == 0 {
        return Err(format!("{counts}"));
    }
    Ok(())
}

fn damaged(_: &Gpu) -> Result<(), String> {
    let folder = Folder::default();
    let (mut bytes, offsets) = take();
    folder.write("whole.aarc", &bytes);
    // Near the end of the second segment.
    bytes[offsets[2] - 30] ^= 0x10;
    folder.write("take.aarc", &bytes);
    for (time_s, is_damaged) in [(0.5, false), (1.5, true), (3.0, false)] {
        let (shown, said) = image(&folder, "take.aarc", time_s)?;
        let (whole, _) = image(&folder, "whole.aarc", time_s)?;
        if is_damaged {
            let lines: Vec<&str> = said.lines().collect();
            let is_right =
                |line: &str| line.contains("segment 1, at 1.000 s: ") && line.ends_with("; the rest plays");
            if !is_black(&shown) || lines.len() != 1 || !is_right(lines[0]) {
                return Err(format!("{time_s} s: {said}"));
            }
        } else if difference(&shown, &whole).max_diff > 0.0 || is_black(&shown) {
            return Err(format!("{time_s} s: another image: {said}"));
        }
    }
    Ok(())
}

fn truncated(_: &Gpu) -> Result<(), String> {
    let folder = Folder::default();
    let (bytes, offsets) = take();
    folder.write("whole.aarc", &bytes);
    folder.write("take.aarc", &bytes[..offsets[2] + 40]);
    for (time_s, is_lost) in [(0.5, false), (1.5, false), (3.0, true)] {
        let (shown, said) = image(&folder, "take.aarc", time_s)?;
        let (whole, _) = image(&folder, "whole.aarc", time_s)?;
        let is_right = if is_lost { is_black(&shown) } else { difference(&shown, &whole).max_diff == 0.0 };
        if !is_right || !said.contains("the file is cut short, 2 of 3 segments are whole") {
            return Err(format!("{time_s} s: {said}"));
        }
    }
    Ok(())
}

fn refused(_: &Gpu) -> Result<(), String> {
    let folder = Folder::default();
    let (bytes, offsets) = take();
    let longer = [&bytes[..], b"more"].concat();
    let mut wrong = bytes.clone();
    wrong[100] ^= 1;
    for bytes in [&bytes[..offsets[0]], &bytes[..offsets[0] - 1], &bytes[..20], &longer, &wrong] {
        folder.write("take.aarc", bytes);
        play(&folder, "take.aarc", "--out image.png").refuses(DATA, "take.aarc: ", "copy it again")?;
    }
    folder.write("take.aarc", &take().0);
    for (line, why) in [("--time 3.6", "time 3.6 s"), ("--layer 2", "the clip has 1 layer")] {
        play(&folder, "take.aarc", &format!("{line} --out image.png")).refuses(USAGE, why, "give")?;
    }
    Ok(())
}

fn in_playlist(_: &Gpu) -> Result<(), String> {
    let folder = Folder::default();
    folder.write("clip.aarc", &clips()[0]);
    folder.write("take.aarc", &take().0);
    folder.write("list.json", br#"{"version": 1, "clips": ["clip.aarc", "take.aarc", "clip.aarc"]}"#);
    for (time_s, alone, alone_s) in
        [(0.5, "clip.aarc", 0.5), (2.5, "take.aarc", 1.5), (5.0, "clip.aarc", 0.5)]
    {
        let (shown, _) = image(&folder, "list.json", time_s)?;
        let (alone, _) = image(&folder, alone, alone_s)?;
        if difference(&shown, &alone).max_diff > 0.0 || is_black(&shown) {
            return Err(format!("{time_s} s"));
        }
    }
    Ok(())
}

const ETAG: &str = "\"one\"";

fn server_of(
    file: Vec<u8>,
    answer: impl Fn(usize, &Request, &mut Answer<'_>, &[u8]) + Send + Sync + 'static,
) -> Server {
    Server::start(move |number, request, to| answer(number, request, to, &file))
}

/// As [`image`], with the cache in the folder.
fn fetched(folder: &Folder, url: &str, time_s: f64) -> Outcome {
    let line = format!("--headless --size 96x64 --time {time_s} --out image.png");
    let mut command = folder.command(client(), &line);
    run(command.env("XDG_CACHE_HOME", folder.path("cache")).arg(url))
}

fn from_url(_: &Gpu) -> Result<(), String> {
    let folder = Folder::default();
    // Ten seconds. One instant is looked at.
    let clip = lasting(&Recipe { seed: 3, ..RECIPE }.field(), 1.0, 8.0);
    let segment = |i: u32| SegmentFile { start_s: f64::from(i), duration_s: 1.0, package: clip.clone() };
    let (bytes, offsets) = take_package(10.0, 8.0, &(0..10).map(segment).collect::<Vec<_>>());
    folder.write("take.aarc", &bytes);
    let (expected, _) = image(&folder, "take.aarc", 7.5)?;
    let server = server_of(bytes, |_, request, answer, file| answer.file(request, file, ETAG));
    let url = server.url("take.aarc");
    fetched(&folder, &url, 7.5).success();
    if difference(&read(&folder, "image.png")?, &expected).max_diff > 0.0 {
        return Err("another image".into());
    }
    let touched = |server: &Server, segment: usize| {
        let (from, to) = (offsets[segment], offsets[segment] + clip.len());
        // The first request is for all of it, until its head tells what it is.
        server.sent().iter().skip(1).filter(|sent| sent.start >= from && sent.end <= to).count()
    };
    // The segment at the instant; those at the start, which any play needs; and what was next while it ran.
    if touched(&server, 7) != 1 || touched(&server, 0) != 1 || touched(&server, 4) + touched(&server, 5) > 0 {
        return Err(format!("{:?} of {offsets:?}", server.sent()));
    }
    server.forget();
    fetched(&folder, &url, 7.5).success();
    match touched(&server, 7) + touched(&server, 0) {
        0 => Ok(()),
        _ => Err(format!("fetched again: {:?}", server.sent())),
    }
}

fn without_ranges(_: &Gpu) -> Result<(), String> {
    let folder = Folder::default();
    let (bytes, _) = take();
    folder.write("take.aarc", &bytes);
    for etag in [Some(ETAG), None] {
        let server = server_of(bytes.clone(), move |_, _, answer, file| match etag {
            Some(etag) => answer.file(&Request::default(), file, etag),
            None => {
                answer.head(200, &[("Content-Length", &file.len().to_string())]);
                answer.raw(file);
            }
        });
        for time_s in [3.0, 0.5] {
            let (expected, _) = image(&folder, "take.aarc", time_s)?;
            fetched(&folder, &server.url("take.aarc"), time_s).success();
            if difference(&read(&folder, "image.png")?, &expected).max_diff > 0.0 {
                return Err(format!("{etag:?}, {time_s} s: another image"));
            }
        }
        // Whole, once to tell what it is and once to play it.
        if server.requests().len() > 4 {
            return Err(format!("{:?}", server.requests()));
        }
    }
    Ok(())
}

fn failing_servers(_: &Gpu) -> Result<(), String> {
    let folder = Folder::default();
    let (bytes, _) = take();
    // Another version after the head was sent.
    let mut other = bytes.clone();
    other[40] ^= 1;
    let changes = server_of(bytes.clone(), move |number, request, answer, file| match number {
        0 => answer.file(request, file, ETAG),
        _ => answer.file(request, &other, "\"two\""),
    });
    fetched(&folder, &changes.url("take.aarc"), 3.0).refuses(
        NETWORK,
        "take.aarc: the file changed on the server",
        "open it again",
    )?;
    // Gone after the head was sent.
    let goes = server_of(bytes, |number, request, answer, file| match number {
        0 => answer.file(request, file, ETAG),
        _ => answer.head(404, &[("Content-Length", "0")]),
    });
    fetched(&folder, &goes.url("take.aarc"), 3.0).refuses(NETWORK, "there is no such file", "check the URL")
}

/// Each part breaks off halfway when it is asked for from its start.
fn breaking_off(_: &Gpu) -> Result<(), String> {
    let folder = Folder::default();
    let (bytes, offsets) = take();
    folder.write("take.aarc", &bytes);
    let starts = offsets.clone();
    let server = server_of(bytes, move |_, request, answer, file| match request.part(file.len()) {
        Some(part) if starts.contains(&part.start) => {
            answer.cut(request, file, ETAG, part.start + part.len() / 2);
        }
        _ => answer.file(request, file, ETAG),
    });
    let (expected, _) = image(&folder, "take.aarc", 3.0)?;
    fetched(&folder, &server.url("take.aarc"), 3.0).success();
    let halves = server.sent().iter().filter(|part| offsets.contains(&part.start)).count();
    let requests = server.requests();
    let parts = requests.iter().filter_map(|request| request.part(usize::MAX));
    let rests = parts.filter(|part| part.start > offsets[2]).count();
    match difference(&read(&folder, "image.png")?, &expected).max_diff == 0.0 && halves > 0 && rests > 0 {
        true => Ok(()),
        false => Err(format!("{:?}", server.sent())),
    }
}

/// The first device is lost after 150 submissions, in the last segment.
fn lost(_: &Gpu) -> Result<(), String> {
    let folder = Folder::default();
    folder.write("take.aarc", &take().0);
    let frames = |out: &str, when: &str| {
        let line = format!("take.aarc --headless --frames 0..168 --fps 48 --size 96x64 --out {out}");
        let mut command = folder.command(client(), &line);
        lossy(&mut command, &folder.path(""), when);
        let outcome = run(&mut command).success();
        let images = (0..168).map(|i| folder.read(&format!("{out}/frame_{i:04}.png")));
        images.collect::<Result<Vec<_>, _>>().map(|images| (outcome, images))
    };
    let (_, expected) = frames("never", "submit:100000")?;
    let (outcome, images) = frames("lost", "submit:150:1")?;
    match images == expected && outcome.stderr.contains("goes on with another") {
        true => Ok(()),
        false => Err(format!("{outcome:?}")),
    }
}

/// A take that is cut short on its server is as one in a file.
fn truncated_on_server(_: &Gpu) -> Result<(), String> {
    let folder = Folder::default();
    let (bytes, offsets) = take();
    folder.write("whole.aarc", &bytes);
    let server = server_of(bytes[..offsets[2] + 40].to_vec(), |_, request, answer, file| {
        answer.file(request, file, ETAG);
    });
    let said = fetched(&folder, &server.url("take.aarc"), 0.5).success().stderr;
    let (whole, _) = image(&folder, "whole.aarc", 0.5)?;
    match said.contains("cut short, 2 of 3 segments are whole") {
        true if difference(&read(&folder, "image.png")?, &whole).max_diff == 0.0 => Ok(()),
        _ => Err(said),
    }
}

/// Plays a take of red and blue clips in turn, two times around, and seeks back to its start.
fn window(display: &Display) -> Result<(), String> {
    const HOME: u32 = 0xff50;
    let folder = Folder::default();
    let [red, blue] = [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]].map(|rgb| lasting(&ball(rgb), 0.7, 10.0));
    let segment = |i: u32| SegmentFile {
        start_s: 0.7 * f64::from(i),
        duration_s: 0.7,
        package: if i.is_multiple_of(2) { red.clone() } else { blue.clone() },
    };
    // Begins and ends in red.
    let (bytes, _) = take_package(0.7 * 5.0, 10.0, &(0..5).map(segment).collect::<Vec<_>>());
    folder.write("turns.aarc", &bytes);
    let mut command = display.command(client());
    command.arg(folder.path("turns.aarc")).args(["--size", "800x600"]).current_dir(folder.path(""));
    let player = display.open(command.stderr(Stdio::inherit()), "turns.aarc")?;
    let window = player.window;
    let is_red = |screen: &display::Screenshot| center_color(screen) == CenterColor::Red;
    display.wait_until(window, is_red).ok_or("the first segment is not drawn")?;
    let (mut order, start) = (vec![CenterColor::Red], Instant::now());
    while order.len() < 10 {
        if start.elapsed() > Duration::from_secs(60) {
            return Err(format!("the next segment does not come: {order:?}"));
        }
        let screen = display.screenshot(window).ok_or("the window went away")?;
        match center_color(&screen) {
            CenterColor::Other(color) => return Err(format!("{color:?} between two segments, {order:?}")),
            color if order.last() != Some(&color) => order.push(color),
            _ => {}
        }
        sleep(Duration::from_millis(2));
    }
    display.focus(window);
    for _ in 0..100 {
        display.press(HOME);
    }
    display.wait_until(window, is_red).ok_or("it does not go to its start")?;
    player.close()
}

/// A red take becomes a green one: by renaming, by a copy that takes a while, and on a server.
fn replaced(display: &Display) -> Result<(), String> {
    // More segments than are loaded at once.
    let take = |rgb: [f32; 3]| {
        let package = lasting(&ball(rgb), 0.5, 10.0);
        let segment =
            |i: u32| SegmentFile { start_s: 0.5 * f64::from(i), duration_s: 0.5, package: package.clone() };
        take_package(0.5 * 12.0, 10.0, &(0..12).map(segment).collect::<Vec<_>>()).0
    };
    let (red, green) = (take([1.0, 0.0, 0.0]), take([0.0, 1.0, 0.0]));
    for way in ["renamed", "copied", "server"] {
        let folder = Folder::default();
        folder.write("turns.aarc", &red);
        folder.write("green.aarc", &green);
        let version = Arc::new(AtomicUsize::new(0));
        let (served, versions) = (version.clone(), [red.clone(), green.clone()]);
        let server = Server::start(move |_, request, answer| {
            let version = served.load(Ordering::Relaxed);
            answer.file(request, &versions[version], &format!("\"{version}\""));
        });
        let mut command = display.command(client());
        match way {
            "server" => command.arg(server.url("turns.aarc")),
            _ => command.arg(folder.path("turns.aarc")),
        };
        let log = std::fs::File::create(folder.path("log")).map_err(|error| error.to_string())?;
        command.args(["--size", "800x600"]).current_dir(folder.path("")).stderr(log);
        let player = display.open(&mut command, "turns.aarc")?;
        let window = player.window;
        let is_red = |screen: &display::Screenshot| center_color(screen) == CenterColor::Red;
        display.wait_until(window, is_red).ok_or("the red take is not drawn")?;
        match way {
            "renamed" => std::fs::rename(folder.path("green.aarc"), folder.path("turns.aarc"))
                .map_err(|error| error.to_string())?,
            "copied" => {
                for part in 1..=4 {
                    folder.write("turns.aarc", &green[..green.len() * part / 4]);
                    sleep(Duration::from_millis(400));
                }
            }
            _ => version.store(1, Ordering::Relaxed),
        }
        let is_green = |screen: &display::Screenshot| match center_color(screen) {
            CenterColor::Other([r, g, b]) => g > 150 && r < 60 && b < 60,
            _ => false,
        };
        let log = || std::fs::read_to_string(folder.path("log")).unwrap_or_default();
        display.wait_until(window, is_green).ok_or_else(|| format!("{way}: it stays red: {}", log()))?;
        // It has come to rest.
        sleep(Duration::from_secs(2));
        player.close()?;
        let said = log();
        if said.matches("the file was replaced: opening it again").count() != 1 || said.contains("cut short")
        {
            return Err(format!("{way}: {said}"));
        }
    }
    Ok(())
}
