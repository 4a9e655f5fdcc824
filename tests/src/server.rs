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

    /// The part of a file of `length` bytes that a header `Range: bytes=FIRST-` or `bytes=FIRST-LAST` names.
    pub fn part(&self, length: usize) -> Option<Range<usize>> {
        let (first, last) = self.header("range")?.strip_prefix("bytes=")?.split_once('-')?;
        let first = first.parse().ok().filter(|&first| first < length)?;
        Some(first..last.parse().map_or(length, |last: usize| last.saturating_add(1).min(length)))
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

    /// Sends the requested part of `file`, or all of it if none is requested, or one of another version than `etag`, which
    /// includes its quotes.
    pub fn file(&mut self, request: &Request, file: &[u8], etag: &str) {
        self.cut(request, file, etag, file.len());
    }

    /// As [`Answer::file`], cut off at `end`.
    pub fn cut(&mut self, request: &Request, file: &[u8], etag: &str, end: usize) {
        let part = self.file_head(request, file, etag);
        self.bytes(file, part.start..part.end.min(end).max(part.start));
    }

    /// As [`Answer::file`], at `bytes_per_s`.
    pub fn paced_part(&mut self, request: &Request, file: &[u8], etag: &str, bytes_per_s: f64) {
        let part = self.file_head(request, file, etag);
        lock(self.sent).push(part.clone());
        self.paced(&file[part], bytes_per_s);
    }

    /// Sends the headers of [`Answer::file`], and returns which bytes follow.
    pub fn file_head(&mut self, request: &Request, file: &[u8], etag: &str) -> Range<usize> {
        let same = request.header("if-range").is_none_or(|version| version == etag);
        let asked = request.part(file.len()).filter(|_| same);
        let part = asked.clone().unwrap_or(0..file.len());
        let length = part.len().to_string();
        let mut headers = vec![("Content-Length", length.as_str()), ("ETag", etag)];
        let range = format!("bytes {}-{}/{}", part.start, part.end.saturating_sub(1), file.len());
        headers.extend(asked.is_some().then_some(("Content-Range", range.as_str())));
        self.head(if asked.is_some() { 206 } else { 200 }, &headers);
        part
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
