//! [`HeadResponses`]: what the ears of a measured head make of sound from any direction.
//!
//! `assets/head.bin` has the responses of one ear of the KEMAR manikin (Gardner and Martin, MIT Media Lab, 1994) in rings
//! of equal elevation; the other ear is its mirror image. They are of minimum phase, so the weighted mean of neighbours is
//! a response between them, and the delay that was taken out of each stands beside it (Kulkarni, Isabelle and Colburn,
//! Sensitivity of Human Subjects to Head-Related Transfer-Function Phase Spectra, 1999). `examples/head.rs` makes the file.

use glam::DVec3;
use sofar::filter::Filter;

use super::packets::Frame;
use super::rate::{CHUNK, RateConverter};

const DATA: &[u8] = include_bytes!("../../../assets/head.bin");

/// Rate of the responses in the file.
const RATE_HZ: u32 = 48_000;

/// Taps of a response, each in units of 1 / [`TAP_SCALE`].
const TAPS: usize = 96;
const TAP_SCALE: f32 = 8192.0;

/// Units of delay in a sample.
const DELAY_SCALE: f32 = 256.0;

/// Directions in each ring, counterclockwise from the front as seen from above; elevation of the lowest ring, and from
/// each to the next.
const RINGS: [usize; 14] = [56, 60, 72, 72, 72, 72, 72, 60, 56, 45, 36, 24, 12, 1];
const LOWEST_DEG: f64 = -40.0;
const STEP_DEG: f64 = 10.0;

/// Bytes of a direction: delay and taps.
const RECORD: usize = 2 * (1 + TAPS);

const _: () = {
    let (mut directions, mut ring) = (0, 0);
    while ring < RINGS.len() {
        directions += RINGS[ring];
        ring += 1;
    }
    assert!(DATA.len() == directions * RECORD);
};

/// Zeros before each response, in samples of the file: resampling rings before a response begins.
const LEAD: usize = 16;

/// Radius of a head in metres. Within it a source comes the more from everywhere, the nearer it is to the centre.
const HEAD_RADIUS_M: f64 = 0.0875;

/// Largest delay between the ears in seconds; the file's is 0.63 ms.
pub(super) const DELAY_MAX_S: f32 = 0.001;

/// The responses at the rate of a device.
pub(super) struct HeadResponses {
    rate_hz: f32,
    /// Taps of one response.
    length: usize,
    /// Taps of all directions, one direction after another.
    taps: Vec<f32>,
    /// Delay of each direction in seconds.
    delays_s: Vec<f32>,
}

impl HeadResponses {
    /// The responses at `rate_hz`.
    pub(super) fn new(rate_hz: u32) -> HeadResponses {
        let ratio = rate_hz as f32 / RATE_HZ as f32;
        let length = ((LEAD + TAPS) as f32 * ratio).ceil() as usize;
        let number = |bytes: &[u8]| f32::from(i16::from_le_bytes([bytes[0], bytes[1]]));
        let mut converter = RateConverter::new(rate_hz);
        let mut responses = HeadResponses {
            rate_hz: rate_hz as f32,
            length,
            taps: Vec::with_capacity(DATA.len() / RECORD * length),
            delays_s: Vec::with_capacity(DATA.len() / RECORD),
        };
        let mut frames = [[0.0; 2]; CHUNK];
        for pair in DATA.chunks(2 * RECORD) {
            // Two responses, as the two channels of what is converted.
            for (channel, record) in pair.chunks_exact(RECORD).enumerate() {
                responses.delays_s.push(number(record) / (DELAY_SCALE * RATE_HZ as f32));
                for (frame, bytes) in frames[LEAD..].iter_mut().zip(record[2..].chunks_exact(2)) {
                    frame[channel] = number(bytes) / TAP_SCALE;
                }
            }
            let mut converted: Vec<Frame> = Vec::with_capacity(length);
            match &mut converter {
                Some(converter) => {
                    converter.restart();
                    // The sum of the taps is the gain.
                    converter.convert(&frames, |frame| converted.push(frame.map(|tap| tap / ratio)));
                }
                None => converted.extend(frames),
            }
            converted.resize(length, [0.0; 2]);
            for channel in 0..pair.len() / RECORD {
                responses.taps.extend(converted.iter().map(|frame| frame[channel]));
            }
        }
        responses
    }

    /// Number of taps of a response.
    pub(super) fn length(&self) -> usize {
        self.length
    }

    /// Seconds by which every response is late, beside what is between the ears.
    pub(super) fn latency_s(&self) -> f64 {
        LEAD as f64 / f64::from(RATE_HZ)
    }

    /// The filter of a source in the direction of `nearness`, whose length is its distance in radii of a head, at most 1.
    /// The ear that hears it first hears it without a delay.
    pub(super) fn filter(&self, nearness: DVec3, filter: &mut Filter) {
        let distance = nearness.length().min(1.0);
        let azimuth_deg = (-nearness.x).atan2(-nearness.z).to_degrees();
        let elevation_deg = nearness.y.atan2(nearness.x.hypot(nearness.z)).to_degrees();
        let mut delays_s = [0.0; 2];
        let ears = [(&mut filter.left, azimuth_deg), (&mut filter.right, -azimuth_deg)];
        for ((taps, azimuth_deg), delay_s) in ears.into_iter().zip(&mut delays_s) {
            taps.fill(0.0);
            *delay_s = self.add(azimuth_deg, elevation_deg, distance as f32, taps);
            let lead = (LEAD as f32 * self.rate_hz / RATE_HZ as f32).round() as usize;
            taps[lead] += 1.0 - distance as f32;
        }
        // Whole samples, which the renderer rounds down to.
        let late = ((delays_s[0] - delays_s[1]) * self.rate_hz).round();
        [filter.ldelay, filter.rdelay] = [late, -late].map(|late| (late.max(0.0) + 0.5) / self.rate_hz);
    }

    /// Adds the response of the left ear to sound from a direction, times `gain`, to `taps`. Returns its delay, times
    /// `gain`.
    fn add(&self, azimuth_deg: f64, elevation_deg: f64, gain: f32, taps: &mut [f32]) -> f32 {
        let top = RINGS.len() - 1;
        let height = ((elevation_deg - LOWEST_DEG) / STEP_DEG).clamp(0.0, top as f64);
        let below = (height as usize).min(top - 1);
        let above_part = (height - below as f64) as f32;
        let mut delay_s = 0.0;
        for (ring, ring_gain) in [(below, gain * (1.0 - above_part)), (below + 1, gain * above_part)] {
            let (first, count) = (RINGS[..ring].iter().sum::<usize>(), RINGS[ring]);
            let turn = (azimuth_deg / 360.0).rem_euclid(1.0) * count as f64;
            let part = turn.fract() as f32;
            for (step, gain) in [(0, ring_gain * (1.0 - part)), (1, ring_gain * part)] {
                let direction = first + (turn as usize + step) % count;
                delay_s += gain * self.delays_s[direction];
                let response = &self.taps[direction * self.length..][..self.length];
                taps.iter_mut().zip(response).for_each(|(sum, tap)| *sum += gain * tap);
            }
        }
        delay_s
    }
}

/// The direction of a source at `source_m` metres from the listener, as long as its distance in radii of a head, at most 1.
/// A source that is nowhere is in the centre of the head.
pub(super) fn nearness(source_m: DVec3) -> DVec3 {
    let nearness = (source_m / HEAD_RADIUS_M).clamp_length_max(1.0);
    if nearness.is_finite() { nearness } else { DVec3::ZERO }
}

#[cfg(test)]
mod responses_tests {
    use super::*;
    use glam::dvec3;

    fn filter(responses: &HeadResponses, source_m: DVec3) -> Filter {
        let mut filter = Filter::new(responses.length());
        responses.filter(nearness(source_m), &mut filter);
        filter
    }

    /// Level of a response at a frequency.
    fn level(taps: &[f32], hz: f32, rate_hz: u32) -> f32 {
        let sum = |wave: fn(f32) -> f32| -> f32 {
            let turn = std::f32::consts::TAU * hz / rate_hz as f32;
            taps.iter().zip(0..).map(|(tap, i)| tap * wave(i as f32 * turn)).sum()
        };
        sum(f32::cos).hypot(sum(f32::sin))
    }

    #[test]
    fn the_near_ear_hears_it_louder_and_earlier() {
        let responses = HeadResponses::new(48_000);
        let [left, right] = [-2.0, 2.0].map(|x| filter(&responses, dvec3(x, 0.0, 0.0)));
        // Woodworth's r / c (pi / 2 + 1) is 656 us, 31.5 samples.
        assert_eq!((left.ldelay * 48_000.0) as usize, 0);
        assert!((28..=33).contains(&((left.rdelay * 48_000.0) as usize)), "{}", left.rdelay);
        for (hz, ratio) in [(500.0, 1.5), (2_000.0, 2.0), (6_000.0, 5.0)] {
            let [near, far] = [&left.left, &left.right].map(|taps| level(taps, hz, 48_000));
            assert!(near > ratio * far, "{hz} Hz: {near} {far}");
        }
        assert!(left.left == right.right && left.right == right.left && left.rdelay == right.ldelay);
    }

    #[test]
    fn front_and_back_above_and_below_differ() {
        let responses = HeadResponses::new(48_000);
        let at = |x: f64, y: f64, z: f64| filter(&responses, dvec3(x, y, z)).left;
        let difference_db = |a: &[f32], b: &[f32]| {
            let bands = [1_000.0, 2_000.0, 4_000.0, 6_000.0, 8_000.0, 10_000.0, 12_000.0];
            let squares =
                bands.map(|hz| (20.0 * (level(a, hz, 48_000) / level(b, hz, 48_000)).log10()).powi(2));
            (squares.iter().sum::<f32>() / bands.len() as f32).sqrt()
        };
        let (front, back) = (at(0.0, 0.0, -2.0), at(0.0, 0.0, 2.0));
        assert!(difference_db(&front, &back) > 3.0, "{}", difference_db(&front, &back));
        let (above, below) = (at(0.0, 1.5, -1.5), at(0.0, -1.2, -1.5));
        assert!(difference_db(&above, &below) > 3.0, "{}", difference_db(&above, &below));
        assert!(difference_db(&front, &above) > 2.0, "{}", difference_db(&front, &above));
    }

    #[test]
    fn neighbours_are_alike_and_every_place_is_finite() {
        let responses = HeadResponses::new(48_000);
        for step in 0..720 {
            let turn = |step: i32| {
                let angle = f64::from(step).to_radians() / 2.0;
                dvec3(angle.sin(), 0.3 * (2.0 * angle).sin(), -angle.cos())
            };
            let [a, b] = [step, step + 1].map(|step| filter(&responses, turn(step)).left);
            let difference = a.iter().zip(&b).map(|(a, b)| (a - b).powi(2)).sum::<f32>().sqrt();
            assert!(difference < 0.1, "{step}: {difference}");
        }
        for source in [
            DVec3::ZERO,
            dvec3(0.0, -5.0, 0.0),
            dvec3(0.0, 1e300, 0.0),
            dvec3(1e-300, 0.0, 0.0),
            dvec3(f64::NAN, 0.0, 1.0),
            dvec3(f64::INFINITY, 0.0, 1.0),
        ] {
            let filter = filter(&responses, source);
            assert!(filter.left.iter().chain(&filter.right).all(|tap| tap.is_finite()), "{source}");
            assert!(filter.ldelay.max(filter.rdelay) < DELAY_MAX_S, "{source}");
        }
        // In the head it is played as it is.
        let within = filter(&responses, DVec3::ZERO);
        assert!(within.left == within.right && within.left[LEAD] == 1.0);
        assert_eq!(within.left.iter().filter(|tap| **tap != 0.0).count(), 1);
    }

    #[test]
    fn a_device_of_another_rate_has_the_same_head() {
        let source = dvec3(-1.0, 0.3, -1.0);
        let expected = filter(&HeadResponses::new(48_000), source);
        for rate_hz in [44_100, 96_000, 192_000] {
            let found = filter(&HeadResponses::new(rate_hz), source);
            assert!((found.rdelay - expected.rdelay).abs() < 2.0 / 44_100.0);
            for hz in [200.0, 1_000.0, 4_000.0, 8_000.0, 14_000.0] {
                let [a, b] = [(&expected, 48_000), (&found, rate_hz)].map(|(filter, rate_hz)| {
                    [&filter.left, &filter.right].map(|taps| level(taps, hz, rate_hz))
                });
                for ear in 0..2 {
                    let ratio_db = 20.0 * (b[ear] / a[ear]).log10();
                    assert!(ratio_db.abs() < 0.5, "{rate_hz} Hz, {hz} Hz, ear {ear}: {ratio_db} dB");
                }
            }
        }
    }
}
