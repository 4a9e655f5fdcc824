//! [`Server`]: answers from a [`Script`] instead of HTTP.
//!
//! An honest server follows RFC 9110. It has two versions of a file, switches between them at any time,
//! and may close a connection anywhere. A dishonest server also sends arbitrary answers.

use std::sync::{Mutex, OnceLock};

use codec::{EncodeOptions, Source, encode};

use super::head::Head;
use super::request_error::RequestError;
use super::retry::RetryPolicy;
use super::state::FileRequest;
use super::watch::Watch;
use crate::seeds;

/// Headers, and values of `retry-after`; none is a positive wait, which the downloader would wait.
const HEADERS: [&str; 5] = ["content-length", "content-range", "etag", "content-encoding", "retry-after"];
const WAITS: [&str; 5] = ["0", "-1", "99", "18446744073709551616", "Wed, 21 Oct 2015 07:28:00 GMT"];

/// Statuses that the downloader knows, and others.
const STATUSES: [u16; 12] = [200, 206, 304, 416, 503, 404, 200, 206, 100, 301, 204, 999];

/// Largest number of requests for one clip: as many for each of its parts, and for the whole.
const REQUESTS_MAX: usize = 5 * 101;

/// Script of the next server.
static STAGED: Mutex<Script> = Mutex::new(Script { bytes: Vec::new(), at: 0 });

/// Bytes that are consumed as decisions, then zeros.
#[derive(Clone)]
pub(crate) struct Script {
    bytes: Vec<u8>,
    at: usize,
}

/// Entity tags of a server.
#[derive(Clone, Copy, PartialEq)]
enum Tags {
    Strong,
    Weak,
    None,
}

impl Script {
    /// The script of an input, whose first byte describes the server.
    pub(super) fn parse(bytes: &[u8]) -> Script {
        Script { bytes: bytes.to_vec(), at: 1 }
    }

    /// Makes this the script of the next server.
    pub(super) fn stage(self) {
        *STAGED.lock().expect("no panic while locked") = self;
    }

    fn flags(&self) -> u8 {
        self.bytes.first().copied().unwrap_or(0)
    }

    /// Whether the server follows RFC 9110.
    pub(super) fn is_honest(&self) -> bool {
        self.flags() & 1 == 0
    }

    fn serves_ranges(&self) -> bool {
        self.flags() & 2 == 0
    }

    fn tags(&self) -> Tags {
        match self.flags() >> 2 & 3 {
            0 | 1 => Tags::Strong,
            2 => Tags::Weak,
            _ => Tags::None,
        }
    }

    /// Whether the server names its versions, so that a part of another version is noticed.
    pub(super) fn tells_versions(&self) -> bool {
        self.tags() == Tags::Strong
    }

    /// The version that the downloader already has.
    pub(super) fn known(&self) -> Option<String> {
        (self.flags() & 0x10 != 0).then(|| tag(self.tags(), 0)).flatten()
    }

    fn u8(&mut self) -> u8 {
        let byte = self.bytes.get(self.at).copied().unwrap_or(0);
        self.at += 1;
        byte
    }

    fn u16(&mut self) -> usize {
        usize::from(u16::from_le_bytes([self.u8(), self.u8()]))
    }

    /// Fewer than `limit` printable characters.
    fn text(&mut self, limit: u8) -> String {
        let length = usize::from(self.u8() % limit);
        (0..length).map(|_| char::from(0x20 + self.u8() % 0x5f)).collect()
    }
}

/// The entity tag of a version.
fn tag(tags: Tags, version: usize) -> Option<String> {
    match tags {
        Tags::Strong => Some(format!("\"{version}\"")),
        Tags::Weak => Some(format!("W/\"{version}\"")),
        Tags::None => None,
    }
}

/// The versions of the file, of equal lengths. Their heads differ in one byte, and their sections in all.
pub(crate) fn versions() -> &'static [Vec<u8>; 2] {
    static VERSIONS: OnceLock<[Vec<u8>; 2]> = OnceLock::new();
    VERSIONS.get_or_init(|| {
        let source = Source { info: &seeds::info(), field: &seeds::field(0), plate: None };
        let options = EncodeOptions { layers: vec![2], ..EncodeOptions::default() };
        let first = encode(&source, &options).expect("a valid field");
        let head = codec::contents(&first, &codec::Limits::default()).expect("a package").head_bytes;
        let mut second = first.clone();
        second[head - 1] ^= 1;
        second[head..].iter_mut().for_each(|byte| *byte ^= 0xff);
        [first, second]
    })
}

/// A scripted server.
pub(super) struct Server {
    /// Script and number of requests.
    state: Mutex<(Script, usize)>,
}

impl Server {
    pub(super) fn new(_url: &str, _retry: RetryPolicy, _watch: &Watch) -> Result<Server, RequestError> {
        let script = STAGED.lock().expect("no panic while locked").clone();
        Ok(Server { state: Mutex::new((script, 0)) })
    }

    pub(super) fn get(&self, request: &FileRequest) -> Result<Response, RequestError> {
        let (script, requests) = &mut *self.state.lock().expect("no panic while locked");
        *requests += 1;
        assert!(*requests <= REQUESTS_MAX, "{requests} requests");
        let flags = script.u8();
        let version = usize::from(flags & 1);
        match flags >> 4 {
            0 => return Err(RequestError::Transient("the connection was lost".into())),
            1 if flags & 2 != 0 => {
                return Err(RequestError::UnknownHost("the server's name is not known".into()));
            }
            _ => {}
        }
        let breaks = Breaks {
            after: if flags & 2 != 0 { script.u16() } else { usize::MAX },
            silently: flags & 4 != 0,
        };
        let piece = 1 + usize::from(script.u8()) * 16;
        let (status, headers, body) = if script.is_honest() {
            honest(script, request, version, flags & 8 != 0)
        } else {
            dishonest(script, version)
        };
        let header =
            |name: &str| headers.iter().find(|(other, _)| *other == name).map(|(_, text)| text.as_str());
        let sent = body.len().min(breaks.after);
        // With an announced length, an early end is a broken connection.
        let ends = sent == body.len() || breaks.silently && header("content-length").is_none();
        let head = Head::parse(status, |name| header(name).into_iter().collect());
        let body = ResponseBody { body: body[..sent].to_vec(), at: 0, piece, ends };
        Ok(Response { head, body, url: String::new() })
    }

    pub(super) fn read(&self, body: &mut ResponseBody, buffer: &mut [u8]) -> Result<usize, RequestError> {
        body.read(buffer)
    }
}

/// An answer.
pub(super) struct Response {
    pub(super) head: Head,
    pub(super) body: ResponseBody,
    pub(super) url: String,
}

/// Where a connection breaks, and whether that looks like its end.
struct Breaks {
    after: usize,
    silently: bool,
}

/// Status, headers and body.
type ScriptedAnswer = (u16, Vec<(&'static str, String)>, Vec<u8>);

/// An answer that follows RFC 9110.
fn honest(script: &Script, request: &FileRequest, version: usize, sends_length: bool) -> ScriptedAnswer {
    let file = &versions()[version];
    let tag = tag(script.tags(), version);
    let mut headers: Vec<(&'static str, String)> = tag.iter().map(|tag| ("etag", tag.clone())).collect();
    if request.if_none_match.is_some() && request.if_none_match == tag {
        return (304, headers, Vec::new());
    }
    let first = usize::try_from(request.offset).unwrap_or(usize::MAX);
    // Weak tags never match for ranges.
    let same = script.tags() == Tags::Strong && request.if_range == tag;
    if request.range().is_none() || !script.serves_ranges() || request.if_range.is_some() && !same {
        if sends_length {
            headers.push(("content-length", file.len().to_string()));
        }
        return (200, headers, file.clone());
    }
    if first >= file.len() {
        return (416, vec![("content-range", format!("bytes */{}", file.len()))], Vec::new());
    }
    let end =
        request.end.map_or(file.len(), |end| file.len().min(usize::try_from(end).unwrap_or(usize::MAX)));
    headers.push(("content-range", format!("bytes {first}-{}/{}", end - 1, file.len())));
    headers.push(("content-length", (end - first).to_string()));
    (206, headers, file[first..end].to_vec())
}

/// An arbitrary answer.
fn dishonest(script: &mut Script, version: usize) -> ScriptedAnswer {
    let status = STATUSES[usize::from(script.u8()) % STATUSES.len()];
    let present = script.u8();
    let mut headers = Vec::new();
    for (i, name) in HEADERS.into_iter().enumerate() {
        if present >> i & 1 == 0 {
            continue;
        }
        let text = match (name, script.u8() % 4) {
            ("retry-after", _) => WAITS[usize::from(script.u8()) % WAITS.len()].into(),
            ("content-length", 0) => script.u16().to_string(),
            ("content-range", 0 | 1) => {
                format!("bytes {}-{}/{}", script.u16(), script.u16(), script.u16())
            }
            ("etag", 0) => tag(script.tags(), version).unwrap_or_default(),
            _ => script.text(24),
        };
        headers.push((name, text));
    }
    let mut body = versions()[version].clone();
    body.drain(..script.u16().min(body.len()));
    // Arbitrary bytes, and more than were requested.
    let length = usize::from(script.u8());
    let arbitrary: Vec<u8> = (0..length).map(|_| script.u8()).collect();
    let more = usize::from(script.u8()) * 64;
    body.extend(arbitrary);
    body.extend(std::iter::repeat_n(0x41, more));
    (status, headers, body)
}

/// The bytes of an answer.
#[derive(Debug)]
pub(super) struct ResponseBody {
    body: Vec<u8>,
    at: usize,
    /// Largest number of bytes per read.
    piece: usize,
    /// Whether the connection then ends, rather than breaks.
    ends: bool,
}

impl ResponseBody {
    fn read(&mut self, buffer: &mut [u8]) -> Result<usize, RequestError> {
        let count = (self.body.len() - self.at).min(self.piece).min(buffer.len());
        if count == 0 && !self.ends {
            return Err(RequestError::Transient("the connection was lost".into()));
        }
        buffer[..count].copy_from_slice(&self.body[self.at..self.at + count]);
        self.at += count;
        Ok(count)
    }
}
