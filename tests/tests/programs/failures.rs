//! What the player answers where it cannot do as asked: one sentence on standard error that says what, where and what
//! to do next, the documented exit code, and no new file.
//!
//! No graphics driver, display or headset is found, unless a window opens. Exit code 1 is not among them: it takes a defect.

use std::fs::OpenOptions;
use std::process::{Command, Stdio};

use aarc_tests::display::{self, Display};
use aarc_tests::gpu::{self, Passes};
use aarc_tests::outcome::{DATA, DEVICE, Failure, NETWORK, Outcome, USAGE, check_failures};
use aarc_tests::programs::{client, run};
use aarc_tests::server::{Answer, Request, Server};
use client::gpu::Gpu;
use libtest_mimic::{Failed, Trial};

use crate::workshop::{Workshop, bad_files};

/// The tests of this file.
pub(crate) fn trials() -> Vec<Trial> {
    let every = || every_failure().map_err(Failed::from);
    vec![
        Trial::test("every failure says what, where and what to do", every),
        display::trial("and so does every failure of a window's first clip", every_window_failure),
        gpu::trial("an image beyond the device's limits is one sentence", Passes::Shared, large_image),
    ]
}

/// SERVER is the URL of a server, IMAGE stands for `--headless --out a.png`.
const FAILURES: &[Failure] = &[
    // The command line.
    ("clip.aarc --headless", USAGE, "required arguments were not provided: --out <PATH>", "--help"),
    ("clip.aarc --out a.png", USAGE, "--headless|--xr", "--help"),
    ("clip.aarc IMAGE --nonsense", USAGE, "unexpected argument '--nonsense'", "--help"),
    ("clip.aarc --frame 0..1 IMAGE", USAGE, "unexpected argument '--frame'", "'--frames'"),
    ("clip.aarc IMAGE --time nan", USAGE, "'nan' for '--time", "not a finite number of seconds"),
    ("clip.aarc IMAGE --frames 3..3", USAGE, "'3..3' for '--frames", "A..B with A below B"),
    ("clip.aarc IMAGE --frames 0..2 --fps 0", USAGE, "'0' for '--fps", "a positive number"),
    ("clip.aarc IMAGE --fps 10", USAGE, "not provided: --frames <A..B>", "--help"),
    ("clip.aarc IMAGE --size 0x0", USAGE, "'0x0' for '--size", "WxH of at least 1x1"),
    ("clip.aarc IMAGE --layer 0", USAGE, "0 is not in 1..", "--help"),
    ("clip.aarc IMAGE --cutoff 7", USAGE, "'7' for '--cutoff", "[possible values: exact, 8, 5]"),
    ("clip.aarc IMAGE --target 12", USAGE, "'12' for '--target", "[possible values: 8, 16]"),
    ("clip.aarc IMAGE --sort never", USAGE, "'never' for '--sort", "[possible values: depth, radial]"),
    ("clip.aarc IMAGE --lens quest9", USAGE, "'quest9' for '--lens", "[possible values: quest3]"),
    ("clip.aarc IMAGE --lens quest3 --inset 2", USAGE, "'2' for '--inset", "a number from 0.1 to 0.9"),
    ("clip.aarc IMAGE --view a --camera b", USAGE, "'--view <NAME|INDEX>' cannot be used with", "--help"),
    ("clip.aarc --quality least", USAGE, "not provided: --xr", "--help"),
    ("clip.aarc IMAGE --quality least", USAGE, "'--headless' cannot be used with '--quality", "--help"),
    ("clip.aarc --xr --quality worst", USAGE, "'worst' for '--quality", "[possible values: exact, fine"),
    ("--generate words", USAGE, "'words' for '--generate", "[possible values: man, bash"),
    ("clip.aarc --xr --out a", USAGE, "--xr --out writes the last of the frames", "give --frames A..B"),
    (
        "clip.aarc --headless --out a --frames 0..4000000000",
        USAGE,
        "--frames 0..4000000000: a run renders 10000000 images at most",
        "give fewer",
    ),
    ("clip.aarc IMAGE --up y", USAGE, "--up is the axis of a field", "leave it out"),
    // What the clip does not have.
    ("clip.aarc IMAGE --time -1", USAGE, "time -1 s is outside the clip", "give 0 to 2 s"),
    ("clip.aarc IMAGE --time 99", USAGE, "time 99 s is outside the clip", "give 0 to 2 s"),
    ("clip.aarc IMAGE --layer 9", USAGE, "--layer 9: the clip has 3 layers", "give no larger number"),
    ("clip.aarc IMAGE --view nowhere", USAGE, "no viewpoint \"nowhere\"", "give one of \"front\" (0)"),
    ("list.json IMAGE --stats a.json", USAGE, "--stats are of one clip", "name a clip of it"),
    ("list.json IMAGE --time -1", USAGE, "time -1 s is before the start", "give 0 or later"),
    // Outputs.
    ("clip.aarc --headless --out no/a.png", USAGE, "cannot write no/a.png: there is no folder no", "make it"),
    ("clip.aarc --headless --out bare", USAGE, "cannot write bare: it is a folder", "name a file"),
    ("clip.aarc --headless --out noise/a.png", USAGE, "cannot write noise/a.png", "make it first"),
    ("clip.aarc --headless --out a.jpg", USAGE, "cannot write a.jpg: images are PNG files", "name it a.png"),
    ("clip.aarc --headless --out /proc/a.png", USAGE, "cannot write /proc/a.png", "name another place"),
    (
        "clip.aarc --headless --frames 0..1 --out noise",
        USAGE,
        "folder noise: noise is a file",
        "name another folder",
    ),
    ("clip.aarc --headless --time 0,1 --out noise", USAGE, "noise is a file", "name another folder"),
    ("clip.aarc IMAGE --stats no/a.json", USAGE, "cannot write no/a.json", "make it first"),
    ("clip.aarc --xr --frames 0..1 --out noise", USAGE, "noise is a file", "name another folder"),
    ("clip.aarc --xr --stats no/a.json", USAGE, "cannot write no/a.json", "make it first"),
    // Clips.
    ("missing.aarc IMAGE", DATA, "missing.aarc: there is no such file", "check the path"),
    ("bare IMAGE", DATA, "bare: is a folder", "name an .aarc file in it"),
    ("empty IMAGE", DATA, "empty: not an .aarc package", "name a file that aarc-studio package made"),
    ("noise IMAGE", DATA, "noise: not an .aarc package", "name a file that aarc-studio package made"),
    ("points.ply IMAGE", DATA, "points.ply: PLY element vertex lacks the properties", "export Gaussians"),
    ("nothing.ply IMAGE", DATA, "nothing.ply: no Gaussians", "export it again"),
    ("short.aarc IMAGE", DATA, "short.aarc: package cut short", "copy it again"),
    ("flipped.aarc IMAGE", DATA, "flipped.aarc: damaged", "copy it again"),
    ("longer.aarc IMAGE", DATA, "longer.aarc: 4 extra bytes", "copy it again"),
    ("version.aarc IMAGE", DATA, "version.aarc: package version 99", "update the player"),
    (
        "version.aarc --headless --time 0,1 --out a",
        DATA,
        "version.aarc: package version",
        "update the player",
    ),
    // Playlists.
    ("missing.json IMAGE", DATA, "missing.json: there is no such file", "check the path"),
    ("camera.json IMAGE", DATA, "camera.json: no playlist", "write {\"version\": 1, \"clips\": [..]}"),
    ("next.json IMAGE", DATA, "next.json: a playlist of version 2", "update the player"),
    ("none.json IMAGE", DATA, "none.json: the playlist has no clip", "name one in \"clips\""),
    ("nested.json IMAGE", DATA, "nested.json: clips[0] is a playlist itself", "name its clips"),
    ("broken.json IMAGE", DATA, "broken.json: ", "write {\"version\": 1, \"clips\": [..]}"),
    ("gone.json IMAGE", DATA, "gone.aarc: there is no such file", "check the path"),
    // Cameras.
    ("clip.aarc IMAGE --camera missing.json", DATA, "missing.json: there is no such file", "check the path"),
    ("clip.aarc IMAGE --camera camera.json", DATA, "camera.json: missing field", "--help describes"),
    ("clip.aarc IMAGE --camera singular.json", DATA, "singular.json: focal lengths", "correct it"),
    // URLs.
    ("ftp://u:key@host/a.aarc IMAGE", USAGE, "ftp://host/a.aarc: clips come from", "so name one of those"),
    ("ftp://host/list.json IMAGE", USAGE, "ftp://host/list.json: clips come from", "so name one of those"),
    ("http:///a.aarc IMAGE", NETWORK, "not a URL", "write it as http://HOST/PATH"),
    (
        "http://nowhere.invalid/a.aarc IMAGE",
        NETWORK,
        "nowhere.invalid/a.aarc: ",
        "check the URL and the network",
    ),
    (
        "http://127.0.0.1:9/a.aarc IMAGE",
        NETWORK,
        "127.0.0.1:9/a.aarc: the server takes no",
        "try again later",
    ),
    ("SERVER/none.aarc IMAGE", NETWORK, "/none.aarc: there is no such file (404", "check the URL"),
    ("SERVER/none.json IMAGE", NETWORK, "/none.json: there is no such file (404", "check the URL"),
    ("SERVER/secret.aarc IMAGE", NETWORK, "the server denies access (403", "ask for a URL with access"),
    ("SERVER/busy.aarc IMAGE", NETWORK, "asks to wait for 600 s", "try again after that"),
    ("SERVER/login.aarc IMAGE", NETWORK, "the network asks for a log-in", "log in with a browser"),
    ("SERVER/packed.aarc IMAGE", NETWORK, "compressed (gzip)", "switch that off there"),
    ("SERVER/cut.aarc IMAGE", DATA, "cut short before its first layer ends", "upload it again"),
    ("SERVER/round.aarc IMAGE", NETWORK, "redirects more than 5 times", "name the URL that it leads to"),
    ("SERVER/away.aarc IMAGE", NETWORK, "neither http nor https", "name the URL of the file itself"),
    ("SERVER/page.aarc IMAGE", DATA, "the server sends a web page", "open the URL in a browser"),
    ("SERVER/damaged.aarc IMAGE", DATA, "/damaged.aarc: damaged", "upload it again"),
    ("SERVER/noise.aarc IMAGE", DATA, "/noise.aarc: not an .aarc package", "or upload it again"),
    ("SERVER/field.ply IMAGE", DATA, "/field.ply: not an .aarc package", "play the file"),
    ("SERVER/version.aarc IMAGE", DATA, "/version.aarc: package version 99", "update the player"),
    // Missing devices.
    ("clip.aarc IMAGE", DEVICE, "no graphics device was found", "install a Vulkan driver"),
    ("list.json IMAGE", DEVICE, "no graphics device was found", "install a Vulkan driver"),
    ("clip.aarc", DEVICE, "no display to open a window on", "give --headless --out PATH"),
    ("list.json", DEVICE, "no display to open a window on", "give --headless --out PATH"),
    // The loader is missing or, where there is one, the runtime.
    ("clip.aarc --xr", DEVICE, "no OpenXR ", "it"),
];

/// As [`FAILURES`], of the first clip of a window that opens.
const WINDOW_FAILURES: &[Failure] = &[
    ("clip.aarc --view nowhere", USAGE, "no viewpoint \"nowhere\"", "give one of \"front\" (0)"),
    ("clip.aarc --layer 9", USAGE, "--layer 9: the clip has 3 layers", "give no larger number"),
    ("missing.aarc", DATA, "missing.aarc: there is no such file", "check the path"),
    ("noise", DATA, "noise: not an .aarc package", "name a file that aarc-studio package made"),
    ("camera.json", DATA, "camera.json: no playlist", "write {\"version\": 1, \"clips\": [..]}"),
    ("gone.json", DATA, "gone.aarc: there is no such file", "check the path"),
    ("ftp://host/a.aarc", USAGE, "ftp://host/a.aarc: clips come from", "so name one of those"),
    ("http://127.0.0.1:9/a.aarc", NETWORK, "127.0.0.1:9/a.aarc: the server takes no", "try again later"),
    ("SERVER/none.aarc", NETWORK, "/none.aarc: there is no such file (404", "check the URL"),
];

/// The workshop with playlists.
fn workshop() -> Workshop {
    let workshop = bad_files();
    for (name, text) in [
        ("list.json", r#"{"version": 1, "clips": ["clip.aarc"]}"#),
        ("next.json", r#"{"version": 2, "clips": ["clip.aarc"]}"#),
        ("none.json", r#"{"version": 1, "clips": []}"#),
        ("nested.json", r#"{"version": 1, "clips": ["list.json"]}"#),
        ("broken.json", r#"{"version": 1, "clips": [1]}"#),
        ("gone.json", r#"{"version": 1, "clips": ["gone.aarc"]}"#),
    ] {
        workshop.write(name, text.as_bytes());
    }
    workshop.seal()
}

/// A server of every failure.
fn server(workshop: &Workshop) -> Result<Server, String> {
    let read = |name: &str| workshop.folder.read(name);
    // Its first layer, without which nothing plays.
    let mut damaged = read("clip.aarc")?;
    let contents = codec::contents(&damaged, &codec::Limits::default()).map_err(|error| error.to_string())?;
    damaged[contents.layer_bytes()[0] - 1] ^= 1;
    let files = [
        ("/cut.aarc", read("clip.aarc")?[..500].to_vec()),
        ("/damaged.aarc", damaged),
        ("/field.ply", read("field.ply")?),
        ("/noise.aarc", b"Not a package".to_vec()),
        ("/version.aarc", read("version.aarc")?),
        ("/page.aarc", b"<!doctype html><title>Welcome</title>".to_vec()),
    ];
    let answer = move |_: usize, request: &Request, answer: &mut Answer<'_>| {
        let path = request.path.as_str();
        if let Some((_, file)) = files.iter().find(|(name, _)| *name == path) {
            return answer.file(request, file, "\"1\"");
        }
        let empty = ("Content-Length", "0");
        match path {
            "/secret.aarc" => answer.head(403, &[empty]),
            "/busy.aarc" => answer.head(503, &[("Retry-After", "600"), empty]),
            "/login.aarc" => answer.head(511, &[empty]),
            "/packed.aarc" => answer.head(200, &[("Content-Encoding", "gzip"), empty]),
            "/round.aarc" => answer.head(302, &[("Location", "/round.aarc"), empty]),
            "/away.aarc" => answer.head(302, &[("Location", "ftp://host/a.aarc"), empty]),
            _ => answer.head(404, &[empty]),
        }
    };
    Ok(Server::start(answer))
}

/// The player on a machine without a graphics driver, a display and a headset.
fn player(workshop: &Workshop, line: &str) -> Command {
    let mut command = workshop.folder.command(client(), line);
    for variable in ["VK_DRIVER_FILES", "VK_ICD_FILENAMES", "XR_RUNTIME_JSON"] {
        command.env(variable, workshop.path("no-such.json"));
    }
    for variable in ["DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET", "SSL_CERT_FILE", "RUST_LOG"] {
        command.env_remove(variable);
    }
    command.env("XDG_CACHE_HOME", "/proc/no-cache");
    command
}

fn every_failure() -> Result<(), String> {
    let workshop = workshop();
    let server = server(&workshop)?;
    check_failures(FAILURES, &workshop.path(""), |line| {
        let line = line.replace("SERVER/", &server.url("")).replace("IMAGE", "--headless --out a.png");
        run(&mut player(&workshop, &line))
    })?;
    let mut full = player(&workshop, "--generate man");
    let device = OpenOptions::new().write(true).open("/dev/full").map_err(|error| error.to_string())?;
    let output = full.stdout(device).stderr(Stdio::piped()).output().map_err(|error| error.to_string())?;
    Outcome::from(output).refuses(USAGE, "cannot write to standard output", "")
}

fn every_window_failure(display: &Display) -> Result<(), String> {
    let workshop = workshop();
    let server = server(&workshop)?;
    check_failures(WINDOW_FAILURES, &workshop.path(""), |line| {
        let mut command = display.command(client());
        command.args(line.replace("SERVER/", &server.url("")).split(' ')).current_dir(workshop.path(""));
        // The driver, which is opened before the clip is, says where it cannot keep shaders.
        run(command.env("XDG_CACHE_HOME", "/proc/no-cache").env("MESA_SHADER_CACHE_DISABLE", "true"))
    })
}

fn large_image(_: &Gpu) -> Result<(), String> {
    let workshop = workshop();
    let outcome = workshop.run(client(), "clip.aarc --headless --out a.png --size 99999x99999");
    workshop.refused(&outcome, USAGE, "image size 99999x99999", "give another --size")
}
