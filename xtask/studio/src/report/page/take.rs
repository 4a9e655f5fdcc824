//! [`TakeFindings`]: what a take costs and how exact it is over time.
//!
//! All costs are counts, which depend on no machine.

use std::fmt::Write;

use anyhow::Context;
use measure::parameter::{FlowStage, Parameter};
use refine::metrics;
use serde::Serialize;
use serde_json::{Map, Value};

use super::photographs::TakePhotographs;
use super::{parameter_lines, rows, section};
use crate::eval::FrameErrors;
use crate::left_out::LeftOut;
use crate::messages::{count, decimal};
use crate::page::{LineChart, PlotLine, Scale, Table, escape, grouped, svg};
use crate::report::ReportPart;
use crate::segments::{Course, CourseRow};

/// Most cuts that plots mark: more would cover them.
const CUTS_MAX: usize = 100;

/// Measurements of a take.
#[derive(Debug)]
pub struct TakeFindings {
    /// Name of the take.
    pub name: String,
    /// Processor and operating system.
    pub machine: String,
    /// What was measured, and how.
    pub setup: TakeSetup,
    /// What the take asks of a player and of the network.
    pub course: Course,
    /// Seconds at which a segment begins or ends, ascending, without the ends of the take.
    pub cuts: Vec<f64>,
    /// Parts of the take that no segment shows, as seconds.
    pub gaps: Vec<[f64; 2]>,
    /// Instants in their order.
    pub instants: Vec<TakeInstant>,
    /// PSNR of the first layers at several instants.
    pub layers: Vec<LayerInstant>,
    /// What photographs show; `None` if no capture was given.
    pub photographs: Option<TakePhotographs>,
    /// The number of layers as a parameter: error against bytes. `None` if every segment has one layer.
    pub parameter: Option<Parameter>,
    /// Optional parts that segments lack.
    pub(crate) left_out: Vec<LeftOut>,
}

/// A take, and the pictures that measure it.
#[derive(Clone, Debug, Serialize)]
pub struct TakeSetup {
    /// Number of segments.
    pub segments: usize,
    /// Gaussians of all segments, plates included.
    pub gaussians: usize,
    /// Size of the package in bytes.
    pub bytes: u64,
    /// Duration in seconds.
    pub duration_s: f64,
    /// Most layers of a segment.
    pub layers: usize,
    /// Size of the pictures in pixels.
    pub size: [u32; 2],
    /// Name of the first viewpoint, which they are seen from.
    pub viewpoint: String,
    /// Number of cameras: at that viewpoint, and where people stand.
    pub cameras: usize,
    /// Name of the field that the take is compared with; `None` if none was given.
    pub reference: Option<String>,
}

/// What a player does at an instant, and how exact its picture is.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TakeInstant {
    /// Second of the take.
    pub t_s: f64,
    /// Whether a segment begins or ends here, or a moment later.
    pub is_cut: bool,
    /// Segments that hold it.
    pub segments: usize,
    /// Their Gaussians, which are resident.
    pub resident: usize,
    /// Gaussians whose opacity reaches 1/255.
    pub alive: usize,
    /// Fragments that a player shades, per pixel of the picture.
    pub fragments_per_pixel: f64,
    /// PSNR in dB against the reference; `None` without one, or where the pictures are the same.
    pub psnr_db: Option<f64>,
}

/// PSNR of the first layers of all segments against all layers, at an instant.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LayerInstant {
    /// Second of the take.
    pub t_s: f64,
    /// In dB, of one layer, two, and so on up to all but the last; `None` where the pictures are the same.
    pub psnr_db: Vec<Option<f64>>,
}

/// PSNR over time.
#[derive(Clone, Debug, PartialEq, Serialize)]
struct Worst {
    t_s: f64,
    is_cut: bool,
    psnr_db: f64,
    /// Medians over the instants at cuts and over the others; `None` without such instants that differ.
    median_at_cuts_db: Option<f64>,
    median_between_db: Option<f64>,
}

impl TakeSetup {
    /// Where the cameras are, in words.
    fn places(&self) -> String {
        let places = count(self.cameras - 1, "place");
        format!("viewpoint \"{}\" and {places} where people stand", self.viewpoint)
    }
}

impl TakeFindings {
    /// The instant with the lowest PSNR. `None` if there is no reference, or no picture differs from it.
    fn worst(&self) -> Option<Worst> {
        let differs = || self.instants.iter().filter_map(|instant| Some((instant, instant.psnr_db?)));
        let (worst, psnr_db) = differs().min_by(|a, b| a.1.total_cmp(&b.1))?;
        let median = |is_cut: bool| {
            let own = differs().filter(|(instant, _)| instant.is_cut == is_cut);
            metrics::median(own.map(|(_, psnr_db)| psnr_db).collect())
        };
        let (median_at_cuts_db, median_between_db) = (median(true), median(false));
        Some(Worst { t_s: worst.t_s, is_cut: worst.is_cut, psnr_db, median_at_cuts_db, median_between_db })
    }

    /// The worst instant and the medians, in a sentence; why there are none, otherwise.
    fn exactness(&self) -> String {
        let Some(reference) = &self.setup.reference else {
            return "not compared: name the field folder or the field that the take was packaged from after it"
                .into();
        };
        let Some(worst) = self.worst() else {
            return format!("no picture differs from those of {reference}");
        };
        let Worst { t_s, is_cut, psnr_db, median_at_cuts_db, median_between_db } = worst;
        let place = if is_cut { ", at a cut" } else { "" };
        let median = |what: &str, db: Option<f64>| db.map(|db| format!("{} dB {what}", decimal(db, 2)));
        let medians = [median("at cuts", median_at_cuts_db), median("between", median_between_db)];
        let medians: Vec<String> = medians.into_iter().flatten().collect();
        format!(
            "worst {} dB, at {} s{place}; median {}; against {reference}",
            decimal(psnr_db, 2),
            decimal(t_s, 3),
            medians.join(", ")
        )
    }

    /// The text for a terminal.
    fn table(&self) -> String {
        let TakeFindings { machine, setup, course, .. } = self;
        let mut text = format!("machine  {machine}\ntake     {}\n", self.size());
        let _ = writeln!(
            text,
            "network  {} Mbps, at most {} over one second after the first instant, which takes {} bytes",
            decimal(course.mean_mbps, 2),
            decimal(course.peak_mbps, 2),
            course.startup_bytes
        );
        let most = self.instants.iter().map(|instant| instant.fragments_per_pixel).fold(0.0, f64::max);
        let _ = writeln!(
            text,
            "player   at most {} Gaussians resident, {} fragments per pixel from {}",
            course.resident_max,
            decimal(most, 1),
            setup.places()
        );
        let _ = writeln!(text, "error    {}", self.exactness());
        if let Some(photographs) = &self.photographs {
            let _ = writeln!(text, "photos   {}", photographs.sentence());
        }
        if !self.gaps.is_empty() {
            let _ = writeln!(text, "gaps     nothing is shown {}", self.gaps_in_words());
        }
        self.parameter.iter().for_each(|parameter| parameter_lines(&mut text, parameter));
        text
    }

    fn size(&self) -> String {
        let TakeSetup { segments, gaussians, bytes, duration_s, .. } = &self.setup;
        format!(
            "{} s in {}, {} Gaussians, {} bytes",
            decimal(*duration_s, 3),
            count(*segments, "segment"),
            grouped(*gaussians as f64),
            grouped(*bytes as f64)
        )
    }

    fn gaps_in_words(&self) -> String {
        let words = |[from, to]: &[f64; 2]| format!("from {} to {} s", decimal(*from, 3), decimal(*to, 3));
        self.gaps.iter().map(words).collect::<Vec<_>>().join(", ")
    }

    /// The part of a report.
    ///
    /// # Errors
    /// If a plot cannot be drawn.
    pub fn part(&self) -> anyhow::Result<ReportPart> {
        Ok(ReportPart {
            title: format!("{}: a take over time", escape(&self.name)),
            body: self.html().context("the page")?,
            text: self.table(),
            json: self.to_json()?,
        })
    }

    /// All numbers as JSON.
    ///
    /// # Errors
    /// If a number has no JSON form.
    fn to_json(&self) -> anyhow::Result<Map<String, Value>> {
        let parameters: Vec<Parameter> = self.parameter.clone().into_iter().collect();
        let values = [
            ("subject", Value::from(self.name.as_str())),
            ("machine", Value::from(self.machine.as_str())),
            ("setup", serde_json::to_value(&self.setup)?),
            ("course", serde_json::to_value(&self.course)?),
            ("cuts_s", serde_json::to_value(&self.cuts)?),
            ("gaps", serde_json::to_value(&self.gaps)?),
            ("over_time", serde_json::to_value(&self.instants)?),
            ("worst", serde_json::to_value(self.worst())?),
            ("photographs", serde_json::to_value(&self.photographs)?),
            ("layers_over_time", serde_json::to_value(&self.layers)?),
            ("knobs", rows::values(&parameters)?),
            ("left_out", serde_json::to_value(&self.left_out)?),
        ];
        Ok(values.into_iter().map(|(key, value)| (key.to_owned(), value)).collect())
    }

    fn html(&self) -> anyhow::Result<String> {
        let mut text = String::new();
        self.introduce(&mut text);
        text += "<h2>Over time</h2>\n";
        let course = |title: &str, y: fn(&CourseRow) -> f64| {
            let steps = self.course.rows.iter().flat_map(|row| [(row.from_s, y(row)), (row.to_s, y(row))]);
            self.counts(title, steps.collect())
        };
        let at = |y: fn(&TakeInstant) -> f64| -> Vec<(f64, f64)> {
            self.instants.iter().map(|instant| (instant.t_s, y(instant))).collect()
        };
        let per_second = |row: &CourseRow| row.decoded as f64 / (row.to_s - row.from_s);
        text += &svg(
            Scale::Linear,
            "s",
            &[
                course("Mbit per second", |row| row.mbps),
                course("Gaussians to decode per second", per_second),
            ],
        )?;
        text += &svg(
            Scale::Linear,
            "s",
            &[
                course("Gaussians resident", |row| row.gaussians as f64),
                self.counts("fragments per pixel", at(|instant| instant.fragments_per_pixel)),
            ],
        )?;
        let _ = writeln!(text, "<h2>Error over time</h2>\n<p>PSNR: {}.</p>", escape(&self.exactness()));
        if self.worst().is_some() {
            let points = at(|instant| instant.psnr_db.unwrap_or(f64::INFINITY));
            let line = PlotLine { name: String::new(), points };
            text += &svg(Scale::Linear, "s", &[self.chart("PSNR against the field (dB)", vec![line])])?;
        }
        if let Some(photographs) = &self.photographs {
            text += &self.beside_photographs(photographs)?;
        }
        text += "<h2>Error against run time</h2>\n";
        match &self.parameter {
            None => text += "<p>Every segment has one layer, so there is nothing to choose.</p>\n",
            Some(parameter) => {
                section(&mut text, parameter)?;
                text += &svg(Scale::Linear, "s", &[self.layers_over_time()])?;
            }
        }
        text += "<h2>Only what this take needs</h2>\n<p>Optional parts that some Gaussians lack, and the bytes that \
                 they would cost as columns of zeros.</p>\n";
        text += &self.left_out_table();
        Ok(text)
    }

    fn introduce(&self, text: &mut String) {
        let TakeSetup { size: [width, height], .. } = self.setup;
        let cuts = match self.cuts.len() {
            0 => String::new(),
            1..=CUTS_MAX => format!(" Dashed lines mark its {}.", count(self.cuts.len(), "cut")),
            many => format!(" Its {} cuts are too many to be marked.", grouped(many as f64)),
        };
        let gaps = match self.gaps.is_empty() {
            true => String::new(),
            false => format!(" Nothing is shown {}.", self.gaps_in_words()),
        };
        let _ = writeln!(
            text,
            "<p>{}. Machine: {}.</p>\n<p>A cut is an instant at which a segment begins or ends.{cuts}{gaps}</p>\n\
             <p>All costs are counts, which depend on no machine. Bytes and Gaussians to decode are those of the segments that \
             begin. Pictures are those of the f64 reference, {width}x{height} from {}, evenly over the \
             take, and at cuts and just before them.</p>",
            self.size(),
            escape(&self.machine),
            escape(&self.setup.places())
        );
    }

    fn beside_photographs(&self, photographs: &TakePhotographs) -> anyhow::Result<String> {
        let mut text = format!(
            "<h2>Photographs over time</h2>\n<p>Against them: {}. Within one frame of a cut counts as at it. Flicker is what the picture \
             changes from frame to frame and the photograph does not: root of the mean square over the pixels of the \
             subject.</p>\n",
            escape(&photographs.sentence())
        );
        let line = |y: fn(&FrameErrors) -> Option<f64>| PlotLine {
            name: String::new(),
            points: photographs.frames.iter().filter_map(|frame| Some((frame.t_s, y(frame)?))).collect(),
        };
        let psnr = self.chart("PSNR of the subject (dB)", vec![line(|frame| frame.psnr_db)]);
        let flicker = self.chart("flicker (of 255)", vec![line(|frame| frame.flicker)]);
        text += &svg(Scale::Linear, "s", &[psnr, LineChart { from_zero: true, ..flicker }])?;
        Ok(text)
    }

    fn chart(&self, title: &str, lines: Vec<PlotLine>) -> LineChart {
        let cuts = if self.cuts.len() > CUTS_MAX { Vec::new() } else { self.cuts.clone() };
        LineChart { title: title.into(), lines, rings: Vec::new(), from_zero: false, cuts }
    }

    fn counts(&self, title: &str, points: Vec<(f64, f64)>) -> LineChart {
        let line = PlotLine { name: String::new(), points };
        LineChart { from_zero: true, ..self.chart(title, vec![line]) }
    }

    fn layers_over_time(&self) -> LineChart {
        let line = |k: usize| PlotLine {
            name: count(k + 1, "layer"),
            points: self
                .layers
                .iter()
                .map(|instant| (instant.t_s, instant.psnr_db[k].unwrap_or(f64::INFINITY)))
                .collect(),
        };
        let lines = (0..self.setup.layers.saturating_sub(1)).map(line).collect();
        self.chart("PSNR against all layers (dB)", lines)
    }

    fn left_out_table(&self) -> String {
        let row = |LeftOut { part, gaussians, bytes_saved, gpu_bytes_saved }: &LeftOut| {
            let numbers = [*gaussians, *bytes_saved, *gpu_bytes_saved].map(|number| grouped(number as f64));
            std::iter::once((*part).to_owned()).chain(numbers).collect()
        };
        Table::new(["part", "Gaussians without it", "package bytes", "GPU bytes"])
            .with_rows(self.left_out.iter().map(row))
            .html()
    }
}

/// The parameter of the number of layers, with its front marked.
pub(crate) fn layers_parameter(points: Vec<measure::parameter::ParameterValue>) -> Parameter {
    Parameter {
        stage: FlowStage::Playing,
        name: "layers".into(),
        about: "The first layers of every segment: what a slow network brings in time. Bytes and Gaussians are sums over the \
                take; fragments are the mean of the pictures."
            .into(),
        why_default: "it is the take".into(),
        cost: "Mbps".into(),
        points,
    }
    .mark_front()
}
