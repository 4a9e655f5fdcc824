//! An ablation as a part of a report.

use std::fmt::Write;

use base64::Engine;
use base64::prelude::BASE64_STANDARD;

use super::result::{Ablation, Method, PackageFigures, PicturedView, measures_in};
use super::table;
use crate::fit::log::LogEntry;
use crate::page::{LineChart, PlotLine, Scale, escape, grouped, prose, svg};
use crate::report::ReportPart;

/// What the columns mean.
const COLUMNS: &str = "PSNR is over the subject, SSIM and LPIPS over the whole picture; each is the mean over the \
     photographs of a split. train: photographs fitted to; interp_b: held frames of fitted cameras; recon: fitted frames \
     of held cameras; interp_a: held frames of held cameras. Every other frame is held out. Fragments per lit pixel are \
     counted 512 pixels wide, in the views below.";

const PACKAGES: &str = "Packages of the full fit at each budget, and of the others at the largest, as `package --budget` makes them. Mbps: size over the duration of the clip; \
     Topo: fraction of the persistent features of the fit's density that the package preserves; PSNR: after decoding.";

impl Ablation {
    /// The part of a report.
    ///
    /// # Errors
    /// If a plot cannot be drawn.
    pub fn part(&self) -> anyhow::Result<ReportPart> {
        Ok(ReportPart {
            title: format!("{}: ablation of the fit", escape(&self.capture)),
            body: self.html()?,
            text: self.text(),
            json: [("ablation".to_owned(), serde_json::to_value(self)?)].into_iter().collect(),
        })
    }

    fn text(&self) -> String {
        let mut text = format!("{}\n{}", table::methods(self).text(), table::similarity(self).text());
        let packages = table::packages(self);
        if !packages.is_empty() {
            text += "\n";
            text += &packages.text();
        }
        for left_out in &self.left_out {
            let _ = writeln!(text, "\n{} is left out: {}", left_out.name, left_out.why);
        }
        text
    }

    fn setup(&self) -> String {
        let [width, height] = self.size;
        let lpips = self.lpips.as_ref().map_or(String::new(), |network| format!(" LPIPS by {network}."));
        format!(
            "{}. {width}x{height} pixels, {} steps, {} Gaussians asked for.{lpips} Machine: {}.",
            self.photographs,
            grouped(self.steps as f64),
            grouped(self.gaussians as f64),
            self.machine
        )
    }

    fn html(&self) -> anyhow::Result<String> {
        let mut text = format!("<p>{}</p>\n<p>{}</p>\n", escape(&self.setup()), prose(COLUMNS));
        text += &table::methods(self).html();
        text += &table::similarity(self).html();
        text += "<ul>\n";
        for method in &self.methods {
            let _ = writeln!(text, "<li><b>{}</b>: {}</li>", escape(&method.name), escape(&method.about));
        }
        for left_out in &self.left_out {
            let _ = writeln!(
                text,
                "<li><b>{}</b> is left out: {}</li>",
                escape(&left_out.name),
                escape(&left_out.why)
            );
        }
        text += "</ul>\n";
        text += &self.fits_over_steps()?;
        let packages = table::packages(self);
        if !packages.is_empty() {
            let _ = write!(text, "<h2>Packages</h2>\n<p>{}</p>\n", prose(PACKAGES));
            text += &self.packages_over_rate()?;
            text += &packages.html();
        }
        if !self.views.is_empty() {
            text += "<h2>Pictures</h2>\n<p>Held photographs and the pictures of each method, cropped to the subject.</p>\n";
        }
        for PicturedView { name, pictures } in &self.views {
            let _ = writeln!(text, "<h3>{}</h3>\n<div class=side-by-side>", escape(name));
            for picture in pictures {
                let _ = writeln!(
                    text,
                    "<figure><img alt=\"{0}\" src=\"data:image/png;base64,{1}\"><figcaption>{0}</figcaption></figure>",
                    escape(&picture.method),
                    BASE64_STANDARD.encode(&picture.png)
                );
            }
            text += "</div>\n";
        }
        Ok(text)
    }

    /// A plot of the PSNR of a few held photographs over the steps of each fit.
    fn fits_over_steps(&self) -> anyhow::Result<String> {
        let line = |method: &Method| {
            let point = |entry: &LogEntry| Some((entry.step as f64, entry.held_psnr_db?));
            PlotLine { name: method.name.clone(), points: method.entries.iter().filter_map(point).collect() }
        };
        let lines: Vec<PlotLine> =
            self.methods.iter().map(line).filter(|line| line.points.len() >= 2).collect();
        match lines.is_empty() {
            true => Ok(String::new()),
            false => {
                let title = "PSNR of a few held photographs (dB)".into();
                svg(
                    Scale::Logarithmic,
                    "steps",
                    &[LineChart { title, lines, rings: Vec::new(), from_zero: false, cuts: Vec::new() }],
                )
            }
        }
    }

    /// Plots of PSNR and topology of the packages over their bit rate.
    fn packages_over_rate(&self) -> anyhow::Result<String> {
        let Some(split) = self.splits().first().copied() else { return Ok(String::new()) };
        let chart = |title: String, value: &dyn Fn(&PackageFigures) -> Option<f64>| {
            let line = |method: &Method| {
                let own = self.packages.iter().filter(|package| package.method == method.name);
                let points = own.filter_map(|package| Some((package.mbps, value(package)?)));
                PlotLine { name: method.name.clone(), points: points.collect() }
            };
            LineChart {
                title,
                lines: self.methods.iter().filter(|method| method.fit.is_some()).map(line).collect(),
                rings: Vec::new(),
                from_zero: false,
                cuts: Vec::new(),
            }
        };
        let psnr = chart(format!("{} PSNR after decoding (dB)", split.name()), &|package| {
            measures_in(&package.splits, split)?.psnr_fg
        });
        let topology = chart("Topo".into(), &|package| Some(package.topology));
        match psnr.lines.iter().any(|line| line.points.len() >= 2) {
            true => svg(Scale::Logarithmic, "Mbps", &[psnr, topology]),
            false => Ok(String::new()),
        }
    }
}
