//! [`Download`]: fetches a clip, decodes its layers as they arrive, each once, and caches it.

use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use codec::{Contents, Error, Limits, contents};
use program::Fault;

use super::cache::{Cache, CachedFile};
use super::fetch::{Fetch, FetchOptions, Outcome, State, undecodable};
use super::partial_file::PartialFile;
use super::remote_file::RemoteFile;
use super::retry::RetryPolicy;
use crate::clips::{ClipVersion, LoadEvent, Progress, decode, decode_layers, redacted};
use crate::takes::{OpenTake, TakeSource};

/// Time between two reports of progress: short, and still long enough to read the numbers.
pub(super) const REPORT_INTERVAL: Duration = Duration::from_millis(250);

/// Options of a download.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// The cache, if downloads are cached.
    pub cache: Option<Cache>,
    /// Timeouts and retries.
    pub retry: RetryPolicy,
    /// Limits on the clip.
    pub limits: Limits,
}

impl Options {
    /// Caches a file, if there is a cache. Logs failure: the file plays without.
    pub(super) fn store(&self, url: &str, file: &CachedFile) {
        if let Some(cache) = &self.cache
            && let Err(error) = cache.put(url, file)
        {
            log::warn!("{}: cannot be cached: {error}", redacted(url));
        }
    }
}

/// Says that a cached version plays because the server was not reached.
pub(super) fn cached_version_note(url: &str, fault: &Fault) -> String {
    format!("{}: {fault}; the version cached on this device plays", redacted(url))
}

/// What a download does next: report an event and pause, or go on.
type Flow = ControlFlow<Result<LoadEvent, Fault>>;

fn report(version: Option<ClipVersion>) -> Flow {
    version.map_or(ControlFlow::Continue(()), |version| ControlFlow::Break(Ok(LoadEvent::Clip(version))))
}

/// The layers of a package that were decoded so far. Those that arrive are appended.
#[derive(Debug)]
struct Arrived {
    head: Contents,
    /// The display shares the clip while it draws. Layers that are appended meanwhile make a copy.
    version: ClipVersion,
}

/// A take that is being opened by a thread of its own, which may wait long for its server. Dropping it ends the read, and
/// leaves the thread behind.
#[derive(Debug)]
struct OpeningTake {
    file: Arc<RemoteFile>,
    is_open: bool,
    result: Receiver<Result<Option<OpenTake>, Fault>>,
}

impl OpeningTake {
    /// Begins to open the file at `url`.
    ///
    /// # Errors
    /// [`Fault::Network`] if the certificates to trust cannot be read; [`Fault::Device`] if the system refuses a thread.
    fn begin(url: &str, options: &Options) -> Result<OpeningTake, Fault> {
        let Options { cache, retry, limits } = options.clone();
        let file = Arc::new(RemoteFile::new(url, retry, cache)?);
        let (sender, result) = channel();
        let source = TakeSource::Remote(file.clone());
        let thread = std::thread::Builder::new().name("open".into()).spawn(move || {
            // Nobody listens where it is not wanted any more.
            let _ = sender.send(OpenTake::from_source(source, &limits));
        });
        thread.map_err(|error| Fault::Device(format!("cannot start a thread: {error}")))?;
        Ok(OpeningTake { file, is_open: false, result })
    }
}

impl Drop for OpeningTake {
    fn drop(&mut self) {
        if !self.is_open {
            self.file.close();
        }
    }
}

/// A clip being downloaded. Iterating waits for the next event, 250 ms at most. It ends after the
/// complete clip or the first error. Dropping it cancels the download.
#[derive(Debug)]
pub struct Download {
    url: String,
    options: Options,
    stage: Stage,
    /// Whether a cached version was reported.
    has_cached: bool,
    /// What was decoded of the file that is being fetched.
    arrived: Option<Arrived>,
    /// Bytes from which the latest clip was decoded, and seconds that decoding a byte of its last layers took.
    decoded_bytes: usize,
    decoding_s_per_byte: f64,
    /// The reason of a retry reported last.
    trouble: Option<String>,
}

/// The stage of a download.
#[derive(Debug)]
enum Stage {
    Begin,
    Fetching(Fetch),
    /// The file is a take.
    Opening(OpeningTake),
    /// A remark on the take was reported; the take is next.
    Opened(Arc<OpenTake>),
    /// The last clip is incomplete; this fault is reported next.
    Failed(Fault),
    /// The complete clip was reported; its package goes to the cache.
    Store {
        etag: String,
        package: Vec<u8>,
    },
    End,
}

impl Download {
    /// A download of the clip at `url`, which starts with the first call of `next`.
    pub fn new(url: &str, options: Options) -> Download {
        Download {
            url: url.into(),
            options,
            stage: Stage::Begin,
            has_cached: false,
            arrived: None,
            decoded_bytes: 0,
            decoding_s_per_byte: 0.0,
            trouble: None,
        }
    }

    /// Starts to fetch, and reports the cached version if there is one.
    fn begin(&mut self) -> Flow {
        let (etag, clip) = self.cached_clip().unzip();
        self.has_cached = clip.is_some();
        let retry = if self.has_cached { self.options.retry.for_revalidation() } else { self.options.retry };
        let etag = etag.filter(|etag| !etag.is_empty());
        let limits = self.options.limits;
        let options =
            FetchOptions { url: self.url.clone(), retry, max_bytes: limits.max_bytes, cached: etag };
        match Fetch::start(options, PartialFile::package(limits)) {
            Ok(fetch) => self.stage = Stage::Fetching(fetch),
            Err(fault) => return self.fail(fault),
        }
        report(clip)
    }

    /// The cached version and its clip. Removes an entry that does not decode.
    fn cached_clip(&self) -> Option<(String, ClipVersion)> {
        let cache = self.options.cache.as_ref()?;
        let file = cache.get(&self.url)?;
        match decode(&file.bytes, &self.options.limits) {
            Ok(clip) => {
                let version = ClipVersion::new(clip, &file.bytes, &self.options.limits);
                Some((file.etag, version))
            }
            Err(error) => {
                log::warn!("{}: the cached clip does not play: {error}", redacted(&self.url));
                cache.remove(&self.url);
                None
            }
        }
    }

    /// Waits for the next event of a fetch.
    fn wait(&mut self, fetch: Fetch) -> Flow {
        let mut state = fetch.wait(REPORT_INTERVAL, |state| self.has_event(state));
        let playable_bytes = state.file.playable_bytes();
        if let Some(outcome) = state.outcome.take() {
            let bytes = state.file.take();
            drop(state);
            return self.on_outcome(outcome, bytes, playable_bytes);
        }
        if self.should_decode(&state) {
            let bytes = state.file.bytes()[..playable_bytes].to_vec();
            drop(state);
            return match self.decode(&bytes) {
                Ok(version) => {
                    self.stage = Stage::Fetching(fetch);
                    report(version)
                }
                Err(fault) => self.fail(fault),
            };
        }
        let progress = state.progress.clone();
        drop(state);
        self.trouble.clone_from(&progress.trouble);
        self.stage = Stage::Fetching(fetch);
        ControlFlow::Break(Ok(LoadEvent::Progress(progress)))
    }

    /// Whether there is an event to report at once: the end, layers to decode, or another trouble.
    fn has_event(&self, state: &State) -> bool {
        state.outcome.is_some() || self.should_decode(state) || state.progress.trouble != self.trouble
    }

    /// Whether to decode the layers received: if the latest clip has fewer, and decoding ends before the
    /// rest arrives, which it would delay. The first layer is always decoded; none if a cached version
    /// plays, which is better than an incomplete one.
    fn should_decode(&self, state: &State) -> bool {
        let playable_bytes = state.file.playable_bytes();
        if self.has_cached || playable_bytes <= self.decoded_bytes {
            return false;
        }
        let decoding_s = self.decoding_s_per_byte * (playable_bytes - self.decoded_bytes) as f64;
        self.decoded_bytes == 0 || state.progress.remaining_s().is_some_and(|left_s| left_s > decoding_s)
    }

    /// Handles the end of the fetch. The first `playable_bytes` bytes of `package` play.
    fn on_outcome(&mut self, outcome: Outcome, package: Vec<u8>, playable_bytes: usize) -> Flow {
        match outcome {
            Outcome::Unchanged => ControlFlow::Continue(()),
            Outcome::Take => match OpeningTake::begin(&self.url, &self.options) {
                Ok(opening) => {
                    self.stage = Stage::Opening(opening);
                    ControlFlow::Continue(())
                }
                Err(fault) => self.fail(fault),
            },
            Outcome::Complete { etag } => match self.decode(&package) {
                Ok(version) => {
                    self.stage = Stage::Store { etag: etag.unwrap_or_default(), package };
                    report(version)
                }
                Err(fault) => self.fail(fault),
            },
            Outcome::Failed { fault, is_transient: true } if self.has_cached => {
                ControlFlow::Break(Ok(LoadEvent::Note(cached_version_note(&self.url, &fault))))
            }
            // The last layers may arrive together with the failure.
            Outcome::Failed { fault, .. } if playable_bytes > self.decoded_bytes && !self.has_cached => {
                match self.decode(&package[..playable_bytes]) {
                    Ok(version) => {
                        self.stage = Stage::Failed(fault);
                        report(version)
                    }
                    Err(fault) => self.fail(fault),
                }
            }
            Outcome::Failed { fault, .. } => self.fail(fault),
        }
    }

    /// Waits until the take is open.
    fn open_take(&mut self, mut opening: OpeningTake) -> Flow {
        let take = match opening.result.recv_timeout(REPORT_INTERVAL) {
            Ok(take) => {
                opening.is_open = true;
                take
            }
            Err(RecvTimeoutError::Timeout) => {
                let received = opening.file.traffic().bytes;
                self.stage = Stage::Opening(opening);
                let progress = Progress { received, ..Progress::default() };
                return ControlFlow::Break(Ok(LoadEvent::Progress(progress)));
            }
            Err(RecvTimeoutError::Disconnected) => {
                return self
                    .fail(Fault::Defect("it cannot be opened: report it with the player's log".into()));
            }
        };
        match take {
            Ok(Some(take)) => {
                let (note, take) = (take.truncation(), Arc::new(take));
                ControlFlow::Break(Ok(match note {
                    Some(note) => {
                        self.stage = Stage::Opened(take);
                        LoadEvent::Note(note)
                    }
                    None => LoadEvent::Take(take),
                }))
            }
            Ok(None) => self.fail(Fault::Network("the file changed on the server: open it again".into())),
            // It names the URL.
            Err(fault) => ControlFlow::Break(Err(fault)),
        }
    }

    /// Decodes the new layers that are complete in `bytes`, the part of the file that has arrived; `None` if there are
    /// none. A file that was sent again as another version is decoded from its start.
    fn decode(&mut self, bytes: &[u8]) -> Result<Option<ClipVersion>, Fault> {
        let start = Instant::now();
        let (version, new_bytes) = self.decode_arrived(bytes).map_err(|error| undecodable(&error))?;
        self.decoding_s_per_byte = start.elapsed().as_secs_f64() / new_bytes.max(1) as f64;
        self.decoded_bytes = bytes.len();
        Ok(version)
    }

    /// The clip of `bytes`, if there are new layers, and the number of their bytes.
    fn decode_arrived(&mut self, bytes: &[u8]) -> Result<(Option<ClipVersion>, usize), Error> {
        let limits = &self.options.limits;
        let head = contents(bytes, limits)?;
        let Some(arrived) = self.arrived.as_mut().filter(|arrived| arrived.head == head) else {
            // What else there is comes before the first layer.
            let version = ClipVersion::new(decode(bytes, limits)?, bytes, limits);
            self.arrived = Some(Arrived { head, version: version.clone() });
            return Ok((Some(version), bytes.len()));
        };
        let (first, ends) = (arrived.version.clip.layers.len(), head.layer_bytes());
        if first == ends.len() {
            return Ok((None, 0));
        }
        let layers = decode_layers(&head, bytes, first, limits)?;
        Arc::make_mut(&mut arrived.version.clip).append(layers);
        arrived.version.is_continued = true;
        Ok((Some(arrived.version.clone()), bytes.len() - ends[first - 1]))
    }

    fn fail(&self, fault: Fault) -> Flow {
        ControlFlow::Break(Err(fault.about(&redacted(&self.url))))
    }
}

impl Iterator for Download {
    type Item = Result<LoadEvent, Fault>;

    fn next(&mut self) -> Option<Result<LoadEvent, Fault>> {
        loop {
            let flow = match std::mem::replace(&mut self.stage, Stage::End) {
                Stage::Begin => self.begin(),
                Stage::Fetching(fetch) => self.wait(fetch),
                Stage::Opening(opening) => self.open_take(opening),
                Stage::Opened(take) => ControlFlow::Break(Ok(LoadEvent::Take(take))),
                Stage::Failed(fault) => self.fail(fault),
                Stage::Store { etag, package } => {
                    let file = CachedFile { etag, base: redacted(&self.url), bytes: package };
                    self.options.store(&self.url, &file);
                    return None;
                }
                Stage::End => return None,
            };
            if let ControlFlow::Break(event) = flow {
                return Some(event);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use codec::{Clip, contents};
    use glam::DVec3;

    use super::*;
    use crate::clips::Progress;
    use crate::test_fields::{ball, field, package, y_up};

    const DEMO: &[u8] = include_bytes!("../../../assets/demo.aarc");

    fn download() -> Download {
        Download::new("http://host/a.aarc", Options::default())
    }

    /// Offsets of the ends of the first two layers.
    fn layer_ends() -> [usize; 2] {
        let ends = contents(DEMO, &Limits::default()).unwrap().layer_bytes();
        [ends[0], ends[1]]
    }

    /// The state of a fetch that has received `bytes` bytes; the rest takes `left_s` seconds.
    fn received(bytes: usize, left_s: f64) -> State {
        let mut file = PartialFile::package(Limits::default());
        file.push(&DEMO[..bytes]).unwrap();
        let mut state = State::new(file);
        let (received, rate) = (bytes as u64, 1e6);
        let total = Some(received + (left_s * rate) as u64);
        state.progress = Progress { received, total, bytes_per_s: Some(rate), trouble: None };
        state
    }

    #[test]
    fn layers_are_decoded_if_that_ends_before_the_rest_arrives() {
        let [first, second] = layer_ends();
        let mut download = download();
        assert!(!download.should_decode(&received(first - 1, 60.0)), "no layer is complete");
        assert!(download.should_decode(&received(first, 0.0)), "the first layer");
        (download.decoded_bytes, download.decoding_s_per_byte) = (first, 1.0 / first as f64);
        assert!(!download.should_decode(&received(second - 1, 60.0)), "no further layer");
        // Decoding time is proportional to the bytes of the new layers.
        let decoding_s = (second - first) as f64 / first as f64;
        for (left_s, is_decoded) in [(0.9 * decoding_s, false), (1.1 * decoding_s, true)] {
            assert_eq!(download.should_decode(&received(second, left_s)), is_decoded, "{left_s} s");
        }
        download.has_cached = true;
        assert!(!download.should_decode(&received(second, 60.0)), "the cached version plays");
    }

    #[test]
    fn the_end_and_layers_and_trouble_are_reported_at_once() {
        let [first, second] = layer_ends();
        let mut download = download();
        download.decoded_bytes = first;
        assert!(!download.has_event(&received(first, 60.0)));
        assert!(download.has_event(&received(second, 60.0)));
        let mut troubled = received(first, 60.0);
        troubled.progress.trouble = Some("the connection was lost".into());
        assert!(download.has_event(&troubled));
        download.trouble.clone_from(&troubled.progress.trouble);
        assert!(!download.has_event(&troubled), "it was reported");
        troubled.outcome = Some(Outcome::Unchanged);
        assert!(download.has_event(&troubled));
    }

    /// A small package of two layers.
    fn other() -> Vec<u8> {
        let field = codec::Field {
            centers: vec![[0.0; 3]; 2],
            rotations: vec![[1.0, 0.0, 0.0, 0.0]; 2],
            log_scales: vec![[-2.0; 3]; 2],
            opacities: vec![0.9; 2],
            sh: vec![[0.3; 3]; 2],
            ..codec::Field::default()
        };
        let source = codec::Source { info: &codec::ClipInfo::default(), field: &field, plate: None };
        codec::encode(&source, &codec::EncodeOptions { layers: vec![1], ..Default::default() }).unwrap()
    }

    #[test]
    fn layers_continue_the_clip_of_the_same_file_and_of_no_other() {
        let mut download = download();
        let mut held: Vec<(Arc<Clip>, Clip)> = Vec::new();
        for end in contents(DEMO, &Limits::default()).unwrap().layer_bytes() {
            let version = download.decode(&DEMO[..end]).unwrap().unwrap();
            assert_eq!(version.is_continued, !held.is_empty());
            let expected = decode(&DEMO[..end], &Limits::default()).unwrap();
            assert!(*version.clip == expected, "{end} bytes");
            assert_eq!(download.decoded_bytes, end);
            held.push((version.clip, expected));
        }
        assert!(download.decode(DEMO).unwrap().is_none(), "nothing is new");
        assert!(held.iter().all(|(clip, expected)| **clip == *expected), "what is drawn does not change");
        // The file was sent again, as another version.
        let other = other();
        for (end, is_continued) in
            contents(&other, &Limits::default()).unwrap().layer_bytes().into_iter().zip([false, true])
        {
            let version = download.decode(&other[..end]).unwrap().unwrap();
            assert_eq!(version.is_continued, is_continued);
            let expected = decode(&other[..end], &Limits::default()).unwrap();
            assert!(version.clip.static_field == expected.static_field);
        }
    }

    #[test]
    fn the_opening_view_is_that_of_the_first_layers_and_stays() {
        // The second layer has another ball beside the first.
        let aside = ball().into_iter().map(|(center, scale)| (center + 1.5 * DVec3::X, scale));
        let rows: Vec<_> = ball().into_iter().zip(aside).flat_map(|(row, aside)| [row, aside]).collect();
        let package = package(&y_up(), &field(&rows));
        let mut download = download();
        let ends = contents(&package, &Limits::default()).unwrap().layer_bytes();
        let versions: Vec<ClipVersion> =
            ends.iter().map(|&end| download.decode(&package[..end]).unwrap().unwrap()).collect();
        let [first, whole] = &versions[..] else { panic!("there are two layers") };
        let target = |version: &ClipVersion| version.clip.info.viewpoints[0].target[0];
        assert!(target(first).abs() < 0.2 && first.subject().radius_m < 1.2, "{:?}", first.clip.info);
        assert_eq!((first.clip.len(), whole.clip.len()), (rows.len() / 2, rows.len()));
        assert_eq!((&first.clip.info, first.subject()), (&whole.clip.info, whole.subject()));
        let at_once = self::download().decode(&package).unwrap().unwrap();
        assert!((target(&at_once) - 0.75).abs() < 0.2 && at_once.subject().radius_m > 1.4);
    }

    #[test]
    fn damage_to_a_later_layer_ends_the_download_and_not_the_clip() {
        let [first, second] = layer_ends();
        let mut download = download();
        let start = download.decode(&DEMO[..first]).unwrap().unwrap().clip;
        let mut damaged = DEMO[..second].to_vec();
        damaged[second - 1] ^= 1;
        assert!(matches!(download.decode(&damaged), Err(Fault::Data(_))));
        assert!(*start == decode(&DEMO[..first], &Limits::default()).unwrap());
    }

    #[test]
    fn layers_that_arrive_with_a_failure_play_before_it_is_reported() {
        let [first, _] = layer_ends();
        let mut download = download();
        let failed = Outcome::Failed { fault: Fault::Network("gone".into()), is_transient: true };
        let flow = download.on_outcome(failed, DEMO[..first].to_vec(), first);
        let Flow::Break(Ok(LoadEvent::Clip(clip))) = flow else { panic!("{flow:?}") };
        assert_eq!((clip.clip.layers.len(), clip.is_continued), (1, false));
        assert!(matches!(download.next(), Some(Err(Fault::Network(why))) if why.contains("gone")));
        assert!(download.next().is_none());
    }
}
