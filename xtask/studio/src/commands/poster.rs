//! `aarc-studio poster`: shows or changes the poster of a package, the time and view that stand for it.
//!
//! Only the beginning of the file changes: the head, and of a take its first segment. Gaussians are copied, not coded
//! anew. The new file takes the place of the old one when it is complete.

use std::convert::Infallible;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use codec::{EncodeError, Limits, Poster, Viewpoint};
use glam::DVec3;
use program::{Fault, output};
use serde_json::json;

use crate::input::viewpoint;
use crate::messages::{bad_package, decimal, unreadable};
use crate::parse::three_numbers;
use crate::segments::TakeFile;

use super::options::JsonOption;

/// Bytes that are copied at a time.
const COPIED_BYTES: usize = 1 << 20;

/// Largest magnitude of a coordinate, in units of length.
const COORDINATE_MAX: f32 = 1e9;

/// Least angle between a view and the up axis, in radians: a tenth of what the player's camera, which turns around that
/// axis, leaves.
const TILT_MIN: f64 = 1e-4;

/// Show the poster of a package: the time and view that file managers and lists of clips show. With options: change it.
#[derive(clap::Args)]
#[command(group = clap::ArgGroup::new("change").multiple(true))]
pub struct Args {
    /// Package: a clip or a take
    clip: PathBuf,
    /// Seconds from the start of the clip [default: as before, else 0]
    #[arg(long, value_name = "S", group = "change")]
    time: Option<f64>,
    /// Look from this viewpoint, by name or number; or from one point at another, in the axes and units of the clip, with
    /// this vertical field of view in degrees, by default the first viewpoint's [default: as before, else the first]
    #[arg(long, value_name = "NAME|INDEX|X,Y,Z:X,Y,Z[:DEGREES]", value_parser = view, allow_hyphen_values = true,
          group = "change")]
    view: Option<PosterView>,
    /// Remove the poster
    #[arg(long, conflicts_with_all = ["time", "view"], group = "change")]
    remove: bool,
    /// Package to write [default: CLIP, whose place the new file takes when it is complete]
    #[arg(short, long, value_name = "PATH", requires = "change")]
    out: Option<PathBuf>,
    #[command(flatten)]
    json: JsonOption,
}

/// Where a poster looks from.
#[derive(Clone, Debug)]
enum PosterView {
    /// A viewpoint of the clip, by name or number.
    Named(String),
    /// Two points.
    Free {
        eye: [f32; 3],
        target: [f32; 3],
        /// Vertical field of view in degrees.
        fov: Option<f32>,
    },
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let out = args.out.as_ref().unwrap_or(&args.clip);
    let is_changed = args.time.is_some() || args.view.is_some() || args.remove;
    if is_changed {
        output::check(out)?;
    }
    let file = TakeFile::open(&args.clip)?;
    let mut source = File::open(&args.clip).map_err(|error| unreadable(&args.clip, &error))?;
    let start = start(&file, &mut source)?;
    let bad = |error: codec::Error| bad_package(&args.clip, &error);
    let before = codec::poster(&start, &Limits::default());
    if !is_changed {
        print(&args.clip, before.map_err(bad)?.as_ref(), args.json.is_given);
        return Ok(());
    }
    // A damaged poster is replaced.
    let poster = if args.remove { None } else { Some(chosen(args, &file, before.unwrap_or_default())?) };
    let changed = codec::with_poster(&start, poster.as_ref(), &Limits::default());
    let changed = changed.map_err(|error| match error {
        EncodeError::Package(error) => bad_package(&args.clip, &error),
        error => Fault::Usage(format!("{}: {error}", args.clip.display())),
    })?;
    output::write_parts(out, |output| {
        output.write(&changed)?;
        let mut bytes = vec![0; COPIED_BYTES];
        loop {
            match source.read(&mut bytes).map_err(|error| unreadable(&args.clip, &error))? {
                0 => return Ok::<(), Fault>(()),
                count => output.write(&bytes[..count])?,
            }
        }
    })?;
    print(out, poster.as_ref(), args.json.is_given);
    Ok(())
}

/// Reads the file up to the end of its first segment, and leaves it there.
///
/// # Errors
/// [`Fault::Data`] if it is cut short before.
fn start(file: &TakeFile, source: &mut File) -> Result<Vec<u8>, Fault> {
    let segment = &file.take().segments[0];
    let needed = segment.offset + segment.bytes() as u64;
    let mut start = Vec::new();
    let read = source.seek(SeekFrom::Start(0)).and_then(|_| source.take(needed).read_to_end(&mut start));
    read.map_err(|error| unreadable(file.path(), &error))?;
    if (start.len() as u64) < needed {
        let (path, count) = (file.path().display(), start.len());
        return Err(Fault::Data(format!(
            "{path}: cut short, {count} of the first {needed} bytes are there; get the file again"
        )));
    }
    Ok(start)
}

/// The poster that the options ask for.
///
/// # Errors
/// [`Fault::Usage`] for a time outside the clip, a viewpoint that it lacks, or a view without a direction or along the up
/// axis.
fn chosen(args: &Args, file: &TakeFile, before: Option<Poster>) -> Result<Poster, Fault> {
    let take = file.take();
    let time_s = args.time.or(before.map(|poster| poster.time_s)).unwrap_or(0.0);
    if !(0.0..=take.duration_s).contains(&time_s) {
        let end = decimal(take.duration_s, 3);
        return Err(Fault::Usage(format!("--time {time_s}: choose a time from 0 to {end} s")));
    }
    let viewpoints = file.viewpoints();
    let Viewpoint { position, target, fov_y, .. } = match (&args.view, before) {
        (Some(PosterView::Named(name)), _) => viewpoint(&viewpoints, name)?.clone(),
        (&Some(PosterView::Free { eye, target, fov }), _) => {
            check_direction(eye, target, take.info.up)?;
            let fov_y = fov.map_or(viewpoints[0].fov_y, f32::to_radians);
            Viewpoint { position: eye, target, fov_y, name: String::new() }
        }
        (None, Some(before)) => before.viewpoint(),
        (None, None) => viewpoints[0].clone(),
    };
    Ok(Poster { time_s, position, target, fov_y })
}

/// # Errors
/// [`Fault::Usage`] for a view without a direction, or along the up axis, which would be turned around it by chance.
fn check_direction(eye: [f32; 3], target: [f32; 3], up: [f32; 3]) -> Result<(), Fault> {
    let point = |[x, y, z]: [f32; 3]| format!("{x},{y},{z}");
    let (view, up_axis) = (format!("--view {}:{}", point(eye), point(target)), point(up));
    if eye == target {
        return Err(Fault::Usage(format!("{view}: it looks at its own eye: choose a point in front of it")));
    }
    let [from, to, axis] = [eye, target, up].map(|point| DVec3::from(point.map(f64::from)));
    let tilt = (to - from).cross(axis).length();
    if tilt >= TILT_MIN * (to - from).length() * axis.length() {
        return Ok(());
    }
    Err(Fault::Usage(format!(
        "{view}: the view is along the clip's up axis {up_axis}, so no side of the picture is up: move one of the points \
         aside"
    )))
}

fn print(path: &Path, poster: Option<&Poster>, is_json: bool) {
    if is_json {
        let poster = poster.map(|poster| {
            json!({
                "time_s": poster.time_s, "position": poster.position, "target": poster.target,
                "fov_y_deg": poster.fov_y.to_degrees(),
            })
        });
        println!("{:#}", json!({"clip": path, "poster": poster}));
        return;
    }
    match poster {
        None => println!("{}: no poster; lists show the first viewpoint at 0 s", path.display()),
        Some(Poster { time_s, position, target, fov_y }) => println!(
            "{}: poster at {} s, from {position:?}, looks at {target:?}, {:.1} degrees high",
            path.display(),
            decimal(*time_s, 3),
            fov_y.to_degrees()
        ),
    }
}

/// Parses two points and perhaps an angle; everything else names a viewpoint.
fn view(text: &str) -> Result<PosterView, Infallible> {
    let free = || {
        let mut parts = text.split(':');
        let (eye, target) = (point(parts.next()?)?, point(parts.next()?)?);
        let fov = parts.next().map(degrees);
        let is_complete = parts.next().is_none() && fov != Some(None);
        is_complete.then_some(PosterView::Free { eye, target, fov: fov.flatten() })
    };
    Ok(free().unwrap_or_else(|| PosterView::Named(text.into())))
}

fn point(text: &str) -> Option<[f32; 3]> {
    three_numbers(text, ',').filter(|point: &[f32; 3]| point.iter().all(|x| x.abs() <= COORDINATE_MAX))
}

fn degrees(text: &str) -> Option<f32> {
    text.parse::<f32>().ok().filter(|angle| (1.0..=179.0).contains(angle))
}
