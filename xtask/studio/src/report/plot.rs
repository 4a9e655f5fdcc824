//! Line charts side by side over one logarithmic axis, as SVG. Rings mark chosen points.

use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};
use plotters::prelude::*;

/// A line chart.
#[derive(Clone, Debug)]
pub(crate) struct LineChart {
    /// Title, which names the quantity of the vertical axis.
    pub(crate) title: String,
    /// The series, in the order of their colours.
    pub(crate) lines: Vec<PlotLine>,
    /// Points with a ring around them.
    pub(crate) rings: Vec<(f64, f64)>,
}

/// A named line through points. Points that are not finite are skipped.
#[derive(Clone, Debug)]
pub(crate) struct PlotLine {
    pub(crate) name: String,
    pub(crate) points: Vec<(f64, f64)>,
}

/// Width and height of a chart in pixels.
const CHART_PX: (u32, u32) = (560, 420);

/// Colours that people with a colour deficiency can tell apart (Okabe and Ito 2008).
const COLORS: [RGBColor; 7] = [
    RGBColor(230, 159, 0),
    RGBColor(0, 158, 115),
    RGBColor(86, 180, 233),
    RGBColor(204, 121, 167),
    RGBColor(0, 0, 0),
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
];

/// Radius of a ring in pixels.
const RING_PX: i32 = 7;

/// The logarithmic axis labels these digits times powers of ten.
const DIGITS: [f64; 5] = [1.0, 2.0, 3.0, 5.0, 7.0];

/// Draws the charts side by side, with `x` as the title of their horizontal axes and a legend in the first.
///
/// # Errors
/// If the plot cannot be drawn.
pub(crate) fn svg(x: &str, charts: &[LineChart]) -> anyhow::Result<String> {
    let mut text = String::new();
    {
        let (width, height) = CHART_PX;
        let area =
            SVGBackend::with_string(&mut text, (width * charts.len() as u32, height)).into_drawing_area();
        area.fill(&WHITE)?;
        let areas = area.split_evenly((1, charts.len()));
        for (i, (area, chart)) in areas.iter().zip(charts).enumerate() {
            draw(area, x, chart, i == 0)?;
        }
        area.present()?;
    }
    Ok(text)
}

fn draw<D: DrawingBackend>(
    area: &DrawingArea<D, plotters::coord::Shift>,
    x: &str,
    chart: &LineChart,
    has_legend: bool,
) -> anyhow::Result<()>
where
    D::ErrorType: 'static,
{
    let is_finite = |(x, y): &(f64, f64)| x.is_finite() && *x > 0.0 && y.is_finite();
    let lines: Vec<Vec<(f64, f64)>> =
        chart.lines.iter().map(|line| line.points.iter().copied().filter(is_finite).collect()).collect();
    let range = |pick: fn(&(f64, f64)) -> f64| {
        let values = lines.iter().flatten().map(pick);
        values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)))
    };
    let (x_low, x_high) = range(|p| p.0);
    let (y_low, y_high) = range(|p| p.1);
    // Without points the axes need a range of their own.
    let (x_low, x_high) = if x_low <= x_high { (x_low / 1.15, x_high * 1.15) } else { (1.0, 10.0) };
    let (y_low, y_high) = if y_low <= y_high { (y_low, y_high) } else { (0.0, 1.0) };
    let margin = if y_low < y_high { 0.05 * (y_high - y_low) } else { 0.5 };

    let mut context = ChartBuilder::on(area)
        .margin(14)
        .caption(&chart.title, ("sans-serif", 17))
        .x_label_area_size(42)
        .y_label_area_size(48)
        .build_cartesian_2d(Logarithmic { low: x_low, high: x_high }, y_low - margin..y_high + margin)?;
    context
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(BLACK.mix(0.12))
        .label_style(("sans-serif", 13))
        .axis_desc_style(("sans-serif", 14))
        .x_desc(x)
        .draw()?;
    for ((i, line), points) in chart.lines.iter().enumerate().zip(lines) {
        let color = COLORS[i % COLORS.len()];
        let drawn = context
            .draw_series(LineSeries::new(points, color.stroke_width(2)).point_size(4))?
            .label(&line.name);
        drawn.legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], color.stroke_width(3)));
    }
    let rings = chart.rings.iter().copied().filter(is_finite);
    context.draw_series(rings.map(|point| Circle::new(point, RING_PX, BLACK.stroke_width(1))))?;
    if has_legend {
        context
            .configure_series_labels()
            .position(SeriesLabelPosition::LowerRight)
            .background_style(WHITE.mix(0.85))
            .border_style(BLACK.mix(0.3))
            .label_font(("sans-serif", 14))
            .draw()?;
    }
    Ok(())
}

/// A logarithmic axis that is also labelled between powers of ten: rates seldom span several.
struct Logarithmic {
    low: f64,
    high: f64,
}

impl Ranged for Logarithmic {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, (first, last): (i32, i32)) -> i32 {
        let place = (value / self.low).ln() / (self.high / self.low).ln();
        first + (f64::from(last - first) * place).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, _: Hint) -> Vec<f64> {
        let decades = self.low.log10().floor() as i32..=self.high.log10().ceil() as i32;
        let points = decades.flat_map(|power| DIGITS.map(|digit| digit * 10f64.powi(power)));
        points.filter(|point| (self.low..=self.high).contains(point)).collect()
    }

    fn range(&self) -> std::ops::Range<f64> {
        self.low..self.high
    }
}

impl ValueFormatter<f64> for Logarithmic {
    fn format(value: &f64) -> String {
        format!("{}", (value * 1e6).round() / 1e6)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chart(points: Vec<(f64, f64)>) -> LineChart {
        let rings = points.iter().copied().filter(|(x, _)| *x == 1.0 || *x == 2.0).collect();
        LineChart { title: "PSNR <dB>".into(), lines: vec![PlotLine { name: "a & b".into(), points }], rings }
    }

    #[test]
    fn every_finite_point_is_drawn() {
        let points = vec![(0.5, 20.0), (1.0, f64::INFINITY), (2.0, 30.0), (4.0, 35.0), (0.0, 1.0)];
        let svg = svg("Mbps", &[chart(points)]).unwrap();
        assert_eq!(svg.matches("<circle").count(), 3 + 1, "three points, a ring: {svg}");
        assert_eq!(svg.matches("r=\"7\"").count(), 1, "{svg}");
        assert!(svg.contains("PSNR &lt;dB&gt;") && svg.contains("a &amp; b") && svg.contains("Mbps"));
        assert!(svg.trim_end().ends_with("</svg>") && !svg.contains("NaN"));
    }

    #[test]
    fn one_point_or_none_makes_a_plot() {
        for points in [vec![], vec![(3.0, 1.0)], vec![(f64::NAN, 1.0)]] {
            let svg = svg("Mbps", &[chart(points.clone()), chart(points)]).unwrap();
            assert!(svg.trim_end().ends_with("</svg>") && !svg.contains("NaN"), "{svg}");
        }
    }

    #[test]
    fn the_axis_is_labelled_between_powers_of_ten() {
        let axis = Logarithmic { low: 0.8, high: 12.0 };
        assert_eq!(axis.key_points(10), [1.0, 2.0, 3.0, 5.0, 7.0, 10.0]);
        assert_eq!((axis.map(&0.8, (10, 110)), axis.map(&12.0, (10, 110))), (10, 110));
        assert_eq!(Logarithmic::format(&0.2), "0.2");
    }
}
