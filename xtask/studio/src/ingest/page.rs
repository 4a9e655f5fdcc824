//! The page `ingest.html`: warnings first, then what each step found. It loads nothing.

use std::fmt::Write as _;

use glam::DVec3;

use super::findings::{self, CameraFindings, IngestFindings};
use super::matte_sheet;
use super::mattes::CameraMattes;
use super::pictures::{CHECKED, FRAMES, Pictures};
use super::sound::{RATE, SoundPair, SoundSync};
use crate::messages::{count, decimal};
use crate::page::{self, LineChart, PlotLine, Scale, decimals, escape, row, svg, table};

/// Most lines of a plot: more cannot be told apart.
const LINES_MAX: usize = 7;

/// Side of the view from above in pixels.
const PLAN_PX: f64 = 460.0;

pub(super) fn page(
    findings: &IngestFindings,
    pictures: &[Pictures],
    instants_s: &[f64; FRAMES],
    mattes: &[CameraMattes],
) -> anyhow::Result<String> {
    let mut text = String::new();
    let _ = writeln!(
        text,
        "<p>{} by {} ({}). The capture has {}, {} a second, and lasts {} s.</p>",
        count(findings.cameras.len(), "camera"),
        escape(&findings.layout),
        escape(&findings.calibration),
        count(findings.frames, "frame"),
        decimal(findings.fps, 3),
        decimal((findings.frames - 1) as f64 / findings.fps, 2)
    );
    match findings.warnings.is_empty() {
        true => text += "<p class=good>No warnings.</p>\n",
        false => findings
            .warnings
            .iter()
            .for_each(|warning| text += &format!("<p class=warning>{}</p>\n", escape(warning))),
    }
    let notes: String =
        findings.placement.notes.iter().map(|note| format!("<li>{}</li>\n", escape(note))).collect();
    if !notes.is_empty() {
        let _ = writeln!(text, "<ul>\n{notes}</ul>");
    }
    text += "<h2>Videos</h2>\n";
    text += &videos(findings);
    text += "<h2>Pictures</h2>\n";
    text += &sheets(findings, pictures, instants_s);
    text += "<h2>Start of the videos</h2>\n";
    text += &starts(findings)?;
    text += "<h2>The calibration against the pictures</h2>\n";
    text += &epipolar(findings);
    text += "<h2>Mattes</h2>\n";
    text += &matte_sheet::section(findings, mattes);
    text += "<h2>Coverage</h2>\n";
    text += &coverage(findings);
    Ok(page::page(&[(&format!("Ingest of {}", escape(&findings.rig)), &text)]))
}

fn headed(columns: &[&str]) -> String {
    row("th", &columns.iter().map(|column| (*column).to_owned()).collect::<Vec<_>>(), "")
}

fn videos(findings: &IngestFindings) -> String {
    let columns = [
        "camera",
        "calibrated as",
        "size",
        "turned",
        "frames a second",
        "frames",
        "seconds",
        "start (s)",
        "codec",
        "sound",
        "timecode",
        "focal length (px)",
    ];
    let mut text = headed(&columns);
    for (camera, start_s) in findings.cameras.iter().zip(&findings.starts.starts_s) {
        let CameraFindings { name, calibrated_name, probe, focal_px, .. } = camera;
        let rate = decimal(probe.fps, 3) + if probe.is_variable { ", variable" } else { "" };
        let cells = [
            escape(name),
            escape(calibrated_name),
            format!("{}x{}", probe.size.0, probe.size.1),
            format!("{}°", probe.rotation),
            rate,
            probe.frames.to_string(),
            decimal(probe.duration_s, 2),
            format!("{start_s:.4}"),
            escape(&probe.codec),
            if probe.has_sound { "yes" } else { "no" }.into(),
            probe.timecode.as_deref().map_or("-".into(), escape),
            format!("{:.0}", focal_px[1]),
        ];
        text += &row("td", &cells, "");
    }
    table(&text)
}

fn sheets(findings: &IngestFindings, pictures: &[Pictures], instants_s: &[f64; FRAMES]) -> String {
    let instants: Vec<String> = instants_s.iter().map(|second| format!("{second:.2} s")).collect();
    let mut text = format!(
        "<p>All cameras at {}. One row for each camera: the pictures of a column should show the same instant. \
         Beside the instant is the mean colour.</p>\n",
        instants.join(", ")
    );
    for (camera, pictures) in findings.cameras.iter().zip(pictures) {
        let _ = write!(text, "<h3>{}</h3>\n<div class=side-by-side>", escape(&camera.name));
        for ((thumbnail, mean), instant) in pictures.thumbnails.iter().zip(&pictures.means).zip(&instants) {
            let [r, g, b] = mean.map(|x| format!("{x:.0}"));
            let _ = write!(
                text,
                "<figure style=\"flex-basis:205px\"><img alt=\"\" src=\"data:image/jpeg;base64,{thumbnail}\"><figcaption>{instant}: {r} {g} {b}</figcaption></figure>"
            );
        }
        text += "</div>\n";
    }
    text
}

fn starts(findings: &IngestFindings) -> anyhow::Result<String> {
    let names: Vec<&str> = findings.cameras.iter().map(|camera| camera.name.as_str()).collect();
    let first_s = findings.starts.starts_s.iter().copied().fold(f64::INFINITY, f64::min);
    let source = findings::describe_source(findings.starts.source);
    let spread = match first_s < 0.0 {
        true => format!(" The last camera starts the capture, {} s after the first.", decimal(-first_s, 3)),
        false => String::new(),
    };
    let mut text = format!("<p>{source}.{spread}</p>\n");
    let Some(sound) = &findings.starts.sound else { return Ok(text) };
    text += "<p>Correlation of the sound of pairs around the delay that was found: one sharp peak is right. Left the pairs with \
             the highest peaks, right those with the lowest.</p>\n";
    text += &correlations(sound, &names)?;
    let mut rows = headed(&["camera", "start (s)", "drift (ppm)"]);
    for ((name, start_s), drift) in names.iter().zip(&findings.starts.starts_s).zip(&sound.drifts_ppm) {
        rows += &row("td", &[escape(name), format!("{start_s:.5}"), format!("{drift:.1}")], "");
    }
    text += &table(&rows);
    let mut rows = headed(&["pair", "later by (s)", "drift (ppm)", "peak / median", "off the solution (ms)"]);
    for pair in &sound.pairs {
        let [a, b] = pair.cameras.map(|camera| escape(names[camera]));
        let residual =
            pair.residual_s.map_or("left out".into(), |residual_s| format!("{:.3}", 1e3 * residual_s.abs()));
        let cells = [
            format!("{a} - {b}"),
            format!("{:.5}", pair.later_s),
            format!("{:.1}", pair.drift_ppm),
            format!("{:.0}", pair.confidence),
            residual,
        ];
        rows += &row("td", &cells, "");
    }
    text += &table(&rows);
    Ok(text)
}

fn correlations(sound: &SoundSync, names: &[&str]) -> anyhow::Result<String> {
    let mut pairs: Vec<&SoundPair> = sound.pairs.iter().filter(|pair| !pair.curve.is_empty()).collect();
    pairs.sort_by(|a, b| b.confidence.total_cmp(&a.confidence));
    let line = |pair: &&SoundPair| {
        let middle = pair.curve.len() as f64 / 2.0 - 0.5;
        let point = |(i, y): (usize, &f32)| (1e3 * (i as f64 - middle) / RATE, f64::from(*y));
        let [a, b] = pair.cameras.map(|camera| names[camera]);
        PlotLine { name: format!("{a} - {b}"), points: pair.curve.iter().enumerate().map(point).collect() }
    };
    let chart = |title: &str, pairs: &[&SoundPair]| LineChart {
        title: title.into(),
        lines: pairs.iter().map(line).collect(),
        rings: Vec::new(),
        from_zero: true,
        cuts: Vec::new(),
    };
    let shown = pairs.len().min(LINES_MAX);
    let highest = chart("correlation / median, highest", &pairs[..shown]);
    let lowest = chart("correlation / median, lowest", &pairs[pairs.len() - shown..]);
    svg(Scale::Linear, "ms", &[highest, lowest])
}

fn epipolar(findings: &IngestFindings) -> String {
    let check = &findings.epipolar;
    let mut text = format!(
        "<p>{}. Corners are matched between neighbouring cameras, within a band of 4 % of the picture on each side of their \
         epipolar lines, on which right matches lie if the calibration is right. Matches of far views are mostly wrong, and lie anywhere in the \
         band: a pair without numbers tells nothing, and an error along the lines or beyond the band is not seen.</p>\n",
        escape(&findings::capital(&findings::describe_epipolar(check)))
    );
    let mut rows = headed(&[
        "pair",
        "matches",
        "near",
        "by chance",
        "median (px)",
        "within 2 px (%)",
        "start",
        "middle",
        "end",
    ]);
    for pair in &check.pairs {
        let [a, b] = pair.cameras.map(|camera| escape(&findings.cameras[camera].name));
        let all = &pair.all;
        let mut cells = vec![
            format!("{a} - {b}"),
            all.matches.to_string(),
            all.near.to_string(),
            format!("{:.0}", all.by_chance),
            decimals(all.median_px, 2),
            decimals(all.exact.map(|share| 100.0 * share), 0),
        ];
        cells.extend((0..CHECKED.len()).map(|i| decimals(pair.instants[i].median_px, 2)));
        rows += &row("td", &cells, "");
    }
    text += &table(&rows);
    text += "<p>Movement of each camera's own picture since the start, by the corners that it keeps: those of the background, if \
             it fills most of the picture.</p>\n";
    let mut rows = headed(&["camera", "to the middle (px)", "to the end (px)"]);
    for (camera, moved) in findings.cameras.iter().zip(&check.moved_px) {
        let [middle, end] = moved.map(|moved_px| decimals(moved_px, 2));
        rows += &row("td", &[escape(&camera.name), middle, end], "");
    }
    text + &table(&rows)
}

/// Cameras and their axes from above, as SVG.
fn coverage(findings: &IngestFindings) -> String {
    let up = DVec3::from(findings.placement.up);
    let right = up.any_orthonormal_vector();
    let ahead = up.cross(right);
    let flat = |x: [f64; 3]| [DVec3::from(x).dot(right), DVec3::from(x).dot(ahead)];
    let focus = findings.placement.focus.map(flat);
    let positions: Vec<[f64; 2]> = findings.cameras.iter().map(|camera| flat(camera.position)).collect();
    let all: Vec<[f64; 2]> = positions.iter().copied().chain(focus).chain([[0.0; 2]]).collect();
    let range = |axis: usize| {
        let values = all.iter().map(|point| point[axis]);
        values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)))
    };
    let (x, y) = (range(0), range(1));
    let span = (x.1 - x.0).max(y.1 - y.0).max(1e-9);
    let margin = 60.0;
    let scale = (PLAN_PX - 2.0 * margin) / span;
    let place = |[u, v]: [f64; 2]| {
        [(u - 0.5 * (x.0 + x.1)) * scale + 0.5 * PLAN_PX, 0.5 * PLAN_PX - (v - 0.5 * (y.0 + y.1)) * scale]
    };
    let mut marks = String::new();
    for (camera, position) in findings.cameras.iter().zip(&positions) {
        let [u, v] = place(*position);
        let length = focus.map_or(0.3 * span, |focus| (focus[0] - position[0]).hypot(focus[1] - position[1]));
        let forward = flat(camera.forward);
        let [end_u, end_v] = place([position[0] + length * forward[0], position[1] + length * forward[1]]);
        let _ = writeln!(
            marks,
            "<line x1=\"{u:.1}\" y1=\"{v:.1}\" x2=\"{end_u:.1}\" y2=\"{end_v:.1}\" stroke=\"#0072b2\" stroke-opacity=\"0.5\"/>\
             <circle cx=\"{u:.1}\" cy=\"{v:.1}\" r=\"5\" fill=\"#d55e00\"/>\
             <text x=\"{:.1}\" y=\"{:.1}\" font-size=\"12\">{}</text>",
            u + 8.0,
            v - 6.0,
            escape(&camera.name)
        );
    }
    let [u, v] = place([0.0; 2]);
    let _ = write!(marks, "<path d=\"M{:.1} {v:.1}h12M{u:.1} {:.1}v12\" stroke=\"#222\"/>", u - 6.0, v - 6.0);
    let unit = match findings.placement.metres_per_unit {
        Some(metres) => format!("{} m", decimal(span * metres, 2)),
        None => format!("{} of the calibration's units", decimal(span, 2)),
    };
    let gap = gap_degrees(&positions, focus.unwrap_or_default());
    format!(
        "<p>From above: cameras, their axes, and the origin (cross). The cameras span {unit}. The widest angle without a camera is \
         {gap:.0}°.</p>\n<svg width=\"{PLAN_PX}\" height=\"{PLAN_PX}\" viewBox=\"0 0 {PLAN_PX} {PLAN_PX}\" \
         font-family=\"sans-serif\">\n{marks}</svg>\n"
    )
}

/// The widest angle in degrees between neighbouring cameras, as seen from `focus`.
fn gap_degrees(positions: &[[f64; 2]], focus: [f64; 2]) -> f64 {
    let mut angles: Vec<f64> =
        positions.iter().map(|[x, y]| libm::atan2(y - focus[1], x - focus[0]).to_degrees()).collect();
    angles.sort_by(f64::total_cmp);
    let next = angles.iter().skip(1).copied().chain(angles.first().map(|first| first + 360.0));
    angles.iter().zip(next).map(|(angle, next)| next - angle).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_widest_gap_goes_around() {
        let gap = gap_degrees(&[[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0]], [0.0, 0.0]);
        assert!((gap - 180.0).abs() < 1e-9, "{gap}");
        assert_eq!(gap_degrees(&[[1.0, 1.0]], [0.0, 0.0]), 360.0);
    }
}
