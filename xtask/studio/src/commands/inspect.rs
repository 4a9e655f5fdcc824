//! `aarc-studio inspect`: the contents of a package, and the optional parts that it lacks; of a field, what its file says.
//!
//! Decodes all segments, one after another, and so validates the file. A segment that is damaged or cut short is named, and
//! the others are listed.

mod field;
mod print;
mod rows;

use std::path::{Path, PathBuf};

use anyhow::bail;
use codec::{Clip, Contents, VERSION_MAJOR};
use formats::{is_field_file, is_package};
use program::{Fault, counted};
use serde::Serialize;

use crate::left_out::{LeftOut, TakeLeftOut};
use crate::scene::Scene;
use crate::segments::{Course, FieldFolder, Span, TakeFile, course, gaps};
use field::FieldInspection;
use rows::{Alive, Attribute, Audio, Damage, Layer, Plate, PosterRow, SectionSum, SegmentRow, ViewpointRow};

use super::options::JsonOption;

/// Fractions of the duration at which alive Gaussians are counted.
const TIMES: [f64; 5] = [0.0, 0.25, 0.5, 0.75, 1.0];

/// Show the contents of a package and the parts that it lacks, and validate it; of a field, what was read and assumed.
#[derive(clap::Args)]
pub struct Args {
    /// Package, a clip or a take, or a field of any format that package reads
    clip: PathBuf,
    #[command(flatten)]
    json: JsonOption,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    if is_field(&args.clip) {
        let inspection = FieldInspection::read(&args.clip)?;
        if args.json.is_given {
            println!("{}", serde_json::to_string_pretty(&inspection)?);
        } else {
            inspection.print(&args.clip);
        }
        return Ok(());
    }
    let file = TakeFile::open(&args.clip)?;
    let inspection = Inspection::new(&file)?;
    if args.json.is_given {
        println!("{}", serde_json::to_string_pretty(&inspection)?);
    } else {
        inspection.print(&args.clip);
    }
    if let Some(what) = inspection.damage() {
        bail!(Fault::Data(format!("{}: {what}", args.clip.display())));
    }
    Ok(())
}

/// Whether there is a field, or a folder with one, and no field folder.
fn is_field(path: &Path) -> bool {
    let has_name = path.file_name().and_then(|name| name.to_str()).is_some_and(is_field_file);
    match path.is_dir() {
        true => Scene::has_field(path) && !FieldFolder::is_one(path),
        false => path.is_file() && has_name && !is_package(path),
    }
}

/// Description of a package; the fields are the keys of the JSON.
#[derive(Serialize)]
struct Inspection {
    format_version: String,
    coder: &'static str,
    /// Size of the file, and the size that its head announces: more where the file was cut short.
    bytes: u64,
    bytes_announced: u64,
    /// Gaussians in complete layers, without the plates.
    gaussians: usize,
    #[serde(rename = "still")]
    static_count: usize,
    #[serde(rename = "moving")]
    dynamic_count: usize,
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
    /// The largest plate of a segment.
    plate: Option<Plate>,
    /// The sound of all segments.
    audio: Option<Audio>,
    /// The poster, which the first segment has.
    poster: Option<PosterRow>,
    damaged: Vec<Damage>,
    layers: Vec<Layer>,
    segments: Vec<SegmentRow>,
    course: Course,
    /// Parts that no segment shows, as seconds.
    gaps: Vec<[f64; 2]>,
    left_out: Vec<LeftOut>,
    /// Largest size in GPU buffers of a segment.
    gpu_bytes: usize,
    /// Where the bytes of the coder `rans` go; empty for the coder `fixed`.
    attributes: Vec<Attribute>,
    alive: Vec<Alive>,
    /// Size of the head of the file and of the heads of its segments.
    head_bytes: usize,
    sections: Vec<SectionSum>,
}

impl Inspection {
    /// Decodes all segments of a file, one after another.
    ///
    /// # Errors
    /// [`Fault::Data`] that names the first segment that is damaged or cut short, if nothing plays.
    fn new(file: &TakeFile) -> Result<Inspection, Fault> {
        let take = file.take();
        let mut inspection = Inspection::of_table(file);
        let (mut left_out, mut refusal) = (TakeLeftOut::of_table(take), None);
        for index in 0..take.segments.len() {
            match file.contents(index).and_then(|contents| Ok((contents, file.decode(index)?))) {
                Ok((contents, clip)) => {
                    left_out.add(take, &contents, &clip);
                    inspection.add(file, index, &contents, &clip);
                }
                Err(fault) => {
                    // A segment that is not there yet is not damaged.
                    if file.available(index) >= file.first_layer_bytes(index) {
                        inspection.note(file, index, "gaussians", &fault);
                    }
                    refusal = refusal.or(Some(fault));
                }
            }
        }
        if let Some(fault) = refusal.filter(|_| inspection.gaussians == 0) {
            return Err(fault);
        }
        inspection.layers.iter_mut().for_each(|layer| layer.gaussians -= left_out.plates);
        inspection.bytes_per_gaussian = inspection.bytes as f64 / inspection.gaussians as f64;
        (inspection.left_out, inspection.gpu_bytes) = (left_out.parts, left_out.segment_gpu_bytes);
        Ok(inspection)
    }

    /// What the head of a file and its table of segments tell.
    fn of_table(file: &TakeFile) -> Inspection {
        let (take, info) = (file.take(), &file.take().info);
        let spans: Vec<Span> = take.segments.iter().map(Span::from).collect();
        Inspection {
            format_version: format!("{VERSION_MAJOR}.{}", take.version_minor),
            coder: take.coder.name(),
            bytes: file.bytes(),
            bytes_announced: take.package_bytes(),
            gaussians: 0,
            static_count: 0,
            dynamic_count: 0,
            bytes_per_gaussian: 0.0,
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
            audio: None,
            poster: None,
            damaged: Vec::new(),
            layers: Layer::list(file),
            segments: (0..take.segments.len()).map(|index| SegmentRow::new(file, index)).collect(),
            course: course(take),
            gaps: gaps(take.duration_s, &spans),
            left_out: Vec::new(),
            gpu_bytes: 0,
            attributes: Vec::new(),
            alive: TIMES.map(|t| Alive { time_s: t * take.duration_s, candidates: 0, alive: 0 }).into(),
            head_bytes: take.head_bytes,
            sections: Vec::new(),
        }
    }

    /// Adds a decoded segment to the sums, and reads the sections without which it plays.
    fn add(&mut self, file: &TakeFile, index: usize, contents: &Contents, clip: &Clip) {
        self.static_count += clip.static_field.len();
        self.dynamic_count += clip.dynamic_field.len();
        self.gaussians += clip.len();
        self.head_bytes += contents.head_bytes;
        contents.sections.iter().for_each(|section| SectionSum::add(&mut self.sections, section));
        for alive in &mut self.alive {
            if file.take().holds(index, alive.time_s) {
                alive.add(clip, file.take().segments[index].clip_time(alive.time_s));
            }
        }
        match file.sound(index, contents) {
            Ok(sound) => {
                let (start_s, take_s) = (file.take().segments[index].start_s, file.take().duration_s);
                sound.iter().for_each(|sound| Audio::add(&mut self.audio, sound, start_s, take_s));
            }
            Err(fault) => self.note(file, index, "sound", &fault),
        }
        match if index == 0 { file.poster() } else { Ok(None) } {
            Ok(poster) => self.poster = self.poster.take().or(poster.map(PosterRow::from)),
            Err(fault) => self.note(file, index, "poster", &fault),
        }
        match file.attributes(index) {
            Ok(sizes) => sizes.iter().for_each(|size| Attribute::add(&mut self.attributes, size)),
            Err(fault) => self.note(file, index, "gaussians", &fault),
        }
    }

    /// Notes a damaged part of a segment.
    fn note(&mut self, file: &TakeFile, index: usize, section: &'static str, fault: &Fault) {
        // The file, and what to do, are said once.
        let text = fault.to_string();
        let text = text.strip_prefix(&format!("{}: ", file.path().display())).unwrap_or(&text);
        let problem = text.rsplit_once("; ").map_or(text, |(what, _)| what).to_owned();
        let row = &mut self.segments[index];
        (row.complete, row.problem) = (false, Some(problem.clone()));
        self.damaged.push(Damage { segment: index, section, problem });
    }

    /// The sentence about all damage, without the name of the file; `None` if there is none. What was cut short plays as
    /// far as it goes, and is not damaged.
    fn damage(&self) -> Option<String> {
        let Damage { segment: first, problem, .. } = self.damaged.first()?;
        let mut segments: Vec<usize> = self.damaged.iter().map(|damage| damage.segment).collect();
        segments.dedup();
        let what = match self.segments.len() {
            1 => self.damaged.iter().map(|damage| &damage.problem[..]).collect::<Vec<_>>().join("; "),
            all => {
                let (bad, all) = (segments.len(), counted(all, "segment"));
                format!("{bad} of {all} damaged, number {first} first: {problem}")
            }
        };
        Some(format!("{what}; the rest plays; get the file again"))
    }

    /// Number of layers that all segments have as a whole, and the most that a segment announces.
    fn layers_there(&self) -> (usize, usize) {
        (self.layers.iter().filter(|layer| layer.complete).count(), self.layers.len())
    }

    /// Share of the Gaussians in percent.
    fn percent(&self, gaussians: usize) -> f64 {
        100.0 * gaussians as f64 / self.gaussians as f64
    }
}
