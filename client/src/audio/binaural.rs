//! [`BinauralSource`] and [`BinauralOutput`]: one source as both ears of a head hear it.
//!
//! The sound thread turns directions into filters and publishes them; the callback of the device convolves, and fades from
//! each filter to the next (`sofar`). Neither exists before the first sound that has a place.

use glam::DVec3;
use rtrb::{Consumer, Producer};
use sofar::filter::Filter;
use sofar::render::{FilterPublisher, FilterTransition, RealtimeRenderer, Renderer, RendererPlan};

use super::packets::Frame;
use super::responses::{DELAY_MAX_S, HeadResponses, nearness};

/// Frames that are convolved at a time. The output is as late.
const BLOCK: usize = 64;

/// Seconds of the fade from one filter to the next: less than the 10 ms between two filters.
const FADE_S: f32 = 0.008;

/// Change of a direction, in radians, below which its filter stays: a third of the least angle that listeners notice.
const CHANGE_MIN: f64 = 0.006;

/// Samples below are silence: far below what a device plays, and far above where arithmetic slows down.
const FLOOR: f32 = 1e-10;

/// The end at the sound thread.
pub(super) struct BinauralSource {
    rate_hz: u32,
    outputs: Producer<BinauralOutput>,
    /// Whether a place was ever asked for.
    is_begun: bool,
    ears: Option<Ears>,
}

/// Makes filters of directions.
struct Ears {
    responses: HeadResponses,
    publisher: FilterPublisher,
    filter: Filter,
    /// The latest that was published.
    nearness: DVec3,
}

impl BinauralSource {
    /// The source of a device, and where its output arrives.
    pub(super) fn new(rate_hz: u32) -> (BinauralSource, Consumer<BinauralOutput>) {
        let (outputs, arriving) = rtrb::RingBuffer::new(1);
        (BinauralSource { rate_hz, outputs, is_begun: false, ears: None }, arriving)
    }

    /// Follows the source to `source_m` metres from the listener: x to the right, y up, z backwards.
    pub(super) fn follow(&mut self, source_m: DVec3) {
        let nearness = nearness(source_m);
        if !std::mem::replace(&mut self.is_begun, true) {
            match Ears::new(self.rate_hz, nearness) {
                Ok((ears, output)) => {
                    self.ears = Some(ears);
                    // Its ring is empty: this is the only one.
                    let _ = self.outputs.push(output);
                }
                Err(error) => log::warn!("sound is played without a place: {error}"),
            }
        } else if let Some(ears) = &mut self.ears
            && nearness.distance(ears.nearness) > CHANGE_MIN
            && let Err(error) = ears.publish(nearness)
        {
            log::debug!("the place of a sound stays: {error}");
        }
    }
}

impl Ears {
    fn new(rate_hz: u32, nearness: DVec3) -> Result<(Ears, BinauralOutput), sofar::render::Error> {
        let responses = HeadResponses::new(rate_hz);
        let filter = Filter::new(responses.length());
        let rate = rate_hz as f32;
        let fading = ((FADE_S * rate) as usize).max(1);
        let plan = RendererPlan::builder(responses.length())
            .with_sample_rate(rate)
            .with_partition_len(BLOCK)
            .build()?;
        let renderer = Renderer::builder(&plan)
            .with_filter_transition(FilterTransition::crossfade(fading))
            .with_max_delay(DELAY_MAX_S)
            .build()?;
        let (publisher, renderer) = renderer.into_realtime();
        let output = BinauralOutput {
            renderer,
            input: [0.0; BLOCK],
            output: [[0.0; BLOCK]; 2],
            at: 0,
            silent: 0,
            taken: 0,
            lasting: responses.length() + (DELAY_MAX_S * rate) as usize + 2 * BLOCK,
            fading,
            latency_s: BLOCK as f64 / f64::from(rate_hz) + responses.latency_s(),
        };
        let mut ears = Ears { responses, publisher, filter, nearness };
        ears.publish(nearness)?;
        Ok((ears, output))
    }

    fn publish(&mut self, nearness: DVec3) -> Result<(), sofar::render::Error> {
        self.responses.filter(nearness, &mut self.filter);
        self.publisher.publish_filter(&self.filter)?;
        self.nearness = nearness;
        Ok(())
    }
}

/// The end at the device's thread. It neither locks nor allocates.
pub(super) struct BinauralOutput {
    renderer: RealtimeRenderer,
    input: [f32; BLOCK],
    output: [[f32; BLOCK]; 2],
    /// Place in both.
    at: usize,
    /// Frames of silence at the end of the input, frames of input, and for how many one of them lasts.
    silent: usize,
    taken: usize,
    lasting: usize,
    /// Frames of a fade from one filter to the next.
    fading: usize,
    latency_s: f64,
}

impl BinauralOutput {
    /// Forgets what it was given. The next sample comes from the direction that was published last.
    pub(super) fn restart(&mut self) {
        self.renderer.reset();
        self.input = [0.0; BLOCK];
        // The end of a fade, and the fade to the latest filter.
        (0..2 * self.fading.div_ceil(BLOCK) + 2).for_each(|_| self.convolve());
        self.output = [[0.0; BLOCK]; 2];
        (self.at, self.silent, self.taken) = (0, 0, 0);
    }

    /// Whether the output is the output of a source that has always been there.
    pub(super) fn is_filled(&self) -> bool {
        self.taken >= self.lasting
    }

    /// Seconds from a sample to when the near ear hears it.
    pub(super) fn latency_s(&self) -> f64 {
        self.latency_s
    }

    /// Takes a sample of the source and returns what the ears hear by now.
    pub(super) fn next(&mut self, sample: f32) -> Frame {
        let heard = self.output.map(|channel| channel[self.at]);
        let is_audible = sample.abs() > FLOOR && sample.is_finite();
        self.input[self.at] = if is_audible { sample } else { 0.0 };
        self.silent = if is_audible { 0 } else { self.silent.saturating_add(1) };
        self.taken = self.taken.saturating_add(1);
        self.at += 1;
        if self.at == BLOCK {
            self.at = 0;
            self.convolve();
        }
        heard
    }

    /// Silence is convolved as well: sound after it comes from where the source is by then.
    fn convolve(&mut self) {
        let [left, right] = &mut self.output;
        let has_failed = self.renderer.process_block(&self.input, left, right).is_err();
        if has_failed || self.silent > self.lasting {
            self.output = [[0.0; BLOCK]; 2];
        }
    }
}

#[cfg(test)]
mod binaural_tests {
    use super::*;
    use glam::dvec3;

    /// What is heard of `wave` for `count` frames, while the source is at `place` of the number of each 480.
    fn heard(count: usize, wave: impl Fn(usize) -> f32, place: impl Fn(usize) -> DVec3) -> Vec<Frame> {
        let (mut source, mut arriving) = BinauralSource::new(48_000);
        source.follow(place(0));
        let mut output = arriving.pop().unwrap();
        let frames = (0..count).map(|i| {
            if i % 480 == 0 {
                source.follow(place(i / 480));
            }
            output.next(wave(i))
        });
        frames.collect()
    }

    fn energy(frames: &[Frame], ear: usize) -> f32 {
        frames.iter().map(|frame| frame[ear].powi(2)).sum()
    }

    /// The frame at which an ear first hears a tenth of its loudest.
    fn onset(frames: &[Frame], ear: usize) -> usize {
        let loudest = frames.iter().fold(0.0f32, |most, frame| most.max(frame[ear].abs()));
        frames.iter().position(|frame| frame[ear].abs() > 0.1 * loudest).unwrap()
    }

    #[test]
    fn from_the_left_the_left_ear_hears_it_earlier_and_louder() {
        let click = |i: usize| if i == 100 { 0.5 } else { 0.0 };
        let frames = heard(1_000, click, |_| dvec3(-2.0, 0.0, 0.0));
        assert!(energy(&frames, 0) > 8.0 * energy(&frames, 1));
        let late = onset(&frames, 1) - onset(&frames, 0);
        assert!((25..=38).contains(&late), "{late}");
        // As late as it says, at the near ear.
        let (mut source, mut arriving) = BinauralSource::new(48_000);
        source.follow(DVec3::Z);
        let latency = arriving.pop().unwrap().latency_s() * 48_000.0;
        assert!((onset(&frames, 0) as f64 - 100.0 - latency).abs() <= 2.0, "{latency}");
    }

    #[test]
    fn front_and_back_sound_different() {
        let noise = |i: usize| if (i * 2_654_435_761) >> 7 & 1 == 0 { 0.2 } else { -0.2 };
        let [front, back] = [-2.0, 2.0].map(|z| heard(9_600, noise, |_| dvec3(0.0, 0.0, z)));
        let difference: f32 = front.iter().zip(&back).map(|(a, b)| (a[0] - b[0]).powi(2)).sum();
        assert!(difference > 0.3 * energy(&back, 0), "{difference}");
        // Straight ahead both ears hear the same.
        assert!(front.iter().all(|frame| (frame[0] - frame[1]).abs() < 1e-5));
    }

    #[test]
    fn a_source_that_flies_around_the_head_and_through_it_does_not_click() {
        // Of a slow wave the second difference is small: 0.5 * 0.03^2 = 0.00045, twice as much at the near ear.
        let wave = |i: usize| 0.5 * (i as f32 * 0.03).sin();
        let around = |step: usize| {
            let angle = step as f64 * 0.06;
            dvec3(angle.sin(), 0.5 * (0.7 * angle).sin(), -angle.cos())
        };
        let through = |step: usize| dvec3(0.01 * step as f64 - 1.0, 1e-9, 0.0);
        // From one side to the other.
        let jumps = |step: usize| dvec3(if (step / 7).is_multiple_of(2) { -1.0 } else { 1.0 }, 0.0, 0.3);
        for (name, frames, bound) in [
            ("around", heard(96_000, wave, around), 0.001),
            ("through", heard(96_000, wave, through), 0.001),
            ("jumps", heard(96_000, wave, jumps), 0.001),
        ] {
            // Behind the beginning of the wave.
            let seconds = frames[400..]
                .windows(3)
                .flat_map(|w| [0, 1].map(|ear: usize| (w[0][ear] - 2.0 * w[1][ear] + w[2][ear]).abs()));
            let largest = seconds.fold(0.0, f32::max);
            println!("{name}: second difference at most {largest}");
            assert!(largest < bound, "{name}: {largest}");
            let loudest = frames[400..].iter().flatten().fold(0.0f32, |most, x| most.max(x.abs()));
            assert!(loudest > 0.2 && loudest < 1.0, "{name}: {loudest}");
        }
    }

    #[test]
    fn silence_stays_silence_and_what_is_no_number_is_silence() {
        for sample in [0.0, f32::NAN, f32::INFINITY, 1e-30] {
            let frames = heard(4_800, |_| sample, |step| dvec3(step as f64 - 5.0, f64::NAN, 0.0));
            assert!(frames.iter().flatten().all(|x| *x == 0.0), "{sample}");
        }
        // One that is no number leaves nothing behind.
        let at_left = |_: usize| dvec3(-1.0, 0.0, 0.0);
        let click = |first: f32| move |i: usize| if i == 70 { first } else { f32::from(i == 80) };
        let expected = heard(600, click(0.0), at_left);
        for sample in [f32::NAN, f32::INFINITY] {
            assert!(heard(600, click(sample), at_left) == expected, "{sample}");
        }
        // Once a sound has died away, nothing is left of it; after silence it sounds as before.
        let bursts = |i: usize| if i % 4_800 < 100 { 0.5 } else { 0.0 };
        let frames = heard(9_600, bursts, at_left);
        assert!(frames[1_000..4_800].iter().flatten().all(|x| x.abs() < 1e-6));
        assert!(frames[2_000..4_800].iter().flatten().all(|x| *x == 0.0));
        assert!(frames[..600].iter().zip(&frames[4_800..]).all(|(a, b)| (a[0] - b[0]).abs() < 1e-6));
    }

    #[test]
    fn after_silence_sound_comes_from_where_the_source_is_by_then() {
        let click = |at: usize| move |i: usize| f32::from(i == at);
        let at_left = |step: usize| dvec3(if step < 50 { -1.0 } else { 1.0 }, 0.0, 0.0);
        let moved = heard(49_000, click(48_000), at_left).split_off(47_000);
        let there = heard(49_000, click(48_000), |_| dvec3(1.0, 0.0, 0.0)).split_off(47_000);
        let largest =
            moved.iter().zip(&there).flat_map(|(a, b)| [0, 1].map(|ear: usize| (a[ear] - b[ear]).abs()));
        assert!(largest.fold(0.0, f32::max) < 1e-6);
        // Also where it begins anew.
        let (mut source, mut arriving) = BinauralSource::new(48_000);
        source.follow(dvec3(-1.0, 0.0, 0.0));
        let mut output = arriving.pop().unwrap();
        (0..1_000).for_each(|i| {
            output.next(click(900)(i));
        });
        source.follow(dvec3(1.0, 0.0, 0.0));
        output.restart();
        let frames: Vec<Frame> = (0..1_000).map(|i| output.next(click(0)(i))).collect();
        assert!(energy(&frames, 1) > 8.0 * energy(&frames, 0));
    }

    #[test]
    fn a_device_of_no_rate_has_no_place() {
        let (mut source, mut arriving) = BinauralSource::new(0);
        source.follow(DVec3::X);
        source.follow(DVec3::Y);
        assert!(arriving.pop().is_err());
    }
}
