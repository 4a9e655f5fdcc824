//! [`Server`]: an HTTP server on this machine that answers as a test wants, correctly or not.

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream};
use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

/// A request.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Request {
    /// Path and query.
    pub path: String,
    /// Values by names in lower case.
    pub headers: BTreeMap<String, String>,
}

impl Request {
    /// Value of a header, by its name in lower case.
    pub fn header(&self, name: &str) -> Option<&str> {
        self.headers.get(name).map(String::as_str)
    }

    /// A header `Range: bytes=FIRST-LAST`, as the range that it stands for.
    pub fn part(&self) -> Option<Range<usize>> {
        let (first, last) = self.header("range")?.strip_prefix("bytes=")?.split_once('-')?;
        Some(first.parse().ok()?..last.parse::<usize>().ok()? + 1)
    }

    /// `FIRST` of a header `Range: bytes=FIRST-`.
    pub fn first_byte(&self) -> Option<usize> {
        self.header("range")?.strip_prefix("bytes=")?.strip_suffix('-')?.parse().ok()
    }
}

/// A connection to a client: TCP or TLS.
pub trait Stream: Read + Write + Send {}
impl<T: Read + Write + Send> Stream for T {}

/// An answer. The connection ends with it.
pub struct Answer<'a> {
    stream: &'a mut dyn Stream,
    sent: &'a Mutex<Vec<Range<usize>>>,
}

impl Answer<'_> {
    /// Sends bytes and returns whether the client is still connected.
    pub fn raw(&mut self, bytes: &[u8]) -> bool {
        self.stream.write_all(bytes).and_then(|()| self.stream.flush()).is_ok()
    }

    /// Sends a status and headers.
    pub fn head(&mut self, status: u16, headers: &[(&str, &str)]) {
        let headers: String = headers.iter().map(|(name, value)| format!("{name}: {value}\r\n")).collect();
        self.raw(format!("HTTP/1.1 {status} x\r\nConnection: close\r\n{headers}\r\n").as_bytes());
    }

    /// Sends `file` from the requested byte up to `end`, with the headers of a correct server. `etag`
    /// includes its quotes.
    pub fn file(&mut self, request: &Request, file: &[u8], etag: &str, end: usize) {
        let first = self.file_head(request, file, etag);
        self.bytes(file, first..end.max(first));
    }

    /// Sends the requested part of `file`, or all of it if none is requested, or one of another version than `etag`.
    pub fn part(&mut self, request: &Request, file: &[u8], etag: &str) {
        match self.part_head(request, file, etag) {
            Some(part) => self.bytes(file, part),
            None => self.file(&Request::default(), file, etag, file.len()),
        }
    }

    /// As [`Answer::part`], at `bytes_per_s`.
    pub fn paced_part(&mut self, request: &Request, file: &[u8], etag: &str, bytes_per_s: f64) {
        let part = match self.part_head(request, file, etag) {
            Some(part) => part,
            None => self.file_head(&Request::default(), file, etag)..file.len(),
        };
        lock(self.sent).push(part.clone());
        self.paced(&file[part], bytes_per_s);
    }

    /// Sends the headers of the requested part of `file` and returns the part; `None` if none is requested, or one of
    /// another version.
    pub fn part_head(&mut self, request: &Request, file: &[u8], etag: &str) -> Option<Range<usize>> {
        let same = request.header("if-range").is_none_or(|version| version == etag);
        let part = request.part().filter(|part| same && part.start < file.len())?;
        let part = part.start..part.end.min(file.len());
        let range = format!("bytes {}-{}/{}", part.start, part.end - 1, file.len());
        let length = part.len().to_string();
        self.head(206, &[("Content-Length", &length), ("Content-Range", &range), ("ETag", etag)]);
        Some(part)
    }

    /// Sends the headers of [`Answer::file`] and returns the requested first byte.
    pub fn file_head(&mut self, request: &Request, file: &[u8], etag: &str) -> usize {
        let same = request.header("if-range").is_none_or(|version| version == etag);
        let first = request.first_byte().filter(|&first| same && first < file.len());
        let length = (file.len() - first.unwrap_or(0)).to_string();
        let mut headers = vec![("Content-Length", length.as_str()), ("ETag", etag)];
        let range = first.map(|first| format!("bytes {first}-{}/{}", file.len() - 1, file.len()));
        headers.extend(range.as_deref().map(|range| ("Content-Range", range)));
        self.head(if first.is_some() { 206 } else { 200 }, &headers);
        first.unwrap_or(0)
    }

    /// Sends a range of `file` and logs it.
    pub fn bytes(&mut self, file: &[u8], range: Range<usize>) {
        lock(self.sent).push(range.clone());
        self.raw(&file[range]);
    }

    /// Waits until the client closes the connection.
    pub fn wait_until_closed(&mut self) {
        while self.stream.read(&mut [0]).is_ok_and(|count| count > 0) {}
    }

    /// Sends `bytes` at `bytes_per_s`.
    pub fn paced(&mut self, bytes: &[u8], bytes_per_s: f64) -> bool {
        // Fifty pieces a second of at most 8 KiB.
        let piece = (bytes_per_s / 50.0) as usize;
        let (start, mut sent) = (Instant::now(), 0);
        bytes.chunks(piece.clamp(1, 8 << 10)).all(|piece| {
            sent += piece.len();
            let due = Duration::from_secs_f64(sent as f64 / bytes_per_s);
            thread::sleep(due.saturating_sub(start.elapsed()));
            self.raw(piece)
        })
    }
}

/// Requests and answers of a server.
#[derive(Default)]
struct Log {
    requests: Mutex<Vec<Request>>,
    sent: Mutex<Vec<Range<usize>>>,
    ended: AtomicBool,
}

/// A running server; ends when dropped.
pub struct Server {
    socket: SocketAddr,
    log: Arc<Log>,
    thread: Option<JoinHandle<()>>,
}

/// Wraps a TCP connection.
type Accept = dyn Fn(TcpStream) -> Option<Box<dyn Stream>> + Send + Sync;

impl Server {
    /// Starts a server that answers each request with `answer`, which gets the number of the request.
    pub fn start(answer: impl Fn(usize, &Request, &mut Answer<'_>) + Send + Sync + 'static) -> Server {
        Server::start_with(|stream| Some(Box::new(stream)), answer)
    }

    /// Starts a server that wraps each connection with `accept`.
    ///
    /// # Panics
    /// If the system gives no port.
    pub fn start_with(
        accept: impl Fn(TcpStream) -> Option<Box<dyn Stream>> + Send + Sync + 'static,
        answer: impl Fn(usize, &Request, &mut Answer<'_>) + Send + Sync + 'static,
    ) -> Server {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).expect("the system has a port");
        let socket = listener.local_addr().expect("a bound port");
        let log = Arc::new(Log::default());
        let (ours, accept, answer) = (log.clone(), Arc::new(accept), Arc::new(answer));
        let thread = thread::spawn(move || {
            for stream in listener.incoming() {
                if ours.ended.load(Ordering::Relaxed) {
                    return;
                }
                let Ok(stream) = stream else { continue };
                let (log, accept, answer) = (ours.clone(), accept.clone(), answer.clone());
                thread::spawn(move || serve(stream, &log, &*accept, &*answer));
            }
        });
        Server { socket, log, thread: Some(thread) }
    }

    /// Address that it listens on.
    pub fn socket(&self) -> SocketAddr {
        self.socket
    }

    /// URL of a file.
    pub fn url(&self, path: &str) -> String {
        format!("http://{}/{path}", self.socket)
    }

    /// Requests so far.
    pub fn requests(&self) -> Vec<Request> {
        lock(&self.log.requests).clone()
    }

    /// Ranges of files that were sent so far.
    pub fn sent(&self) -> Vec<Range<usize>> {
        lock(&self.log.sent).clone()
    }

    /// Clears both logs; the next request has number 0.
    pub fn forget(&self) {
        lock(&self.log.requests).clear();
        lock(&self.log.sent).clear();
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.log.ended.store(true, Ordering::Relaxed);
        // Wakes the thread, which waits for a connection.
        let _ = TcpStream::connect(self.socket);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn serve(
    stream: TcpStream,
    log: &Log,
    accept: &Accept,
    answer: &(dyn Fn(usize, &Request, &mut Answer<'_>) + Send + Sync),
) {
    let Some(mut stream) = accept(stream) else { return };
    let Some(request) = read(&mut *stream) else {
        // The client does not speak HTTP.
        let _ = stream.write_all(b"HTTP/1.1 400 Bad Request\r\nConnection: close\r\n\r\n");
        return;
    };
    let number = {
        let mut requests = lock(&log.requests);
        requests.push(request.clone());
        requests.len() - 1
    };
    answer(number, &request, &mut Answer { stream: &mut *stream, sent: &log.sent });
}

/// Reads a request without a body.
fn read(stream: &mut dyn Stream) -> Option<Request> {
    let mut lines = BufReader::new(stream).lines().map_while(Result::ok);
    let first = lines.next()?;
    let mut request = Request { path: first.split(' ').nth(1)?.into(), ..Request::default() };
    for line in lines.take_while(|line| !line.is_empty()) {
        let (name, value) = line.split_once(':')?;
        request.headers.insert(name.to_ascii_lowercase(), value.trim().into());
    }
    Some(request)
}

fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
