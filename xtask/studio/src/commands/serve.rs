//! `aarc-studio serve`: serves the files of a folder over HTTP, to try URLs locally.
//!
//! One request per connection, one thread per connection: enough for a few players; for
//! the public use any static host. It answers as those do: versions (`ETag`), parts
//! (`Range`), conditions (`If-None-Match`, `If-Range`), after RFC 9110.
//!
//! A web page that a browser on this network shows may give its own name the address of this server, and
//! so read what it serves (DNS rebinding). Such requests carry the page's name in `Host`: only addresses
//! and `localhost` are answered.

use std::fs::File;
use std::io::{BufRead, BufReader, Read, Seek, SeekFrom, Write};
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr, TcpListener, TcpStream};
use std::ops::Range;
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant, UNIX_EPOCH};

use program::Fault;

/// Maximum size of a request in bytes.
const REQUEST_BYTES: u64 = 16 << 10;

/// Bytes per write.
const PIECE_BYTES: usize = 16 << 10;

/// Time for a request to arrive, and for a client to take the next piece.
const PATIENCE: Duration = Duration::from_secs(30);

/// Maximum number of connections at once.
const CONNECTIONS_MAX: usize = 64;

/// Serve the files of a folder over HTTP, to try URLs. For the public, use any static host.
#[derive(clap::Args)]
pub struct Args {
    /// The folder; all of it, but nothing that links lead to outside, is readable for everyone who reaches the
    /// address
    folder: PathBuf,
    /// Where to listen: 0.0.0.0:8000 for the whole network, a headset for one
    #[arg(long, value_name = "IP:PORT", default_value = "127.0.0.1:8000")]
    address: SocketAddr,
    /// Send at most so many megabits per second on each connection [default: unlimited]
    #[arg(long, value_name = "N", value_parser = positive)]
    mbit: Option<f64>,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let folder = args.folder.canonicalize().ok().filter(|folder| folder.is_dir());
    let folder =
        folder.ok_or_else(|| Fault::Data(format!("{}: not a folder; name one", args.folder.display())))?;
    let listener = TcpListener::bind(args.address).map_err(|error| {
        Fault::Usage(format!("cannot listen on {}: {error}; choose another with --address", args.address))
    })?;
    println!("{}: http://{}/, until Ctrl-C", args.folder.display(), listener.local_addr()?);
    serve(&listener, &folder.into(), args.mbit.map(|mbit| mbit * 1e6 / 8.0));
    Ok(())
}

/// Answers connections, each in a thread, as long as the listener accepts.
fn serve(listener: &TcpListener, folder: &Arc<Path>, bytes_per_s: Option<f64>) {
    for stream in listener.incoming() {
        // Each connection's thread has a copy.
        let folder = folder.clone();
        let is_crowded = Arc::strong_count(&folder) > 1 + CONNECTIONS_MAX;
        let serve = move |stream: TcpStream| -> std::io::Result<()> {
            stream.set_write_timeout(Some(PATIENCE))?;
            let Some(request) = Request::read(Limited { stream: &stream, end: Instant::now() + PATIENCE })
            else {
                return Reply::empty("400 Bad Request").send(&stream, None);
            };
            let reply = answer(&request, &folder);
            println!("{} {} {}", reply.status, request.method.escape_debug(), request.path.escape_debug());
            reply.send(&stream, bytes_per_s)
        };
        let started = stream.and_then(|stream| match is_crowded {
            true => Reply::empty("503 Service Unavailable").send(&stream, None),
            false => thread::Builder::new().spawn(move || drop(serve(stream))).map(drop),
        });
        // A client that went away is no news; nor is one that the system has no thread for, or no file.
        if started.is_err() {
            thread::sleep(Duration::from_millis(100));
        }
    }
}

/// Reads from a client until a moment, however many pieces come.
struct Limited<'a> {
    stream: &'a TcpStream,
    end: Instant,
}

impl Read for Limited<'_> {
    fn read(&mut self, bytes: &mut [u8]) -> std::io::Result<usize> {
        let left = self.end.saturating_duration_since(Instant::now());
        // No timeout is zero: that would be none.
        self.stream.set_read_timeout(Some(left.max(Duration::from_millis(1))))?;
        let mut stream = self.stream;
        stream.read(bytes)
    }
}

fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(number) if (1e-3..=1e6).contains(&number) => Ok(number),
        _ => Err("a number of megabits per second from 0.001 to 1000000".into()),
    }
}

/// The evaluated fields of a request.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
struct Request {
    method: String,
    /// Without the query.
    path: String,
    /// Name or address, and port, by which the client reaches the server.
    host: Option<String>,
    range: Option<String>,
    if_range: Option<String>,
    if_none_match: Option<String>,
}

impl Request {
    /// Reads a request; `None` if it is malformed.
    fn read(stream: impl Read) -> Option<Request> {
        let mut lines = BufReader::new(stream.take(REQUEST_BYTES)).lines().map_while(Result::ok);
        let first = lines.next()?;
        let mut words = first.split(' ');
        let (method, target) = (words.next()?, words.next()?);
        words.next().filter(|version| version.starts_with("HTTP/1."))?;
        let path = target.split(['?', '#']).next().unwrap_or_default();
        let mut request = Request { method: method.into(), path: path.into(), ..Request::default() };
        for line in lines.take_while(|line| !line.is_empty()) {
            let (name, value) = line.split_once(':')?;
            let field = match name.to_ascii_lowercase().as_str() {
                "host" => &mut request.host,
                "range" => &mut request.range,
                "if-range" => &mut request.if_range,
                "if-none-match" => &mut request.if_none_match,
                _ => continue,
            };
            *field = Some(value.trim().into());
        }
        Some(request)
    }
}

/// A response.
#[derive(Debug)]
struct Reply {
    status: &'static str,
    headers: Vec<(&'static str, String)>,
    /// The part of a file that follows.
    body: Option<(File, Range<u64>)>,
}

impl Reply {
    fn empty(status: &'static str) -> Reply {
        Reply { status, headers: vec![("Content-Length", "0".into())], body: None }
    }

    /// Sends the response at a limited number of bytes per second.
    fn send(self, mut stream: impl Write, bytes_per_s: Option<f64>) -> std::io::Result<()> {
        let mut head = format!("HTTP/1.1 {}\r\nConnection: close\r\n", self.status);
        for (name, value) in self.headers {
            head += &format!("{name}: {value}\r\n");
        }
        stream.write_all(format!("{head}\r\n").as_bytes())?;
        let Some((mut file, part)) = self.body else { return Ok(()) };
        file.seek(SeekFrom::Start(part.start))?;
        let mut file = file.take(part.end - part.start);
        let (start, mut sent, mut piece) = (Instant::now(), 0, vec![0; PIECE_BYTES]);
        loop {
            let count = file.read(&mut piece)?;
            if count == 0 {
                return Ok(());
            }
            sent += count;
            if let Some(rate) = bytes_per_s {
                let due = Duration::from_secs_f64(sent as f64 / rate);
                thread::sleep(due.saturating_sub(start.elapsed()));
            }
            stream.write_all(&piece[..count])?;
        }
    }
}

/// The answer to a request for a file in `folder`.
fn answer(request: &Request, folder: &Path) -> Reply {
    if !request.host.as_deref().is_some_and(is_own_host) {
        return Reply::empty("421 Misdirected Request");
    }
    if !matches!(request.method.as_str(), "GET" | "HEAD") {
        return Reply::empty("405 Method Not Allowed");
    }
    let opened = file_path(&request.path, folder).and_then(|path| {
        // Check before opening: opening a pipe blocks until a writer opens it.
        let about = path.metadata().ok().filter(|about| about.is_file())?;
        let file = File::open(path).ok()?;
        Some((file, about))
    });
    let Some((file, about)) = opened else { return Reply::empty("404 Not Found") };
    let length = about.len();
    let changed = about.modified().ok().and_then(|time| time.duration_since(UNIX_EPOCH).ok());
    let etag = format!("\"{length:x}-{:x}\"", changed.unwrap_or_default().as_nanos());
    if request.if_none_match.as_ref().is_some_and(|known| known == "*" || known.contains(&etag)) {
        return Reply { status: "304 Not Modified", headers: vec![("ETag", etag)], body: None };
    }
    let same = request.if_range.as_ref().is_none_or(|version| *version == etag);
    let range = request.range.as_deref().filter(|_| same).and_then(|range| parse_range(range, length));
    let (status, part) = match range {
        None => ("200 OK", 0..length),
        Some(part) if part.is_empty() => {
            let mut reply = Reply::empty("416 Range Not Satisfiable");
            reply.headers.push(("Content-Range", format!("bytes */{length}")));
            return reply;
        }
        Some(part) => ("206 Partial Content", part),
    };
    let mut headers = vec![
        ("Content-Type", "application/octet-stream".into()),
        ("Content-Length", (part.end - part.start).to_string()),
        ("Accept-Ranges", "bytes".into()),
        ("ETag", etag),
    ];
    if status.starts_with("206") {
        headers.push(("Content-Range", format!("bytes {}-{}/{length}", part.start, part.end - 1)));
    }
    Reply { status, headers, body: (request.method == "GET").then_some((file, part)) }
}

/// Whether the value of `Host` is an address or `localhost`, with a port or without: no DNS entry can give these
/// names to another server.
fn is_own_host(host: &str) -> bool {
    let name = match host.rsplit_once(':') {
        Some((name, port)) if port.bytes().all(|byte| byte.is_ascii_digit()) => name,
        _ => host,
    };
    let inside_brackets = name.strip_prefix('[').and_then(|name| name.strip_suffix(']'));
    name.eq_ignore_ascii_case("localhost")
        || name.parse::<Ipv4Addr>().is_ok()
        || inside_brackets.is_some_and(|name| name.parse::<Ipv6Addr>().is_ok())
}

/// The file at the path of a request; `None` if it lies outside the folder, a canonical path, also by a
/// link.
fn file_path(path: &str, folder: &Path) -> Option<PathBuf> {
    let decoded = percent_decoded(path.strip_prefix('/')?)?;
    let inside = Path::new(&decoded).components().all(|part| matches!(part, Component::Normal(_)));
    let path = inside.then(|| folder.join(decoded))?.canonicalize().ok()?;
    path.starts_with(folder).then_some(path)
}

/// Decodes percent-encoded bytes.
fn percent_decoded(text: &str) -> Option<String> {
    let mut bytes = Vec::new();
    let mut rest = text.bytes();
    while let Some(byte) = rest.next() {
        bytes.push(match byte {
            b'%' => {
                let digits = [rest.next()?, rest.next()?];
                u8::from_str_radix(str::from_utf8(&digits).ok()?, 16).ok()?
            }
            byte => byte,
        });
    }
    String::from_utf8(bytes).ok().filter(|text| !text.contains('\0'))
}

/// One range of a file of `length` bytes; empty where it begins beyond the end; `None` for what is
/// not understood, which asks for the whole.
fn parse_range(text: &str, length: u64) -> Option<Range<u64>> {
    let (first, last) = text.strip_prefix("bytes=")?.split_once('-')?;
    if first.is_empty() {
        return Some(length.saturating_sub(last.parse().ok()?)..length);
    }
    let first: u64 = first.parse().ok()?;
    let end = if last.is_empty() { length } else { last.parse::<u64>().ok()?.saturating_add(1).min(length) };
    if first >= length { Some(length..length) } else { (first < end).then_some(first..end) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn get(path: &str) -> Request {
        let host = Some("127.0.0.1:8000".into());
        Request { method: "GET".into(), path: path.into(), host, ..Request::default() }
    }

    /// What a client sees: the head and the body.
    fn seen(request: &Request, folder: &Path) -> (String, Vec<u8>) {
        let mut bytes = Vec::new();
        answer(request, folder).send(&mut bytes, None).unwrap();
        let end = bytes.windows(4).position(|four| four == b"\r\n\r\n").unwrap() + 4;
        (String::from_utf8(bytes[..end].to_vec()).unwrap(), bytes[end..].to_vec())
    }

    fn folder() -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("in")).unwrap();
        std::fs::write(folder.path().join("in/a b.aarc"), b"0123456789").unwrap();
        folder
    }

    fn etag(head: &str) -> String {
        head.lines().find_map(|line| line.strip_prefix("ETag: ")).unwrap().into()
    }

    #[test]
    fn files_come_whole_and_in_parts_and_as_they_are_asked_for() {
        let folder = folder();
        let request = get("/in/a%20b.aarc");
        let (head, body) = seen(&request, folder.path());
        assert!(head.starts_with("HTTP/1.1 200 OK\r\n") && head.contains("Content-Length: 10\r\n"), "{head}");
        assert_eq!(body, b"0123456789");
        let version = etag(&head);
        for (range, part, text) in
            [("bytes=4-", "4-9", "456789"), ("bytes=2-3", "2-3", "23"), ("bytes=-3", "7-9", "789")]
        {
            let if_range = Some(version.clone());
            let ranged = Request { range: Some(range.into()), if_range, ..request.clone() };
            let (head, body) = seen(&ranged, folder.path());
            assert!(head.contains("206 Partial Content\r\n") && body == text.as_bytes(), "{head}");
            assert!(head.contains(&format!("Content-Range: bytes {part}/10\r\n")), "{head}");
            let other = Request { if_range: Some("\"other\"".into()), ..ranged };
            assert_eq!(seen(&other, folder.path()).1, b"0123456789", "of another version, the whole");
        }
        let beyond = Request { range: Some("bytes=10-".into()), ..request.clone() };
        assert!(seen(&beyond, folder.path()).0.contains("416 Range Not Satisfiable"));
        let known = Request { if_none_match: Some(version), ..request.clone() };
        assert!(seen(&known, folder.path()).0.contains("304 Not Modified"));
        let head_only = Request { method: "HEAD".into(), ..request };
        let (head, body) = seen(&head_only, folder.path());
        assert!(head.contains("Content-Length: 10\r\n") && body.is_empty());
    }

    #[test]
    fn nothing_outside_the_folder_is_served() {
        let folder = folder();
        let inside = folder.path().join("in");
        std::fs::write(folder.path().join("secret"), "").unwrap();
        for path in [
            "/../secret",
            "/%2e%2e/secret",
            "/./../secret",
            "//etc/passwd",
            "secret",
            "/",
            "/%",
            "/%00",
            "/x",
        ] {
            assert_eq!(answer(&get(path), &inside).status, "404 Not Found", "{path}");
        }
        let post = Request { method: "POST".into(), ..get("/a%20b.aarc") };
        assert_eq!(answer(&post, &inside).status, "405 Method Not Allowed");
    }

    #[cfg(unix)]
    #[test]
    fn links_inside_the_folder_are_followed_and_others_are_not() {
        use std::os::unix::fs::symlink;
        let folder = folder();
        let inside = folder.path().join("in");
        std::fs::write(folder.path().join("secret"), "").unwrap();
        symlink("a b.aarc", inside.join("latest")).unwrap();
        symlink("../secret", inside.join("file")).unwrap();
        symlink("..", inside.join("folder")).unwrap();
        assert_eq!(answer(&get("/latest"), &inside).status, "200 OK");
        for path in ["/file", "/folder/secret", "/folder/in/../secret"] {
            assert_eq!(answer(&get(path), &inside).status, "404 Not Found", "{path}");
        }
        // A link back into the folder stays inside.
        assert_eq!(answer(&get("/folder/in/latest"), &inside).status, "200 OK");
    }

    #[test]
    fn names_of_other_servers_are_refused() {
        let folder = folder();
        let status = |host: Option<&str>| {
            let request = Request { host: host.map(str::to_owned), ..get("/in/a%20b.aarc") };
            answer(&request, folder.path()).status
        };
        for host in ["127.0.0.1", "192.168.1.5:8000", "localhost", "LocalHost:80", "[::1]:8000", "[fe80::1]"]
        {
            assert_eq!(status(Some(host)), "200 OK", "{host}");
        }
        for host in
            ["example.org", "example.org:8000", "localhost.example.org", "", ":", "127.0.0.1.nip.io", "::1"]
        {
            assert_eq!(status(Some(host)), "421 Misdirected Request", "{host}");
        }
        assert_eq!(status(None), "421 Misdirected Request");
    }

    #[test]
    fn connections_have_a_limit_and_make_room_for_others() {
        let folder = folder();
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let shared: Arc<Path> = folder.path().canonicalize().unwrap().into();
        // Ends with the test program.
        thread::spawn(move || serve(&listener, &shared, None));
        let reply = || {
            let mut stream = TcpStream::connect(address).unwrap();
            // The server may close the connection before it has read the request.
            let _ = write!(stream, "GET /in/a%20b.aarc HTTP/1.1\r\nHost: {address}\r\n\r\n");
            let mut text = Vec::new();
            let _ = stream.read_to_end(&mut text);
            String::from_utf8_lossy(&text).into_owned()
        };
        assert!(reply().starts_with("HTTP/1.1 200 OK"));
        let silent: Vec<_> = (0..CONNECTIONS_MAX).map(|_| TcpStream::connect(address).unwrap()).collect();
        // One thread accepts all: it has accepted those before.
        let crowded = reply();
        assert!(!crowded.contains("200 OK"), "{crowded}");
        drop(silent);
        let start = Instant::now();
        while !reply().starts_with("HTTP/1.1 200 OK") {
            assert!(start.elapsed() < PATIENCE, "the places are not given back");
            thread::sleep(Duration::from_millis(10));
        }
    }

    #[test]
    fn a_request_has_to_arrive_in_time() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let mut slow = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        let (stream, _) = listener.accept().unwrap();
        let start = Instant::now();
        let patience = Duration::from_millis(300);
        let sender = thread::spawn(move || {
            while start.elapsed() < 10 * patience && slow.write_all(b"G").is_ok() {
                thread::sleep(patience / 10);
            }
        });
        assert_eq!(Request::read(Limited { stream: &stream, end: start + patience }), None);
        assert!(start.elapsed() < 5 * patience, "{:?}", start.elapsed());
        drop(stream);
        sender.join().unwrap();
    }

    #[test]
    fn requests_are_read_and_nonsense_is_not() {
        let text = b"GET /a?b HTTP/1.1\r\nHost: 127.0.0.1:8000\r\nRANGE: bytes=1-\r\n\r\n";
        assert_eq!(Request::read(&text[..]), Some(Request { range: Some("bytes=1-".into()), ..get("/a") }));
        for text in
            [&b""[..], b"GET", b"GET /", b"GET / SMTP\r\n\r\n", b"GET / HTTP/1.1\r\nx\r\n\r\n", b"\xff\xff"]
        {
            assert_eq!(Request::read(text), None, "{text:?}");
        }
        for range in ["bytes=5-2", "bytes=x-", "lines=1-2", "bytes=1-2,4-5", "bytes=-"] {
            assert_eq!(parse_range(range, 10), None, "{range}");
        }
    }

    #[test]
    fn the_rate_is_kept() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("a"), vec![0; 100_000]).unwrap();
        let start = Instant::now();
        answer(&get("/a"), folder.path()).send(std::io::sink(), Some(1e6)).unwrap();
        assert!(start.elapsed() >= Duration::from_millis(100), "{:?}", start.elapsed());
    }
}
