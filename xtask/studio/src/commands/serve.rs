//! `aarc-studio serve`: serves the files of a folder over HTTP, to try URLs locally.
//!
//! One request per connection, one thread per connection: enough for a few players; for
//! the public use any static host. It answers as those do: versions (`ETag`), parts
//! (`Range`), conditions (`If-None-Match`, `If-Range`), after RFC 9110.

use std::fs::File;
use std::io::{BufRead, BufReader, Read, Seek, SeekFrom, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
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

/// Timeout of a client.
const PATIENCE: Duration = Duration::from_secs(30);

/// Serve the files of a folder over HTTP, to try URLs. For the public, use any static host.
#[derive(clap::Args)]
pub struct Args {
    /// The folder; all of it is readable for everyone who reaches the address
    folder: PathBuf,
    /// Where to listen: 0.0.0.0:8000 for the whole network, a headset for one
    #[arg(long, value_name = "IP:PORT", default_value = "127.0.0.1:8000")]
    address: SocketAddr,
    /// Send at most so many megabits per second on each connection [default: unlimited]
    #[arg(long, value_name = "N", value_parser = positive)]
    mbit: Option<f64>,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let folder = &args.folder;
    if !folder.is_dir() {
        return Err(Fault::Data(format!("{}: not a folder", folder.display())).into());
    }
    let listener = TcpListener::bind(args.address)
        .map_err(|error| Fault::Usage(format!("cannot listen on {}: {error}", args.address)))?;
    println!("{}: http://{}/, until Ctrl-C", folder.display(), listener.local_addr()?);
    let folder: Arc<Path> = folder.as_path().into();
    let bytes_per_s = args.mbit.map(|mbit| mbit * 1e6 / 8.0);
    for stream in listener.incoming() {
        let folder = folder.clone();
        let serve = move |stream: TcpStream| -> std::io::Result<()> {
            stream.set_read_timeout(Some(PATIENCE))?;
            stream.set_write_timeout(Some(PATIENCE))?;
            let Some(request) = Request::read(&stream) else { return Ok(()) };
            let reply = answer(&request, &folder);
            println!("{} {} {}", reply.status, request.method.escape_debug(), request.path.escape_debug());
            reply.send(&stream, bytes_per_s)
        };
        // A client that went away is no news; nor is one that the system has no thread for, or no file.
        let started = stream.and_then(|stream| thread::Builder::new().spawn(move || drop(serve(stream))));
        if started.is_err() {
            thread::sleep(Duration::from_millis(100));
        }
    }
    Ok(())
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

/// The file at the path of a request; `None` if it may lie outside the folder.
fn file_path(path: &str, folder: &Path) -> Option<PathBuf> {
    let decoded = percent_decoded(path.strip_prefix('/')?)?;
    let inside = Path::new(&decoded).components().all(|part| matches!(part, Component::Normal(_)));
    inside.then(|| folder.join(decoded))
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
        Request { method: "GET".into(), path: path.into(), ..Request::default() }
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

    #[test]
    fn requests_are_read_and_nonsense_is_not() {
        let text = b"GET /a?b HTTP/1.1\r\nHost: x\r\nRANGE: bytes=1-\r\n\r\n";
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
