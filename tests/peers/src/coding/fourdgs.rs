//! crates.io `fourdgs`: dynamic fields with linear motion.

use anyhow::Context;
use codec::{ClipInfo, Field, SH_C0, Temporal};
use fourdgs::quantization::Profile;
use fourdgs::{GaussianSet, SceneExtras, WriteOptions};

use super::peer_file::PeerFile;

/// Samples of a trajectory for the fit of a line.
const SAMPLES: usize = 9;

/// Highest level of `fourdgs`'s strongest back end.
const ZSTD_LEVEL: u32 = 19;

/// A file for each profile of `fourdgs`, the coarsest first.
pub(super) fn files(field: &Field, info: &ClipInfo) -> anyhow::Result<Vec<PeerFile>> {
    let duration_s = f64::from(info.duration_s);
    let set = to_set(field, duration_s);
    let profiles = [
        ("fourdgs, coarse", Profile::Coarse),
        ("fourdgs, default", Profile::Default),
        ("fourdgs, fine", Profile::Fine),
    ];
    let file = |(name, profile)| -> anyhow::Result<PeerFile> {
        let options = WriteOptions {
            profile,
            codec: fourdgs::codec::ZSTD,
            level: ZSTD_LEVEL,
            // Its verification reports colours that it clamps to [0, 1] as errors.
            verify: false,
            ..WriteOptions::default()
        };
        let bytes = fourdgs::write_to_vec(&set, duration_s, &options, &SceneExtras::default())?;
        let decoded = fourdgs::read_bytes(&bytes)?;
        let field = to_field(&decoded.gaussians, duration_s);
        field.check().map_err(|what| anyhow::anyhow!("{name}: {what}")).context("decoded")?;
        Ok(PeerFile {
            name,
            leaves_out: "curved trajectories, rotation over time",
            bytes: bytes.len(),
            field,
            decode: Box::new(move || {
                fourdgs::read_bytes(&bytes)?;
                Ok(())
            }),
        })
    };
    profiles.into_iter().map(file).collect()
}

/// Converts a field: times to seconds, trajectories to lines.
fn to_set(field: &Field, duration_s: f64) -> GaussianSet {
    let mut set = GaussianSet::default();
    for i in 0..field.len() {
        let Some(alive) = field.alive_interval(i) else { continue };
        let (tau, s) = match &field.temporal {
            Some(temporal) => (f64::from(temporal.tau[i]), f64::from(temporal.s[i])),
            None => (0.0, f64::INFINITY),
        };
        let (position, velocity) = line(field, i, alive, tau);
        let [w, x, y, z] = field.rotation_at(i, tau.clamp(alive.0, alive.1)).map(|c| c as f32);
        set.positions.extend(position.map(|x| x as f32));
        set.scales.extend(field.log_scales[i].map(f32::exp));
        set.rotations.extend([x, y, z, w]);
        set.colors.extend(field.sh_of(i)[0].map(|c| (0.5 + SH_C0 * f64::from(c)) as f32));
        set.colors.push(field.opacities[i]);
        set.motions.extend(velocity.map(|x| (x / duration_s) as f32));
        set.mu_t.push((tau * duration_s) as f32);
        set.sigma_t.push((s * duration_s) as f32);
        set.win_lo.push(0.0);
        // A window is open at its end, a clip is not.
        set.win_hi.push(f32::INFINITY);
    }
    set
}

/// Fits a line to the trajectory of Gaussian `i` while it is alive, by least squares weighted with squared
/// opacity. Returns the position at `tau` and the velocity per clip duration.
fn line(field: &Field, i: usize, (from, to): (f64, f64), tau: f64) -> ([f64; 3], [f64; 3]) {
    let samples: Vec<(f64, f64, [f64; 3])> = (0..SAMPLES)
        .map(|k| {
            let t = from + (to - from) * (k as f64 + 0.5) / SAMPLES as f64;
            (field.opacity_at(i, t).powi(2), t - tau, field.position_at(i, t))
        })
        .collect();
    let total: f64 = samples.iter().map(|(weight, ..)| weight).sum();
    let mean = |value: &dyn Fn(f64, [f64; 3]) -> f64| {
        samples.iter().map(|&(weight, d, position)| weight * value(d, position)).sum::<f64>() / total
    };
    let mean_d = mean(&|d, _| d);
    let variance = mean(&|d, _| (d - mean_d).powi(2));
    let slope = |axis: usize| {
        let covariance = mean(&|d, position| (d - mean_d) * position[axis]);
        if variance > 0.0 { covariance / variance } else { 0.0 }
    };
    let velocity = [slope(0), slope(1), slope(2)];
    let position = [0, 1, 2].map(|axis| mean(&|_, position| position[axis]) - mean_d * velocity[axis]);
    (position, velocity)
}

/// Converts decoded Gaussians to a field.
fn to_field(set: &GaussianSet, duration_s: f64) -> Field {
    let triples = |values: &[f32], change: &dyn Fn(f32) -> f32| -> Vec<[f32; 3]> {
        values.chunks_exact(3).map(|x| [change(x[0]), change(x[1]), change(x[2])]).collect()
    };
    let clip_time = |seconds: &f32| (f64::from(*seconds) / duration_s) as f32;
    let colors = set.colors.chunks_exact(4);
    Field {
        centers: triples(&set.positions, &|x| x),
        rotations: set.rotations.chunks_exact(4).map(|q| [q[3], q[0], q[1], q[2]]).collect(),
        log_scales: triples(&set.scales, &f32::ln),
        opacities: colors.clone().map(|color| color[3].clamp(0.0, 1.0)).collect(),
        sh_degree: 0,
        sh: colors.map(|color| [0, 1, 2].map(|c| ((f64::from(color[c]) - 0.5) / SH_C0) as f32)).collect(),
        temporal: Some(Temporal {
            tau: set.mu_t.iter().map(clip_time).collect(),
            s: set.sigma_t.iter().map(clip_time).collect(),
            motion_order: 1,
            motion: triples(&set.motions, &|x| (f64::from(x) * duration_s) as f32),
            rotation_rates: None,
        }),
        ..Field::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A Gaussian whose trajectory is a line plus `bend` times d^2.
    fn field(bend: f32) -> Field {
        Field {
            centers: vec![[1.0, 2.0, 3.0]],
            rotations: vec![[0.0, 1.0, 0.0, 0.0]],
            log_scales: vec![[-1.0, -2.0, -3.0]],
            opacities: vec![0.5],
            sh_degree: 0,
            sh: vec![[0.3, -0.2, 0.1]],
            temporal: Some(Temporal {
                tau: vec![0.5],
                s: vec![0.1],
                motion_order: 2,
                motion: vec![[4.0, 0.0, -1.0], [bend, 0.0, 0.0]],
                rotation_rates: None,
            }),
            ..Field::default()
        }
    }

    #[test]
    fn linear_motion_is_lossless() {
        let field = field(0.0);
        let back = to_field(&to_set(&field, 2.0), 2.0);
        assert_eq!(back.check(), Ok(()));
        for t in [0.3, 0.5, 0.7] {
            let (a, b) = (field.position_at(0, t), back.position_at(0, t));
            assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-5), "{a:?} {b:?}");
            assert!((field.opacity_at(0, t) - back.opacity_at(0, t)).abs() < 1e-6);
        }
        assert_eq!(back.rotations, field.rotations);
        let close = |a: &[f32; 3], b: &[f32; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-5);
        assert!(close(&back.sh[0], &field.sh[0]) && close(&back.log_scales[0], &field.log_scales[0]));
    }

    #[test]
    fn the_line_follows_the_mean_of_a_bend() {
        let field = field(10.0);
        let (position, velocity) = line(&field, 0, (0.2, 0.8), 0.5);
        // A centred parabola adds no slope, and its mean is above its vertex.
        assert!((velocity[0] - 4.0).abs() < 1e-9);
        assert!(position[0] > 1.0 && position[0] < 1.5, "{position:?}");
    }
}
