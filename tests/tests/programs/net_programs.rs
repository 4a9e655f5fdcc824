//! The player with clips by URL, as a user runs it: images, a window, errors and exit codes.

use std::fs;
use std::path::Path;
use std::process::Command;
use std::sync::mpsc::channel;
use std::sync::{Arc, Mutex};

use aarc_tests::display::{self, Display, Screenshot};
use aarc_tests::gpu::{self, Passes};
use aarc_tests::outcome::{DATA, NETWORK, Outcome};
use aarc_tests::programs::{Folder, client, run};
use aarc_tests::scene::{Motion, Recipe, packaged};
use aarc_tests::server::{Server, Stream};
use aarc_tests::take_files::{SegmentFile, take_package};
use client::gpu::Gpu;
use codec::{Limits, Poster, contents};
use libtest_mimic::{Failed, Trial};
use rustls::pki_types::PrivateKeyDer;
use rustls::{ServerConfig, ServerConnection, StreamOwned};
use serde_json::Value;

const ETAG: &str = "\"one\"";

/// The tests of this file.
pub(crate) fn trials() -> Vec<Trial> {
    vec![
        gpu::trial("a URL gives the image of the file, also without the network", Passes::Shared, images),
        gpu::trial("a secure connection needs a trusted certificate", Passes::Shared, secure),
        gpu::trial("a URL has the poster of its package", Passes::Shared, |_| poster()),
        Trial::test("faults are one sentence and an exit code", || faults().map_err(Failed::from)),
        gpu::trial("no output has the secrets of a URL", Passes::Shared, secrets),
        gpu::trial("the environment names a proxy", Passes::Shared, proxied),
        display::trial("a window plays the first layer before the rest is sent", window),
    ]
}

/// A command that plays `clip`, with its cache in the folder, and writes `image`.
fn player(folder: &Folder, clip: &str, image: &str) -> Command {
    let line = format!("{clip} --headless --time 0.3 --size 96x64 --stats stats.json --out {image}");
    let mut command = folder.command(client(), &line);
    command.env("XDG_CACHE_HOME", folder.path("cache")).env_remove("SSL_CERT_FILE");
    command
}

fn package() -> Arc<[u8]> {
    let recipe = Recipe {
        count: 2000,
        sh_degree: 1,
        motion: Motion::Dynamic,
        motion_order: 3,
        turning: false,
        seed: 31,
    };
    packaged(&recipe.field(), None, &[400, 900]).into()
}

fn server_of(file: &Arc<[u8]>) -> Server {
    let file = file.clone();
    Server::start(move |_, request, answer| {
        if request.header("if-none-match") == Some(ETAG) {
            answer.head(304, &[("ETag", ETAG)]);
        } else {
            answer.file(request, &file, ETAG);
        }
    })
}

/// The image of the poster, of a file and of its URL, of a clip and of a take.
fn poster() -> Result<(), String> {
    let limits = Limits::default();
    let poster = Poster { time_s: 0.7, position: [2.0, 1.0, -4.0], target: [0.0; 3], fov_y: 0.6 };
    let clip = package();
    let segment = SegmentFile { start_s: 0.0, duration_s: 2.0, package: clip.to_vec() };
    for plain in [clip.to_vec(), take_package(2.0, 30.0, &[segment]).0] {
        let file = codec::with_poster(&plain, Some(&poster), &limits).map_err(|error| error.to_string())?;
        let folder = Folder::default();
        folder.write("plain.aarc", &plain);
        folder.write("clip.aarc", &file);
        let server = Server::start(move |_, request, answer| answer.file(request, &file, ETAG));
        let image = |clip: &str, image: &str| {
            let line = format!("{clip} --headless --poster --size 96x64 --out {image}");
            run(folder.command(client(), &line).env("XDG_CACHE_HOME", folder.path("cache"))).success();
            folder.read(image)
        };
        let expected = image("clip.aarc", "file.png")?;
        if expected == image("plain.aarc", "plain.png")? {
            return Err("the file has no poster".into());
        }
        for name in ["fetched.png", "cached.png"] {
            if image(&server.url("clip.aarc"), name)? != expected {
                return Err(format!("{name} is another image than that of the file"));
            }
        }
    }
    Ok(())
}

fn images(_: &Gpu) -> Result<(), String> {
    let (folder, file) = (Folder::default(), package());
    folder.write("clip.aarc", &file);
    run(&mut player(&folder, "clip.aarc", "file.png")).success();
    let server = server_of(&file);
    let url = server.url("clip.aarc");
    run(&mut player(&folder, &url, "fetched.png")).success();
    let stats: Value =
        serde_json::from_slice(&folder.read("stats.json")?).map_err(|error| error.to_string())?;
    let ms = |key: &str| stats["loading"][key].as_f64().ok_or(format!("no {key}: {stats}"));
    if !(0.0 < ms("playable_ms")? && ms("playable_ms")? <= ms("whole_ms")?) {
        return Err(stats.to_string());
    }
    run(&mut player(&folder, &url, "again.png")).success();
    let sent = server.sent().len();
    drop(server);
    let alone = run(&mut player(&folder, &url, "alone.png")).success();
    if sent != 1 || !alone.stderr.contains("cached on this device") {
        return Err(format!("sent {sent} times, {alone:?}"));
    }
    let expected = folder.read("file.png")?;
    for name in ["fetched.png", "again.png", "alone.png"] {
        if folder.read(name)? != expected {
            return Err(format!("{name} is another image"));
        }
    }
    Ok(())
}

/// A server behind TLS. Writes its certificate to `path`.
fn secure_server(file: &Arc<[u8]>, path: &Path) -> Server {
    let made =
        rcgen::generate_simple_self_signed(vec!["127.0.0.1".into()]).expect("a certificate can be made");
    fs::write(path, made.cert.pem()).expect("temporary files can be written");
    let key = PrivateKeyDer::Pkcs8(made.signing_key.serialize_der().into());
    let provider = rustls::crypto::ring::default_provider().into();
    let config = ServerConfig::builder_with_provider(provider)
        .with_safe_default_protocol_versions()
        .expect("the provider has them")
        .with_no_client_auth()
        .with_single_cert(vec![made.cert.der().clone()], key)
        .expect("the key is that of the certificate");
    let (config, file) = (Arc::new(config), file.clone());
    Server::start_with(
        move |stream| {
            let connection = ServerConnection::new(config.clone()).ok()?;
            Some(Box::new(StreamOwned::new(connection, stream)) as Box<dyn Stream>)
        },
        move |_, request, answer| match request.path.as_str() {
            "/down" => {
                let location = format!("http://{}/clip.aarc", request.header("host").unwrap_or_default());
                answer.head(302, &[("Location", &location), ("Content-Length", "0")]);
            }
            _ => answer.file(request, &file, ETAG),
        },
    )
}

fn secure(_: &Gpu) -> Result<(), String> {
    let (folder, file) = (Folder::default(), package());
    let certificate = folder.path("certificate.pem");
    let server = secure_server(&file, &certificate);
    let url = format!("https://{}/clip.aarc", server.socket());
    refused(&folder, &mut player(&folder, &url, "a.png"), NETWORK, "no secure connection")?;
    run(player(&folder, &url, "a.png").env("SSL_CERT_FILE", &certificate)).success();
    folder.read("a.png")?;
    let down = format!("https://{}/down", server.socket());
    let mut command = player(&folder, &down, "b.png");
    refused(&folder, command.env("SSL_CERT_FILE", &certificate), NETWORK, "from https to http")?;
    let mut command = player(&folder, &url, "b.png");
    refused(&folder, command.env("SSL_CERT_FILE", "nowhere.pem"), NETWORK, "SSL_CERT_FILE=nowhere.pem")
}

/// Checks that the player ends with this code and one error line that contains `sentence`, and writes
/// no image.
fn refused(folder: &Folder, command: &mut Command, code: i32, sentence: &str) -> Result<(), String> {
    run(command).refuses(code, "error: http", sentence)?;
    match folder.path("b.png").exists() {
        true => Err("an image was written".into()),
        false => Ok(()),
    }
}

fn faults() -> Result<(), String> {
    let folder = Folder::default();
    let server = Server::start(|_, request, answer| match request.path.as_str() {
        "/page" => {
            answer.head(200, &[]);
            answer.raw(b"<!doctype html><title>Welcome</title>");
        }
        _ => answer.head(404, &[("Content-Length", "0")]),
    });
    let player = |url: &str| player(&folder, url, "b.png");
    refused(&folder, &mut player(&server.url("a.aarc")), NETWORK, "no such file (404 Not Found)")?;
    refused(&folder, &mut player(&server.url("page")), DATA, "a web page")?;
    refused(&folder, &mut player("http://nowhere.invalid/a.aarc"), NETWORK, "name")?;
    if folder.path("stats.json").exists() || folder.path("cache").exists() {
        return Err("something was left".into());
    }
    Ok(())
}

/// The host of the URL does not exist: its proxy answers.
fn proxied(_: &Gpu) -> Result<(), String> {
    const URL: &str = "http://clips.invalid/clip.aarc";
    let (folder, proxy) = (Folder::default(), server_of(&package()));
    let mut command = player(&folder, URL, "a.png");
    for name in ["http_proxy", "HTTP_PROXY", "all_proxy", "ALL_PROXY", "no_proxy", "NO_PROXY"] {
        command.env_remove(name);
    }
    run(command.env("http_proxy", format!("http://{}", proxy.socket()))).success();
    let asked: Vec<String> = proxy.requests().into_iter().map(|request| request.path).collect();
    if asked.is_empty() || asked.iter().any(|path| path != URL) {
        return Err(format!("the proxy is asked for {asked:?}"));
    }
    folder.read("a.png").map(drop)
}

/// Whatever happens, and however much is logged.
fn secrets(_: &Gpu) -> Result<(), String> {
    let (folder, file) = (Folder::default(), package());
    let sent = file.clone();
    let server = Server::start(move |number, request, answer| {
        match request.path.split('?').next().unwrap_or_default() {
            "/clip.aarc" => answer.file(request, &sent, ETAG),
            "/moved.aarc" => {
                answer.head(302, &[("Location", "/clip.aarc?SECRET4"), ("Content-Length", "0")]);
            }
            "/lost.aarc" => {
                answer.head(302, &[("Location", "//ann:SECRET4@host/a?SECRET5"), ("Content-Length", "0")]);
            }
            "/list.json" => {
                let list = br#"{"version": 1, "clips": ["none.aarc", "clip.aarc"]}"#;
                answer.file(request, list, ETAG);
            }
            "/busy.aarc" if number % 2 == 0 => answer.head(503, &[("Content-Length", "0")]),
            "/page.aarc" => {
                answer.head(200, &[]);
                answer.raw(b"<!doctype html>");
            }
            _ => answer.head(404, &[("Content-Length", "0")]),
        }
    });
    let check = |what: &str, outcome: &Outcome| match format!("{outcome:?}").contains("SECRET") {
        true => Err(format!("{what}: {outcome:?}")),
        false => Ok(()),
    };
    let tail = "?key=SECRET2#SECRET3";
    let mut urls: Vec<String> =
        ["clip.aarc", "moved.aarc", "lost.aarc", "list.json", "busy.aarc", "page.aarc"]
            .iter()
            .map(|path| format!("http://ann:SECRET1@{}/{path}{tail}", server.socket()))
            .collect();
    urls.push(format!("https://ann:SECRET1@{}/clip.aarc{tail}", server.socket()));
    urls.push(format!("ftp://ann:SECRET1@host/clip.aarc{tail}"));
    urls.push(format!("http://ann:SECRET1/x@host/clip.aarc{tail}"));
    for url in &urls {
        let line = format!("{url} --headless --time 0.1 --size 16x16 --out image.png");
        let mut command = folder.command(client(), &line);
        command
            .env("XDG_CACHE_HOME", folder.path("cache"))
            .env("RUST_LOG", "trace,wgpu_core=warn,wgpu_hal=warn,naga=warn");
        check(url, &run(&mut command))?;
    }
    let listed = format!("list.json {} --headless --out image.png", urls[0]);
    check("a second clip", &run(&mut folder.command(client(), &listed)))?;
    folder.write("list.json", format!(r#"{{"version": 1, "clips": ["{}"]}}"#, urls[0]).as_bytes());
    check("a playlist", &run(&mut folder.command(client(), "list.json --headless --out image.png")))?;
    let entries = folder.path("cache/aarc/clips").read_dir().map_err(|error| error.to_string())?;
    let mut count = 0;
    for entry in entries {
        let path = entry.map_err(|error| error.to_string())?.path();
        let bytes = fs::read(&path).map_err(|error| error.to_string())?;
        if path.display().to_string().contains("SECRET") || bytes.windows(6).any(|part| part == b"SECRET") {
            return Err(format!("{}", path.display()));
        }
        count += 1;
    }
    // The head and three layers of the clip under two URLs and within the playlist, and the playlist.
    if count == 3 * 4 + 1 { Ok(()) } else { Err(format!("{count} files are cached")) }
}

fn window(display: &Display) -> Result<(), String> {
    let (folder, file) = (Folder::default(), package());
    let ends = contents(&file, &Limits::default()).map_err(|error| error.to_string())?.layer_bytes();
    let first = ends[0];
    let (permit, permits) = channel::<()>();
    let (sent, gate) = (file.clone(), Mutex::new(permits));
    let server = Server::start(move |_, request, answer| {
        answer.file_head(request, &sent, ETAG);
        answer.bytes(&sent, 0..first);
        // Until the window has drawn the first layer, or the test has ended.
        if gate.lock().is_ok_and(|gate| gate.recv().is_ok()) {
            answer.bytes(&sent, first..sent.len());
        }
    });
    let mut command = display.command(client());
    // The title of the window is the name of the file alone.
    command.arg(server.url("clip.aarc?key=secret")).args(["--size", "800x600"]).current_dir(folder.path(""));
    command.env("XDG_CACHE_HOME", folder.path("cache"));
    // Dropped before the server, whose thread waits for it.
    let permit = permit;
    let player = display.open(&mut command, "clip.aarc")?;
    let is_drawn = |screen: &Screenshot| screen.colors() > 500;
    display.wait_until(player.window, is_drawn).ok_or("the first layer is not drawn")?;
    if server.sent().len() != 1 {
        return Err("the rest was sent before".to_owned());
    }
    permit.send(()).map_err(|error| error.to_string())?;
    // The head, and all layers.
    let parts = 1 + ends.len();
    let is_cached =
        || folder.path("cache/aarc/clips").read_dir().is_ok_and(|entries| entries.count() == parts);
    display.wait_until(player.window, |_: &Screenshot| is_cached()).ok_or("the rest never came")?;
    player.close()
}
