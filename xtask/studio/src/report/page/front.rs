//! SVG charts of error over cost, with marks for the Pareto front and the default.

use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

/// A chart.
pub(super) struct Chart {
    /// Quantity of the y axis.
    pub(super) title: String,
    /// Quantity of the x axis.
    pub(super) x: String,
    pub(super) marks: Vec<Mark>,
}

/// A point of a chart; non-finite points are not drawn.
pub(super) struct Mark {
    pub(super) label: String,
    /// Median, lower and upper quartile.
    pub(super) x: [f64; 3],
    pub(super) y: f64,
    pub(super) default: bool,
    pub(super) on_front: bool,
}

impl Chart {
    /// The labels of the marks without an error, which have no place in a chart of decibels.
    pub(super) fn exact(&self) -> Vec<&str> {
        let exact = self.marks.iter().filter(|mark| mark.y == f64::INFINITY);
        exact.map(|mark| mark.label.as_str()).collect()
    }

    /// Whether it shows at least two points.
    pub(super) fn has_line(&self) -> bool {
        self.marks.iter().filter(|mark| mark.is_finite()).count() >= 2
    }
}

impl Mark {
    fn is_finite(&self) -> bool {
        self.y.is_finite() && self.x.iter().all(|x| x.is_finite())
    }
}

/// Size of a chart in pixels.
const SIZE: (u32, u32) = (520, 330);

/// Blue and vermillion of Okabe and Ito (2008), distinguishable with colour vision deficiencies.
const FRONT: RGBColor = RGBColor(0, 114, 178);
const DEFAULT: RGBColor = RGBColor(213, 94, 0);
const OFF: RGBColor = RGBColor(130, 130, 130);

/// Maximum number of labels; more would overlap.
const LABELS_MAX: usize = 12;

/// Draws the charts side by side.
///
/// # Errors
/// If the plotting library fails.
pub(super) fn svg(charts: &[Chart]) -> anyhow::Result<String> {
    let mut text = String::new();
    {
        let (width, height) = SIZE;
        let size = (width * charts.len().max(1) as u32, height);
        let area = SVGBackend::with_string(&mut text, size).into_drawing_area();
        area.fill(&WHITE)?;
        for (area, chart) in area.split_evenly((1, charts.len().max(1))).iter().zip(charts) {
            draw(area, chart)?;
        }
        area.present()?;
    }
    Ok(text)
}

fn draw<D: DrawingBackend>(area: &DrawingArea<D, Shift>, chart: &Chart) -> anyhow::Result<()>
where
    D::ErrorType: 'static,
{
    let mut marks: Vec<&Mark> = chart.marks.iter().filter(|mark| mark.is_finite()).collect();
    marks.sort_by(|a, b| a.x[0].total_cmp(&b.x[0]));
    let (left, right) = range(marks.iter().flat_map(|mark| mark.x), [0.06, 0.14]);
    let (bottom, top) = range(marks.iter().map(|mark| mark.y), [0.12, 0.12]);

    let mut axes = ChartBuilder::on(area)
        .margin(12)
        .caption(&chart.title, ("sans-serif", 16))
        .x_label_area_size(40)
        .y_label_area_size(54)
        .build_cartesian_2d(left..right, bottom..top)?;
    axes.configure_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(BLACK.mix(0.1))
        .label_style(("sans-serif", 12))
        .axis_desc_style(("sans-serif", 13))
        .x_labels(6)
        .x_label_formatter(&|x| axis_label(*x, right - left))
        .y_label_formatter(&|y| axis_label(*y, top - bottom))
        .x_desc(&chart.x)
        .draw()?;

    let front = marks.iter().filter(|mark| mark.on_front).map(|mark| (mark.x[0], mark.y));
    axes.draw_series(LineSeries::new(front, FRONT.mix(0.5).stroke_width(2)))?;
    for (i, mark) in marks.iter().enumerate() {
        let [x, low, high] = mark.x;
        let color = if mark.on_front { FRONT } else { OFF };
        axes.draw_series([PathElement::new([(low, mark.y), (high, mark.y)], color.stroke_width(1))])?;
        let style = if mark.on_front { color.filled() } else { color.stroke_width(1) };
        axes.draw_series([Circle::new((x, mark.y), 4, style)])?;
        if mark.default {
            axes.draw_series([Circle::new((x, mark.y), 8, DEFAULT.stroke_width(2))])?;
        }
        if marks.len() > LABELS_MAX && !mark.default {
            continue;
        }
        // Labels alternate above and below, so that neighbours do not overlap.
        let (v, y) = if i.is_multiple_of(2) { (VPos::Bottom, -7) } else { (VPos::Top, 7) };
        // Towards the middle, so that a long one stays within the chart.
        let (h, aside) = if 2.0 * x > left + right { (HPos::Right, -5) } else { (HPos::Left, 5) };
        let color = if mark.default { DEFAULT } else { BLACK };
        let style = ("sans-serif", 12).into_text_style(area).color(&color).pos(Pos::new(h, v));
        let at = EmptyElement::at((x, mark.y));
        axes.draw_series([at + Text::new(mark.label.clone(), (aside, y), style)])?;
    }
    Ok(())
}

/// The range of `values`, extended by fractions of its length below and above.
fn range(values: impl Iterator<Item = f64>, [below, above]: [f64; 2]) -> (f64, f64) {
    let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    // An empty chart still needs a range.
    let (low, high) = if low <= high { (low, high) } else { (0.0, 1.0) };
    let length = if high > low { high - low } else { low.abs().max(1.0) * 0.1 };
    (low - below * length, high + above * length)
}

/// Formats a number on an axis of this length, with enough digits to distinguish its labels.
fn axis_label(x: f64, length: f64) -> String {
    match length {
        length if length >= 2e6 => format!("{:.1} M", 1e-6 * x),
        length if length >= 5e3 => format!("{:.0} k", 1e-3 * x),
        length => format!("{x:.*}", (2.0 - length.log10()).floor().clamp(0.0, 6.0) as usize),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mark(x: f64, y: f64, default: bool) -> Mark {
        Mark { label: format!("<{x}>"), x: [x, x - 0.1, x + 0.1], y, default, on_front: y < 45.0 }
    }

    #[test]
    fn every_finite_point_is_drawn_and_defaults_have_a_ring() {
        let marks = vec![mark(1.0, 40.0, true), mark(2.0, 50.0, false), mark(3.0, f64::INFINITY, false)];
        let svg = svg(&[Chart { title: "a & b".into(), x: "ms".into(), marks }]).unwrap();
        assert_eq!(svg.matches("<circle").count(), 3, "{svg}");
        assert!(svg.contains("a &amp; b") && svg.contains("&lt;1&gt;") && !svg.contains("NaN"), "{svg}");
    }

    #[test]
    fn labels_turn_towards_the_middle() {
        let marks = vec![mark(1.0, 40.0, false), mark(9.0, 50.0, false)];
        let svg = svg(&[Chart { title: String::new(), x: String::new(), marks }]).unwrap();
        let anchor = |label: &str| {
            let before = &svg[..svg.find(label).unwrap()];
            let text = &before[before.rfind("<text").unwrap()..];
            text.split_once("text-anchor=\"").unwrap().1.split('"').next().unwrap().to_owned()
        };
        assert_eq!((anchor("&lt;1&gt;"), anchor("&lt;9&gt;")), ("start".into(), "end".into()), "{svg}");
    }

    #[test]
    fn one_point_or_none_make_a_chart() {
        for marks in [vec![], vec![mark(0.0, 0.0, true)]] {
            let svg = svg(&[Chart { title: String::new(), x: String::new(), marks }]).unwrap();
            assert!(svg.trim_end().ends_with("</svg>") && !svg.contains("NaN"), "{svg}");
        }
    }

    #[test]
    fn axis_labels_are_distinguishable() {
        assert_eq!(axis_label(43.256, 30.0), "43");
        assert_eq!(axis_label(43.256, 4.0), "43.3");
        assert_eq!(axis_label(3.2468, 0.05), "3.247");
        assert_eq!((axis_label(61_970.0, 4e4), axis_label(5e6, 9e6)), ("62 k".into(), "5.0 M".into()));
    }
}
