//! Finds when videos started by their sound.
//!
//! ```text
//! extract:   ffmpeg -> 16 kHz, one channel, kept in a file
//! correlate: whitened cross-correlation (GCC-PHAT) of all pairs: the beginnings of recordings, or where these do not join all
//!            cameras, blocks anywhere in them; then blocks along the time in which all run -> delay and drift of each pair
//! solve:     least squares over the pairs, without those that contradict the others -> start and drift of each camera
//! ```
//!
//! Sound needs 2.9 ms for a metre. So a start by sound is late by the way from the sound to the microphone, which nothing here
//! knows: cameras at different distances, up to 10 m, differ by up to 29 ms. The fit learns the rest.

mod blocks;
mod correlate;
mod extract;
mod pair;
mod solve;

use program::Fault;

pub(super) use extract::Track;
pub(super) use pair::{CONFIDENCE_MIN, DRIFT_MAX_PPM, RATE};
pub(super) use pair::{SoundPair, SoundSync};

/// Compares all pairs of `tracks` and solves for their starts; `name` names a camera in messages, and `say` gets a line for
/// each pair that is searched through.
///
/// # Errors
/// [`Fault::Data`] if a track matches none of the others.
pub(super) fn synchronise(
    tracks: &[Track],
    name: &dyn Fn(usize) -> String,
    say: &mut dyn FnMut(&str),
) -> Result<SoundSync, Fault> {
    let mut coarse = correlate::whole(tracks)?;
    join(tracks, &mut coarse, name, say)?;
    let starts_s = solve::starts(tracks.len(), &coarse).values;
    let mut pairs = blocks::refined(tracks, &starts_s, coarse)?;
    let solution = solve::starts(tracks.len(), &pairs);
    for (pair, residual_s) in pairs.iter_mut().zip(solution.residuals) {
        pair.residual_s = residual_s;
    }
    Ok(SoundSync { starts_s: solution.values, drifts_ppm: solve::drifts(tracks.len(), &pairs), pairs })
}

/// Seeks blocks of pairs of cameras that are not joined, until all are, or a group of cameras has no such pair left.
///
/// # Errors
/// [`Fault::Data`] that names a camera of the smaller side if a group cannot be joined to the others, or a track that cannot be
/// read.
fn join(
    tracks: &[Track],
    pairs: &mut [SoundPair],
    name: &dyn Fn(usize) -> String,
    say: &mut dyn FnMut(&str),
) -> Result<(), Fault> {
    let cameras = tracks.len();
    let mut is_sought = vec![false; pairs.len()];
    loop {
        let groups = groups_of(cameras, pairs);
        if groups.iter().all(|group| *group == 0) {
            return Ok(());
        }
        let is_across = |i: &usize, group: usize| {
            let [a, b] = pairs[*i].cameras.map(|camera| groups[camera] == group);
            a != b
        };
        let across = |group: usize| (0..pairs.len()).filter(|i| is_across(i, group)).collect::<Vec<_>>();
        let left = |group: usize| across(group).into_iter().filter(|i| !is_sought[*i]);
        // The group that is known first to be alone, if it is.
        let alone = (0..cameras).filter(|camera| groups[*camera] == *camera);
        let group = alone.min_by_key(|group| left(*group).count()).expect("several groups");
        let Some(next) = left(group).next() else {
            let is_smaller = 2 * groups.iter().filter(|other| **other == group).count() < cameras;
            let outside = (0..cameras).find(|camera| (groups[*camera] == group) == is_smaller);
            let best = across(group).into_iter().map(|i| pairs[i].confidence).fold(0.0, f64::max);
            return Err(Fault::Data(format!(
                "{}: its sound is not that of the other cameras: the correlation peaks at {best:.1} times its median, and \
                 {CONFIDENCE_MIN} are needed; state when the videos start with --offsets FILE",
                name(outside.expect("two groups"))
            )));
        };
        let [a, b] = pairs[next].cameras;
        let number = 1 + is_sought.iter().filter(|is_sought| **is_sought).count();
        say(&format!(
            "the sound of {} and {} is compared block by block, pair {number} of at most {}",
            name(a),
            name(b),
            pairs.len()
        ));
        let found = correlate::sought([a, b], tracks)?;
        is_sought[next] = true;
        if found.confidence > pairs[next].confidence {
            pairs[next] = found;
        }
    }
}

/// The number of the group of each camera that pairs that match join it with.
fn groups_of(cameras: usize, pairs: &[SoundPair]) -> Vec<usize> {
    solve::groups(cameras, pairs.iter().filter(|pair| pair.confidence >= CONFIDENCE_MIN))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A source of noise, and recordings of it: from second `from_s` on, by a clock that runs `drift_ppm` slow.
    fn recorded(folder: &std::path::Path, recordings: &[(f64, f64, f64)]) -> Vec<Track> {
        let mut random = fastrand::Rng::with_seed(3);
        let mut smooth = 0.0;
        let source: Vec<f32> = (0..300 * RATE as usize)
            .map(|_| {
                // Band-limited, so that values between samples can be interpolated.
                smooth += 0.3 * (random.f32() - 0.5 - smooth);
                smooth
            })
            .collect();
        let mut record = |(i, &(from_s, seconds, drift_ppm)): (usize, &(f64, f64, f64))| {
            let sample = |k: usize| {
                let at = from_s * RATE + k as f64 * (1.0 + 1e-6 * drift_ppm);
                let part = at.fract() as f32;
                source[at as usize] * (1.0 - part) + source[at as usize + 1] * part
            };
            let samples: Vec<f32> = (0..(seconds * RATE) as usize)
                .map(|k| 1e5 * (sample(k) + 0.05 * (random.f32() - 0.5)))
                .collect();
            Track::from_samples(folder.join(i.to_string()), &samples)
        };
        recordings.iter().enumerate().map(&mut record).collect()
    }

    fn starts_s(recordings: &[(f64, f64, f64)]) -> Result<SoundSync, Fault> {
        let folder = tempfile::tempdir().unwrap();
        let name = |camera: usize| format!("camera {camera}");
        synchronise(&recorded(folder.path(), recordings), &name, &mut |_| ())
    }

    #[test]
    fn a_camera_may_start_minutes_early() {
        let found = starts_s(&[(140.0, 30.0, 0.0), (5.0, 170.0, 0.0), (139.0, 20.0, 0.0)]).unwrap().starts_s;
        for (found_s, expected_s) in found.iter().zip([0.0, -135.0, -1.0]) {
            assert!((found_s - expected_s).abs() < 2e-4, "{found:?}");
        }
    }

    #[test]
    fn one_of_another_event_is_known_by_its_own_pairs() {
        let folder = tempfile::tempdir().unwrap();
        let mut random = fastrand::Rng::with_seed(5);
        let mut noise = |i: usize| {
            let samples: Vec<f32> = (0..6 * RATE as usize).map(|_| 2e4 * (random.f32() - 0.5)).collect();
            Track::from_samples(folder.path().join(i.to_string()), &samples)
        };
        let others: Vec<Track> = (0..4).map(&mut noise).collect();
        let one = vec![others[0].clone(), others[1].clone(), others[0].clone(), others[0].clone()];
        for (tracks, outside) in [(others, 0), (one, 1)] {
            let mut said = Vec::new();
            let name = |camera: usize| format!("camera {camera}");
            let mut say = |line: &str| said.push(line.to_owned());
            let error = synchronise(&tracks, &name, &mut say).unwrap_err().to_string();
            assert!(error.starts_with(&format!("camera {outside}: its sound is not that of")), "{error}");
            assert!(
                said.len() == 3
                    && said[0].contains("camera 0 and camera 1 is compared block by block, pair 1"),
                "{said:?}"
            );
        }
    }

    #[test]
    fn clocks_may_drift_over_minutes() {
        let (seconds, drifts) = (200.0, [0.0, 104.0, -200.0]);
        let recordings: Vec<_> =
            [3.0, 4.0, 7.0].into_iter().zip(drifts).map(|(at, ppm)| (at, seconds, ppm)).collect();
        let found = starts_s(&recordings).unwrap();
        for (camera, (found_ppm, ppm)) in found.drifts_ppm.iter().zip(drifts).enumerate() {
            assert!((found_ppm - ppm).abs() < 2.0, "{found_ppm} for {ppm}");
            // In the middle of the time in which all run, that is 98 s after the last one starts.
            let expected_s = recordings[camera].0 - 3.0 + 1e-6 * ppm * (105.0 - recordings[camera].0);
            assert!((found.starts_s[camera] - expected_s).abs() < 2e-4, "{:?} {expected_s}", found.starts_s);
        }
    }
}
