//! The player with clips by address, as a user runs it: pictures, a window, sentences and exit codes.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};
use std::sync::mpsc::channel;
use std::sync::{Arc, Mutex};

use aarc_tests::display::{self, Display, Screenshot};
use aarc_tests::gpu::{self, Passes};
use aarc_tests::programs::{Outcome, client, run};
use aarc_tests::scene::{Motion, Recipe, packaged};
use aarc_tests::server::{Server, Stream};
use client::gpu::Gpu;
use codec::{Limits, contents};
use libtest_mimic::{Failed, Trial};
use rustls::pki_types::PrivateKeyDer;
use rustls::{ServerConfig, ServerConnection, StreamOwned};
use serde_json::Value;
use tempfile::TempDir;

const DATA: i32 = 3;
const NETWORK: i32 = 4;

const ETAG: &str = "\"one\"";

fn main() -> ExitCode {
    gpu::run(vec![
        gpu::trial(
            "an address gives the picture of the file, also without the network",
            Passes::Shared,
            pictures,
        ),
        gpu::trial("a secure connection needs a certificate that is trusted", Passes::Shared, secure),
        Trial::test("faults are one sentence and an exit code", || faults().map_err(Failed::from)),
        display::trial("a window plays the first layer before the rest is sent", window),
    ])
}

/// A folder that players keep clips in and write pictures to.
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

    /// Runs the player here, which writes `picture`.
    fn player(&self, clip: &str, picture: &str) -> Command {
        let mut command = Command::new(client());
        command.current_dir(self.folder.path()).env("XDG_CACHE_HOME", self.path("cache"));
        command.env_remove("SSL_CERT_FILE").arg(clip);
        command.args([
            "--headless",
            "--time",
            "0.3",
            "--size",
            "96x64",
            "--stats",
            "stats.json",
            "--out",
            picture,
        ]);
        command
    }

    fn picture(&self, name: &str) -> Result<Vec<u8>, String> {
        fs::read(self.path(name)).map_err(|error| format!("{name}: {error}"))
    }
}

fn package() -> Arc<[u8]> {
    let recipe = Recipe {
        count: 2000,
        sh_degree: 1,
        motion: Motion::Moving,
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
            answer.file(request, &file, ETAG, file.len());
        }
    })
}

fn pictures(_: &Gpu) -> Result<(), String> {
    let (place, file) = (Place::new(), package());
    fs::write(place.path("clip.aarc"), &file).map_err(|error| error.to_string())?;
    run(&mut place.player("clip.aarc", "file.png")).success();
    let server = server_of(&file);
    let url = server.url("clip.aarc");
    run(&mut place.player(&url, "fetched.png")).success();
    let stats: Value =
        serde_json::from_slice(&place.picture("stats.json")?).map_err(|error| error.to_string())?;
    let ms = |key: &str| stats["loading"][key].as_f64().ok_or(format!("no {key}: {stats}"));
    if !(0.0 < ms("playable_ms")? && ms("playable_ms")? <= ms("whole_ms")?) {
        return Err(stats.to_string());
    }
    run(&mut place.player(&url, "again.png")).success();
    let sent = server.sent().len();
    drop(server);
    let alone = run(&mut place.player(&url, "alone.png")).success();
    if sent != 1 || !alone.stderr.contains("cached on this device") {
        return Err(format!("sent {sent} times, {alone:?}"));
    }
    let expected = place.picture("file.png")?;
    for name in ["fetched.png", "again.png", "alone.png"] {
        if place.picture(name)? != expected {
            return Err(format!("{name} is another picture"));
        }
    }
    Ok(())
}

/// A server behind TLS, whose certificate is in the file at `path`.
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
            _ => answer.file(request, &file, ETAG, file.len()),
        },
    )
}

fn secure(_: &Gpu) -> Result<(), String> {
    let (place, file) = (Place::new(), package());
    let certificate = place.path("certificate.pem");
    let server = secure_server(&file, &certificate);
    let url = format!("https://{}/clip.aarc", server.address());
    refused(&place, &mut place.player(&url, "a.png"), NETWORK, "no secure connection")?;
    run(place.player(&url, "a.png").env("SSL_CERT_FILE", &certificate)).success();
    place.picture("a.png")?;
    let down = format!("https://{}/down", server.address());
    let mut player = place.player(&down, "b.png");
    refused(&place, player.env("SSL_CERT_FILE", &certificate), NETWORK, "from https to http")?;
    let mut player = place.player(&url, "b.png");
    refused(&place, player.env("SSL_CERT_FILE", "nowhere.pem"), NETWORK, "SSL_CERT_FILE=nowhere.pem")
}

/// Runs the player, which must end with this code and one line that says what the matter is, and
/// leave no picture.
fn refused(place: &Place, command: &mut Command, code: i32, sentence: &str) -> Result<(), String> {
    let outcome: Outcome = run(command);
    let lines: Vec<&str> = outcome.stderr.lines().collect();
    let [line] = lines[..] else { return Err(format!("{outcome:?}")) };
    let told = line.starts_with("error: http") && line.contains(sentence);
    if outcome.code != Some(code) || !told || place.path("b.png").exists() {
        return Err(format!("{outcome:?}"));
    }
    Ok(())
}

fn faults() -> Result<(), String> {
    let place = Place::new();
    let server = Server::start(|_, request, answer| match request.path.as_str() {
        "/page" => {
            answer.head(200, &[]);
            answer.raw(b"<!doctype html><title>Welcome</title>");
        }
        _ => answer.head(404, &[("Content-Length", "0")]),
    });
    let player = |url: &str| place.player(url, "b.png");
    refused(&place, &mut player(&server.url("a.aarc")), NETWORK, "no such file (404 Not Found)")?;
    refused(&place, &mut player(&server.url("page")), DATA, "not an .aarc package")?;
    refused(&place, &mut player("http://nowhere.invalid/a.aarc"), NETWORK, "name")?;
    if place.path("stats.json").exists() || place.path("cache").exists() {
        return Err("something was left".into());
    }
    Ok(())
}

fn window(display: &Display) -> Result<(), String> {
    let (place, file) = (Place::new(), package());
    let first = contents(&file, &Limits::default()).map_err(|error| error.to_string())?.layer_bytes()[0];
    let (permit, permits) = channel::<()>();
    let (sent, gate) = (file.clone(), Mutex::new(permits));
    let server = Server::start(move |_, request, answer| {
        answer.file_head(request, &sent, ETAG);
        answer.bytes(&sent, 0..first);
        // Until the test has seen the window, or is over.
        if gate.lock().is_ok_and(|gate| gate.recv().is_ok()) {
            answer.bytes(&sent, first..sent.len());
        }
    });
    let mut command = display.command(client());
    command.arg(server.url("clip.aarc")).args(["--size", "800x600"]).current_dir(place.folder.path());
    command.env("XDG_CACHE_HOME", place.path("cache"));
    // Dropped before the server, which waits for what it is sending.
    let permit = permit;
    let player = display.open(&mut command, "clip.aarc")?;
    let plays = |shot: &Screenshot| shot.colors() > 500;
    display.wait_until(player.window, plays).ok_or("the first layer is not seen")?;
    if server.sent().len() != 1 {
        return Err("the rest was sent before".to_owned());
    }
    permit.send(()).map_err(|error| error.to_string())?;
    let kept = || place.path("cache/aarc/clips").read_dir().is_ok_and(|entries| entries.count() == 1);
    display.wait_until(player.window, |_: &Screenshot| kept()).ok_or("the rest never came")?;
    player.close()
}
