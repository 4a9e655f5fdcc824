//! Finds the camera of each video by name, and compares the sizes of both.
//!
//! Names match if they are equal, or if the words of one are among the other's; case and punctuation do not count. Numbers
//! are words of their own, and so is what begins with a capital: `camA` is no `C`, and `cam1` no part of `cam10`. Words that
//! all videos or all cameras share tell none of them apart, as in `session1_cam10`.

use std::path::Path;

use codec::Camera;
use formats::list_of;
use program::Fault;

use super::calibration::{Calibration, RigCamera};
use super::options::ResizePolicy;
use super::videos::RigVideo;
use crate::capture::bad;

/// How far a principal point may be from the middle of a video where no size is stated, as a part of half its side: the
/// same pictures at three quarters of their size are off by a third.
const OFF_CENTER: f64 = 0.25;

/// The calibration that fits the videos, and the camera of each video, in their order; `say` gets a line where there are
/// several calibrations or sizes are missing, `warnings` the cameras without a video.
///
/// # Errors
/// [`Fault::Data`] if the only calibration does not fit; [`Fault::Usage`] if none of several does, or two that differ do.
pub(super) fn choose(
    videos: &[RigVideo],
    mut calibrations: Vec<Calibration>,
    resize: Option<ResizePolicy>,
    warnings: &mut Vec<String>,
    say: &mut dyn FnMut(&str),
) -> Result<(Calibration, Vec<RigCamera>), Fault> {
    // The cameras of the videos, and the warning on those without one.
    let fitted = |calibration: &Calibration| -> Result<(Vec<RigCamera>, Option<String>), Fault> {
        let (mut cameras, left_out) = cameras_of(videos, calibration)?;
        for (camera, video) in cameras.iter_mut().zip(videos) {
            camera.camera = sized(video, &camera.camera, resize)?;
            let check = camera.camera.check();
            let name = &camera.name;
            check.map_err(|problem| bad(&calibration.path, format!("camera {name}: {problem}")))?;
        }
        Ok((cameras, left_out))
    };
    let mut fits: Vec<_> = calibrations.iter().map(fitted).collect();
    if calibrations.len() == 1 {
        let (cameras, left_out) = fits.remove(0)?;
        warnings.extend(left_out);
        if calibrations[0].cameras.iter().any(|camera| camera.camera.width == 0) {
            say(
                "note: the calibration states no size, so it is taken to be of pictures as large as the videos",
            );
        }
        return Ok((calibrations.remove(0), cameras));
    }
    let names: Vec<String> = calibrations.iter().map(|calibration| file_name(&calibration.path)).collect();
    let list = names.join(", ");
    let mut fitting: Vec<usize> = (0..fits.len()).filter(|i| fits[*i].is_ok()).collect();
    // One without further cameras fits better.
    let is_exact = |i: &usize| matches!(fits[*i], Ok((_, None)));
    if fitting.iter().any(is_exact) {
        fitting.retain(is_exact);
    }
    let Some(chosen) = fitting.first().copied() else {
        let why = fits.remove(0).expect_err("none fits");
        let what = format!("none of the calibrations {list} fits the videos, the first because of ");
        return Err(Fault::Usage(format!("{what}{why}; name one with --calibration")));
    };
    let cameras_at = |i: usize| &fits[i].as_ref().expect("it fits").0;
    if fitting.iter().any(|i| !is_same(cameras_at(*i), cameras_at(chosen))) {
        return Err(Fault::Usage(format!(
            "the calibrations {list} differ, and several fit the videos; name one of them with --calibration"
        )));
    }
    let how = if fitting.len() == 1 { "alone fits the videos" } else { "is read" };
    say(&format!("note: calibrations found: {list}; {} {how}, --calibration names another", names[chosen]));
    let (cameras, left_out) = fits.swap_remove(chosen)?;
    warnings.extend(left_out);
    Ok((calibrations.swap_remove(chosen), cameras))
}

/// Largest difference of numbers that count as the same, relative to large ones: some programs write six digits.
const ROUNDING: f64 = 1e-5;

/// Whether cameras are the same, up to the rounding of text.
fn is_same(some: &[RigCamera], others: &[RigCamera]) -> bool {
    let numbers = |RigCamera { camera, lens, .. }: &RigCamera| {
        [camera.k.as_flattened(), camera.camera_from_world.as_flattened(), &lens.coefficients().1].concat()
    };
    let is_near = |(a, b): (&f64, &f64)| (a - b).abs() <= ROUNDING * (1.0 + a.abs());
    some.iter().zip(others).all(|(a, b)| {
        let [x, y] = [a, b].map(numbers);
        x.len() == y.len() && x.iter().zip(&y).all(is_near)
    })
}

/// The camera of each video, in their order, and the warning on cameras without a video.
///
/// # Errors
/// [`Fault::Data`] if a video has no camera or several, or a camera several videos.
fn cameras_of(
    videos: &[RigVideo],
    calibration: &Calibration,
) -> Result<(Vec<RigCamera>, Option<String>), Fault> {
    let path = &calibration.path;
    let mut cameras = Vec::new();
    let video_names: Vec<&str> = videos.iter().map(|video| video.name.as_str()).collect();
    let usable = calibration.cameras.iter().map(|camera| camera.name.as_str());
    let camera_names: Vec<&str> =
        usable.chain(calibration.unusable.iter().map(|(name, _)| name.as_str())).collect();
    let mut video_of: Vec<Option<usize>> = vec![None; camera_names.len()];
    for (v, found) in matches(&video_names, &camera_names).into_iter().enumerate() {
        let video = &videos[v];
        let c = camera_of(video, &found, calibration, &camera_names)?;
        if let Some(other) = video_of[c].replace(v) {
            return Err(bad(
                &video.path,
                format!(
                    "{} is of the same camera, {}; leave one of the two files there",
                    file_name(&videos[other].path),
                    camera_names[c]
                ),
            ));
        }
        let unusable = || calibration.unusable[c - calibration.cameras.len()].1.clone();
        cameras.push(calibration.cameras.get(c).cloned().ok_or_else(|| bad(path, unusable()))?);
    }
    let left_out = camera_names.iter().zip(&video_of).filter(|(_, video)| video.is_none());
    let warning = |names: String| {
        format!(
            "{}: no video of {names}; put it there under that name if it is to be in the capture",
            path.display()
        )
    };
    Ok((cameras, list_of(left_out.map(|(name, _)| *name)).map(warning)))
}

fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// The camera of a video, of the cameras that match its name.
fn camera_of(
    video: &RigVideo,
    found: &[usize],
    calibration: &Calibration,
    names: &[&str],
) -> Result<usize, Fault> {
    // Cameras of other programs may be named as paths, which no file can be.
    let name = |i: usize| names[i].replace(['/', '\\'], "_");
    match found {
        [camera] => Ok(*camera),
        [a, b, ..] => Err(bad(
            &video.path,
            format!("its name fits the cameras {} and {}; rename it to the name of one", name(*a), name(*b)),
        )),
        [] => {
            let names: Vec<String> = (0..calibration.cameras.len().min(12)).map(name).collect();
            let what = "has no camera of that name; rename it to one of";
            let calibration = calibration.path.display();
            Err(bad(&video.path, format!("{calibration} {what} {}, or take it away", names.join(", "))))
        }
    }
}

/// For each of `names` the numbers of `others` that match it, in the surest way in which any does.
pub(super) fn matches(names: &[&str], others: &[&str]) -> Vec<Vec<usize>> {
    let [all, all_others] = [names, others].map(|names| names.iter().copied().map(words).collect::<Vec<_>>());
    let [own, own_others] = [&all, &all_others].map(|all| without_shared(all));
    let is_within = |part: &[String], whole: &[String]| {
        !part.is_empty() && whole.windows(part.len()).any(|window| window == part)
    };
    let is_part = |a: &[String], b: &[String]| is_within(a, b) || is_within(b, a);
    // From the surest way to the least.
    let ways: [&dyn Fn(usize, usize) -> bool; 5] = [
        &|i, j| names[i] == others[j],
        &|i, j| !all[i].is_empty() && all[i].concat() == all_others[j].concat(),
        &|i, j| !own[i].is_empty() && own[i] == own_others[j],
        &|i, j| is_part(&own[i], &own_others[j]),
        &|i, j| is_part(&all[i], &all_others[j]),
    ];
    let found = |i: usize, way: &dyn Fn(usize, usize) -> bool| -> Vec<usize> {
        (0..others.len()).filter(|j| way(i, *j)).collect()
    };
    let best = |i| ways.iter().map(|way| found(i, way)).find(|found| !found.is_empty()).unwrap_or_default();
    (0..names.len()).map(best).collect()
}

/// The words of a name, in lower case. They begin after punctuation, where letters and digits meet, and at capitals after
/// small letters.
fn words(name: &str) -> Vec<String> {
    let chars: Vec<char> = name.chars().collect();
    let is_one = |a: &char, b: &char| {
        a.is_alphanumeric()
            && b.is_alphanumeric()
            && a.is_numeric() == b.is_numeric()
            && !(a.is_lowercase() && b.is_uppercase())
    };
    let word = |word: &[char]| word.iter().flat_map(|c| c.to_lowercase()).collect();
    chars.chunk_by(is_one).filter(|word| word[0].is_alphanumeric()).map(word).collect()
}

/// The words of each of several names without those that all of them share.
fn without_shared(names: &[Vec<String>]) -> Vec<Vec<String>> {
    let [first, rest @ ..] = names else { return Vec::new() };
    let mut own = names.to_vec();
    for word in first.iter().filter(|_| !rest.is_empty()) {
        let at = |name: &Vec<String>| name.iter().position(|other| other == word);
        if let Some(places) = own.iter().map(at).collect::<Option<Vec<usize>>>() {
            own.iter_mut().zip(places).for_each(|(name, place)| drop(name.remove(place)));
        }
    }
    own
}

/// The camera with the size of its video.
///
/// # Errors
/// [`Fault::Data`] that says how the sizes differ, and what helps.
fn sized(video: &RigVideo, camera: &Camera, resize: Option<ResizePolicy>) -> Result<Camera, Fault> {
    let ((width, height), (w, h)) = (video.probe.size, (camera.width, camera.height));
    let mut resized = Camera { width, height, ..camera.clone() };
    if (width, height) == (w, h) {
        return Ok(resized);
    }
    if (w, h) == (0, 0) {
        let [cx, cy] = [camera.k[0][2], camera.k[1][2]];
        let off = |center: f64, side: u32| (2.0 * center / f64::from(side) - 1.0).abs();
        return match off(cx, width).max(off(cy, height)) <= OFF_CENTER {
            true => Ok(resized),
            false => Err(bad(
                &video.path,
                format!(
                    "{width}x{height} pixels, but its calibration is of others: it states no size, and its principal point is \
                     at {cx:.0}, {cy:.0}; scale the video, or state the size there"
                ),
            )),
        };
    }
    let factors = [f64::from(width) / f64::from(w), f64::from(height) / f64::from(h)];
    match resize {
        Some(ResizePolicy::Scale) => {
            (0..2).for_each(|axis| resized.k[axis].iter_mut().for_each(|k| *k *= factors[axis]));
            return Ok(resized);
        }
        Some(ResizePolicy::Crop) => {
            let more = [f64::from(width) - f64::from(w), f64::from(height) - f64::from(h)];
            (0..2).for_each(|axis| resized.k[axis][2] += 0.5 * more[axis]);
            return Ok(resized);
        }
        None => {}
    }
    let proportions = factors[0] / factors[1];
    let why = if (height, width) == (w, h) {
        "it is rotated, or the calibration is; turn the video by its metadata, or calibrate with turned pictures"
            .to_owned()
    } else if width != w && height != h && (proportions - 1.0).abs() < 2.0 / f64::from(width.min(height)) {
        format!("it is scaled by {:.3}; --resize scale scales the camera, too", factors[0])
    } else {
        "other proportions; --resize scale if the pictures were scaled, --resize crop if as much was cut off (or added) on \
         both sides"
            .to_owned()
    };
    Err(bad(&video.path, format!("{width}x{height} pixels, but its calibration is of {w}x{h}: {why}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_a_size_the_principal_point_is_in_the_middle() {
        let video = super::super::videos::tests::video("a", 25.0);
        let size = |center: [f64; 2]| {
            let k = [[50.0, 0.0, center[0]], [0.0, 50.0, center[1]], [0.0, 0.0, 1.0]];
            let camera = Camera { width: 0, height: 0, k, camera_from_world: [[0.0; 4]; 4] };
            sized(&video, &camera, None)
                .map(|camera| (camera.width, camera.height))
                .map_err(|fault| fault.to_string())
        };
        assert_eq!(size([33.0, 20.0]), Ok((64, 48)));
        for center in [[64.0, 48.0], [42.7, 32.0], [32.0, 32.0], [16.0, 12.0]] {
            assert!(
                size(center).unwrap_err().contains("it states no size, and its principal point"),
                "{center:?}"
            );
        }
    }

    #[test]
    fn names_match_by_words() {
        for (names, others) in [
            (["cam01", "cam02", "cam10"], ["int_cam01_img", "int_cam02_img", "int_cam10_img"]),
            (["take-camA", "take-camB", "take-camC"], ["A", "B", "C"]),
            (["session1_cam1", "session1_cam2", "session1_cam10"], ["cam_1", "cam_2", "cam_10"]),
            (["cam_0", "cam_1", "cam_2"], ["0", "1", "2"]),
            (["session1_cam1", "session1_cam2", "session1_cam10"], ["1", "2", "10"]),
            (["cam01", "cam02", "cam03"], ["cam01/000000.png", "cam02/000000.png", "cam03/000000.png"]),
            (["A 2026-11-01", "B 2026-11-01", "C 2026-11-02"], ["a", "b", "c"]),
            (["Cam_01 (left)", "x", "cam1"], ["cam01left", "X", "CAM 1"]),
            (["1", "2", "a"], ["cam1left", "cam2left", "a"]),
        ] {
            assert_eq!(matches(&names, &others), [[0], [1], [2]], "{names:?} {others:?}");
            assert_eq!(matches(&others, &names), [[0], [1], [2]], "{others:?} {names:?}");
        }
        for (name, other) in
            [("cam1", "cam10"), ("1", "cam01"), ("1", "cam21"), ("-", "a"), ("b", "a"), ("cama", "A")]
        {
            assert!(matches(&[name], &[other])[0].is_empty(), "{name} {other}");
        }
        assert_eq!(matches(&["left_A"], &["left", "a"]), [[0, 1]], "two cameras");
    }
}
