//! [`TakePlayer`]: keeps the segments of a take in GPU memory that playing needs.
//!
//! Once a frame, between two frames, [`TakePlayer::update`] takes in what the loader has packed, makes room for it by
//! removing what is least needed, and uploads a part of it. It never waits. An instant that lacks a segment is not
//! drawn: the clock waits ([`TakePlayer::is_missing`]), and the latest complete instant stays on display
//! ([`TakePlayer::shown_s`]).

use std::sync::Arc;
use std::time::{Duration, Instant};

use codec::Take;
use program::Fault;

#[cfg(any(feature = "window", feature = "xr"))]
use super::beginning::Beginning;
use super::buffered::Buffered;
use super::layers::LayerChoice;
use super::loader::{SegmentEvent, SegmentLoader};
use crate::clock::Clock;
use crate::content::{Direction, Loaded, OpenTake, PackedWant, Plan, Playhead, Want, needs, span};
use crate::gpu::{FrameLayout, Gpu, PackedLayers, PackedSegment, Renderer, SlotId, Slots};

/// Most bytes that one frame uploads: 23 MB a second at 90 Hz, and a fraction of a millisecond of a frame's time.
pub const UPLOAD_BYTES_MAX: usize = 256_000;

/// Wait before segments are asked for again that could not be read: from a network, after all its retries.
const RETRY_AFTER: Duration = Duration::from_secs(2);

/// Interval between looks whether a take that begins is still wanted.
const LOOK_INTERVAL: Duration = Duration::from_millis(50);

/// A segment with a place in GPU memory.
struct Resident {
    segment: usize,
    /// Number of layers that are drawn or being uploaded.
    layers: usize,
    slot: SlotId,
    /// Whether all of them are drawn.
    is_ready: bool,
    /// Whether the first are.
    is_drawn: bool,
}

/// How much of an instant is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Extent {
    /// The first layer of each segment.
    FirstLayers,
    /// All layers.
    All,
}

/// A segment that is packed, and waits for room.
type Packed = (Want, Box<PackedSegment>);

/// Counts of a frame for statistics.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TakeCounts {
    /// Number of segments of the take.
    pub segments: usize,
    /// Number of segments in GPU memory.
    pub resident: usize,
    /// Number of sounds in memory.
    pub sounds: usize,
    /// Number of segments in GPU memory whose sound is in memory.
    pub resident_sounds: usize,
    /// Number of segments that were loaded so far, again ones included.
    pub loaded: usize,
    /// Seconds that play on without loading, from the position in the direction of play.
    pub buffered_s: f64,
    /// Most layers of a segment that are loaded while the take plays.
    pub layers: usize,
    /// Most layers of a segment that are drawn or being uploaded.
    pub resident_layers: usize,
    /// Bytes uploaded in the latest frame. What is uploaded before a take is shown is in none.
    pub uploaded_bytes: usize,
    /// The most in any frame.
    pub uploaded_bytes_max: usize,
}

#[cfg(any(feature = "window", feature = "xr"))]
impl TakeCounts {
    /// Rows of names and values for a viewer; none for a single segment.
    pub(crate) fn rows(&self) -> Vec<(&'static str, String)> {
        if self.segments == 1 {
            return Vec::new();
        }
        let TakeCounts { segments, resident, buffered_s, layers, uploaded_bytes, uploaded_bytes_max, .. } =
            self;
        let kilobytes = |bytes: &usize| bytes.div_ceil(1000);
        vec![
            ("segments", format!("{resident} of {segments}")),
            ("buffered", format!("{buffered_s:.1} s of {}", program::counted(*layers, "layer"))),
            (
                "uploaded, most",
                format!("{}, {} kB", kilobytes(uploaded_bytes), kilobytes(uploaded_bytes_max)),
            ),
        ]
    }
}

/// The segments of a take in GPU memory.
pub struct TakePlayer {
    opened: Arc<OpenTake>,
    loader: SegmentLoader,
    /// Layers of each segment that can be loaded; 0 for a segment that is missing or damaged.
    layers: Vec<usize>,
    /// How many of them to load while the take plays.
    layer_choice: LayerChoice,
    /// Layers that the plan wants at most.
    layers_wanted: usize,
    head: Playhead,
    plan: Plan,
    residents: Vec<Resident>,
    waiting: Option<Packed>,
    /// After a failure of the network or the disk, when to ask for segments again.
    retry_at: Option<Instant>,
    /// Whether everything was removed for the present plan to close gaps.
    was_cleared: bool,
    buffered: Buffered,
    shown_s: f64,
    /// Grows whenever the picture of an instant may change.
    revision: u64,
    notes: Vec<String>,
    /// Why the network or the disk failed last, until a segment arrives. It is said once.
    trouble: Option<Fault>,
    /// Why a segment of a file that was replaced cannot be loaded.
    replaced: Option<Fault>,
    counts: TakeCounts,
}

impl TakePlayer {
    /// A player of `opened` at its start, and its renderer for frames of `layout`. The loader calls `wake` when
    /// [`TakePlayer::update`] has work.
    ///
    /// # Errors
    /// [`Fault::Device`] if the take does not fit the device.
    pub fn new(
        gpu: &Gpu,
        opened: Arc<OpenTake>,
        layout: FrameLayout,
        wake: impl Fn() + Send + 'static,
    ) -> Result<(Renderer, TakePlayer), Fault> {
        let renderer = Renderer::new_take(gpu, opened.layout(), layout)?;
        let loader = SegmentLoader::new(opened.clone(), wake)?;
        let layers = opened.layers().to_vec();
        let most = layers.iter().copied().max().unwrap_or(1).max(1);
        let counts = TakeCounts { segments: layers.len(), ..TakeCounts::default() };
        let buffered = Buffered::new(&opened.take, &layers);
        let mut player = TakePlayer {
            opened,
            loader,
            layers,
            layer_choice: LayerChoice::new(most),
            layers_wanted: most,
            head: Playhead::default(),
            plan: Plan::default(),
            residents: Vec::new(),
            waiting: None,
            retry_at: None,
            was_cleared: false,
            buffered,
            shown_s: 0.0,
            revision: 0,
            notes: Vec::new(),
            trouble: None,
            replaced: None,
            counts,
        };
        player.replan();
        Ok((renderer, player))
    }

    /// As [`TakePlayer::new`], with what its first picture needs in GPU memory.
    ///
    /// # Errors
    /// As [`TakePlayer::new`] and [`TakePlayer::wait`].
    #[cfg(any(feature = "window", feature = "xr"))]
    pub(crate) fn begin(
        gpu: &Gpu,
        opened: Arc<OpenTake>,
        layout: FrameLayout,
        beginning: Beginning<'_>,
        wake: impl Fn() + Send + 'static,
    ) -> Result<(Renderer, TakePlayer), Fault> {
        // What is read from a disk comes at once, and what plays later has time.
        let extent = match beginning.is_blocking && opened.source().is_remote() {
            true => Extent::FirstLayers,
            false => Extent::All,
        };
        let (mut renderer, mut take) = TakePlayer::new(gpu, opened, layout, wake)?;
        take.wait_unless(gpu, &mut renderer, beginning.position_s, extent, beginning.is_overtaken)?;
        Ok((renderer, take))
    }

    /// Takes in the position of `clock`, and what was loaded, and uploads at most [`UPLOAD_BYTES_MAX`] for the next
    /// submission. Call it once a frame, after a frame was submitted and before the next one is prepared.
    pub fn update(&mut self, gpu: &Gpu, renderer: &mut Renderer, clock: &Clock) {
        let t_s = clock.position_s();
        let direction = match clock.is_playing() {
            true if clock.is_reversed() => Direction::Backward,
            true => Direction::Forward,
            false if t_s < self.head.t_s => Direction::Backward,
            false if t_s > self.head.t_s => Direction::Forward,
            false => self.head.direction,
        };
        // A picture that stands still has time to become sharp.
        let layers = match clock.is_playing() {
            true => self.layer_choice.layers(),
            false => usize::MAX,
        };
        self.move_to(Playhead { t_s, direction, looping: clock.is_looping(), speed: clock.speed() }, layers);
        let written = self.load(gpu, renderer, UPLOAD_BYTES_MAX);
        self.counts.uploaded_bytes = written;
        self.counts.uploaded_bytes_max = self.counts.uploaded_bytes_max.max(written);
    }

    /// Waits until the first layers or everything at `t_s` seconds is drawn, apart from segments that cannot be loaded.
    ///
    /// # Errors
    /// [`Fault::Device`] if what holds the instant does not fit the device's memory; the fault of its network or disk if it
    /// cannot be read.
    pub fn wait(
        &mut self,
        gpu: &Gpu,
        renderer: &mut Renderer,
        t_s: f64,
        extent: Extent,
    ) -> Result<(), Fault> {
        self.wait_unless(gpu, renderer, t_s, extent, &|| false)
    }

    /// As [`TakePlayer::wait`], until it `is_overtaken`, which is looked at every 50 ms.
    ///
    /// # Errors
    /// As there; [`Fault::Network`] if it is overtaken.
    pub fn wait_unless(
        &mut self,
        gpu: &Gpu,
        renderer: &mut Renderer,
        t_s: f64,
        extent: Extent,
        is_overtaken: &dyn Fn() -> bool,
    ) -> Result<(), Fault> {
        self.move_to(Playhead { t_s, ..Playhead::default() }, usize::MAX);
        loop {
            self.load(gpu, renderer, usize::MAX);
            if self.is_drawn(extent) {
                return Ok(());
            }
            if self.retry_at.take().is_some() {
                // Without a fault, another segment has come since.
                let Some(fault) = self.replaced.take().or(self.trouble.take()) else { continue };
                self.notes.retain(|note| *note != fault.to_string());
                return Err(fault);
            }
            match self.loader.wait(LOOK_INTERVAL) {
                Some(event) => self.take_in(slots_of(renderer), event),
                None if is_overtaken() => return Err(Fault::Network("cancelled".into())),
                None if !self.loader.is_idle() => {}
                None if self.waiting.is_some() => {
                    return Err(Fault::Device(format!(
                        "{}: its segments at {t_s:.3} s do not fit together: package it with a smaller --budget",
                        self.opened.name()
                    )));
                }
                None => {
                    return Err(Fault::Defect(format!(
                        "{}: nothing is left to load at {t_s:.3} s, and something is missing",
                        self.opened.name()
                    )));
                }
            }
        }
    }

    /// Takes in the position, and how many layers to load at most.
    fn move_to(&mut self, head: Playhead, layers: usize) {
        let is_same = (self.head.direction, self.head.looping, self.layers_wanted)
            == (head.direction, head.looping, layers);
        (self.head, self.layers_wanted) = (head, layers);
        if !is_same || !self.plan.is_for(head.t_s) {
            self.replan();
        }
    }

    /// Takes in what was loaded, and uploads at most `budget` bytes. Returns how many.
    fn load(&mut self, gpu: &Gpu, renderer: &mut Renderer, budget: usize) -> usize {
        let slots = slots_of(renderer);
        self.place(slots);
        while self.waiting.is_none()
            && let Some(event) = self.loader.poll()
        {
            self.take_in(slots, event);
        }
        self.request();
        let written = slots.upload(gpu, budget);
        self.settle(slots);
        if !self.is_missing(self.head.t_s) {
            self.shown_s = self.head.t_s;
        }
        self.counts.resident = self.residents.len();
        self.counts.sounds = self.opened.sound.len();
        let has_sound = |resident: &&Resident| self.opened.sound.has(resident.segment);
        self.counts.resident_sounds = self.residents.iter().filter(has_sound).count();
        self.counts.layers = self.layer_choice.layers();
        self.counts.resident_layers =
            self.residents.iter().map(|resident| resident.layers).max().unwrap_or(0);
        self.counts.buffered_s = self.buffered.from(self.head.t_s, self.head.direction);
        written
    }

    fn take_in(&mut self, slots: &mut Slots, event: SegmentEvent) {
        match event {
            SegmentEvent::Packed(Loaded { want, packed, traffic }) => {
                self.counts.loaded += 1;
                // Of a file that is read whole, fewer layers come no sooner. The only segment is loaded once.
                if self.opened.source().has_ranges() && self.counts.segments > 1 {
                    self.layer_choice
                        .on_segment(traffic, |layers| needs(&self.opened.take, layers, &self.head));
                }
                self.trouble = None;
                match packed {
                    PackedWant::Segment(packed) => {
                        self.waiting = Some((want, packed));
                        self.place(slots);
                    }
                    PackedWant::Layers(layers) => self.append(slots, want, *layers),
                }
            }
            // It is asked for again after a while.
            SegmentEvent::Unread(_, fault) => {
                let why = fault.to_string();
                if self.trouble.as_ref().map(Fault::to_string).as_ref() != Some(&why) {
                    self.notes.push(why);
                }
                self.trouble = Some(fault);
                self.retry_at = Some(Instant::now() + RETRY_AFTER);
            }
            // Until it is opened again, what is here plays.
            SegmentEvent::Replaced(_, fault) => {
                self.replaced = Some(fault);
                self.retry_at = Some(Instant::now() + RETRY_AFTER);
            }
            // The first layer of the read may be whole, and the layers before it are.
            SegmentEvent::Damaged(want, fault) => {
                self.give_up(want, want.from.max(want.layers.min(2) - 1), &fault.to_string())
            }
            SegmentEvent::Overtaken(_) | SegmentEvent::Idle => {}
        }
    }

    /// Plays on with only the first `layers` layers of a segment, and says why, once for each segment.
    fn give_up(&mut self, want: Want, layers: usize, why: &str) {
        let Want { segment, .. } = want;
        if self.layers[segment] == self.opened.layers()[segment] {
            self.notes.push(format!("{why}; the rest plays"));
        }
        self.layers[segment] = layers;
        self.buffered = Buffered::new(&self.opened.take, &self.layers);
        self.change();
        self.replan();
    }

    /// Appends further layers to the layers of their segment. If the segment is gone, they are dropped: the plan asks
    /// for the segment again if it is wanted.
    fn append(&mut self, slots: &mut Slots, want: Want, layers: PackedLayers) {
        let is_followed =
            |resident: &&mut Resident| (resident.segment, resident.layers) == (want.segment, want.from);
        if let Some(resident) = self.residents.iter_mut().find(is_followed) {
            slots.append(resident.slot, layers);
            (resident.layers, resident.is_ready) = (want.layers, false);
        }
    }

    /// Gives the waiting segment its place, if there is room, or something less urgent makes room.
    fn place(&mut self, slots: &mut Slots) {
        let Some((want, packed)) = self.waiting.take() else { return };
        if !self.plan.wants(want.segment) || self.resident(want.segment).is_some() {
            self.drop_sounds();
            return;
        }
        let is_held = self.plan.holds(want.segment);
        while !slots.has_room(&packed) {
            let resident: Vec<usize> = self.residents.iter().map(|resident| resident.segment).collect();
            let fits_alone = is_held && !resident.is_empty() && !slots.is_any_leaving();
            match self.plan.victim(&resident, want.segment) {
                Some(segment) => self.remove(slots, segment),
                // Only gaps between segments that are drawn are left. After all are removed there is room for all.
                None if fits_alone && !self.was_cleared => {
                    self.was_cleared = true;
                    resident.into_iter().for_each(|segment| self.remove(slots, segment));
                }
                None if fits_alone => {
                    let start_s = self.opened.take.segments[want.segment].start_s;
                    let name = self.opened.name();
                    let why = format!("{name}: segment at {start_s:.3} s: does not fit beside the others");
                    return self.give_up(want, self.resident_layers(want.segment), &why);
                }
                None => {
                    // A picture that is being saved may still use the rows of removed segments. What is only needed
                    // later does not keep what is needed now from being loaded.
                    let keeps = is_held || !self.is_missing(self.head.t_s);
                    self.waiting = keeps.then_some((want, packed));
                    return;
                }
            }
        }
        let Some(slot) = slots.insert(*packed) else { return };
        let Want { segment, layers, .. } = want;
        self.residents.push(Resident { segment, layers, slot, is_ready: false, is_drawn: false });
    }

    /// Removes a segment.
    fn remove(&mut self, slots: &mut Slots, segment: usize) {
        let Some(at) = self.residents.iter().position(|resident| resident.segment == segment) else { return };
        let resident = self.residents.swap_remove(at);
        slots.remove(resident.slot);
        self.drop_sounds();
        self.change();
    }

    /// Drops the sounds of segments that are neither planned, nor on their way, nor in GPU memory: what is planned again is
    /// loaded again.
    fn drop_sounds(&self) {
        let under_way = self.loader.under_way();
        let is_needed = |segment: usize| {
            self.plan.wants(segment) || self.resident(segment).is_some() || under_way.contains(&segment)
        };
        self.opened.sound.retain(is_needed);
    }

    /// Takes in which segments are complete.
    fn settle(&mut self, slots: &Slots) {
        let mut has_changed = false;
        for resident in self.residents.iter_mut().filter(|resident| !resident.is_ready) {
            let was_drawn = resident.is_drawn;
            (resident.is_ready, resident.is_drawn) =
                (slots.is_ready(resident.slot), slots.is_drawn(resident.slot));
            has_changed |= resident.is_ready || resident.is_drawn != was_drawn;
            if resident.is_ready && self.counts.segments == 1 {
                log::info!("{}: now {} layers", self.opened.name(), resident.layers);
            }
        }
        if has_changed {
            self.change();
        }
    }

    /// Takes in that other segments are drawn.
    fn change(&mut self) {
        self.revision += 1;
        let drawn = self.residents.iter().filter(|resident| resident.is_drawn);
        self.buffered.update(drawn.map(|resident| resident.segment));
    }

    fn replan(&mut self) {
        let wanted: Vec<usize> = self.layers.iter().map(|layers| self.layers_wanted.min(*layers)).collect();
        let plan = Plan::new(&self.opened.take, &wanted, self.head, self.opened.layout().room.total());
        let last = std::mem::replace(&mut self.plan, plan);
        if self.plan.held() != last.held() {
            // What could not be read a moment ago is not what is wanted now.
            self.retry_at = None;
        }
        self.was_cleared = false;
        self.drop_sounds();
        self.request();
    }

    /// Tells the loader what is missing.
    fn request(&mut self) {
        if self.retry_at.is_some_and(|retry_at| Instant::now() < retry_at) {
            return;
        }
        self.retry_at = None;
        let mut missing = self.plan.missing(|segment| self.resident_layers(segment));
        // Further layers of a segment that waits for room have no place yet.
        let waiting = self.waiting.as_ref().map(|(want, _)| want.segment);
        missing.retain(|want| Some(want.segment) != waiting);
        if self.opened.source().is_remote() && self.counts.segments == 1 {
            // Each layer is drawn as soon as it is there.
            missing.iter_mut().for_each(|want| want.layers = want.from + 1);
        }
        self.loader.set(missing);
    }

    /// Number of layers of a segment in GPU memory, complete or not; 0 for none.
    fn resident_layers(&self, segment: usize) -> usize {
        self.resident(segment).map_or(0, |resident| resident.layers)
    }

    /// Number of layers of a segment that is complete in GPU memory; 0 for one that is not.
    fn ready_layers(&self, segment: usize) -> usize {
        self.resident(segment).filter(|resident| resident.is_ready).map_or(0, |resident| resident.layers)
    }

    fn resident(&self, segment: usize) -> Option<&Resident> {
        self.residents.iter().find(|resident| resident.segment == segment)
    }

    /// Whether the first layers or all that are loaded are drawn at the position, apart from segments that cannot be
    /// loaded.
    pub fn is_drawn(&self, extent: Extent) -> bool {
        self.plan.held().iter().all(|&segment| match extent {
            Extent::FirstLayers => self.resident(segment).is_some_and(|resident| resident.is_drawn),
            Extent::All => self.ready_layers(segment) >= self.layers[segment].min(self.layers_wanted),
        })
    }

    /// Whether a segment that can be loaded is not drawn at `t_s` seconds.
    pub fn is_missing(&self, t_s: f64) -> bool {
        let is_missing = |segment: usize| !self.resident(segment).is_some_and(|resident| resident.is_drawn);
        if self.plan.is_for(t_s) {
            return self.plan.held().iter().any(|&segment| is_missing(segment));
        }
        let Take { segments, duration_s, .. } = &self.opened.take;
        let holds = |index: usize| self.layers[index] > 0 && span(&segments[index]).holds(t_s, *duration_s);
        (0..segments.len()).any(|index| holds(index) && is_missing(index))
    }

    /// The instant to draw while the clock is at `t_s` seconds: that one if nothing of it is missing, else the latest
    /// complete one, as long as nothing of that was removed.
    pub fn shown_s(&self, t_s: f64) -> f64 {
        if self.is_missing(t_s) && !self.is_missing(self.shown_s) { self.shown_s } else { t_s }
    }

    /// Whether another version has taken the place of the file, and can be opened. Noticed when a segment is loaded.
    pub fn is_replaced(&self) -> bool {
        self.opened.source().has_settled()
    }

    /// Whether the next frame uploads a part of a segment.
    pub fn is_uploading(&self) -> bool {
        self.residents.iter().any(|resident| !resident.is_ready)
    }

    /// A number that changes with the segments that are drawn.
    pub fn revision(&self) -> u64 {
        self.revision
    }

    /// The parts of the take that play without loading, as seconds (from, to), ascending; none to tell of a single segment.
    pub fn buffered(&self) -> &[(f64, f64)] {
        if self.counts.segments == 1 { &[] } else { self.buffered.ranges() }
    }

    /// Counts for statistics.
    pub fn counts(&self) -> TakeCounts {
        self.counts
    }

    /// The remarks since the last call.
    pub fn take_notes(&mut self) -> Vec<String> {
        std::mem::take(&mut self.notes)
    }
}

/// The slots of a take's renderer.
fn slots_of(renderer: &mut Renderer) -> &mut Slots {
    renderer.slots().expect("it is the renderer of a take")
}
