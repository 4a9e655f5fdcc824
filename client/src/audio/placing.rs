//! [`Placing`]: the sound of the track as it is, or as it comes from a place.
//!
//! A sound without a place passes unchanged. The one of a place is the mean of its channels, as [`BinauralOutput`] makes it
//! heard, and its level falls with the distance. It fades from one to the other.

use glam::DVec3;
use rtrb::Consumer;

use super::binaural::BinauralOutput;
use super::packets::Frame;

/// Distance up to which a source is as loud as it was recorded; beyond it the amplitude falls with the distance.
const NEAR_M: f64 = 1.5;

/// Seconds in which the level follows a change to 63 %, and of the fade between sound as it is and from a place.
const FOLLOWS_S: f32 = 0.01;

/// How the sound is to be heard.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Placement {
    pub(super) level: f32,
    /// Whether it comes from a place.
    pub(super) is_placed: bool,
}

impl Placement {
    /// Placement of a source at `source_m` metres from the listener; without one the sound is played as it is.
    pub(super) fn new(source_m: Option<DVec3>) -> Placement {
        Placement { level: source_m.map_or(1.0, level), is_placed: source_m.is_some() }
    }
}

/// Amplitude of a source at `source_m` metres from the listener. One that is nowhere is silent.
fn level(source_m: DVec3) -> f32 {
    let distance = source_m.length();
    if distance.is_finite() { (NEAR_M / distance.max(NEAR_M)) as f32 } else { 0.0 }
}

/// Below this level, the change from sound as it is to sound from a place needs no fade.
const QUIET: f32 = 1e-3;

/// Applies placements to samples, without steps.
pub(super) struct Placing {
    arriving: Consumer<BinauralOutput>,
    binaural: Option<BinauralOutput>,
    level: f32,
    follows: f32,
    /// Share of the sound that comes from a place, and whether it is more than none, or about to be.
    placed: f32,
    is_running: bool,
}

impl Placing {
    pub(super) fn new(arriving: Consumer<BinauralOutput>, rate_hz: u32) -> Placing {
        let follows = 1.0 / (FOLLOWS_S * rate_hz as f32).max(1.0);
        Placing { arriving, binaural: None, level: 1.0, follows, placed: 0.0, is_running: false }
    }

    /// Seconds by which sound of this placement is late. Takes in what arrived.
    pub(super) fn begin(&mut self, target: Placement) -> f64 {
        if self.binaural.is_none() {
            self.binaural = self.arriving.pop().ok();
        }
        let binaural = self.binaural.as_ref().filter(|_| target.is_placed);
        binaural.map_or(0.0, BinauralOutput::latency_s)
    }

    /// The next sample, on the way to `target`.
    pub(super) fn place(&mut self, frame: Frame, target: Placement) -> Frame {
        self.level += (target.level - self.level) * self.follows;
        let level = self.level;
        let Some(binaural) = &mut self.binaural else { return frame.map(|x| x * level) };
        if !self.is_running {
            if !target.is_placed {
                return frame.map(|x| x * level);
            }
            binaural.restart();
            self.is_running = true;
            self.placed = if frame.iter().all(|x| x.abs() < QUIET) { 1.0 } else { 0.0 };
        }
        if !target.is_placed {
            self.placed = (self.placed - self.follows).max(0.0);
            self.is_running = self.placed > 0.0;
        } else if binaural.is_filled() {
            self.placed = (self.placed + self.follows).min(1.0);
        }
        let heard = binaural.next(0.5 * (frame[0] + frame[1]));
        std::array::from_fn(|ear| level * (frame[ear] + (heard[ear] - frame[ear]) * self.placed))
    }
}

#[cfg(test)]
mod placing_tests {
    use super::super::binaural::BinauralSource;
    use super::*;
    use glam::dvec3;

    fn wave(i: usize) -> Frame {
        [0.5 * (i as f32 * 0.01).sin(), 0.3 * (i as f32 * 0.013).cos()]
    }

    #[test]
    fn the_level_falls_with_the_distance() {
        for (distance, expected) in [(0.0, 1.0), (0.5, 1.0), (1.5, 1.0), (3.0, 0.5), (15.0, 0.1)] {
            let direction = dvec3(0.6, 0.48, -0.64);
            assert!((level(direction * distance) - expected).abs() < 1e-6, "{distance}");
        }
        for nowhere in [f64::NAN, f64::INFINITY] {
            assert_eq!(level(dvec3(nowhere, 0.0, 0.0)), 0.0);
        }
    }

    #[test]
    fn sound_without_a_place_is_unchanged_and_nothing_is_made_for_it() {
        let (source, arriving) = BinauralSource::new(48_000);
        let mut placing = Placing::new(arriving, 48_000);
        let target = Placement::new(None);
        for i in 0..10_000 {
            assert_eq!(placing.begin(target), 0.0);
            assert_eq!(placing.place(wave(i), target), wave(i));
        }
        assert!(placing.binaural.is_none());
        drop(source);
    }

    #[test]
    fn a_source_around_the_head_takes_a_small_part_of_a_callback() {
        let (mut source, arriving) = BinauralSource::new(48_000);
        let mut placing = Placing::new(arriving, 48_000);
        let mut calls_s: Vec<f64> = (0..1_000)
            .map(|call| {
                let begun = std::time::Instant::now();
                let angle = 0.05 * f64::from(call);
                let source_m = dvec3(angle.sin(), 0.3, angle.cos());
                source.follow(source_m);
                let target = Placement::new(Some(source_m));
                placing.begin(target);
                (0..480).for_each(|i| {
                    std::hint::black_box(placing.place(wave(i), target));
                });
                begun.elapsed().as_secs_f64()
            })
            .collect();
        // The median: another program may take the CPU in some of them.
        calls_s.sort_by(f64::total_cmp);
        let median_s = calls_s[calls_s.len() / 2];
        println!("{:.0} us of a callback of 10 ms", 1e6 * median_s);
        assert!(median_s < 2.5e-4, "{median_s} s");
    }

    #[test]
    fn a_place_that_comes_again_begins_anew() {
        let (begin, end) = (Placement::new(Some(dvec3(-1.0, 0.0, 0.0))), Placement::new(None));
        let [once, again] = [0, 5_000].map(|visit| {
            let (mut source, arriving) = BinauralSource::new(48_000);
            source.follow(dvec3(-1.0, 0.0, 0.0));
            let mut placing = Placing::new(arriving, 48_000);
            let mut frames = Vec::new();
            for i in 0..12_000 {
                let target = if i < visit || i >= 8_000 { begin } else { end };
                placing.begin(target);
                frames.push(placing.place([0.5 - wave(i)[0]; 2], target));
            }
            frames.split_off(8_000)
        });
        assert!(once == again);
    }

    #[test]
    fn it_goes_to_a_place_and_back_without_a_step() {
        let (mut source, arriving) = BinauralSource::new(48_000);
        let mut placing = Placing::new(arriving, 48_000);
        let (mut last, mut largest) = (wave(0), 0.0f32);
        for i in 0..40_000 {
            // Without a place, then at the left and far away, and without again.
            let source_m = (10_000..30_000).contains(&i).then_some(dvec3(-3.0, 0.0, 0.0));
            let target = Placement::new(source_m);
            if let Some(source_m) = source_m.filter(|_| i % 480 == 0) {
                source.follow(source_m);
            }
            placing.begin(target);
            let frame = placing.place(wave(i), target);
            largest = (0..2).map(|ear| (frame[ear] - last[ear]).abs()).fold(largest, f32::max);
            last = frame;
            match i {
                0..10_000 | 38_000.. => assert!((frame[0] - wave(i)[0]).abs() < 1e-3, "{i}: {frame:?}"),
                12_000..30_000 => assert!(frame[0].abs().max(frame[1].abs()) < 0.4, "{i}: {frame:?}"),
                _ => {}
            }
        }
        assert!(largest < 0.01, "{largest}");
    }
}
