//! Clips by URL, from servers on this machine that work and that fail. Window, headset and headless path all show the
//! events of [`Download`] and read the layers of its takes, so the tests check those.

use std::net::{Ipv4Addr, TcpListener};
use std::ops::{ControlFlow, Range};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::channel;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use aarc_tests::scene::{Motion, Recipe, packaged};
use aarc_tests::server::{Answer, Request, Server};
use aarc_tests::take_files::{SegmentFile, take_package};
use client::clips::playlist;
use client::clips::playlist::Playlist;
use client::content::transfer::{Cache, Options, RetryPolicy};
use client::content::{Download, OpenEvent, OpenTake, Progress, SourceOptions};
use codec::{Clip, Limits, contents, decode};
use program::Fault;

const ETAG: &str = "\"one\"";

/// Short, to keep the tests short.
const RETRY: RetryPolicy = RetryPolicy {
    response_timeout: Duration::from_secs(2),
    read_timeout: Duration::from_secs(3),
    grace: Duration::from_secs(30),
    least_bytes_per_s: 1000,
    retries: 3,
    first_retries: 3,
    first_wait: Duration::from_millis(50),
};

/// A clip of about 50 kB with three layers.
fn package(seed: u64) -> Arc<[u8]> {
    package_of(1500, seed)
}

/// A clip of so many Gaussians.
fn package_of(count: usize, seed: u64) -> Arc<[u8]> {
    let recipe = Recipe { count, sh_degree: 1, motion: Motion::Mixed, motion_order: 3, turning: false, seed };
    packaged(&recipe.field(), None, &[count / 5, count / 2]).into()
}

/// Offsets of the ends of its layers, in bytes.
fn layer_ends(package: &[u8]) -> Vec<usize> {
    contents(package, &Limits::default()).unwrap().layer_bytes()
}

fn decoded(package: &[u8]) -> Clip {
    decode(package, &Limits::default()).unwrap()
}

/// All events of a download.
#[derive(Debug, Default)]
struct Events {
    clips: Vec<Clip>,
    notes: Vec<String>,
    progress: Vec<Progress>,
    fault: Option<Fault>,
}

impl Events {
    /// Decodes the layers of a take, one more after the other, as playing does. Returns whether all did.
    fn add(&mut self, take: &OpenTake) -> bool {
        let mut layers = (1..=take.layers()[0]).map(|layers| take.segment(0, layers));
        let mut latest = None;
        let fault = layers.find_map(|clip| match clip {
            Ok(clip) => {
                latest = Some(clip);
                None
            }
            Err(fault) => Some(fault),
        });
        self.clips.extend(latest);
        self.fault = fault.or(self.fault.take());
        self.fault.is_none()
    }

    fn troubles(&self) -> Vec<&str> {
        self.progress.iter().filter_map(|progress| progress.trouble.as_deref()).collect()
    }

    /// The last clip.
    fn clip(&self) -> &Clip {
        assert_eq!(self.fault, None);
        self.clips.last().expect("a download without a fault has a clip")
    }
}

/// Opens a file again that changes while it is read, as the player does.
fn collect(url: &str, options: &Options) -> Events {
    let start = Instant::now();
    loop {
        let mut events = Events::default();
        let mut takes = Vec::new();
        for event in Download::new(url, options.clone()) {
            match event {
                Ok(OpenEvent::Take(take)) => takes.push(take),
                Ok(OpenEvent::Note(note)) => events.notes.push(note),
                Ok(OpenEvent::Progress(progress)) => events.progress.push(progress),
                Err(fault) => events.fault = Some(fault),
            }
            assert!(start.elapsed() < Duration::from_secs(60), "it does not end: {events:?}");
        }
        if takes.iter().all(|take| events.add(take) || !take.is_replaced()) {
            return events;
        }
    }
}

fn options() -> Options {
    Options { retry: RETRY, ..Options::default() }
}

fn get(url: &str) -> Events {
    collect(url, &options())
}

fn get_cached(url: &str, folder: &Path) -> Events {
    get_bounded(url, folder, 1 << 20)
}

fn get_bounded(url: &str, folder: &Path, max_bytes: u64) -> Events {
    collect(url, &Options { cache: Some(Cache::new(folder, max_bytes)), ..options() })
}

/// The files of a cache.
fn entries(folder: &Path) -> Vec<PathBuf> {
    folder.read_dir().unwrap().map(|entry| entry.unwrap().path()).collect()
}

/// A server of one file.
fn server_of(file: &Arc<[u8]>) -> Server {
    let file = file.clone();
    Server::start(move |_, request, answer| answer_with(request, answer, &file, ETAG))
}

/// Answers like a correct server.
fn answer_with(request: &Request, answer: &mut Answer<'_>, file: &[u8], etag: &str) {
    if request.header("if-none-match") == Some(etag) {
        answer.head(304, &[("ETag", etag)]);
    } else {
        answer.file(request, file, etag);
    }
}

#[test]
fn a_clip_arrives_complete_and_uncompressed() {
    let file = package(1);
    let server = server_of(&file);
    let events = get(&server.url("a/clip.aarc?key=1").replace("://", "://ann:secret@"));
    assert_eq!(events.clip(), &decoded(&file));
    let [request] = &server.requests()[..] else { panic!("one request is enough") };
    assert_eq!(request.header("authorization"), None, "a user name and a password are not sent");
    assert_eq!((request.path.as_str(), request.header("range")), ("/a/clip.aarc?key=1", None));
    assert_eq!(request.header("accept-encoding"), Some("identity"));
}

#[test]
fn layers_play_before_the_rest_is_sent() {
    let file = package(2);
    let ends = layer_ends(&file);
    let (permit, permits) = channel::<()>();
    let (sent, gate) = (file.clone(), Mutex::new(permits));
    let layers = ends.clone();
    let server = Server::start(move |_, request, answer| {
        let mut first = answer.file_head(request, &sent, ETAG).start;
        for &end in &layers {
            answer.bytes(&sent, first..end);
            first = end;
            // The test permits the next layer when this one plays.
            gate.lock().unwrap().recv().unwrap();
        }
    });
    let retry = RetryPolicy { read_timeout: Duration::from_secs(30), ..RETRY };
    let mut layers_played = Vec::new();
    for event in Download::new(&server.url("clip.aarc"), Options { retry, ..Options::default() }) {
        let OpenEvent::Take(take) = event.unwrap() else { continue };
        for layers in 1..=take.layers()[0] {
            // Waits for the layer.
            assert_eq!(take.segment(0, layers).unwrap(), decoded(&file[..ends[layers - 1]]));
            assert_eq!(server.sent().len(), layers, "no more was sent than plays");
            layers_played.push(layers);
            permit.send(()).unwrap();
        }
    }
    assert_eq!(layers_played, [1, 2, 3]);
}

#[test]
fn a_transfer_cut_at_every_tenth_resumes_each_time() {
    let file = package(3);
    let (sent, length) = (file.clone(), file.len());
    let server = Server::start(move |number, request, answer| {
        answer.cut(request, &sent, ETAG, (number + 1) * length / 10);
    });
    assert_eq!(get(&server.url("clip.aarc")).clip(), &decoded(&file));
    let (sent, requests) = (server.sent(), server.requests());
    assert!(sent.len() >= 10 && is_every_byte_once(&sent, length), "{sent:?}");
    for (number, request) in requests.iter().enumerate() {
        let condition = (number > 0).then_some(ETAG);
        assert_eq!(request.header("if-range"), condition, "request {number}");
    }
}

/// Whether ranges follow each other from the first byte to the last.
fn is_every_byte_once(sent: &[Range<usize>], length: usize) -> bool {
    let ends = sent.iter().map(|range| range.end);
    let starts = sent.iter().map(|range| range.start);
    std::iter::once(0).chain(ends).eq(starts.chain([length]))
}

#[test]
fn a_stall_counts_as_a_lost_connection() {
    let file = package(4);
    let (sent, length) = (file.clone(), file.len());
    let server = Server::start(move |number, request, answer| {
        if number == 0 {
            answer.cut(request, &sent, ETAG, length / 2);
            std::thread::sleep(Duration::from_secs(20));
        } else {
            answer.cut(request, &sent, ETAG, length);
        }
    });
    let retry = RetryPolicy { read_timeout: Duration::from_secs(2), ..RETRY };
    let start = Instant::now();
    let events = collect(&server.url("clip.aarc"), &Options { retry, ..options() });
    assert_eq!(events.clip(), &decoded(&file));
    assert!(start.elapsed() < Duration::from_secs(15), "it does not wait for the server");
    assert!(is_every_byte_once(&server.sent(), length), "{:?}", server.sent());
}

#[test]
fn a_server_without_ranges_sends_everything_again() {
    let file = package(5);
    let (sent, length) = (file.clone(), file.len());
    let server = Server::start(move |number, request, answer| {
        // The second answer ignores the range.
        let request = if number == 1 { Request::default() } else { request.clone() };
        answer.cut(&request, &sent, ETAG, if number == 0 { length / 2 } else { length });
    });
    let events = get(&server.url("clip.aarc"));
    assert_eq!(events.clip(), &decoded(&file));
    assert_eq!(server.sent(), [0..length / 2, 0..length]);
}

#[test]
fn two_versions_of_a_file_are_never_mixed() {
    let (old, new) = (package(6), package(7));
    for etags in [["\"old\"", "\"new\""], ["W/\"old\"", "W/\"new\""], ["", ""]] {
        let files = [old.clone(), new.clone()];
        let server = Server::start(move |number, request, answer| {
            let which = number.min(1);
            let file = &files[which];
            answer.cut(request, file, etags[which], if number == 0 { file.len() / 2 } else { file.len() });
        });
        let events = get(&server.url("clip.aarc"));
        assert_eq!(events.clips, [decoded(&new)], "{etags:?}: {:?}", events.fault);
    }
}

/// Without a strong version, only checksums tell that the part of a file is of another one.
#[test]
fn a_part_of_a_file_that_was_replaced_is_noticed() {
    let (file, other) = (package(6), package(7));
    // The last layer is damaged for good.
    let mut damaged = file.to_vec();
    damaged[layer_ends(&file)[1] + 100] ^= 1;
    let server = Server::start(move |_, request, answer| answer.file(request, &damaged, ""));
    let events = get(&server.url("clip.aarc"));
    assert!(matches!(&events.fault, Some(Fault::Data(why)) if why.contains("CRC-32")), "{events:?}");
    assert_eq!(events.clips[0].layers.len(), 2, "what is right plays");
    // It is another file by now, of the same length.
    let (longer, first) = (file.len().max(other.len()), layer_ends(&file)[0]);
    let padded = |file: &[u8]| [file, &vec![0; longer - file.len()]].concat();
    let versions = [padded(&file), padded(&other)];
    let server = Server::start(move |number, request, answer| match number {
        0 => answer.cut(request, &versions[0], "", first),
        _ => answer.file(request, &versions[1], ""),
    });
    assert_eq!(get(&server.url("clip.aarc")).clips, [decoded(&other)]);
}

#[test]
fn a_wrong_range_is_discarded() {
    let file = package(8);
    let (sent, length) = (file.clone(), file.len());
    let server = Server::start(move |number, request, answer| match number {
        0 => answer.cut(request, &sent, ETAG, length / 2),
        1 | 2 => {
            let range = format!("bytes 7-{}/{length}", length - 1);
            answer.head(206, &[("Content-Range", &range), ("ETag", ETAG)]);
            answer.bytes(&sent, 7..length);
        }
        _ => answer.file(request, &sent, ETAG),
    });
    let events = get(&server.url("clip.aarc"));
    assert_eq!(events.clip(), &decoded(&file));
    let ranges: Vec<bool> =
        server.requests().iter().map(|request| request.header("range").is_some()).collect();
    assert_eq!(ranges, [false, true, true, false], "the whole file, after two wrong parts");
}

/// The bodies of redirects are not read: one of them has no end.
#[test]
fn redirects_are_followed_at_most_five_times() {
    let file = package(9);
    let sent = file.clone();
    let (closed, is_closed) = channel();
    let closed = Mutex::new(closed);
    let server = Server::start(move |_, request, answer| match request.path.as_str() {
        "/old" => {
            answer.head(301, &[("Location", "/newer")]);
            while answer.raw(&[b' '; 10_000]) {}
            closed.lock().unwrap().send(()).unwrap();
        }
        "/newer" => {
            let host = request.header("host").unwrap();
            let location = format!("http://{host}/clip.aarc#top");
            answer.head(302, &[("Location", &location)]);
            answer.raw(b"<p>over there");
        }
        "/round" => answer.head(307, &[("Location", "/round"), ("Content-Length", "0")]),
        "/nowhere" => answer.head(302, &[("Content-Length", "0")]),
        "/words" => {
            answer.head(302, &[("Location", "/t\u{e4}nze und//mehr.aarc"), ("Content-Length", "0")]);
        }
        "/file" => answer.head(302, &[("Location", "file:///etc/passwd")]),
        _ => answer.file(request, &sent, ETAG),
    });
    assert_eq!(get(&server.url("old")).clip(), &decoded(&file));
    is_closed.recv_timeout(Duration::from_secs(10)).expect("the connection was closed");
    assert_eq!(get(&server.url("words")).clip(), &decoded(&file));
    let led = server.requests().last().map(|request| request.path.clone());
    assert_eq!(led.as_deref(), Some("/t%C3%A4nze%20und//mehr.aarc"), "as browsers do");
    for (path, sentence) in [
        ("round", "redirects more than 5 times"),
        ("nowhere", "answers 302"),
        ("file", "neither http nor https"),
    ] {
        let events = get(&server.url(path));
        let Some(Fault::Network(why)) = &events.fault else { panic!("{events:?}") };
        assert!(why.contains(sentence), "{why}");
    }
}

/// Bytes that come too slowly end the request, also those that are no part of the file.
#[test]
fn a_trickle_ends() {
    let file = package(23);
    let sent = file.clone();
    let server = Server::start(move |_, request, answer| {
        let drip = |answer: &mut Answer<'_>, byte: &[u8]| {
            while answer.raw(byte) {
                std::thread::sleep(Duration::from_millis(100));
            }
        };
        match request.path.as_str() {
            "/head" => {
                answer.raw(b"HTTP/1.1 200 OK\r\nX: ");
                drip(answer, b"x");
            }
            "/extension" => {
                answer.head(200, &[("Transfer-Encoding", "chunked")]);
                answer.raw(b"1;");
                drip(answer, b"x");
            }
            _ => {
                let part = answer.file_head(request, &sent, ETAG);
                answer.paced(&sent[part], 10.0);
            }
        }
    });
    let retry = RetryPolicy {
        grace: Duration::from_secs(1),
        response_timeout: Duration::from_secs(1),
        retries: 1,
        first_retries: 1,
        ..RETRY
    };
    for path in ["clip.aarc", "head", "extension"] {
        let start = Instant::now();
        let events = collect(&server.url(path), &Options { retry, ..options() });
        let Some(Fault::Network(why)) = &events.fault else { panic!("{path}: {events:?}") };
        assert!(start.elapsed() < Duration::from_secs(8), "{path}: {why} after {:?}", start.elapsed());
        if path == "clip.aarc" {
            assert!(why.contains("fewer than 1000 bytes a second"), "{why}");
        }
    }
}

#[test]
fn wrong_lengths_are_noticed() {
    let file = package(10);
    let length = file.len();
    let serve = |announced: Option<usize>, sent: usize| {
        let file = file.clone();
        Server::start(move |_, _, answer| {
            let announced = announced.map(|length| length.to_string());
            let headers: Vec<_> =
                announced.iter().map(|length| ("Content-Length", length.as_str())).collect();
            answer.head(200, &headers);
            answer.bytes(&file, 0..sent);
        })
    };
    for announced in [None, Some(length), Some(length + 5000)] {
        let server = serve(announced, length);
        assert_eq!(get(&server.url("clip.aarc")).clip(), &decoded(&file), "{announced:?}");
        assert_eq!(server.requests().len(), 1);
    }
    let server = serve(Some(length - 10), length);
    let events = get(&server.url("clip.aarc"));
    let [note] = &events.notes[..] else { panic!("{events:?}") };
    assert!(note.contains("cut short, 2 of 3 layers play"), "{note}");
    assert_eq!(events.clip().layers.len(), 2, "what is complete plays");
    // Without a length, an early end is a lost connection.
    let server = serve(None, length - 10);
    let events = get(&server.url("clip.aarc"));
    assert!(matches!(events.fault, Some(Fault::Network(_))), "{events:?}");
    assert_eq!((events.clips[0].layers.len(), server.requests().len() > 1), (2, true));
}

#[test]
fn chunks_without_a_length_play() {
    let file = package(11);
    let sent = file.clone();
    let server = Server::start(move |_, _, answer| {
        answer.head(200, &[("Transfer-Encoding", "chunked"), ("ETag", ETAG)]);
        for piece in sent.chunks(1000) {
            answer.raw(format!("{:x}\r\n", piece.len()).as_bytes());
            answer.raw(piece);
            answer.raw(b"\r\n");
        }
        answer.raw(b"0\r\n\r\n");
    });
    let events = get(&server.url("clip.aarc"));
    assert_eq!((events.clip(), server.requests().len()), (&decoded(&file), 1));
}

/// Its head says so, and nothing else of it is read.
#[test]
fn a_file_that_is_too_large_is_refused() {
    let limits = Limits { max_bytes: 1 << 20, ..Limits::default() };
    let count = Arc::new(Mutex::new(0));
    let taken = count.clone();
    let server = Server::start(move |_, _, answer| {
        answer.head(200, &[]);
        // The beginning of a package with a head of 3 GiB.
        let mut piece = b"AARC\x01\0\0\0\0\0\0\xc0".to_vec();
        piece.resize(10_000, 0);
        for _ in 0..10_000 {
            if !answer.raw(&piece) {
                return;
            }
            *taken.lock().unwrap() += piece.len();
        }
    });
    let events = collect(&server.url("clip.aarc"), &Options { limits, ..options() });
    let Some(Fault::Data(why)) = &events.fault else { panic!("{events:?}") };
    assert!(why.contains("1048576 allowed"), "{why}");
    assert_eq!(server.requests().len(), 1, "no request is repeated");
    // Includes what the system buffered.
    let taken = *count.lock().unwrap();
    assert!(taken < 30_000_000, "{taken} bytes were taken");
}

/// Every permanent fault is one sentence that names the URL.
#[test]
fn faults_are_one_sentence() {
    let file = package(12);
    let sent = file.clone();
    let server = Server::start(move |_, request, answer| {
        let status = request.path.trim_start_matches("/status/").parse::<u16>();
        match request.path.as_str() {
            "/page" => {
                answer.head(200, &[]);
                answer.raw(b"<!doctype html><title>Welcome</title>");
            }
            "/other" => {
                answer.head(200, &[]);
                answer.raw(b"ply\nformat binary");
            }
            "/empty" => answer.head(200, &[("Content-Length", "0")]),
            "/packed" => answer.head(200, &[("Content-Encoding", "gzip")]),
            "/smtp" => {
                answer.raw(b"220 mail.example.org ESMTP\r\n");
            }
            "/closed" => {}
            "/mute" => std::thread::sleep(Duration::from_secs(3)),
            "/busy" => answer.head(503, &[("Retry-After", "600"), ("Content-Length", "0")]),
            "/damaged" => {
                let mut damaged = sent.to_vec();
                damaged[sent.len() - 100] ^= 1;
                answer.file(request, &damaged, ETAG);
            }
            "/unasked" => answer.head(206, &[("Content-Range", "bytes 5-9/10")]),
            _ => answer.head(status.unwrap_or(500), &[("Content-Length", "0")]),
        }
    });
    let free_port = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap().local_addr().unwrap();
    let secure = format!("https://{}/clip.aarc", server.socket());
    let network = |url: &str, sentence: &str| {
        let events = get(url);
        let Some(Fault::Network(why)) = &events.fault else { panic!("{url}: {events:?}") };
        assert!(why.starts_with(url) && why.contains(sentence) && !why.contains('\n'), "{url}: {why}");
    };
    for (path, sentence) in [
        ("status/403", "denies access (403 Forbidden)"),
        ("status/404", "no such file (404 Not Found)"),
        ("status/410", "no such file (410 Gone)"),
        ("status/416", "answers 416 Range Not Satisfiable"),
        ("status/418", "answers 418"),
        ("status/500", "answers 500 Internal Server Error"),
        ("status/503", "answers 503 Service Unavailable"),
        ("status/304", "answers 304"),
        ("busy", "asks to wait for 600 s"),
        ("unasked", "answers 206"),
        ("packed", "compressed (gzip)"),
        ("smtp", "does not speak HTTP"),
        ("closed", "connection was lost"),
        ("mute", "does not answer"),
    ] {
        network(&server.url(path), sentence);
    }
    network(&format!("http://{free_port}/clip.aarc"), "takes no connections");
    network("http://nowhere.invalid/clip.aarc", "name");
    network(&secure, "no secure connection: the server does not speak TLS: try the URL with http://");
    let hangs_up = Server::start_with(|_| None, |_, _, _| ());
    network(&format!("https://{}/clip.aarc", hangs_up.socket()), "try the URL with http://");
    network("http://", "not a URL");
    for (path, sentence) in [
        ("page", "a web page"),
        ("other", "name the URL of a file that aarc-studio package made"),
        ("damaged", "CRC-32"),
        ("empty", "upload it again"),
    ] {
        let events = get(&server.url(path));
        let Some(Fault::Data(why)) = &events.fault else { panic!("{path}: {events:?}") };
        assert!(why.contains(sentence), "{why}");
    }
}

#[test]
fn an_overloaded_server_gets_the_time_it_asks_for() {
    let file = package(13);
    let sent = file.clone();
    let server = Server::start(move |number, request, answer| match number {
        0 => answer.head(503, &[("Retry-After", "1"), ("Content-Length", "0")]),
        1 => answer.head(500, &[("Content-Length", "0")]),
        _ => answer.file(request, &sent, ETAG),
    });
    let start = Instant::now();
    let events = get(&server.url("clip.aarc"));
    assert_eq!(events.clip(), &decoded(&file));
    assert!(start.elapsed() >= Duration::from_secs(1), "it was asked to wait");
    assert!(events.troubles().iter().any(|trouble| trouble.contains("503")), "{events:?}");
}

#[test]
fn progress_has_bytes_rate_and_remaining_time() {
    let file = package(14);
    let total = layer_ends(&file)[0];
    let rate = total as f64 / 1.5;
    let sent = file.clone();
    let server = Server::start(move |_, request, answer| {
        answer.file_head(request, &sent, ETAG);
        answer.paced(&sent[..total], rate);
    });
    let mut reports = Vec::new();
    for event in Download::new(&server.url("clip.aarc"), options()) {
        match event.unwrap() {
            OpenEvent::Progress(progress) => reports.push(progress),
            OpenEvent::Take(take) => assert_eq!(take.segment(0, 1).unwrap(), decoded(&file[..total])),
            event => panic!("{event:?}"),
        }
    }
    // How much of the first layer, which plays then.
    let last = reports.last().expect("some progress");
    assert_eq!(last.total, Some(total as u64), "{reports:?}");
    let (measured, left) = (last.bytes_per_s.unwrap(), last.remaining_s().unwrap());
    assert!((0.4..2.5).contains(&(measured / rate)), "{measured} bytes per second, {rate} sent");
    assert!((0.0..2.0).contains(&left), "{left} s left");
    assert!(reports.is_sorted_by_key(|progress| progress.received), "{reports:?}");
}

#[test]
fn a_cached_clip_plays_without_the_network() {
    let folder = tempfile::tempdir().unwrap();
    let file = package(15);
    let server = server_of(&file);
    let url = server.url("clip.aarc");
    assert_eq!(get_cached(&url, folder.path()).clip(), &decoded(&file));

    let again = get_cached(&url, folder.path());
    assert_eq!((again.clip(), again.clips.len()), (&decoded(&file), 1));
    let requests = server.requests();
    assert_eq!((requests.len(), requests[1].header("if-none-match")), (2, Some(ETAG)));
    assert_eq!(server.sent().len(), 1, "sent once");

    drop(server);
    let alone = get_cached(&url, folder.path());
    assert_eq!(alone.clip(), &decoded(&file));
    let [note] = &alone.notes[..] else { panic!("{alone:?}") };
    assert!(note.contains("takes no connections") && note.contains("cached"), "{note}");
}

#[test]
fn a_new_version_replaces_the_cached_one() {
    let folder = tempfile::tempdir().unwrap();
    let (old, new) = (package(16), package(17));
    let files = [old.clone(), new.clone()];
    let server = Server::start(move |number, request, answer| {
        let which = number.min(1);
        answer_with(request, answer, &files[which], ["\"old\"", "\"new\""][which]);
    });
    let url = server.url("clip.aarc");
    assert_eq!(get_cached(&url, folder.path()).clip(), &decoded(&old));
    let changed = get_cached(&url, folder.path());
    assert_eq!(changed.clips, [decoded(&old), decoded(&new)], "the cached clip first, then the new one");
    assert_eq!(get_cached(&url, folder.path()).clips, [decoded(&new)]);
    assert_eq!((server.requests().len(), server.sent().len()), (3, 2));
}

#[test]
fn a_definite_answer_overrules_the_cache() {
    let folder = tempfile::tempdir().unwrap();
    let file = package(18);
    let sent = file.clone();
    let server = Server::start(move |number, request, answer| {
        if number == 0 {
            answer.file(request, &sent, ETAG);
        } else {
            answer.head(404, &[("Content-Length", "0")]);
        }
    });
    let url = server.url("clip.aarc");
    get_cached(&url, folder.path()).clip();
    let gone = get_cached(&url, folder.path());
    assert!(matches!(gone.fault, Some(Fault::Network(_))), "{gone:?}");
}

/// A network sends a page until the user logs in, and a gateway a status of its own while the server is away.
#[test]
fn a_web_page_does_not_replace_a_cached_clip() {
    let folder = tempfile::tempdir().unwrap();
    let file = package(24);
    let sent = file.clone();
    let server = Server::start(move |number, request, answer| match number {
        0 => answer.file(request, &sent, ETAG),
        1 => {
            answer.head(200, &[("Content-Type", "text/html")]);
            answer.raw(b"\r\n<!doctype html><title>Welcome</title>");
        }
        2 => answer.head(511, &[("Content-Length", "0")]),
        _ => answer.head(522, &[("Content-Length", "0")]),
    });
    let url = server.url("clip.aarc");
    get_cached(&url, folder.path()).clip();
    for sentence in ["sends a web page", "log-in (511", "answers 522"] {
        let events = get_cached(&url, folder.path());
        assert_eq!((events.clip(), events.clips.len()), (&decoded(&file), 1));
        let [note] = &events.notes[..] else { panic!("{events:?}") };
        assert!(note.contains(sentence) && note.contains("cached"), "{note}");
    }
}

#[test]
fn what_is_not_to_be_stored_is_not_cached() {
    let folder = tempfile::tempdir().unwrap();
    let (old, new) = (package(27), package(28));
    let files = [old.clone(), new.clone()];
    let server = Server::start(move |number, request, answer| match number {
        0 => answer.file(request, &files[0], ETAG),
        // Says nothing of versions: all of it comes with each request.
        _ => {
            let length = files[1].len().to_string();
            answer.head(200, &[("Content-Length", &length), ("Cache-Control", "private, no-store")]);
            answer.bytes(&files[1], 0..files[1].len());
        }
    });
    let url = server.url("clip.aarc");
    assert_eq!(get_cached(&url, folder.path()).clip(), &decoded(&old));
    let before = entries(folder.path()).len();
    assert_eq!(get_cached(&url, folder.path()).clips, [decoded(&old), decoded(&new)]);
    assert_eq!(entries(folder.path()).len(), before - 1, "the old head is gone, and nothing is new");
    assert_eq!(get_cached(&url, folder.path()).clips, [decoded(&new)]);
}

/// A take of three segments, and its segments as they are read from a file.
fn take(seed: u64) -> (Arc<[u8]>, Vec<Clip>) {
    take_of(1500, seed)
}

/// The same with so many Gaussians in each segment.
fn take_of(count: usize, seed: u64) -> (Arc<[u8]>, Vec<Clip>) {
    let segment = |i: u32| SegmentFile {
        start_s: f64::from(i),
        duration_s: 2.0,
        package: package_of(count, seed + u64::from(i)).to_vec(),
    };
    let (bytes, _) = take_package(4.0, 30.0, &[0, 1, 2].map(segment));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("take.aarc");
    std::fs::write(&path, &bytes).unwrap();
    let opened = OpenTake::open(&path, &Limits::default()).unwrap();
    let clips = (0..3).map(|i| opened.segment(i, opened.layers()[i]).unwrap()).collect();
    (bytes.into(), clips)
}

/// The take at a URL, open.
fn open_take(url: &str, folder: &Path) -> Arc<OpenTake> {
    let options = Options { cache: Some(Cache::new(folder, 1 << 20)), ..options() };
    let opened = Download::new(url, options).find_map(|event| match event.unwrap() {
        OpenEvent::Take(take) => Some(take),
        _ => None,
    });
    opened.expect("it opens")
}

/// All segments of the take at a URL.
fn segments(url: &str, folder: &Path) -> Vec<Clip> {
    let opened = open_take(url, folder);
    (0..3).map(|i| opened.segment(i, opened.layers()[i]).unwrap()).collect()
}

#[test]
fn a_take_plays_whose_length_the_server_does_not_state() {
    for count in [20, 1500] {
        let (file, clips) = take_of(count, 60);
        assert_eq!(file.len() < 32 << 10, count == 20, "{}", file.len());
        for has_ranges in [false, true] {
            let sent = file.clone();
            let server = Server::start(move |_, request, answer| {
                let part = request.part(sent.len()).filter(|_| has_ranges);
                match &part {
                    Some(part) => {
                        let range = format!("bytes {}-{}/*", part.start, part.end - 1);
                        answer.head(206, &[("Content-Range", &range), ("ETag", ETAG)]);
                    }
                    None => answer.head(200, &[("ETag", ETAG)]),
                }
                answer.bytes(&sent, part.unwrap_or(0..sent.len()));
            });
            let (folder, url) = (tempfile::tempdir().unwrap(), server.url("take.aarc"));
            assert!(segments(&url, folder.path()) == clips, "{count} {has_ranges}");
            server.forget();
            assert!(segments(&url, folder.path()) == clips, "{count} {has_ranges}, from the cache");
        }
    }
}

#[test]
fn after_one_odd_answer_to_the_request_of_a_part_the_part_is_right_and_so_is_the_cache() {
    let (file, clips) = take(30);
    for odd in ["none", "416", "other part", "damaged"] {
        let (sent, was_odd) = (file.clone(), AtomicBool::new(false));
        let server = Server::start(move |_, request, answer| {
            let part = request.part(sent.len()).filter(|part| part.start > 0);
            let is_odd = part.is_some() && !was_odd.swap(true, Ordering::Relaxed);
            match (odd, part) {
                ("416", Some(_)) if is_odd => answer.head(416, &[("Content-Length", "0")]),
                ("other part", Some(_)) if is_odd => {
                    let range = format!("bytes 0-99/{}", sent.len());
                    answer.head(206, &[("Content-Length", "100"), ("Content-Range", &range), ("ETag", ETAG)]);
                    answer.bytes(&sent, 0..100);
                }
                ("damaged", Some(part)) if is_odd => {
                    let mut damaged = sent.to_vec();
                    damaged[part.end - 100] ^= 1;
                    answer.file(request, &damaged, ETAG);
                }
                _ => answer_with(request, answer, &sent, ETAG),
            }
        });
        let (folder, url) = (tempfile::tempdir().unwrap(), server.url("take.aarc"));
        assert!(segments(&url, folder.path()) == clips, "{odd}");
        server.forget();
        assert!(segments(&url, folder.path()) == clips, "{odd}, from the cache");
        assert!(server.sent().is_empty(), "{odd}: {:?}", server.sent());
    }
}

#[test]
fn a_take_that_was_replaced_is_noticed_by_any_version_and_by_none() {
    let ((old, old_clips), (new, new_clips)) = (take(40), take(50));
    let longer = old.len().max(new.len());
    let padded = |file: &[u8]| [file, &vec![0; longer - file.len()]].concat().into();
    let versions: [[Arc<[u8]>; 2]; 2] = [[old.clone(), new.clone()], [padded(&old), padded(&new)]];
    for files in versions {
        for etags in [["\"a\"", "\"b\""], ["W/\"a\"", "W/\"b\""], ["W/\"a\"", "W/\"a\""], ["", ""]] {
            let is_replaced = Arc::new(AtomicBool::new(false));
            let (replaced, sent) = (is_replaced.clone(), files.clone());
            let server = Server::start(move |_, request, answer| {
                let which = usize::from(replaced.load(Ordering::Relaxed));
                answer.file(request, &sent[which], etags[which]);
            });
            let (folder, url) = (tempfile::tempdir().unwrap(), server.url("take.aarc"));
            let opened = open_take(&url, folder.path());
            assert!(opened.segment(0, opened.layers()[0]).unwrap() == old_clips[0]);
            is_replaced.store(true, Ordering::Relaxed);
            let fault = opened.segment(1, opened.layers()[1]).unwrap_err();
            assert!(opened.is_replaced(), "{etags:?}: {fault}");
            assert!(opened.segment(0, opened.layers()[0]).unwrap() == old_clips[0], "what is cached is old");
            // Without the cached version, which opens first.
            assert!(segments(&url, &folder.path().join("new")) == new_clips, "{etags:?}");
        }
    }
}

#[test]
fn a_damaged_entry_is_fetched_again() {
    let folder = tempfile::tempdir().unwrap();
    let file = package(19);
    let server = server_of(&file);
    let url = server.url("clip.aarc");
    get_cached(&url, folder.path()).clip();
    let damage = |entry: &PathBuf| {
        let mut bytes = std::fs::read(entry).unwrap();
        let center = bytes.len() / 2;
        bytes[center] ^= 0x10;
        std::fs::write(entry, bytes).unwrap();
    };
    let parts = entries(folder.path());
    assert_eq!(parts.len(), 4, "the head and three layers");
    for part in &parts {
        damage(part);
        server.forget();
        assert_eq!(get_cached(&url, folder.path()).clip(), &decoded(&file));
        assert!(!server.sent().is_empty(), "what was damaged is sent");
        server.forget();
        assert_eq!(get_cached(&url, folder.path()).clips.len(), 1);
        let [request] = &server.requests()[..] else { panic!("{:?}", server.requests()) };
        assert_eq!(request.header("if-none-match"), Some(ETAG), "it was cached again");
    }
    parts.iter().for_each(damage);
    server.forget();
    assert_eq!(get_cached(&url, folder.path()).clip(), &decoded(&file));
    assert_eq!(server.requests()[0].header("if-none-match"), None);
}

/// What the checksums confirm is not read again, though it cannot be decoded.
#[test]
fn a_part_that_needs_too_much_memory_stays_in_the_cache() {
    let folder = tempfile::tempdir().unwrap();
    let (file, clips) = take(30);
    let server = server_of(&file);
    let url = server.url("take.aarc");
    assert!(segments(&url, folder.path()) == clips);
    server.forget();
    let opens_within = |max_bytes: usize| {
        let limits = Limits { max_bytes, ..Limits::default() };
        let options = Options { cache: Some(Cache::new(folder.path(), 1 << 20)), limits, ..options() };
        let opened = Download::new(&url, options).find_map(|event| match event {
            Ok(OpenEvent::Take(take)) => Some(take),
            _ => None,
        });
        opened.map(|opened| opened.segment(0, opened.layers()[0]).map(drop))
    };
    let limits = (10..24).rev().map(|power| 1 << power);
    let fault = limits.map_while(opens_within).find_map(Result::err).expect("it opens, and is too large");
    assert!(fault.to_string().contains("allowed"), "{fault}");
    assert_eq!(server.sent(), []);
    assert!(segments(&url, folder.path()) == clips && server.sent().is_empty());
}

#[test]
fn the_cache_stays_within_its_bound() {
    let folder = tempfile::tempdir().unwrap();
    let file = package(20);
    let server = server_of(&file);
    let most = file.len() as u64 * 5 / 2;
    for number in 0..6 {
        get_bounded(&server.url(&format!("{number}.aarc")), folder.path(), most).clip();
        let bytes: u64 = entries(folder.path()).iter().map(|entry| entry.metadata().unwrap().len()).sum();
        assert!(bytes <= most && bytes >= file.len() as u64, "{bytes} of {most} bytes");
    }
}

#[test]
fn players_share_a_cache() {
    let folder = tempfile::tempdir().unwrap();
    let file = package(21);
    let server = server_of(&file);
    let expected = decoded(&file);
    std::thread::scope(|scope| {
        for player in 0..4 {
            let (url, folder, expected) = (server.url(&format!("{}", player % 2)), folder.path(), &expected);
            scope.spawn(move || {
                for _ in 0..5 {
                    assert_eq!(get_cached(&url, folder).clip(), expected);
                }
            });
        }
    });
    for path in ["0", "1"] {
        assert_eq!(get_cached(&server.url(path), folder.path()).clips.len(), 1);
    }
    let last = server.requests();
    assert_eq!(last[last.len() - 1].header("if-none-match"), Some(ETAG), "the entries are complete");
    assert_eq!(entries(folder.path()).len(), 2 * 4, "heads and layers, and nothing else");
}

#[test]
fn a_playlist_arrives_as_clips_do() {
    let text = r#"{"version": 1, "clips": ["a.aarc"]}"#;
    let server = Server::start(move |number, request, answer| match request.path.as_str() {
        // Cut once, and silent about its length once.
        "/list.json" if number == 0 => answer.cut(request, text.as_bytes(), ETAG, 10),
        "/list.json" => answer.file(request, text.as_bytes(), ETAG),
        "/short.json" => {
            answer.head(200, &[]);
            answer.raw(text.as_bytes());
        }
        "/long.json" => {
            answer.head(200, &[]);
            while answer.raw(&[b' '; 10_000]) {}
        }
        "/page.json" => {
            answer.head(200, &[]);
            answer.raw(b"<!doctype html><title>Welcome</title>");
        }
        _ => answer.head(404, &[("Content-Length", "0")]),
    });
    let open = |path: &str| {
        playlist::open(&[server.url(path)], &SourceOptions::default(), &mut |_| ControlFlow::Continue(()))
    };
    for path in ["list.json", "short.json"] {
        assert_eq!(open(path).unwrap().unwrap().clips, [server.url("a.aarc")], "{path}");
    }
    assert_eq!(server.sent(), [0..10, 0..text.len()], "from the start again");
    for (path, sentence) in [("long.json", "larger than 1 MiB"), ("page.json", "a web page")] {
        let Err(Fault::Data(why)) = open(path) else { panic!("{path} is no playlist") };
        assert!(why.starts_with(&server.url(path)) && why.contains(sentence), "{why}");
    }
    assert!(matches!(open("none.json"), Err(Fault::Network(why)) if why.contains("404 Not Found")));
    // A caller can stop waiting.
    let silent = Server::start(|_, _, _| std::thread::sleep(Duration::from_secs(5)));
    let start = Instant::now();
    let stopped =
        playlist::open(&[silent.url("a.json")], &SourceOptions::default(), &mut |_| ControlFlow::Break(()));
    assert!(matches!(stopped, Ok(None)) && start.elapsed() < Duration::from_secs(4));
}

/// Where redirects led, also from the cache.
#[test]
fn entries_of_a_playlist_are_relative_to_its_last_url() {
    let folder = tempfile::tempdir().unwrap();
    let text = r#"{"version": 1, "clips": ["a.aarc", "/b.aarc"]}"#;
    let server = Server::start(move |_, request, answer| match request.path.as_str() {
        "/list.json" => {
            answer.head(302, &[("Location", "shows/today/list.json?key"), ("Content-Length", "0")]);
        }
        "/shows/today/list.json?key" if request.header("if-none-match") == Some(ETAG) => {
            answer.head(304, &[("ETag", ETAG)]);
        }
        "/shows/today/list.json?key" => answer.file(request, text.as_bytes(), ETAG),
        _ => answer.head(404, &[("Content-Length", "0")]),
    });
    let (url, clips) = (server.url("list.json"), [server.url("shows/today/a.aarc"), server.url("b.aarc")]);
    let options = SourceOptions { cache_dir: Some(folder.path().into()), ..SourceOptions::default() };
    let open = || {
        playlist::open(std::slice::from_ref(&url), &options, &mut |_| ControlFlow::Continue(()))
            .unwrap()
            .unwrap()
    };
    for what in ["fetched", "current", "alone"] {
        assert_eq!(open(), Playlist { clips: clips.to_vec() }, "{what}");
        if what == "current" {
            assert_eq!(server.sent().len(), 1);
            server.forget();
        }
    }
    drop(server);
    assert_eq!(open(), Playlist { clips: clips.to_vec() }, "without the server");
}

/// While nothing arrives, and the connection could be silent for long.
#[test]
fn a_dropped_download_closes_its_connection_within_a_second() {
    let file = package(26);
    let (answered, is_answered) = channel();
    let (closed, is_closed) = channel();
    let senders = Mutex::new((answered, closed));
    let sent = file.clone();
    let server = Server::start(move |_, request, answer| {
        if request.path != "/mute" {
            answer.cut(request, &sent, ETAG, 100);
        }
        senders.lock().unwrap().0.send(()).unwrap();
        answer.wait_until_closed();
        senders.lock().unwrap().1.send(Instant::now()).unwrap();
    });
    for path in ["mute", "clip.aarc"] {
        let mut download = Download::new(&server.url(path), Options::default());
        assert!(matches!(download.next(), Some(Ok(OpenEvent::Progress(_)))));
        is_answered.recv_timeout(Duration::from_secs(60)).unwrap();
        std::thread::sleep(Duration::from_millis(100));
        let dropped = Instant::now();
        drop(download);
        let closed = is_closed.recv_timeout(Duration::from_secs(60)).expect("the connection was closed");
        assert!(closed - dropped < Duration::from_secs(1), "{path}: {:?}", closed - dropped);
    }
}

#[test]
fn a_dropped_download_closes_its_connection() {
    let file = package(22);
    let sent = file.clone();
    let (done, ended) = channel();
    let done = Mutex::new(done);
    let server = Server::start(move |_, request, answer| {
        answer.file_head(request, &sent, ETAG);
        // Would take ten minutes.
        let is_complete = answer.paced(&sent, sent.len() as f64 / 600.0);
        done.lock().unwrap().send(is_complete).unwrap();
    });
    let mut download = Download::new(&server.url("clip.aarc"), Options::default());
    assert!(matches!(download.next(), Some(Ok(OpenEvent::Progress(_)))));
    drop(download);
    assert_eq!(ended.recv_timeout(Duration::from_secs(60)), Ok(false), "the connection was closed");
}
