//! Sound and picture together, on a device of the tests: what it played is recorded with its times, and what the frames
//! showed with theirs. Time is simulated, so ten minutes pass in a few seconds.

use std::f64::consts::TAU;
use std::sync::Arc;

use codec::{Sound, SoundInfo};
use glam::DVec3;

use super::binaural::BinauralSource;
use super::filler::{RING_S, RingFiller};
use super::link::Link;
use super::output::RingOutput;
use super::packets::{Frame, PacketReader};
use super::timing::{FrameTime, SoundTiming};
use super::track::{SoundTrack, samples};
use crate::clock::Clock;

/// Most seconds between sound and picture.
const OFFSET_MAX_S: f64 = 0.02;

/// Samples by which the decoder of a stream is late: the delay of the encoder used here.
const LEAD: u16 = 120;

/// Packets of `seconds` of mono sound.
fn packets(seconds: f64, sample: impl Fn(usize) -> f32) -> Vec<Vec<u8>> {
    let count = samples(seconds) as usize;
    let mut encoder =
        rusty_opus::OpusEncoder::new(48_000, 1, rusty_opus::Application::RestrictedLowDelay).unwrap();
    encoder.bitrate_bps = 64_000;
    let packet = |first: usize| -> Vec<u8> {
        let pcm: Vec<f32> = (first..first + 960).map(|i| if i < count { sample(i) } else { 0.0 }).collect();
        let mut packet = vec![0; 1_500];
        let length = encoder.encode(&pcm, 960, &mut packet).unwrap();
        packet.truncate(length);
        packet
    };
    (0..count + usize::from(LEAD)).step_by(960).map(packet).collect()
}

/// The sound of packets, from packet `first` on, heard from sample `start` of the stream for `length` samples.
fn part(all: &[Vec<u8>], first: usize, start: usize, length: usize, at: u32) -> Sound {
    let info = SoundInfo {
        channels: 1,
        position: None,
        stream: 7,
        start: at,
        length: length as u32,
        lead: (usize::from(LEAD) + start - 960 * first) as u16,
        packet_samples: 960,
    };
    Sound::new(info, all[first..first + info.packet_count()].iter().map(Vec::as_slice)).unwrap()
}

/// A clap of 3 ms: noise of full level.
fn clap(i: usize) -> f32 {
    if i < 144 { if (i * 2_654_435_761) >> 7 & 1 == 0 { 0.9 } else { -0.9 } } else { 0.0 }
}

/// Sound of `duration_s` seconds with a clap at each of `claps_s`.
fn clapping(duration_s: f64, claps_s: &[f64]) -> Sound {
    let claps: Vec<usize> = claps_s.iter().map(|s| samples(*s) as usize).collect();
    let sample = |i: usize| claps.iter().filter(|at| i >= **at).map(|at| clap(i - at)).sum();
    part(&packets(duration_s, sample), 0, 0, samples(duration_s) as usize, 0)
}

/// A window and an audio device with clocks of their own.
struct Simulation {
    link: Arc<Link>,
    filler: RingFiller,
    binaural: BinauralSource,
    output: RingOutput,
    timing: SoundTiming,
    track: SoundTrack,
    clock: Clock,
    now_s: f64,
    /// Seconds of the device in a second of the display.
    device_speed: f64,
    rate_hz: u32,
    /// Seconds between two calls of the device, and from a call to the ear.
    period_s: f64,
    latency_s: f64,
    next_call_s: f64,
    /// Frames that the device was given, and when the first of each call was heard.
    calls: Vec<(f64, Vec<Frame>)>,
    /// When frames were seen, and what they showed.
    seen: Vec<(f64, f64)>,
}

impl Simulation {
    fn new(track: SoundTrack, clock: Clock, rate_hz: u32) -> Simulation {
        let link = Arc::new(Link::default());
        let (producer, consumer) = rtrb::RingBuffer::new((RING_S * f64::from(rate_hz)) as usize);
        link.set_open(true);
        link.set_gain(1.0);
        link.set_source_m(None);
        let (binaural, placed) = BinauralSource::new(rate_hz);
        Simulation {
            filler: RingFiller::new(producer, link.clone(), rate_hz),
            output: RingOutput::new(consumer, placed, link.clone(), rate_hz),
            binaural,
            link,
            timing: SoundTiming::default(),
            track,
            clock,
            now_s: 0.0,
            device_speed: 1.0,
            rate_hz,
            period_s: 0.01,
            latency_s: 0.03,
            next_call_s: 0.0,
            calls: Vec::new(),
            seen: Vec::new(),
        }
    }

    /// Lets the device play until `until_s`.
    fn play_device(&mut self, until_s: f64) {
        while self.next_call_s <= until_s {
            if let Some(source_m) = self.link.source_m() {
                self.binaural.follow(source_m);
            }
            self.filler.fill();
            let count = (self.period_s * f64::from(self.rate_hz)).round() as usize;
            let mut samples = vec![0.0; 2 * count];
            self.output.render(&mut samples, |x| x, 2, self.next_call_s, self.latency_s);
            let frames = samples.chunks(2).map(|frame| [frame[0], frame[1]]).collect();
            self.calls.push((self.next_call_s + self.latency_s, frames));
            self.next_call_s += self.period_s / self.device_speed;
        }
    }

    /// A frame that is seen `elapsed_s` after the frame before.
    fn frame(&mut self, elapsed_s: f64, is_scrubbing: bool) {
        self.now_s += elapsed_s;
        self.play_device(self.now_s);
        let frame = FrameTime { elapsed_s, seen_at_s: self.now_s };
        let (step_s, command) = self.timing.step(&self.clock, is_scrubbing, &self.track, &self.link, frame);
        if let Some(command) = command {
            self.filler.take(command);
        }
        if !is_scrubbing {
            self.clock.advance(step_s);
        }
        self.seen.push((self.now_s, self.clock.position_s()));
    }

    /// Frames at `rate_hz` for `seconds`.
    fn run(&mut self, seconds: f64, rate_hz: f64) {
        let until_s = self.now_s + seconds;
        while self.now_s < until_s {
            self.frame(1.0 / rate_hz, false);
        }
    }

    /// When claps were heard: where the level rises after a tenth of a second without.
    fn claps_heard_s(&self) -> Vec<f64> {
        let mut heard: Vec<f64> = Vec::new();
        let mut last_s = f64::NEG_INFINITY;
        for (at_s, frames) in &self.calls {
            for (i, frame) in frames.iter().enumerate() {
                if frame[0].abs() > 0.3 {
                    let now_s = at_s + i as f64 / f64::from(self.rate_hz) / self.device_speed;
                    if now_s - last_s > 0.1 {
                        heard.push(now_s);
                    }
                    last_s = now_s;
                }
            }
        }
        heard
    }

    /// When the picture showed the position `position_s`, between two frames that play over it.
    fn seen_s(&self, position_s: f64) -> Vec<f64> {
        let between = |pair: &[(f64, f64)]| {
            let [(from_s, from), (to_s, to)] = [pair[0], pair[1]];
            let is_played = from <= position_s && position_s < to && to - from < 0.1;
            is_played.then(|| from_s + (to_s - from_s) * (position_s - from) / (to - from))
        };
        self.seen.windows(2).filter_map(between).collect()
    }

    /// For each clap that was heard, seconds from the nearest picture of one of `claps_s` to it.
    fn offsets_s(&self, claps_s: &[f64]) -> Vec<f64> {
        let seen: Vec<f64> = claps_s.iter().flat_map(|clap_s| self.seen_s(*clap_s)).collect();
        let nearest = |heard: f64| {
            let offsets = seen.iter().map(|seen| heard - seen);
            offsets.min_by(|a, b| a.abs().total_cmp(&b.abs())).unwrap_or(f64::INFINITY)
        };
        self.claps_heard_s().into_iter().map(nearest).collect()
    }

    /// The largest step from one sample to the next.
    fn largest_step(&self) -> f32 {
        let mut before = 0.0f32;
        let mut largest = 0.0f32;
        for frame in self.calls.iter().flat_map(|(_, frames)| frames) {
            largest = largest.max((frame[0] - before).abs());
            before = frame[0];
        }
        largest
    }
}

fn largest(offsets: &[f64]) -> f64 {
    offsets.iter().fold(0.0, |a: f64, b| a.max(b.abs()))
}

/// A track of one sound, and a clock of its clip in a loop.
fn looping(sound: Sound, duration_s: f64) -> (SoundTrack, Clock) {
    let track = SoundTrack::default();
    track.insert(sound, 0, 0.0);
    (track, Clock::new(duration_s, 30.0))
}

#[test]
fn ten_minutes_of_a_loop_are_in_time_whatever_the_two_clocks_do() {
    // A duration that is no whole number of samples, and a device that is 200 ppm too fast or too slow.
    let (duration_s, claps_s) = (2.000_013, [0.7]);
    let sound = clapping(duration_s, &claps_s);
    for (device_speed, rate_hz, frames_hz) in
        [(1.0002, 48_000, 60.0), (0.9998, 48_000, 90.0), (1.0002, 44_100, 72.0)]
    {
        let (track, clock) = looping(sound.clone(), duration_s);
        let mut simulation = Simulation::new(track, clock, rate_hz);
        simulation.device_speed = device_speed;
        simulation.run(600.0, frames_hz);
        let offsets = simulation.offsets_s(&claps_s);
        assert_eq!(offsets.len(), (600.0 * device_speed / duration_s).round() as usize);
        let (first, last) = (largest(&offsets[..30]), largest(&offsets[offsets.len() - 30..]));
        let all = largest(&offsets);
        println!(
            "{rate_hz} Hz, device {device_speed}: offset at most {:.2} ms, first minute {:.2}, last {:.2}",
            all * 1e3,
            first * 1e3,
            last * 1e3
        );
        assert!(all < OFFSET_MAX_S, "{all} s");
        assert!((last - first).abs() < 1e-3, "no drift: {first} s, then {last} s");
        // Frames are even: the picture neither stands nor jumps for the sound.
        let steps =
            simulation.seen.windows(2).skip(60).map(|pair| (pair[1].1 - pair[0].1).rem_euclid(duration_s));
        let (least, most) = steps.fold((f64::MAX, 0.0f64), |(a, b), step| (a.min(step), b.max(step)));
        assert!(least > 0.94 / frames_hz && most < 1.06 / frames_hz, "{least} to {most}");
    }
}

#[test]
fn what_comes_from_a_place_is_heard_when_it_is_seen() {
    let (duration_s, claps_s) = (2.0, [0.7]);
    let sound = clapping(duration_s, &claps_s);
    for rate_hz in [48_000, 44_100] {
        let [plain, placed] = [None, Some(DVec3::new(-1.2, 0.0, -0.3))].map(|source_m| {
            let (track, clock) = looping(sound.clone(), duration_s);
            let mut simulation = Simulation::new(track, clock, rate_hz);
            simulation.link.set_source_m(source_m);
            simulation.run(30.0, 60.0);
            let offsets = simulation.offsets_s(&claps_s);
            assert_eq!(offsets.len(), 15);
            offsets.iter().skip(5).sum::<f64>() / 10.0
        });
        // The filter is 1.7 ms late, which the clock subtracts; a clap rises in less.
        println!("{rate_hz} Hz: {:.2} ms without a place, {:.2} ms with one", plain * 1e3, placed * 1e3);
        assert!((placed - plain).abs() < 5e-4, "{plain} {placed}");
    }
}

#[test]
fn a_take_of_many_segments_is_one_sound_in_time() {
    // A tone that runs over all cuts, with a clap every two seconds. Segments hold two seconds each.
    let tone = |i: usize| 0.2 * (i as f64 * 440.0 * TAU / 48_000.0).sin() as f32;
    let all = packets(60.0, |i| tone(i) + if i >= 33_600 { clap((i - 33_600) % 96_000) * 0.7 } else { 0.0 });
    let track = SoundTrack::default();
    for segment in 0..30usize {
        let start = if segment == 0 { 0 } else { 96_000 * segment - usize::from(LEAD) };
        let end = if segment == 29 { 60 * 48_000 } else { 96_000 * (segment + 1) - usize::from(LEAD) };
        let first = (start + usize::from(LEAD)) / 960;
        let first = first.saturating_sub(4);
        // Written in the clip time of its segment, which begins up to a second earlier.
        let begin_s = (start as f64 / 48_000.0 - 0.5).max(0.0);
        let at = (start as i64 - samples(begin_s)) as u32;
        track.insert(part(&all, first, start, end - start, at), segment, begin_s);
    }
    // Read through, it is what one decoder makes of the whole stream.
    let whole = SoundTrack::default();
    whole.insert(part(&all, 0, 0, 60 * 48_000, 0), 0, 0.0);
    let read = |track: &SoundTrack, from: usize, count: usize| {
        let mut frames = vec![[0.0; 2]; count];
        PacketReader::new(track.clone(), from as i64).read(&mut frames);
        frames
    };
    assert!(read(&track, 0, 960_000) == read(&whole, 0, 960_000), "no seam is heard");
    // From a seek on, a decoder that was primed makes nearly the same.
    let difference =
        |a: &[Frame], b: &[Frame]| a.iter().zip(b).map(|(a, b)| (a[0] - b[0]).abs()).fold(0.0f32, f32::max);
    let reference = read(&whole, 0, 500_000);
    for from in [100_000, 191_880, 191_881, 250_001, 300_000] {
        let error = difference(
            &read(&track, from, 20_000)[EDGE_FRAMES..],
            &reference[from + EDGE_FRAMES..from + 20_000],
        );
        assert!(error < 0.02, "from {from}: {error}");
    }
    let mut simulation = Simulation::new(track, Clock::new(60.0, 30.0), 48_000);
    simulation.run(59.0, 60.0);
    let claps: Vec<f64> = (0..30).map(|second| 0.7 + 2.0 * f64::from(second)).collect();
    let offsets = simulation.offsets_s(&claps);
    assert_eq!(offsets.len(), 30);
    assert!(largest(&offsets) < OFFSET_MAX_S, "{offsets:?}");
}

#[test]
fn a_stream_goes_on_over_a_gap_of_less_than_a_sample_and_in_the_later_of_two_segments() {
    let tone = |i: usize| 0.3 * (i as f64 * 440.0 * TAU / 48_000.0).sin() as f32;
    let all = packets(3.0, tone);
    let cut = 960 * 50 - usize::from(LEAD);
    let read = |track: &SoundTrack, count: usize| {
        let mut frames = vec![[0.0; 2]; count];
        PacketReader::new(track.clone(), 0).read(&mut frames);
        frames
    };
    let whole = SoundTrack::default();
    whole.insert(part(&all, 0, 0, 96_000, 0), 0, 0.0);
    let expected = read(&whole, 90_000);
    for offset in [-0.9, -0.4, 0.4, 0.9] {
        let track = SoundTrack::default();
        track.insert(part(&all, 0, 0, cut, 0), 0, 0.0);
        let start_s = (cut as f64 + offset) / 48_000.0;
        track.insert(part(&all, 46, cut, 96_000 - cut, 0), 1, start_s);
        assert!(read(&track, 90_000) == expected, "no seam is heard at {offset}");
    }
    // Another stream, of silence, in a later segment: it is heard while it lasts, and the tone fades around it.
    let silence = packets(1.0, |_| 0.0);
    let track = SoundTrack::default();
    track.insert(part(&all, 0, 0, 96_000, 0), 0, 0.0);
    track.insert(part(&silence, 0, 0, 12_000, 0), 1, 0.5);
    let frames = read(&track, 90_000);
    assert!(frames[24_000..36_000].iter().all(|frame| frame[0].abs() < 1e-3), "the later segment is heard");
    let loudest =
        |from: usize| frames[from..from + 4_000].iter().fold(0.0f32, |a, frame| a.max(frame[0].abs()));
    assert!(loudest(19_000) > 0.25 && loudest(37_000) > 0.25);
    let steps = frames.windows(2).map(|pair| (pair[1][0] - pair[0][0]).abs());
    let largest = steps.fold(0.0f32, f32::max);
    assert!(largest < 0.03, "{largest}: 0.3 * 440 Hz * 2 pi / 48 kHz = 0.017, and a fade");
}

/// Samples behind a seek that may differ: the samples of the fade.
const EDGE_FRAMES: usize = 144;

#[test]
fn after_a_thousand_seeks_it_is_in_time_and_none_of_them_clicks() {
    // A low tone, whose own steps are small: 0.4 * 110 Hz * 2 pi / 48 kHz = 0.006.
    let duration_s = 8.0;
    let claps_s: Vec<f64> = (0..16).map(|i| 0.25 + 0.5 * f64::from(i)).collect();
    let (track, clock) = looping(clapping(duration_s, &claps_s), duration_s);
    let mut simulation = Simulation::new(track, clock, 48_000);
    let mut random = 1u64;
    let mut uniform = |high: f64| {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (random >> 33) as f64 / (1u64 << 31) as f64 * high
    };
    let mut count = 0;
    for seek in 0..1000 {
        simulation.clock.seek(uniform(duration_s));
        match seek % 10 {
            // Held in between, paused, and played at another speed.
            3 => (0..5).for_each(|_| simulation.frame(1.0 / 60.0, true)),
            5 => {
                simulation.clock.set_playing(false);
                simulation.run(0.05, 60.0);
                simulation.clock.set_playing(true);
            }
            7 => {
                simulation.clock.set_speed(2.0);
                simulation.run(0.1, 60.0);
                simulation.clock.set_speed(1.0);
            }
            _ => {}
        }
        // What was heard before is another matter: it is compared with the frames of its own time.
        simulation.run(uniform(0.4), 60.0);
        let from = simulation.now_s;
        simulation.run(0.7, 60.0);
        let heard: Vec<f64> = simulation.offsets_s(&claps_s);
        let times = simulation.claps_heard_s();
        let settled: Vec<f64> = times
            .iter()
            .zip(heard)
            .filter(|(at, _)| **at > from + 0.15 && **at < simulation.now_s - 0.02)
            .map(|(_, offset)| offset)
            .collect();
        count += settled.len();
        assert!(largest(&settled) < OFFSET_MAX_S, "seek {seek}: {settled:?}");
        simulation.calls.clear();
        simulation.seen.clear();
    }
    assert!(count > 700, "{count} claps were heard");

    let tone = packets(duration_s, |i| 0.4 * (i as f64 * 110.0 * TAU / 48_000.0).sin() as f32);
    let tone = part(&tone, 0, 0, samples(duration_s) as usize, 0);
    let (track, clock) = looping(tone.clone(), duration_s);
    let mut simulation = Simulation::new(track, clock, 48_000);
    for seek in 0..200 {
        simulation.clock.seek(uniform(duration_s));
        if seek % 4 == 1 {
            simulation.clock.set_playing(false);
            simulation.run(0.03, 60.0);
            simulation.clock.set_playing(true);
        }
        if seek % 4 == 2 {
            simulation.link.set_gain(if seek % 8 == 2 { 0.0 } else { 1.0 });
        }
        if seek % 4 == 3 {
            // Another clip follows, and another is opened.
            let track = SoundTrack::default();
            track.insert(tone.clone(), 0, 0.0);
            simulation.track = track;
            simulation.timing.change_track(seek % 8 == 3);
        }
        simulation.run(0.1 + uniform(0.2), 60.0);
    }
    simulation.clock.seek(duration_s - 0.1);
    simulation.run(0.5, 60.0);
    // A fade of 5 ms from 0.4 takes steps of 0.0017 more.
    assert!(simulation.largest_step() < 0.012, "{}", simulation.largest_step());
}

#[test]
fn other_speeds_backwards_and_scrubbing_are_silent_and_follow_the_display() {
    let duration_s = 2.0;
    let loud = packets(duration_s, |i| 0.5 * (i as f64 * 300.0 * TAU / 48_000.0).sin() as f32);
    let (track, clock) = looping(part(&loud, 0, 0, 96_000, 0), duration_s);
    let mut simulation = Simulation::new(track, clock, 48_000);
    let level = |simulation: &mut Simulation, seconds: f64, is_scrubbing: bool| {
        (0..20).for_each(|_| simulation.frame(1.0 / 60.0, is_scrubbing));
        simulation.calls.clear();
        let before = simulation.clock.position_s();
        let frames = (seconds * 60.0) as usize;
        (0..frames).for_each(|_| simulation.frame(1.0 / 60.0, is_scrubbing));
        let played = simulation
            .calls
            .iter()
            .flat_map(|(_, frames)| frames)
            .map(|frame| frame[0].abs())
            .fold(0.0, f32::max);
        (played, (simulation.clock.position_s() - before).rem_euclid(duration_s))
    };
    let (played, moved) = level(&mut simulation, 0.5, false);
    assert!(played > 0.4 && (moved - 0.5).abs() < 0.01, "{played} {moved}");
    simulation.clock.set_speed(0.5);
    let (played, moved) = level(&mut simulation, 0.5, false);
    assert!(played < 1e-3 && (moved - 0.25).abs() < 1e-6, "{played} {moved}");
    simulation.clock.set_speed(1.0);
    simulation.clock.set_reversed(true);
    let (played, moved) = level(&mut simulation, 0.5, false);
    assert!(played < 1e-3 && (moved - 1.5).abs() < 1e-6, "{played} {moved}");
    simulation.clock.set_reversed(false);
    assert!(level(&mut simulation, 0.5, true).0 < 1e-3, "held");
    assert!(level(&mut simulation, 0.5, false).0 > 0.4, "and on");
    simulation.clock.set_playing(false);
    assert!(level(&mut simulation, 0.5, false).0 < 1e-3, "paused");
}

#[test]
fn a_device_that_stops_or_is_lost_holds_the_picture_for_half_a_second_at_most() {
    let (track, clock) = looping(clapping(2.0, &[0.7]), 2.0);
    let mut simulation = Simulation::new(track, clock, 48_000);
    simulation.run(1.0, 60.0);
    // The device asks for no more samples, without an error, for as long as it would be tried six times.
    simulation.next_call_s = f64::INFINITY;
    simulation.seen.clear();
    simulation.run(20.0, 60.0);
    let stands = simulation.seen.windows(2).filter(|pair| pair[0].1 == pair[1].1).count();
    assert!((25..=32).contains(&stands), "{stands} frames of 1/60 s stand");
    // It is called again: sound comes back after a while.
    simulation.next_call_s = simulation.now_s;
    simulation.run(10.0, 60.0);
    let offsets = simulation.offsets_s(&[0.7]);
    assert!(offsets.len() >= 3 && largest(&offsets[offsets.len() - 3..]) < OFFSET_MAX_S, "{offsets:?}");
    // One that is lost is not waited for at all.
    simulation.link.set_open(false);
    simulation.next_call_s = f64::INFINITY;
    let before = simulation.clock.position_s();
    simulation.run(0.5, 60.0);
    assert!(((simulation.clock.position_s() - before).rem_euclid(2.0) - 0.5).abs() < 0.02);
}

#[test]
fn the_next_clip_begins_without_a_break_of_the_picture() {
    let (track, mut clock) = looping(clapping(2.0, &[0.7]), 2.0);
    clock.set_has_next(true);
    let mut simulation = Simulation::new(track, clock, 48_000);
    simulation.run(1.5, 60.0);
    while simulation.clock.overrun_s().is_none() {
        simulation.frame(1.0 / 60.0, false);
    }
    simulation.clock.continue_with(2.0, 30.0);
    let next = SoundTrack::default();
    next.insert(clapping(2.0, &[0.3, 1.3]), 0, 0.0);
    simulation.track = next;
    simulation.timing.change_track(true);
    simulation.seen.clear();
    simulation.calls.clear();
    simulation.run(1.8, 60.0);
    let steps: Vec<f64> = simulation.seen.windows(2).map(|pair| pair[1].1 - pair[0].1).collect();
    assert!(steps.iter().all(|step| (0.9 / 60.0..1.1 / 60.0).contains(step)), "{steps:?}");
    let offsets = simulation.offsets_s(&[0.3, 1.3]);
    assert_eq!(offsets.len(), 2);
    assert!(largest(&offsets) < OFFSET_MAX_S, "{offsets:?}");
}

#[test]
fn damaged_packets_are_silence_and_keep_the_time() {
    let mut all = packets(2.0, |i| 0.4 * (i as f64 * 300.0 * TAU / 48_000.0).sin() as f32);
    let mut random = 9u64;
    for (i, packet) in all.iter_mut().enumerate() {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        match i % 5 {
            1 => packet.iter_mut().skip(1).for_each(|byte| *byte ^= (random >> 40) as u8),
            2 => packet.truncate(1),
            3 => packet[0] = (random >> 30) as u8,
            _ => {}
        }
    }
    let track = SoundTrack::default();
    track.insert(part(&all, 0, 0, 96_000, 0), 0, 0.0);
    let mut frames = vec![[f32::NAN; 2]; 100_000];
    PacketReader::new(track, 0).read(&mut frames);
    assert!(frames.iter().flatten().all(|x| x.is_finite()));
    assert!(frames[96_000..].iter().flatten().all(|x| *x == 0.0));
}
