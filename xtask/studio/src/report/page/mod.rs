//! The report on one clip, field or take.

mod findings;
mod front;
mod photographs;
mod rows;
mod tables;
mod take;

use std::fmt::Write;

use anyhow::Context;
use measure::parameter::{FlowStage, Parameter, ParameterValue};
use refine::prune::RESOLUTION_DB;

use crate::messages::decimal;
use crate::page::{LineChart, PlotLine, Scale, escape, grouped, prose, svg as line_charts};
use crate::report::ReportPart;
use crate::report::fitting::{self, FitLog};
pub use findings::Findings;
use front::{Chart, Mark, svg};
pub use photographs::TakePhotographs;
pub(crate) use take::layers_parameter;
pub use take::{LayerInstant, TakeFindings, TakeInstant, TakeSetup};

impl Findings {
    /// The text for a terminal: a line for each value of each parameter.
    fn table(&self) -> String {
        let setup = &self.playing.setup;
        let mut text = format!("machine  {}\nadapter  {}, {}\n", self.machine, setup.adapter, setup.driver);
        for parameter in self.parameters().iter().filter(|parameter| parameter.stage != FlowStage::Fitting) {
            parameter_lines(&mut text, parameter);
        }
        for beaten in self.beaten_defaults() {
            let _ = writeln!(text, "\na default is off the front: {beaten}");
        }
        text
    }

    /// The part of a report.
    ///
    /// # Errors
    /// If a plot cannot be drawn.
    pub fn part(&self) -> anyhow::Result<ReportPart> {
        Ok(ReportPart {
            title: format!("{}: error against run time", escape(&self.name)),
            body: self.html().context("the page")?,
            text: self.table(),
            json: self.to_json()?,
        })
    }

    /// All numbers as JSON.
    ///
    /// # Errors
    /// If a number has no JSON form.
    fn to_json(&self) -> anyhow::Result<serde_json::Map<String, serde_json::Value>> {
        rows::json(self, &self.parameters())
    }

    fn html(&self) -> anyhow::Result<String> {
        let mut text = String::new();
        self.introduce(&mut text);
        text += "<h2>Playing</h2>\n";
        for parameter in &self.playing.parameters {
            section(&mut text, parameter)?;
        }
        self.pictures(&mut text)?;
        text += "<h2>Only what this scene needs</h2>\n\
             <p>Each optional part that the clip lacks was added with values that change no pixel, then rendered, \
             counted and packaged: the numbers are the savings of leaving it out. Gray rows are parts that the clip \
             needs. The last column is the time of a frame without and with the part.</p>\n<div class=parts>";
        text += &tables::features(&self.playing.features);
        text += "</div>\n<h2>Packaging</h2>\n";
        for parameter in &self.packaging {
            section(&mut text, parameter)?;
        }
        text += "<h2>Fitting</h2>\n";
        if self.fits.is_empty() {
            text += "<p>There is no table of a fit beside the field.</p>\n";
        } else {
            text += &self.fits()?;
        }
        Ok(text)
    }

    fn introduce(&self, text: &mut String) {
        let Findings { machine, playing, .. } = self;
        let setup = &playing.setup;
        let [width, height] = setup.size;
        let drawing = match setup.gpu_timed {
            true => "measured with GPU timestamps",
            false => "the remainder of a frame: this GPU writes no timestamps",
        };
        let fragments = if setup.f16 { "f16" } else { "f32" };
        let _ = writeln!(
            text,
            "<p>{} Gaussians. Machine: {}. Adapter: {}, {}.</p>\n\
             <p>Every point measures the same work: {} pictures of {width}x{height}, each with its own viewpoint and \
             instant, and {} frames of a head that turns by 90 degrees a second while the clip plays. Errors are against \
             the f64 reference of the whole field: PSNR over all pixels of all pictures, the mean SSIM, the PSNR of the \
             worst tile of 32x32 pixels, and <i>flicker</i>, the root mean square of how the error changes from frame to \
             frame while the head turns, against the reference in the order that does not change when a head turns; an error \
             that stays where it is in the world does not flicker. \
             Run times of playing are medians of {} rounds, with the ends of the middle half; each round draws every \
             variant once. \
             <i>Alive</i> and <i>sort</i> run on the CPU, <i>draw</i> is {drawing}; the fragment stage calculates in {fragments}. Counts are means of a picture and depend \
             on no machine; fetched bytes are those of the mean record and of the order, once an instance.</p>\n\
             <p>Blue points are on the Pareto front: no other value of the parameter is cheaper and no less exact, or more exact \
             and no dearer. A value is cheaper if the middle halves of both measurements do not overlap, and more exact by more than {RESOLUTION_DB} dB. \
             The ring marks the default.</p>",
            grouped(setup.gaussians as f64),
            escape(machine),
            escape(&setup.adapter),
            escape(&setup.driver),
            setup.pictures,
            setup.turn_frames,
            setup.rounds,
        );
        let beaten = self.beaten_defaults();
        if beaten.is_empty() {
            *text += "<p class=good>Every default is on the front of its parameter.</p>\n";
        } else {
            *text += "<div class=warning>Defaults that are off the front of their parameter:<ul>\n";
            for beaten in beaten {
                let _ = writeln!(text, "<li>{}</li>", escape(&beaten));
            }
            *text += "</ul></div>\n";
        }
    }

    /// Writes a comparison of two selectable pictures.
    fn pictures(&self, text: &mut String) -> anyhow::Result<()> {
        let pictures = &self.playing.pictures;
        let listed: Vec<[String; 2]> = pictures
            .iter()
            .map(|picture| [picture.name.clone(), format!("data:image/png;base64,{}", picture.png)])
            .collect();
        // No text within the script may look like its end tag.
        let listed = serde_json::to_string(&listed)?.replace('<', "\\u003c");
        let [width, height] = self.playing.setup.size;
        let _ = writeln!(
            text,
            "<h2>Pictures</h2>\n<p>The first picture by the reference, by the player as it is, and at the end of each \
             parameter. Slide over them, or look at their difference, eight times as bright.</p>\n\
             <div class=controls><label>left <select></select></label><label>right <select></select></label>\
             <input type=range min=0 max=100 step=0.1 value=50 aria-label=\"where the pictures meet\">\
             <label><input type=checkbox> difference</label></div>\n\
             <div class=compare><img alt=left width={width} height={height}><img alt=right width={width} \
             height={height}></div>\n<script>\nconst pictures = {listed};\n{}</script>",
            include_str!("compare.js")
        );
        Ok(())
    }

    /// Plots of the held-out PSNR over steps, over time and over work, and a table of the fits.
    fn fits(&self) -> anyhow::Result<String> {
        let parameter = fitting::parameter(&self.fits);
        let by_fit = parameter.as_ref().map(|parameter| fitting::points_by_fit(&self.fits, parameter));
        let by_fit = by_fit.unwrap_or_else(|| vec![&[]; self.fits.len()]);
        if !by_fit.iter().any(|points| points.len() >= 2) {
            return Ok(no_chart("the PSNR of held photographs") + &tables::fits(&self.fits, &by_fit));
        }
        let chart = |over: &str, x: fn(&ParameterValue) -> f64, is_ringed: fn(&ParameterValue) -> bool| {
            let place = |point: &ParameterValue| (x(point), point.psnr_db());
            let line = |(fit, points): (&FitLog, &&[ParameterValue])| PlotLine {
                name: fit.name.clone(),
                points: points.iter().map(place).collect(),
            };
            LineChart {
                title: format!("PSNR of held photographs (dB) over {over}"),
                lines: self.fits.iter().zip(&by_fit).map(line).collect(),
                rings: by_fit.concat().iter().filter(|point| is_ringed(point)).map(place).collect(),
                from_zero: false,
                cuts: Vec::new(),
            }
        };
        let over = |x: &str, chart: LineChart| line_charts(Scale::Logarithmic, x, &[chart]);
        let steps = chart("steps", |point| point.counts["steps"], |_| false);
        let seconds =
            chart("seconds", |point| 1e-3 * point.run_time_ms.map_or(0.0, |ms| ms.median), |_| false);
        let work = chart("work", |point| point.cost.median, |point| point.on_front);
        let mut text = over("steps", steps)? + &over("seconds", seconds)?;
        text += &over(fitting::WORK, work)?;
        text += "<p>The work of a fit is the number of Gaussians drawn in all its steps, which depends on no machine. \
             Rings mark the Pareto front of all fits: no point has as much quality for less work.</p>\n";
        text += &tables::fits(&self.fits, &by_fit);
        Ok(text)
    }
}

/// Writes a parameter for a terminal: a line for each value.
fn parameter_lines(text: &mut String, parameter: &Parameter) {
    let _ = writeln!(text, "\n{:<34}{:>10}{:>14}  {}", parameter.name, "PSNR, dB", "cost", parameter.cost);
    for point in &parameter.points {
        let mark = if point.default { '*' } else { ' ' };
        let off = if point.on_front { "" } else { "  off the front" };
        let psnr = point.errors.psnr_db.map_or_else(|| "same".into(), |db| format!("{db:.2}"));
        let _ =
            writeln!(text, "{mark} {:<32}{psnr:>10}{:>14}{off}", point.value, decimal(point.cost.median, 3));
    }
}

/// Writes a parameter: description, charts and table.
fn section(text: &mut String, parameter: &Parameter) -> anyhow::Result<()> {
    let _ = writeln!(text, "<h3>{}</h3>\n<p>{}</p>", escape(&parameter.name), prose(&parameter.about));
    let mark = |point: &ParameterValue, y: f64, on_front: bool| Mark {
        label: point.value.clone(),
        x: [point.cost.median, point.cost.low, point.cost.high],
        y,
        default: point.default,
        on_front,
    };
    let psnr = |point: &ParameterValue| mark(point, point.psnr_db(), point.on_front);
    let mut charts = vec![Chart {
        title: "PSNR (dB)".into(),
        x: parameter.cost.clone(),
        marks: parameter.points.iter().map(psnr).collect(),
    }];
    if parameter.points.iter().any(|point| point.errors.flicker.is_some()) {
        let flicker = |point: &ParameterValue| {
            let value = |point: &ParameterValue| point.errors.flicker.unwrap_or(f64::NAN);
            let beaten =
                |other: &ParameterValue| other.cost.high < point.cost.low && value(other) <= value(point);
            mark(point, value(point), !parameter.points.iter().any(beaten))
        };
        charts.push(Chart {
            title: "flicker while the head turns (/255, less is better)".into(),
            x: parameter.cost.clone(),
            marks: parameter.points.iter().map(flicker).collect(),
        });
    }
    let exact = charts[0].exact().join(", ");
    if !exact.is_empty() {
        let _ = writeln!(text, "<p>Without an error, and so not in the chart: {}.</p>", escape(&exact));
    }
    let (drawn, empty): (Vec<Chart>, Vec<Chart>) = charts.into_iter().partition(Chart::has_line);
    if !drawn.is_empty() {
        *text += &svg(&drawn)?;
    }
    empty.iter().for_each(|chart| *text += &no_chart(&chart.title));
    *text += &tables::parameter(parameter);
    Ok(())
}

/// The sentence in place of a chart of `what`.
fn no_chart(what: &str) -> String {
    format!("<p>No chart of {}: it has fewer than two points.</p>\n", escape(what))
}

#[cfg(test)]
mod tests;
