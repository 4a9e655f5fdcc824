//! `aarc-studio inspect`: the contents of a package, and the optional parts that it lacks.
//!
//! Decodes the whole file, and so validates it.

mod rows;
mod take;

use std::path::{Path, PathBuf};

use crate::input::read_package;
use crate::left_out::{LeftOut, gpu_bytes, left_out};
use crate::messages::{bad_package, decimal};
use crate::segments::TakeFile;
use anyhow::bail;
use codec::{AttributeSize, Clip, Contents, Field, Limits, Region, SectionKind, VERSION_MAJOR};
use program::Fault;
use serde::Serialize;

use rows::{Audio, Damage, Plate, PosterRow, ViewpointRow};

/// Clip times at which alive Gaussians are counted.
const TIMES: [f64; 5] = [0.0, 0.25, 0.5, 0.75, 1.0];

/// Show the contents of a package and the parts that it lacks, and validate it.
#[derive(clap::Args)]
pub struct Args {
    /// Package: a clip or a take
    clip: PathBuf,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let file = TakeFile::open(&args.clip)?;
    if !file.is_clip() {
        return take::run(&file, args.json);
    }
    let bytes = read_package(&args.clip)?;
    let limits = Limits::default();
    let bad = |error: codec::Error| bad_package(&args.clip, &error);
    let contents = codec::contents(&bytes, &limits).map_err(bad)?;
    let clip = codec::decode(&bytes, &limits).map_err(bad)?;
    let attributes = codec::measure(&bytes, &limits).map_err(bad)?;
    let inspection = inspect(&bytes, contents, &clip, attributes);
    if args.json {
        println!("{}", serde_json::to_string_pretty(&inspection)?);
    } else {
        inspection.print(&args.clip);
    }
    if let Some(what) = Damage::sentence(&inspection.damaged) {
        bail!(Fault::Data(format!("{}: {what}", args.clip.display())));
    }
    Ok(())
}

/// Description of a package; the fields are the keys of the JSON.
#[derive(Serialize)]
struct Inspection {
    format_version: String,
    coder: &'static str,
    /// Size of the file, and the size that its head announces: more where the file was cut short.
    bytes: usize,
    bytes_announced: usize,
    /// Gaussians in complete layers, without the plate.
    gaussians: usize,
    #[serde(rename = "still")]
    static_count: usize,
    #[serde(rename = "moving")]
    dynamic_count: usize,
    bytes_per_gaussian: f64,
    duration_s: f32,
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
    plate: Option<Plate>,
    audio: Option<Audio>,
    poster: Option<PosterRow>,
    /// Sections that are damaged and without which the clip plays.
    damaged: Vec<Damage>,
    layers: Vec<Layer>,
    /// One, as a clip is a take of one segment.
    segments: [OnlySegment; 1],
    left_out: Vec<LeftOut>,
    gpu_bytes: usize,
    /// Where the bytes of the coder `rans` go; empty for the coder `fixed`.
    attributes: Vec<Attribute>,
    alive: Vec<Alive>,
    head_bytes: usize,
    sections: Vec<Section>,
}

/// The segment that an ordinary clip is.
#[derive(Serialize)]
struct OnlySegment {
    start_s: f64,
    duration_s: f64,
    level: u8,
    gaussians: usize,
    bytes: usize,
}

/// Cost of playing up to and including a layer.
#[derive(Serialize)]
struct Layer {
    /// Gaussians of this layer and the layers before it.
    gaussians: usize,
    /// Bytes of the file up to its end.
    bytes: usize,
    /// Whether the file holds the whole layer.
    complete: bool,
}

/// Coded size of an attribute of all Gaussians, and the sizes that simpler coders would reach for the same numbers.
#[derive(Serialize)]
struct Attribute {
    attribute: &'static str,
    /// Order-0 entropy: each number coded by its frequency alone. Preserves any order of the Gaussians.
    order_0_bytes: usize,
    /// Order-0 entropy of the prediction residuals. The coder chooses the order of the Gaussians.
    predicted_bytes: usize,
    /// Size as coded.
    coded_bytes: usize,
}

/// Gaussians at an instant.
#[derive(Serialize)]
struct Alive {
    time_s: f64,
    /// Gaussians that the time index lists, and all motionless ones.
    candidates: usize,
    /// Candidates with an opacity of at least 1/255.
    alive: usize,
}

#[derive(Serialize)]
struct Section {
    kind: String,
    region: &'static str,
    layer: u8,
    chunk: u32,
    offset: usize,
    bytes: usize,
    raw_bytes: usize,
}

fn inspect(bytes: &[u8], contents: Contents, clip: &Clip, attributes: Vec<AttributeSize>) -> Inspection {
    let info = &clip.info;
    let (limits, mut damaged) = (Limits::default(), Vec::new());
    let sound = contents.sound(bytes, &limits).map_err(|error| error.to_string());
    let audio = Damage::note(&mut damaged, "sound", sound).map(|sound| Audio::from(&sound));
    let poster = codec::poster(bytes, &limits).map_err(|error| error.to_string());
    let poster = Damage::note(&mut damaged, "poster", poster).map(PosterRow::from);
    Inspection {
        format_version: format!("{VERSION_MAJOR}.{}", contents.version_minor),
        coder: contents.coder.name(),
        bytes: bytes.len(),
        bytes_announced: contents.sections.last().map_or(contents.head_bytes, codec::Section::end),
        gaussians: clip.len(),
        static_count: clip.static_field.len(),
        dynamic_count: clip.dynamic_field.len(),
        bytes_per_gaussian: bytes.len() as f64 / clip.len() as f64,
        duration_s: info.duration_s,
        fps: info.fps,
        up: info.up,
        metres_per_unit: info.metres_per_unit,
        bounds: clip.bounds,
        viewpoints: info.viewpoints.iter().map(ViewpointRow::from).collect(),
        sh_degree: contents.sh_degree,
        motion_order: contents.motion_order,
        rotation_rates: contents.rotation_rates,
        filter: contents.filter.name(),
        near: Some(contents.near).filter(|near| *near > 0.0),
        by_device: contents.by_device,
        plate: clip.plate.as_ref().map(|plate| Plate {
            gaussians: plate.len(),
            sh_degree: plate.sh_degree,
            filter: plate.filter.name(),
        }),
        audio,
        poster,
        damaged,
        layers: layers(&contents, clip.layers.len()),
        segments: [OnlySegment {
            start_s: 0.0,
            duration_s: f64::from(info.duration_s),
            level: 0,
            gaussians: clip.len() + clip.plate.as_ref().map_or(0, Field::len),
            bytes: bytes.len(),
        }],
        left_out: left_out(&contents, clip),
        gpu_bytes: gpu_bytes(&contents, clip),
        attributes: attributes.into_iter().map(Attribute::from).collect(),
        alive: TIMES.iter().map(|&t| alive(clip, t)).collect(),
        head_bytes: contents.head_bytes,
        sections: contents.sections.iter().map(Section::from).collect(),
    }
}

fn layers(contents: &Contents, complete: usize) -> Vec<Layer> {
    let of_layer = |layer: usize| contents.sections.iter().filter(move |s| usize::from(s.layer) <= layer);
    let layers = contents.layers.iter().enumerate();
    layers
        .map(|(layer, end)| Layer {
            gaussians: end.total(),
            bytes: of_layer(layer).map(codec::Section::end).max().unwrap_or(contents.head_bytes),
            complete: layer < complete,
        })
        .collect()
}

fn alive(clip: &Clip, t: f64) -> Alive {
    let is_alive = |field: &Field, i: usize| field.opacity_at(i, t) >= codec::ALPHA_MIN;
    let static_alive = (0..clip.static_field.len()).filter(|&i| is_alive(&clip.static_field, i)).count();
    let mut counts = Alive {
        time_s: t * f64::from(clip.info.duration_s),
        candidates: clip.static_field.len(),
        alive: static_alive,
    };
    for range in clip.time_index.candidates(t, clip.layers.len()) {
        counts.candidates += range.len();
        counts.alive += range.filter(|&i| is_alive(&clip.dynamic_field, i)).count();
    }
    counts
}

impl From<AttributeSize> for Attribute {
    fn from(size: AttributeSize) -> Attribute {
        let [order_0_bytes, predicted_bytes, coded_bytes] =
            [size.order_0, size.predicted, size.coded].map(|bytes| bytes.round() as usize);
        Attribute { attribute: size.attribute, order_0_bytes, predicted_bytes, coded_bytes }
    }
}

impl From<&codec::Section> for Section {
    fn from(section: &codec::Section) -> Section {
        Section {
            kind: match section.kind {
                SectionKind::Gaussians => "gaussians".into(),
                SectionKind::TimeIndex => "time index".into(),
                SectionKind::Poster => "poster".into(),
                SectionKind::Sound => "sound".into(),
                SectionKind::Unknown(kind) => format!("unknown {kind}"),
            },
            region: region_name(section.region),
            layer: section.layer,
            chunk: section.chunk,
            offset: section.offset,
            bytes: section.length,
            raw_bytes: section.raw_length,
        }
    }
}

fn region_name(region: Region) -> &'static str {
    match region {
        Region::Static => "still",
        Region::Dynamic => "moving",
        Region::Plate => "plate",
    }
}

impl Inspection {
    // Long: one line of output after the other.
    fn print(&self, path: &Path) {
        println!("{}: .aarc {}, coder {}", path.display(), self.format_version, self.coder);
        if self.bytes < self.bytes_announced {
            let complete = self.layers.iter().filter(|layer| layer.complete).count();
            println!(
                "cut short: {} of {} bytes; plays as its first {complete} of {} layers",
                self.bytes,
                self.bytes_announced,
                self.layers.len()
            );
        }
        println!();
        println!(
            "gaussians   {} ({} motionless, {} moving or fading)",
            self.gaussians, self.static_count, self.dynamic_count
        );
        let mbps = self.bytes as f64 * 8e-6 / f64::from(self.duration_s);
        println!(
            "bytes       {}, {:.2} per Gaussian, {mbps:.2} Mbps; {} on the GPU",
            self.bytes, self.bytes_per_gaussian, self.gpu_bytes
        );
        let [duration_s, fps] = [self.duration_s, self.fps].map(|x| decimal(f64::from(x), 3));
        println!("duration    {duration_s} s at {fps} frames per second");
        println!("up          {:?}, {} m per unit", self.up, self.metres_per_unit);
        println!("bounds      {:?} to {:?}", self.bounds[0], self.bounds[1]);
        for view in &self.viewpoints {
            println!(
                "viewpoint   \"{}\" at {:?}, looks at {:?}, {:.1} degrees high",
                view.name, view.position, view.target, view.fov_y_deg
            );
        }
        let rotates = if self.rotation_rates { "rotation over time" } else { "no rotation over time" };
        println!(
            "columns     SH degree {}, motion of order {}, {rotates}",
            self.sh_degree, self.motion_order
        );
        println!("filter      {}", self.filter);
        if let Some(near) = self.near {
            println!("near        fades nearer than {near} units to the eye");
        }
        if self.by_device {
            println!("computed    by a graphics device; elsewhere the same field may give another package");
        }
        match &self.plate {
            Some(Plate { gaussians, sh_degree, filter }) => {
                println!("plate       {gaussians} Gaussians, SH degree {sh_degree}, filter {filter}")
            }
            None => println!("plate       none"),
        }
        let line = |section, value| Damage::line(&self.damaged, section, value);
        println!("sound       {}", line("sound", self.audio.as_ref().map(Audio::describe)));
        println!("poster      {}", line("poster", self.poster.as_ref().map(PosterRow::describe)));

        println!("\n{:<8}{:>12}{:>12}  (to its end)", "layer", "gaussians", "bytes");
        for (i, layer) in self.layers.iter().enumerate() {
            let missing = if layer.complete { "" } else { "  missing" };
            println!("{i:<8}{:>12}{:>12}{missing}", layer.gaussians, layer.bytes);
        }

        println!("\n{:<20}{:>8}{:>12}{:>12}", "sections", "number", "bytes", "raw bytes");
        println!("{:<20}{:>8}{:>12}", "head", 1, self.head_bytes);
        let mut kinds: Vec<String> = Vec::new();
        for section in &self.sections {
            let kind = section.name();
            if !kinds.contains(&kind) {
                kinds.push(kind);
            }
        }
        for kind in kinds {
            let of_kind = || self.sections.iter().filter(|section| section.name() == kind);
            let bytes: usize = of_kind().map(|section| section.bytes).sum();
            let raw_bytes: usize = of_kind().map(|section| section.raw_bytes).sum();
            println!("{kind:<20}{:>8}{bytes:>12}{raw_bytes:>12}", of_kind().count());
        }

        self.print_attributes();

        println!("\n{:<44}{:>12}{:>14}{:>12}", "left out", "gaussians", "package bytes", "GPU bytes");
        for part in &self.left_out {
            println!(
                "{:<44}{:>12}{:>14}{:>12}",
                part.part, part.gaussians, part.bytes_saved, part.gpu_bytes_saved
            );
        }
        println!("(package bytes: size of columns of zeros; with the coder fixed, before zstd)");

        println!("\n{:<12}{:>12}{:>12}{:>10}", "time in s", "candidates", "alive", "share");
        for Alive { time_s, candidates, alive } in &self.alive {
            let share = 100.0 * *alive as f64 / self.gaussians as f64;
            println!("{time_s:<12.3}{candidates:>12}{alive:>12}{share:>8.1} %");
        }
    }

    fn print_attributes(&self) {
        if self.attributes.is_empty() {
            return;
        }
        println!(
            "\n{:<22}{:>12}{:>12}{:>12}{:>14}",
            "bytes", "order 0", "predicted", "coded", "per Gaussian"
        );
        let row = |name: &str, [order_0, predicted, coded]: [usize; 3]| {
            let each = coded as f64 / self.gaussians as f64;
            println!("{name:<22}{order_0:>12}{predicted:>12}{coded:>12}{each:>14.2}");
        };
        let mut sums = [0; 3];
        for part in &self.attributes {
            let sizes = [part.order_0_bytes, part.predicted_bytes, part.coded_bytes];
            (0..3).for_each(|i| sums[i] += sizes[i]);
            row(part.attribute, sizes);
        }
        row("all", sums);
        println!("(order 0: entropy of the same rounded numbers, with the Gaussians in any order;");
        println!(" predicted: entropy of the prediction residuals, with the Gaussians in the coder's order)");
    }
}

impl Section {
    fn name(&self) -> String {
        match self.kind.as_str() {
            kind @ ("sound" | "poster") => kind.into(),
            kind => format!("{} {kind}", self.region),
        }
    }
}
