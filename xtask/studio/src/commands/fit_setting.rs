//! [`FitSetting`]: a constant of a fit that experiments change, and no user has to.

use std::time::Duration;

use clap::ValueEnum;
use codec::PixelFilter;
use program::Fault;
use refine::anchor::Mirror;

use crate::fit::{CHECKPOINT_EVERY, DepthScale};

/// A constant, as `--set KEY=VALUE` states it.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum FitSetting {
    AnchorCameras(Vec<String>),
    Mirror(Mirror),
    MotionStart(bool),
    DepthScale(DepthScale),
    Filter(PixelFilter),
    Floor(bool),
    Fps(f64),
    FragmentWeight(f64),
    CheckpointEvery(Duration),
    Seed(u64),
}

/// The help of `--set`.
pub(super) const HELP: &str = "A constant of the fit, for experiments: anchor-cameras=NAME[,NAME..], mirror=auto|on|off, \
    motion-start=on|off, depth-scale=auto|metric|rig|hull, filter=mip|blur, floor=on|off, fragment-weight=W, \
    checkpoint-every=S, seed=N; or fps=F, the frame rate of a capture that states none (xtask/README.md lists them); \
    repeatable";

/// All of these constants.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct FitConstants {
    /// Cameras whose pixels become Gaussians of the anchor, by name, like the paper's frontal ones; empty for all.
    pub(super) anchor_cameras: Vec<String>,
    /// Whether the anchor's visible side is mirrored to its hidden side.
    pub(super) mirror: Mirror,
    /// Whether the anchor's Gaussians start on the motion of the surface between frames, rather than at rest.
    pub(super) motion_start: bool,
    /// How depth maps are scaled to the units of the cameras.
    pub(super) depth_scale: DepthScale,
    /// Low-pass filter of the field.
    pub(super) filter: PixelFilter,
    /// Whether pruning stops at the number of Gaussians asked for.
    pub(super) has_floor: bool,
    /// Captured frames per second, of a capture that does not state them.
    pub(super) fps: Option<f64>,
    /// Weight of the area that Gaussians cover in the loss, 0 to 1; `None` for the plan's weight.
    pub(super) fragment_weight: Option<f64>,
    pub(super) checkpoint_every: Duration,
    /// Seed of the random numbers.
    pub(super) seed: u64,
}

impl FitConstants {
    /// The defaults, with these settings; of equal keys the last one holds.
    pub(super) fn new(settings: &[FitSetting]) -> FitConstants {
        let mut constants = FitConstants {
            anchor_cameras: Vec::new(),
            mirror: Mirror::Auto,
            motion_start: true,
            depth_scale: DepthScale::Auto,
            filter: PixelFilter::Mip,
            has_floor: true,
            fps: None,
            fragment_weight: None,
            checkpoint_every: CHECKPOINT_EVERY,
            seed: 0,
        };
        for setting in settings {
            match setting {
                FitSetting::AnchorCameras(names) => constants.anchor_cameras.clone_from(names),
                FitSetting::Mirror(mirror) => constants.mirror = *mirror,
                FitSetting::MotionStart(is_on) => constants.motion_start = *is_on,
                FitSetting::DepthScale(scale) => constants.depth_scale = *scale,
                FitSetting::Filter(filter) => constants.filter = *filter,
                FitSetting::Floor(is_on) => constants.has_floor = *is_on,
                FitSetting::Fps(fps) => constants.fps = Some(*fps),
                FitSetting::FragmentWeight(weight) => constants.fragment_weight = Some(*weight),
                FitSetting::CheckpointEvery(time) => constants.checkpoint_every = *time,
                FitSetting::Seed(seed) => constants.seed = *seed,
            }
        }
        constants
    }
}

/// What a fit has that settings are about.
#[derive(Clone, Copy, Debug)]
pub(super) struct Subjects {
    /// Why there is no anchor, if there is none.
    pub(super) no_anchor: Option<&'static str>,
    /// Whether the fit starts from a field.
    pub(super) has_field: bool,
    /// Whether there are depth maps.
    pub(super) has_depths: bool,
    /// Whether the number of Gaussians changes.
    pub(super) prunes: bool,
}

/// Refuses settings that would have no effect.
pub(super) fn check_settings(settings: &[FitSetting], subjects: Subjects) -> Result<(), Fault> {
    let Subjects { no_anchor, has_field, has_depths, prunes } = subjects;
    for setting in settings {
        let (key, why) = match (setting, no_anchor) {
            (FitSetting::AnchorCameras(_), Some(why)) => ("anchor-cameras", why),
            (FitSetting::Mirror(_), Some(why)) => ("mirror", why),
            (FitSetting::MotionStart(_), Some(why)) => ("motion-start", why),
            (FitSetting::Filter(_), _) if has_field => {
                ("filter", "a fit that starts from a field keeps its filter")
            }
            (FitSetting::DepthScale(_), _) if !has_depths => ("depth-scale", "there are no depth maps"),
            (FitSetting::Floor(_), _) if !prunes => {
                ("floor", "--rule relocate keeps the number of Gaussians")
            }
            _ => continue,
        };
        return Err(Fault::Usage(format!("--set {key}: {why}; leave it out")));
    }
    Ok(())
}

/// Parses `KEY=VALUE`.
pub(super) fn fit_setting(text: &str) -> Result<FitSetting, String> {
    let (key, value) = text.split_once('=').ok_or("KEY=VALUE, such as seed=1")?;
    match key {
        "anchor-cameras" => Ok(FitSetting::AnchorCameras(value.split(',').map(str::to_owned).collect())),
        "mirror" => match value {
            "auto" => Ok(FitSetting::Mirror(Mirror::Auto)),
            "on" => Ok(FitSetting::Mirror(Mirror::On)),
            "off" => Ok(FitSetting::Mirror(Mirror::Off)),
            _ => Err("mirror is auto, on or off".into()),
        },
        "motion-start" => switch(key, value).map(FitSetting::MotionStart),
        "depth-scale" => DepthScale::from_str(value, false)
            .map(FitSetting::DepthScale)
            .map_err(|_| "depth-scale is auto, metric, rig or hull".into()),
        "filter" => match value {
            "mip" => Ok(FitSetting::Filter(PixelFilter::Mip)),
            "blur" => Ok(FitSetting::Filter(PixelFilter::Blur)),
            _ => Err("filter is mip or blur".into()),
        },
        "floor" => switch(key, value).map(FitSetting::Floor),
        "fps" => {
            let fps = value.parse().ok().filter(|fps| (1e-3..=1e6).contains(fps));
            fps.map(FitSetting::Fps).ok_or_else(|| "fps is a number from 0.001 to 1000000".into())
        }
        "fragment-weight" => fragment_weight(value).map(FitSetting::FragmentWeight),
        "checkpoint-every" => {
            let seconds = value.parse().ok().filter(|seconds| (1e-3..=1e6).contains(seconds));
            let every = seconds.map(|seconds| FitSetting::CheckpointEvery(Duration::from_secs_f64(seconds)));
            every.ok_or_else(|| "seconds from 0.001 to 1000000".into())
        }
        "seed" => value.parse().map(FitSetting::Seed).map_err(|_| "seed is a whole number from 0 on".into()),
        _ => Err(format!("there is no constant {key}")),
    }
}

/// Parses the weight of the fragment term.
pub(super) fn fragment_weight(text: &str) -> Result<f64, String> {
    let weight = text.parse().ok().filter(|weight| (0.0..=1.0).contains(weight));
    weight.ok_or_else(|| "a number from 0 to 1".into())
}

/// Parses the value of a switch.
pub(super) fn switch(key: &str, value: &str) -> Result<bool, String> {
    match value {
        "on" => Ok(true),
        "off" => Ok(false),
        _ => Err(format!("{key} is on or off")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_change_what_they_name() {
        let default = FitConstants::new(&[]);
        let set = |text: &str| FitConstants::new(&[fit_setting(text).unwrap()]);
        let cameras = vec!["00".to_owned(), "08".to_owned()];
        assert_eq!(set("anchor-cameras=00,08"), FitConstants { anchor_cameras: cameras, ..default.clone() });
        assert_eq!(set("mirror=off"), FitConstants { mirror: Mirror::Off, ..default.clone() });
        assert_eq!(set("motion-start=off"), FitConstants { motion_start: false, ..default.clone() });
        assert_eq!(set("depth-scale=rig"), FitConstants { depth_scale: DepthScale::Rig, ..default.clone() });
        assert_eq!(set("filter=blur"), FitConstants { filter: PixelFilter::Blur, ..default.clone() });
        assert_eq!(set("fps=12.5"), FitConstants { fps: Some(12.5), ..default.clone() });
        assert_eq!(set("floor=off"), FitConstants { has_floor: false, ..default.clone() });
        let fragment_weight = Some(0.25);
        assert_eq!(set("fragment-weight=0.25"), FitConstants { fragment_weight, ..default.clone() });
        let checkpoint_every = Duration::from_millis(500);
        assert_eq!(set("checkpoint-every=0.5"), FitConstants { checkpoint_every, ..default.clone() });
        assert_eq!(set("seed=7"), FitConstants { seed: 7, ..default.clone() });
        for key in [
            "anchor-cameras",
            "mirror",
            "motion-start",
            "depth-scale",
            "filter",
            "floor",
            "fps",
            "fragment-weight",
            "checkpoint-every",
            "seed",
        ] {
            assert!(HELP.contains(&format!("{key}=")), "{key}");
        }
        let twice = ["seed=1", "seed=2"].map(|text| fit_setting(text).unwrap());
        assert_eq!(FitConstants::new(&twice).seed, 2);
        for (text, why) in [
            ("seed", "KEY=VALUE"),
            ("seed=-1", "whole number"),
            ("mirror=maybe", "auto, on or off"),
            ("fragment-weight=2", "0 to 1"),
            ("checkpoint-every=0", "seconds from"),
            ("depth-scale=big", "auto, metric, rig or hull"),
            ("filter=none", "mip or blur"),
            ("floor=2", "floor is on or off"),
            ("fps=0", "0.001 to"),
            ("gravity=9.81", "no constant gravity"),
        ] {
            assert!(fit_setting(text).unwrap_err().contains(why), "{text}");
        }
    }
}
