//! `inspect` of a take: its segments, decoded one after another, and what it asks for over time.
//!
//! A segment that is damaged or cut short is named, and the others are listed.

use anyhow::bail;
use codec::{Segment, Take, VERSION_MAJOR};
use program::Fault;
use serde::Serialize;

use super::rows::{Audio, Plate, PosterRow, ViewpointRow};
use crate::left_out::{LeftOut, TakeLeftOut};
use crate::messages::{count, decimal};
use crate::segments::{Course, Span, TakeFile, course, gaps};

/// Description of a take; the fields are the keys of the JSON, a clip's keys where they mean the same.
#[derive(Serialize)]
struct TakeInspection {
    format_version: String,
    coder: &'static str,
    /// Size of the file, and the size that its head announces: more where the file was cut short.
    bytes: u64,
    bytes_announced: u64,
    /// Gaussians that the table announces, without the plates where segments decode.
    gaussians: usize,
    bytes_per_gaussian: f64,
    duration_s: f64,
    fps: f32,
    up: [f32; 3],
    metres_per_unit: f32,
    bounds: [[f32; 3]; 2],
    viewpoints: Vec<ViewpointRow>,
    sh_degree: u8,
    motion_order: u8,
    rotation_rates: bool,
    filter: &'static str,
    /// In source units.
    #[serde(skip_serializing_if = "Option::is_none")]
    near: Option<f32>,
    by_device: bool,
    /// The largest plate.
    plate: Option<Plate>,
    /// The sound of all segments.
    audio: Option<Audio>,
    /// That of the first segment.
    poster: Option<PosterRow>,
    /// Sums over all segments of their first layers.
    layers: Vec<LayerSum>,
    segments: Vec<SegmentRow>,
    course: Course,
    /// Parts of the take that no segment shows, as seconds.
    gaps: Vec<[f64; 2]>,
    left_out: Vec<LeftOut>,
    /// Largest size in GPU buffers of a segment that decodes.
    segment_gpu_bytes: usize,
    head_bytes: usize,
}

#[derive(Serialize)]
struct SegmentRow {
    start_s: f64,
    duration_s: f64,
    level: u8,
    /// Gaussians and bytes that the table announces, the plate included.
    gaussians: usize,
    bytes: usize,
    layers: Vec<LayerSum>,
    /// Whether all of it is in the file and decodes.
    complete: bool,
    /// Whether what is in the file does not decode.
    damaged: bool,
    /// What is missing or damaged.
    problem: Option<String>,
}

/// Cost of a layer and the layers before it.
#[derive(Clone, Copy, Serialize)]
struct LayerSum {
    gaussians: usize,
    bytes: u64,
}

/// Inspects a take and prints it.
///
/// # Errors
/// [`Fault::Data`] that names the first segment that is damaged, after everything is printed. A take that was cut
/// short plays as far as it goes, and is none.
pub(super) fn run(file: &TakeFile, json: bool) -> anyhow::Result<()> {
    let inspection = inspect(file);
    match json {
        true => println!("{}", serde_json::to_string_pretty(&inspection)?),
        false => inspection.print(file),
    }
    let mut bad = inspection.segments.iter().enumerate().filter(|(_, segment)| segment.damaged);
    if let Some((index, first)) = bad.next() {
        let all = count(inspection.segments.len(), "segment");
        let problem = first.problem.as_deref().unwrap_or_default();
        bail!(Fault::Data(format!(
            "{}: {} of {all} damaged, number {index} first: {problem}; get the file again",
            file.path().display(),
            1 + bad.count()
        )));
    }
    Ok(())
}

/// What segments add to.
struct Sums {
    left_out: TakeLeftOut,
    audio: Option<Audio>,
    poster: Option<PosterRow>,
}

/// Decodes a segment and adds it to the sums, and its sound to the sound of the segments before. The first one has the
/// poster.
fn row(file: &TakeFile, index: usize, sums: &mut Sums) -> SegmentRow {
    let (take, segment) = (file.take(), &file.take().segments[index]);
    let available = file.available(index);
    let first_layer = segment.layers.first().map_or(0, |layer| layer.bytes);
    let missing = segment.bytes() - available;
    let mut problem = (missing > 0).then(|| format!("{missing} of {} bytes are missing", segment.bytes()));
    let mut damaged = false;
    match file.contents(index).and_then(|contents| Ok((contents, file.decode(index)?))) {
        Ok((contents, clip)) => {
            sums.left_out.add(take, &contents, &clip);
            match file.sound(index, &contents) {
                Ok(sound) => match (sound.as_ref().map(Audio::from), &mut sums.audio) {
                    (Some(sound), Some(all)) => all.add(&sound),
                    (Some(sound), none) => *none = Some(sound),
                    (None, _) => {}
                },
                Err(error) => (problem, damaged) = (Some(without_file(&error, file)), true),
            }
            if index == 0 {
                match file.poster() {
                    Ok(poster) => sums.poster = poster.map(PosterRow::from),
                    Err(error) => (problem, damaged) = (Some(without_file(&error, file)), true),
                }
            }
        }
        Err(_) if available < first_layer => {}
        Err(error) => (problem, damaged) = (Some(without_file(&error, file)), true),
    }
    SegmentRow::new(segment, problem, damaged)
}

fn inspect(file: &TakeFile) -> TakeInspection {
    let take = file.take();
    let mut sums = Sums { left_out: TakeLeftOut::of_table(take), audio: None, poster: None };
    let segments = (0..take.segments.len()).map(|index| row(file, index, &mut sums)).collect();
    let Sums { left_out: TakeLeftOut { parts: left_out, plates, segment_gpu_bytes }, audio, poster } = sums;
    let gaussians = take.segments.iter().map(Segment::gaussians).sum::<usize>() - plates;
    let spans: Vec<Span> = take.segments.iter().map(Span::from).collect();
    let info = &take.info;
    TakeInspection {
        format_version: format!("{VERSION_MAJOR}.{}", take.version_minor),
        coder: take.coder.name(),
        bytes: file.bytes(),
        bytes_announced: take.package_bytes(),
        gaussians,
        bytes_per_gaussian: file.bytes() as f64 / gaussians as f64,
        duration_s: take.duration_s,
        fps: info.fps,
        up: info.up,
        metres_per_unit: info.metres_per_unit,
        bounds: take.bounds,
        viewpoints: info.viewpoints.iter().map(ViewpointRow::from).collect(),
        sh_degree: take.sh_degree,
        motion_order: take.motion_order,
        rotation_rates: take.rotation_rates,
        filter: take.filter.name(),
        near: Some(take.near).filter(|near| *near > 0.0),
        by_device: take.by_device,
        plate: (take.plate_len > 0).then(|| Plate {
            gaussians: take.plate_len,
            sh_degree: take.plate_sh_degree,
            filter: take.plate_filter.name(),
        }),
        audio,
        poster,
        layers: layer_sums(take),
        segments,
        course: course(take),
        gaps: gaps(take.duration_s, &spans),
        left_out,
        segment_gpu_bytes,
        head_bytes: take.head_bytes,
    }
}

/// The message of a fault without the name of the file, which is said once.
fn without_file(error: &Fault, file: &TakeFile) -> String {
    let text = error.to_string();
    let text = text.strip_prefix(&format!("{}: ", file.path().display())).unwrap_or(&text);
    text.strip_suffix("; get the file again").unwrap_or(text).to_owned()
}

/// Gaussians and bytes of the first layers of all segments; a segment of fewer layers counts as a whole.
fn layer_sums(take: &Take) -> Vec<LayerSum> {
    let most = take.segments.iter().map(|segment| segment.layers.len()).max().unwrap_or(0);
    let sum = |k: usize| {
        let layers =
            take.segments.iter().filter_map(|segment| segment.layers.get(k).or(segment.layers.last()));
        let mut sum = LayerSum { gaussians: 0, bytes: take.head_bytes as u64 };
        for layer in layers {
            sum.gaussians += layer.gaussians;
            sum.bytes += layer.bytes as u64;
        }
        sum
    };
    (0..most).map(sum).collect()
}

impl SegmentRow {
    fn new(segment: &Segment, problem: Option<String>, damaged: bool) -> SegmentRow {
        let layers = segment.layers.iter();
        SegmentRow {
            start_s: segment.start_s,
            duration_s: segment.duration_s,
            level: segment.level,
            gaussians: segment.gaussians(),
            bytes: segment.bytes(),
            layers: layers
                .map(|layer| LayerSum { gaussians: layer.gaussians, bytes: layer.bytes as u64 })
                .collect(),
            complete: problem.is_none(),
            damaged,
            problem,
        }
    }
}

impl TakeInspection {
    // Long: one line after the other.
    fn print(&self, file: &TakeFile) {
        let row = |name: &str, value: String| println!("{name:<20}{value}");
        let name = file.path().display();
        let segments = count(self.segments.len(), "segment");
        println!(
            "{name}: a take of {segments}, package version {}, coder {}",
            self.format_version, self.coder
        );
        let announced = match self.bytes < self.bytes_announced {
            true => format!(" of {}, cut short", self.bytes_announced),
            false => String::new(),
        };
        row("bytes", format!("{}{announced}, {:.2} per Gaussian", self.bytes, self.bytes_per_gaussian));
        row("head", format!("{} bytes, the table of segments included", self.head_bytes));
        row("Gaussians", format!("{}, at most {} at an instant", self.gaussians, self.course.resident_max));
        let Course { startup_bytes, mean_mbps, peak_mbps, peak_s, rows, .. } = &self.course;
        row("duration", format!("{} s, {} frames per second", decimal(self.duration_s, 3), self.fps));
        for [from, to] in &self.gaps {
            row("gap", format!("no segment shows {} to {} s", decimal(*from, 3), decimal(*to, 3)));
        }
        row("first instant", format!("{startup_bytes} bytes"));
        row(
            "Mbps",
            format!(
                "{mean_mbps:.2} in the mean; after the first instant at most {peak_mbps:.2} over one second, from {peak_s:.3} s"
            ),
        );
        row("SH degree", self.sh_degree.to_string());
        let rotation = if self.rotation_rates { ", with rotation rates" } else { "" };
        row("motion", format!("power {}{rotation}", self.motion_order));
        row("filter", self.filter.into());
        if let Some(near) = self.near {
            row("near", format!("fades nearer than {near} units to the eye"));
        }
        if self.by_device {
            row("computed", "by a graphics device; elsewhere the same fields may give another take".into());
        }
        if let Some(plate) = &self.plate {
            row("plate", format!("{} Gaussians at most, SH degree {}", plate.gaussians, plate.sh_degree));
        }
        row("sound", self.audio.as_ref().map_or("none".into(), Audio::describe));
        row("poster", self.poster.as_ref().map_or("none".into(), PosterRow::describe));
        for view in &self.viewpoints {
            row("viewpoint", view.name.clone());
        }

        println!("\n{:<8}{:>12}{:>14}", "layers", "Gaussians", "bytes");
        for (k, layer) in self.layers.iter().enumerate() {
            println!("{:<8}{:>12}{:>14}", k + 1, layer.gaussians, layer.bytes);
        }

        println!(
            "\n{:<8}{:>11}{:>12}{:>7}{:>8}{:>12}{:>12}",
            "segment", "from, s", "seconds", "level", "layers", "Gaussians", "bytes"
        );
        for (i, segment) in self.segments.iter().enumerate() {
            let problem = segment.problem.as_ref().map_or(String::new(), |what| format!("  {what}"));
            println!(
                "{i:<8}{:>11.3}{:>12.3}{:>7}{:>8}{:>12}{:>12}{problem}",
                segment.start_s,
                segment.duration_s,
                segment.level,
                segment.layers.len(),
                segment.gaussians,
                segment.bytes
            );
        }

        println!(
            "\n{:<11}{:>11}{:>10}{:>12}{:>12}{:>9}",
            "from, s", "to, s", "segments", "Gaussians", "bytes", "Mbps"
        );
        for row in rows {
            println!(
                "{:<11.3}{:>11.3}{:>10}{:>12}{:>12}{:>9.2}",
                row.from_s, row.to_s, row.segments, row.gaussians, row.bytes, row.mbps
            );
        }
        println!("(segments and Gaussians: the most at an instant; bytes: of segments that begin)");

        println!("\n{:<44}{:>12}{:>14}{:>12}", "left out", "gaussians", "package bytes", "GPU bytes");
        for part in &self.left_out {
            println!(
                "{:<44}{:>12}{:>14}{:>12}",
                part.part, part.gaussians, part.bytes_saved, part.gpu_bytes_saved
            );
        }
    }
}
