//! From the videos of a rig and its calibration to a capture.
//!
//! ```text
//! videos:      finds and probes the files
//! calibration: reads the cameras; matching finds the camera of each video
//! starts:      when each video begins: stated, by timecode, or by sound
//! placement:   up, metres per unit, origin
//! pictures:    a few frames of each video; features are their corners
//! epipolar:    the calibration against the corners
//! plates:      what each camera shows without the subject; mattes: which part of each frame is the subject
//! write:       capture.json, which refers to the videos
//! page:        ingest.html, which shows whether all that is any good
//! ```
//!
//! The steps run one after another, each from the results of the steps before. Steps that cost time keep their results
//! in the output's folder, where `store` says under which conditions they count.

mod calibration;
mod epipolar;
mod features;
mod findings;
mod life_size;
mod matching;
mod matte_sheet;
mod mattes;
mod options;
mod page;
mod pictures;
mod placement;
mod plates;
mod sound;
mod starts;
mod store;
mod videos;
mod write;

use std::path::Path;

use program::{Fault, output};
use rayon::prelude::*;
use refine::capture::Lens;
use serde_json::json;

use crate::capture::{CaptureFiles, bad, check_fps, check_length, picture_notes};
use crate::messages::{count, decimal};
use calibration::RigCamera;
use findings::CameraFindings;
pub use findings::IngestFindings;
use mattes::MatteSettings;
pub use options::{ExtractFormat, IngestOptions, MattePolicy, Offsets, ResizePolicy, UpSource};
use store::{Store, identity};
use videos::RigVideo;

/// Folder of kept results in the output's.
const STORE: &str = "ingest";

/// File name of the page.
pub const PAGE: &str = "ingest.html";

/// Makes the capture `out` of the videos in `rig`; `say` gets a line for each step.
///
/// # Errors
/// [`Fault::Usage`] if a program is missing or an option contradicts the rig; [`Fault::Data`] if a file is unusable.
// Long: one step after another, each with its line.
pub fn ingest(
    rig: &Path,
    out: &Path,
    options: &IngestOptions,
    say: &mut dyn FnMut(&str),
) -> anyhow::Result<IngestFindings> {
    if !rig.is_dir() {
        std::fs::metadata(rig).map_err(|error| crate::messages::unreadable(rig, &error))?;
        return Err(bad(rig, "a file; a rig is a folder of videos, so name that").into());
    }
    if options.height_m.is_some() && options.mattes == MattePolicy::Off {
        let what =
            "--height measures the subject in its mattes; leave --mattes off out, or state --metres-per-unit";
        return Err(Fault::Usage(what.into()).into());
    }
    let mut warnings = Vec::new();
    let paths = videos::find(rig, &mut warnings)?;
    output::check_folder(out)?;
    let manifest = out.join(write::MANIFEST);
    if manifest.exists() && !out.join(STORE).is_dir() {
        let what = "it is not from an earlier run of ingest, which would replace it; name another --out";
        return Err(Fault::Usage(format!("{}: {what}", manifest.display())).into());
    }
    output::make_folder(out)?;
    let store = Store::open(out.join(STORE))?;

    let probed =
        paths.par_iter().map(|path| videos::probe(&store, path)).collect::<Result<Vec<_>, Fault>>()?;
    let is_kept = probed.iter().all(|(_, is_kept)| *is_kept);
    let videos: Vec<RigVideo> = probed.into_iter().map(|(video, _)| video).collect();
    say(&line("videos", is_kept, &describe_videos(&videos)));
    warnings.extend(picture_notes(videos.iter().map(|video| (video.name.as_str(), &video.probe.unusual))));

    let calibrations = calibration::read(rig, options.calibration.as_deref(), &mut warnings)?;
    let (calibration, mut cameras) =
        matching::choose(&videos, calibrations, options.resize, &mut warnings, say)?;
    let layout = calibration.layout;
    say(&line("cameras", false, &format!("{} by {layout}, {}", cameras.len(), calibration.path.display())));

    let starts = starts::find(&store, &videos, &options.offsets, &mut warnings, &mut |what| {
        say(&line("sound", false, what));
    })?;
    let fps = options.fps.unwrap_or_else(|| videos::commonest_fps(&videos));
    let frames = write::frames(&videos, &starts, fps);
    check_fps(fps).and_then(|()| check_length(frames)).map_err(|problem| {
        bad(rig, format!("{problem}; cut the videos into parts, or state fewer frames a second with --fps"))
    })?;
    say(&line("starts", starts.is_kept, &findings::describe_starts(&starts, &videos)));
    warnings.extend(findings::drift_warnings(&starts, &videos, fps, frames));

    let mut placement = placement::place(&mut cameras, &calibration, options)?;
    placement.notes.iter().for_each(|note| say(&format!("note: {note}")));

    let instants_s = pictures::instants_s((frames - 1) as f64 / fps);
    let decoded = videos
        .par_iter()
        .zip(&starts.starts_s)
        .map(|(video, start_s)| pictures::decode(&store, video, *start_s, &instants_s))
        .collect::<Result<Vec<_>, Fault>>()?;
    let is_kept = decoded.iter().all(|(_, is_kept)| *is_kept);
    let pictures: Vec<pictures::Pictures> = decoded.into_iter().map(|(pictures, _)| pictures).collect();
    say(&line("pictures", is_kept, &format!("{} of each camera", pictures::FRAMES)));

    let features: Vec<&[features::Features]> = pictures.iter().map(|pictures| &*pictures.features).collect();
    let key = json!([key_of(&cameras), key_of_videos(&videos)?, starts.starts_s, frames, fps]);
    let (epipolar, is_kept) = store.result("epipolar", &key, || Ok(epipolar::check(&cameras, &features)))?;
    say(&line("calibration", is_kept, &findings::describe_epipolar(&epipolar)));
    warnings.extend(findings::epipolar_warnings(&epipolar, &videos));

    let settings = MatteSettings { plates: options.plates.as_deref(), policy: options.mattes, frames, fps };
    let (mattes, is_kept) = mattes::make(&store, out, &videos, &starts.starts_s, settings)?;
    say(&line("mattes", is_kept, &findings::describe_mattes(&mattes)));
    warnings.extend(findings::matte_warnings(&mattes, &videos));
    warnings.iter().for_each(|warning| say(&format!("warning: {warning}")));

    let parts = write::CaptureParts {
        videos: &videos,
        cameras: &cameras,
        starts: &starts,
        fps,
        frames,
        has_masks: options.mattes == MattePolicy::On,
    };
    let before = std::fs::read_to_string(&manifest).ok();
    write::write(&store, out, &parts, &placement, options.extract)?;
    // A capture that cannot be read, or of another size than was asked for, must not be taken for it.
    let undo = || match before.as_ref().filter(|before| write::is_same_but_for_size(before, &manifest)) {
        Some(before) => output::write(&manifest, before.as_bytes()),
        None => output::remove(&manifest).map(drop),
    };
    // What was written is what the other commands read.
    let capture_files =
        CaptureFiles::open(out).or_else(|error| undo().map_err(Into::into).and(Err(error)))?;
    capture_files.notes.iter().for_each(|note| say(&format!("note: {}: {note}", out.display())));
    if let Some(height_m) = options.height_m {
        let metres = life_size::metres_per_unit(&capture_files, placement.up, height_m);
        let life_size::Measure { value: metres, spread } = metres.or_else(|error| undo().and(Err(error)))?;
        say(&line(
            "size",
            false,
            &format!(
                "{} metres per unit, by the height of the subject, with a spread of {} % between views",
                decimal(metres, 5),
                decimal(100.0 * spread, 1)
            ),
        ));
        placement.metres_per_unit = Some(metres);
        write::write(&store, out, &parts, &placement, options.extract)?;
    }
    let findings = IngestFindings {
        rig: rig.display().to_string(),
        calibration: calibration.path.display().to_string(),
        layout: layout.to_owned(),
        fps,
        frames,
        cameras: videos
            .iter()
            .zip(&cameras)
            .map(|(video, camera)| CameraFindings::new(video, camera))
            .collect(),
        starts,
        placement,
        epipolar,
        mattes: mattes.iter().map(mattes::CameraMattes::without_pictures).collect(),
        warnings,
    };
    let page = page::page(&findings, &pictures, &instants_s, &mattes)?;
    output::write(&out.join(PAGE), page.as_bytes())?;
    say(&line(
        "capture",
        false,
        &format!(
            "{}, {} a second, {} s: {}",
            count(frames, "frame"),
            decimal(fps, 3),
            decimal((frames - 1) as f64 / fps, 2),
            out.join(write::MANIFEST).display()
        ),
    ));
    say(&line("page", false, &out.join(PAGE).display().to_string()));
    Ok(findings)
}

/// A line of the terminal.
fn line(step: &str, is_kept: bool, text: &str) -> String {
    format!("{step:<12}{text}{}", if is_kept { " (kept from an earlier run)" } else { "" })
}

fn describe_videos(videos: &[RigVideo]) -> String {
    let seconds: f64 = videos.iter().map(|video| video.probe.duration_s).sum();
    let mut sizes: Vec<(u32, u32)> = videos.iter().map(|video| video.probe.size).collect();
    sizes.sort_unstable();
    sizes.dedup();
    let sizes: Vec<String> = sizes.into_iter().map(|(w, h)| format!("{w}x{h}")).collect();
    let count_videos = |is: fn(&RigVideo) -> bool| videos.iter().filter(|video| is(video)).count();
    format!(
        "{} of {}, {:.1} s in all, {} with sound, {} at a variable rate",
        videos.len(),
        sizes.join(" and "),
        seconds,
        count_videos(|video| video.probe.has_sound),
        count_videos(|video| video.probe.is_variable)
    )
}

/// What the check depends on of cameras.
fn key_of(cameras: &[RigCamera]) -> serde_json::Value {
    let numbers = |RigCamera { camera, lens, .. }: &RigCamera| {
        let lens: &Lens = lens;
        json!([camera.width, camera.height, camera.k, camera.camera_from_world, lens.coefficients()])
    };
    cameras.iter().map(numbers).collect()
}

fn key_of_videos(videos: &[RigVideo]) -> Result<serde_json::Value, Fault> {
    videos.iter().map(|video| identity(&video.path)).collect::<Result<Vec<_>, Fault>>().map(Into::into)
}
