//! Playback that goes on and on: what a person can do, at random and as fast as the device draws,
//! and the memory that remains each time a clip was put away.
//!
//! A round takes a clip in from memory or from a server, uploads it, draws it for one eye or two into
//! images whose size changes, through seeks, steps, speeds, pauses and all settings, counts and reads
//! back now and then, and puts everything away. One clip is never put away, so that a renderer lives as
//! long as the device. At first the device is lost a few times and another one opened.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::num::NonZero;
use std::sync::Arc;
use std::time::{Duration, Instant};

use client::clock::{Clock, SPEED_RANGE};
use client::content::transfer::{CACHE_BYTES, Cache, Options, RetryPolicy};
use client::content::{Download, OpenEvent};
use client::gpu::{
    ChannelDepth, Cutoff, FrameLayout, Gpu, GpuClip, Offscreen, RenderSettings, Renderer, SortOrder,
};
use client::view::View;
use codec::{Clip, Limits, decode_parallel};
use fastrand::Rng;
use glam::UVec2;
use program::Fault;

use crate::scene::{Motion, Place, Recipe, camera, packaged};
use crate::server::Server;

/// Frames of a round.
const FRAMES: u32 = 40;

/// Rounds from loss to loss of the device, and how often it is lost: drivers keep some memory of each,
/// which is not the player's and would hide what is.
const LOSS_EVERY: u64 = 4;
const LOSSES_MAX: u64 = 3;

/// Seconds of the viewer between two frames.
const FRAME_S: f64 = 1.0 / 30.0;

/// Fewest rounds that tell whether memory is flat.
const ROUNDS_MIN: usize = 12;

/// What memory that others hand out in pools may grow by, relative and in bytes.
const GROWTH: f64 = 0.02;
const GROWTH_BYTES: u64 = 8 << 20;

/// Growth of the heap that is allowed, in bytes. Every byte of the heap is counted.
const HEAP_GROWTH_BYTES: u64 = 64 << 10;

/// The memory in use after a round.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sample {
    /// Since the beginning.
    pub seconds: f64,
    /// Bytes of the process in memory, 0 if the system does not count them.
    pub resident_bytes: u64,
    /// Allocated by the program itself, but for these samples.
    pub heap_bytes: u64,
    /// Bytes on the graphics device, if it counts them.
    pub gpu_bytes: u64,
}

/// What was done.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Account {
    /// Clips put on.
    pub rounds: u64,
    /// Of them, from a server.
    pub downloads: u64,
    /// Frames drawn.
    pub frames: u64,
    /// Seconds of the viewer that they stand for.
    pub played_s: f64,
    /// Seeks, steps and pauses.
    pub seeks: u64,
    /// Images of another size.
    pub resizes: u64,
    /// Devices lost.
    pub losses: u64,
    /// After each round.
    pub samples: Vec<Sample>,
    /// How many of them are of the time in which pools and tables find their size: until all was done
    /// once, and the device lost for the last time.
    pub warm_up: usize,
}

impl Account {
    /// Whether memory is flat: what is least for a while is what is held on to.
    ///
    /// # Errors
    /// What has grown, and by how much; or that there were too few rounds to tell.
    pub fn check(&self) -> Result<(), String> {
        let warm = self.warm();
        if !self.is_enough() {
            return Err(format!("{} rounds after warming up: {ROUNDS_MIN} are needed", warm.len()));
        }
        let (first, second) = warm.split_at(warm.len() / 2);
        let pooled = |before: u64| (before as f64 * GROWTH) as u64 + GROWTH_BYTES;
        let kinds: [Kind<'_>; 3] = [
            ("the process", |sample| sample.resident_bytes, &pooled),
            ("the heap", |sample| sample.heap_bytes, &|_| HEAP_GROWTH_BYTES),
            ("the graphics device", |sample| sample.gpu_bytes, &pooled),
        ];
        for (what, measure, growth) in kinds {
            let least = |samples: &[Sample]| samples.iter().map(measure).min().unwrap_or(0);
            let (before, after) = (least(first), least(second));
            if after > before + growth(before) {
                return Err(format!("memory of {what} grew from {before} to {after} bytes"));
            }
        }
        Ok(())
    }

    /// The samples after warming up, and after a quarter of them all.
    fn warm(&self) -> &[Sample] {
        &self.samples[self.warm_up.max(self.samples.len() / 4)..]
    }

    /// Whether there are enough rounds to tell.
    fn is_enough(&self) -> bool {
        self.warm_up > 0 && self.warm().len() >= ROUNDS_MIN
    }
}

/// Memory of one kind: whose, how much of it a sample has, and what it may grow by from how much.
type Kind<'a> = (&'a str, fn(&Sample) -> u64, &'a dyn Fn(u64) -> u64);

/// Plays for `duration`; at least until all was done once, and for as many rounds more as
/// [`Account::check`] needs. `heap_bytes` tells what the program has allocated; `on_sample` is called
/// after each round.
///
/// # Errors
/// What the player reports, or what it left behind.
pub fn soak(
    duration: Duration,
    heap_bytes: impl Fn() -> u64,
    mut on_sample: impl FnMut(&Account),
) -> Result<Account, String> {
    let text = |fault: Fault| fault.to_string();
    let start = Instant::now();
    let mut account = Account::default();
    let mut rng = Rng::with_seed(1);
    let shelf = Shelf::new();
    let mut gpu = Gpu::new_headless().map_err(text)?;
    let (mut lasting, mut at_rest) = lasting(&gpu, &shelf, &mut rng, &mut account)?;
    let mut kinds = BTreeSet::new();
    while start.elapsed() < duration || !account.is_enough() {
        if account.losses < LOSSES_MAX && account.rounds % LOSS_EVERY == LOSS_EVERY - 1 {
            lose(&gpu, &shelf.clip(0)?)?;
            account.losses += 1;
            gpu = Gpu::new_headless().map_err(text)?;
            (lasting, at_rest) = self::lasting(&gpu, &shelf, &mut rng, &mut account)?;
        }
        let clip = match rng.u8(..4) {
            0 => {
                account.downloads += 1;
                shelf.download(rng.usize(..shelf.packages.len()))?
            }
            _ => {
                let kind = account.rounds as usize % shelf.packages.len();
                kinds.insert(kind);
                shelf.clip(kind)?
            }
        };
        let mut watched = Watched::new(&gpu, &clip, &mut rng, false).map_err(text)?;
        watched.play(&gpu, &mut rng, &mut account).map_err(text)?;
        drop((watched, clip));
        lasting.play(&gpu, &mut rng, &mut account).map_err(text)?;
        gpu.wait().map_err(text)?;
        let held = objects(&gpu)?;
        if held != at_rest {
            return Err(format!("after {} rounds {held:?} are held, {at_rest:?} at first", account.rounds));
        }
        account.rounds += 1;
        account.samples.push(Sample {
            seconds: start.elapsed().as_secs_f64(),
            resident_bytes: resident_bytes(),
            heap_bytes: heap_bytes() - (account.samples.capacity() * size_of::<Sample>()) as u64,
            gpu_bytes: gpu.allocated_bytes().unwrap_or(0),
        });
        let is_warm =
            kinds.len() == shelf.packages.len() && account.downloads > 0 && account.losses == LOSSES_MAX;
        if account.warm_up == 0 && is_warm {
            account.warm_up = account.samples.len();
        }
        on_sample(&account);
    }
    Ok(account)
}

/// A clip that stays on the device, and the graphics objects that it takes after a round.
fn lasting(
    gpu: &Gpu,
    shelf: &Shelf,
    rng: &mut Rng,
    account: &mut Account,
) -> Result<(Watched, BTreeMap<&'static str, usize>), String> {
    let text = |fault: Fault| fault.to_string();
    let mut lasting = Watched::new(gpu, &shelf.clip(0)?, rng, true).map_err(text)?;
    lasting.play(gpu, rng, account).map_err(text)?;
    compile(gpu, shelf).map_err(text)?;
    let at_rest = objects(gpu)?;
    Ok((lasting, at_rest))
}

/// Draws and counts a frame of every clip in every way, so that the device has all pipelines: it keeps them.
fn compile(gpu: &Gpu, shelf: &Shelf) -> Result<(), Fault> {
    let size = UVec2::splat(32);
    let views = camera(Place::Far, size.x, size.y).stereo_pair(0.065).map(|eye| View::from_camera(&eye));
    for which in 0..shelf.packages.len() {
        let clip = GpuClip::upload(gpu, &shelf.clip(which).map_err(Fault::Data)?)?;
        for depth in [ChannelDepth::Eight, ChannelDepth::Sixteen] {
            for eyes in [1, 2] {
                let layout = FrameLayout { format: depth.format(), eyes, foveated: false };
                let mut renderer = Renderer::new(gpu, clip.clone(), layout)?;
                let image = Offscreen::new(gpu, size, eyes as u32, depth)?;
                image.render(gpu, &mut renderer, 0.5, &views[..eyes], &RenderSettings::default())?;
                renderer.count(gpu)?;
            }
        }
    }
    gpu.wait()
}

/// Clips of every kind, and a server that has them.
struct Shelf {
    packages: Vec<Arc<[u8]>>,
    server: Server,
    cache: tempfile::TempDir,
}

impl Shelf {
    fn new() -> Shelf {
        let recipe = |count, sh_degree, motion, turning| {
            Recipe { count, sh_degree, motion, motion_order: 3, turning, seed: count as u64 }.field()
        };
        let static_field = recipe(900, 2, Motion::Static, false);
        let packages: Vec<Arc<[u8]>> = vec![
            packaged(&recipe(3000, 0, Motion::Mixed, true), None, &[500, 1000]).into(),
            packaged(&recipe(1200, 3, Motion::Dynamic, true), Some(&static_field), &[]).into(),
            packaged(&static_field, None, &[300]).into(),
            packaged(&recipe(1, 1, Motion::Dynamic, false), None, &[]).into(),
        ];
        let served = packages.clone();
        let server = Server::start(move |number, request, answer| {
            let which = request.path.trim_matches(|c: char| !c.is_ascii_digit()).parse().unwrap_or(0);
            let file: &Arc<[u8]> = &served[which];
            // Every other time, the connection breaks on the way.
            let end = if number % 2 == 0 { file.len() / 2 } else { file.len() };
            answer.cut(request, file, &format!("\"{which}\""), end);
        });
        Shelf { packages, server, cache: tempfile::tempdir().expect("temporary files can be made") }
    }

    fn clip(&self, which: usize) -> Result<Clip, String> {
        decode_parallel(&self.packages[which], &Limits::default(), NonZero::<usize>::MIN.saturating_add(1))
            .map_err(|error| error.to_string())
    }

    /// The clip with this number by way of the server, kept in between on disk half of the time.
    fn download(&self, which: usize) -> Result<Clip, String> {
        let cache = which.is_multiple_of(2).then(|| Cache::new(self.cache.path(), CACHE_BYTES));
        let retry = RetryPolicy { first_wait: Duration::from_millis(1), ..RetryPolicy::default() };
        let mut latest = None;
        let url = self.server.url(&format!("{which}"));
        for event in Download::new(&url, Options { cache, retry, ..Options::default() }) {
            if let OpenEvent::Take(take) = event.map_err(|fault| fault.to_string())? {
                latest = Some(take);
            }
        }
        self.server.forget();
        let take = latest.ok_or("a download without a clip")?;
        take.segment(0, take.layers()[0]).map_err(|fault| fault.to_string())
    }
}

/// The largest inset of a frame, as a fraction of the image's sides.
const INSET_MAX: f32 = 0.5;

/// A clip on a device, and how it is watched.
struct Watched {
    renderer: Renderer,
    clock: Clock,
    eyes: usize,
    depth: ChannelDepth,
    size: UVec2,
    image: Offscreen,
    /// Whether frames may be foveated, with images that are made once, as a headset's are.
    foveated: bool,
}

impl Watched {
    fn new(gpu: &Gpu, clip: &Clip, rng: &mut Rng, foveated: bool) -> Result<Watched, Fault> {
        let eyes = 1 + usize::from(rng.bool());
        let depth = if rng.bool() { ChannelDepth::Eight } else { ChannelDepth::Sixteen };
        let on_gpu = GpuClip::upload(gpu, clip)?;
        let size = random_size(rng);
        let image = Offscreen::new(gpu, size, eyes as u32, depth)?;
        Ok(Watched {
            renderer: Renderer::new(gpu, on_gpu, FrameLayout { format: depth.format(), eyes, foveated })?,
            clock: Clock::new(f64::from(clip.info.duration_s), f64::from(clip.info.fps)),
            eyes,
            depth,
            size,
            image: if foveated { image.foveated(gpu, INSET_MAX)? } else { image },
            foveated,
        })
    }

    /// The frames of a round.
    fn play(&mut self, gpu: &Gpu, rng: &mut Rng, account: &mut Account) -> Result<(), Fault> {
        for frame in 0..FRAMES {
            self.act(gpu, rng, account)?;
            self.clock.advance(FRAME_S);
            account.played_s += FRAME_S * self.clock.speed();
            let place = [Place::Whole, Place::Near, Place::Far, Place::Edge][rng.usize(..4)];
            let seen = camera(place, self.size.x, self.size.y);
            let cameras = if self.eyes == 2 { seen.stereo_pair(0.065).to_vec() } else { vec![seen] };
            let views: Vec<View> = cameras.iter().map(View::from_camera).collect();
            let settings = RenderSettings {
                sort: [SortOrder::Depth, SortOrder::Radial][rng.usize(..2)],
                cutoff: [Cutoff::Exact, Cutoff::Sqrt8, Cutoff::Sqrt5][rng.usize(..3)],
                layers: [None, Some(1)][rng.usize(..2)],
                inset: [None, Some(0.3), Some(INSET_MAX)][rng.usize(..3)].filter(|_| self.foveated),
            };
            let t = self.clock.clip_time();
            self.image.render(gpu, &mut self.renderer, t, &views, &settings)?;
            account.frames += 1;
            if frame % 16 == 15 {
                self.renderer.count(gpu)?;
                self.image.read(gpu)?;
            }
        }
        Ok(())
    }

    /// What a person may do between two frames.
    fn act(&mut self, gpu: &Gpu, rng: &mut Rng, account: &mut Account) -> Result<(), Fault> {
        let action = rng.u8(..16);
        account.seeks += u64::from(action < 4);
        let clock = &mut self.clock;
        match action {
            0 => clock.seek(rng.f64() * clock.duration_s()),
            1 => clock.step_forward(),
            2 => clock.step_back(),
            3 => clock.toggle_playing(),
            4 => clock.set_speed(SPEED_RANGE.0 + (SPEED_RANGE.1 - SPEED_RANGE.0) * rng.f64()),
            5 => clock.set_looping(rng.bool()),
            6 if !self.foveated => {
                self.size = random_size(rng);
                self.image = Offscreen::new(gpu, self.size, self.eyes as u32, self.depth)?;
                account.resizes += 1;
            }
            _ => clock.set_playing(true),
        }
        Ok(())
    }
}

fn random_size(rng: &mut Rng) -> UVec2 {
    UVec2::new(rng.u32(16..320), rng.u32(16..240))
}

/// Loses the device under a clip that is drawn: every way to use it says so and none panics.
fn lose(gpu: &Gpu, clip: &Clip) -> Result<(), String> {
    let text = |fault: Fault| fault.to_string();
    let on_gpu = GpuClip::upload(gpu, clip).map_err(text)?;
    let depth = ChannelDepth::Eight;
    let mut renderer =
        Renderer::new(gpu, on_gpu.clone(), FrameLayout::plain(depth.format(), 1)).map_err(text)?;
    let image = Offscreen::new(gpu, UVec2::new(64, 48), 1, depth).map_err(text)?;
    let (views, settings) = ([View::from_camera(&camera(Place::Whole, 64, 48))], RenderSettings::default());
    image.render(gpu, &mut renderer, 0.5, &views, &settings).map_err(text)?;
    gpu.lose();
    let outcomes = [
        ("drawing", image.render(gpu, &mut renderer, 0.5, &views, &settings).map(drop)),
        ("counting", renderer.count(gpu).map(drop)),
        ("reading back", image.read(gpu).map(drop)),
        ("resizing", Offscreen::new(gpu, UVec2::new(32, 32), 1, depth).map(drop)),
        ("uploading", GpuClip::upload(gpu, clip).map(drop)),
        ("setting up", Renderer::new(gpu, on_gpu, FrameLayout::plain(depth.format(), 2)).map(drop)),
    ];
    for (what, outcome) in outcomes {
        match outcome {
            Err(Fault::Device(sentence)) if sentence.contains("stopped working") => {}
            other => return Err(format!("{what} with a device that is lost gives {other:?}")),
        }
    }
    Ok(())
}

/// Objects of the graphics interface by kind.
fn objects(gpu: &Gpu) -> Result<BTreeMap<&'static str, usize>, String> {
    let objects: BTreeMap<_, _> = gpu.objects().into_iter().collect();
    if objects.get("devices") == Some(&1) { Ok(objects) } else { Err(format!("{objects:?}: not counted")) }
}

/// Memory of this process in the machine, where Linux tells.
fn resident_bytes() -> u64 {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
    let kilobytes = line.and_then(|line| line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok());
    kilobytes.unwrap_or(0) << 10
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn growth_is_noticed_and_a_wave_is_none() {
        let account = |resident: &dyn Fn(u64) -> u64, heap: &dyn Fn(u64) -> u64| Account {
            samples: (0..100)
                .map(|i| Sample { resident_bytes: resident(i), heap_bytes: heap(i), ..Sample::default() })
                .collect(),
            warm_up: 30,
            ..Account::default()
        };
        let wave = |i| (1 << 30) + (i % 10) * (30 << 20);
        assert_eq!(account(&wave, &|i| (1 << 20) + (i % 10) * (1 << 20)).check(), Ok(()));
        let grown = account(&|i| (1 << 30) + i * (1 << 20), &|_| 1).check().unwrap_err();
        assert!(grown.contains("the process"), "{grown}");
        let grown = account(&wave, &|i| (1 << 20) + i * (2 << 10)).check().unwrap_err();
        assert!(grown.contains("the heap"), "{grown}");
        // While it warms up, memory may grow.
        assert_eq!(account(&wave, &|i| (1 << 20) + i.min(29) * (1 << 20)).check(), Ok(()));
    }

    #[test]
    fn a_few_rounds_tell_nothing() {
        let samples = vec![Sample::default(); 30 + ROUNDS_MIN];
        let mut account = Account { samples, warm_up: 30, ..Account::default() };
        assert!(account.is_enough() && account.check().is_ok());
        account.samples.pop();
        assert!(!account.is_enough() && account.check().is_err());
    }

    #[test]
    fn the_system_tells_how_large_the_process_is() {
        if cfg!(target_os = "linux") {
            assert!(resident_bytes() > 1 << 20);
        }
    }
}
