//! Line charts side by side over one axis, as SVG. Rings mark chosen points, and dashed lines chosen instants.

use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};
use plotters::coord::types::RangedCoordf64;
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
    /// Whether the vertical axis begins at 0, as the axis of counts does.
    pub(crate) from_zero: bool,
    /// Where the cuts of a take are, on the horizontal axis.
    pub(crate) cuts: Vec<f64>,
}

/// The horizontal axis of charts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Scale {
    /// Of rates and work, all above 0.
    Logarithmic,
    /// Of time.
    Linear,
}

/// A named line through points. Points that are not finite are skipped.
#[derive(Clone, Debug)]
pub(crate) struct PlotLine {
    /// Its name in the legend; none if it is empty.
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

/// The colour of cuts.
const CUT: RGBColor = RGBColor(150, 150, 150);

/// Radius of a ring in pixels.
const RING_PX: i32 = 7;

/// Most points of a line that are marked: the marks of more would be a thick line.
const MARKED_MAX: usize = 120;

/// Length of the dashes of a cut and of the gaps between them, in pixels.
const DASH_PX: (i32, i32) = (4, 4);

/// The logarithmic axis labels these digits times powers of ten.
const DIGITS: [f64; 5] = [1.0, 2.0, 3.0, 5.0, 7.0];

/// Draws the charts side by side, with `x` as the title of their horizontal axes and a legend in the first.
///
/// # Errors
/// If the plot cannot be drawn.
pub(crate) fn svg(scale: Scale, x: &str, charts: &[LineChart]) -> anyhow::Result<String> {
    let mut text = String::new();
    {
        let (width, height) = CHART_PX;
        let area =
            SVGBackend::with_string(&mut text, (width * charts.len() as u32, height)).into_drawing_area();
        area.fill(&WHITE)?;
        let areas = area.split_evenly((1, charts.len()));
        for (i, (area, chart)) in areas.iter().zip(charts).enumerate() {
            draw(area, (scale, x), chart, i == 0)?;
        }
        area.present()?;
    }
    Ok(text)
}

fn draw<D: DrawingBackend>(
    area: &DrawingArea<D, plotters::coord::Shift>,
    (scale, x): (Scale, &str),
    chart: &LineChart,
    has_legend: bool,
) -> anyhow::Result<()>
where
    D::ErrorType: 'static,
{
    let is_finite = |point: &(f64, f64)| is_drawn(scale, point);
    let lines: Vec<Vec<(f64, f64)>> =
        chart.lines.iter().map(|line| line.points.iter().copied().filter(is_finite).collect()).collect();
    let [(x_low, x_high), (y_low, y_high)] = ranges(scale, &lines, chart.from_zero);
    let mut context = ChartBuilder::on(area)
        .margin(14)
        .caption(&chart.title, ("sans-serif", 17))
        .x_label_area_size(42)
        .y_label_area_size(60)
        .build_cartesian_2d(Axis { scale, low: x_low, high: x_high }, y_low..y_high)?;
    context
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(BLACK.mix(0.12))
        .label_style(("sans-serif", 13))
        .axis_desc_style(("sans-serif", 14))
        .x_desc(x)
        .draw()?;
    for &cut in chart.cuts.iter().filter(|cut| (x_low..=x_high).contains(*cut)) {
        let ends = [(cut, y_low), (cut, y_high)];
        let (dash, gap) = DASH_PX;
        context.draw_series(DashedLineSeries::new(ends, dash, gap, CUT.stroke_width(1)))?;
    }
    for ((i, line), points) in chart.lines.iter().enumerate().zip(lines) {
        let color = COLORS[i % COLORS.len()];
        let marks = if points.len() > MARKED_MAX { 0 } else { 4 };
        let drawn = context.draw_series(LineSeries::new(points, color.stroke_width(2)).point_size(marks))?;
        if !line.name.is_empty() {
            let key = move |(x, y)| PathElement::new([(x, y), (x + 18, y)], color.stroke_width(3));
            drawn.label(&line.name).legend(key);
        }
    }
    let rings = chart.rings.iter().copied().filter(is_finite);
    context.draw_series(rings.map(|point| Circle::new(point, RING_PX, BLACK.stroke_width(1))))?;
    if has_legend && chart.lines.iter().any(|line| !line.name.is_empty()) {
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

/// Whether a point has a place in a chart.
fn is_drawn(scale: Scale, (x, y): &(f64, f64)) -> bool {
    x.is_finite() && y.is_finite() && (scale == Scale::Linear || *x > 0.0)
}

/// The ranges of both axes around the points of `lines`, which all are drawn; some range if there is none.
fn ranges(scale: Scale, lines: &[Vec<(f64, f64)>], from_zero: bool) -> [(f64, f64); 2] {
    let range = |pick: fn(&(f64, f64)) -> f64| {
        let values = lines.iter().flatten().map(pick);
        values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)))
    };
    let (x_low, x_high) = range(|p| p.0);
    let (y_low, y_high) = range(|p| p.1);
    let x = match scale {
        _ if x_low > x_high => (1.0, 10.0),
        Scale::Logarithmic => (x_low / 1.15, x_high * 1.15),
        Scale::Linear if x_low == x_high => (x_low - 1.0, x_high + 1.0),
        Scale::Linear => (x_low, x_high),
    };
    let y_low = if from_zero { y_low.min(0.0) } else { y_low };
    let (y_low, y_high) = if y_low <= y_high { (y_low, y_high) } else { (0.0, 1.0) };
    let margin = if y_low < y_high { 0.05 * (y_high - y_low) } else { 0.5 };
    [x, (y_low - margin, y_high + margin)]
}

/// A horizontal axis. A logarithmic one is also labelled between powers of ten: rates seldom span several.
struct Axis {
    scale: Scale,
    low: f64,
    high: f64,
}

impl Ranged for Axis {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, (first, last): (i32, i32)) -> i32 {
        let place = match self.scale {
            Scale::Logarithmic => (value / self.low).ln() / (self.high / self.low).ln(),
            Scale::Linear => (value - self.low) / (self.high - self.low),
        };
        first + (f64::from(last - first) * place).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        if self.scale == Scale::Linear {
            return RangedCoordf64::from(self.low..self.high).key_points(hint);
        }
        let decades = self.low.log10().floor() as i32..=self.high.log10().ceil() as i32;
        let points = decades.flat_map(|power| DIGITS.map(|digit| digit * 10f64.powi(power)));
        points.filter(|point| (self.low..=self.high).contains(point)).collect()
    }

    fn range(&self) -> std::ops::Range<f64> {
        self.low..self.high
    }
}

impl ValueFormatter<f64> for Axis {
    fn format(value: &f64) -> String {
        format!("{}", (value * 1e6).round() / 1e6)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chart(points: Vec<(f64, f64)>) -> LineChart {
        let rings = points.iter().copied().filter(|(x, _)| *x == 1.0 || *x == 2.0).collect();
        let lines = vec![PlotLine { name: "a & b".into(), points }];
        LineChart { title: "PSNR <dB>".into(), lines, rings, from_zero: false, cuts: Vec::new() }
    }

    #[test]
    fn every_finite_point_is_drawn() {
        let points = vec![(0.5, 20.0), (1.0, f64::INFINITY), (2.0, 30.0), (4.0, 35.0), (0.0, 1.0)];
        let svg = svg(Scale::Logarithmic, "Mbps", &[chart(points)]).unwrap();
        assert_eq!(svg.matches("<circle").count(), 3 + 1, "three points, a ring: {svg}");
        assert_eq!(svg.matches("r=\"7\"").count(), 1, "{svg}");
        assert!(svg.contains("PSNR &lt;dB&gt;") && svg.contains("a &amp; b") && svg.contains("Mbps"));
        assert!(svg.trim_end().ends_with("</svg>") && !svg.contains("NaN"));
    }

    #[test]
    fn one_point_or_none_makes_a_plot() {
        for points in [vec![], vec![(3.0, 1.0)], vec![(f64::NAN, 1.0)]] {
            let svg = svg(Scale::Logarithmic, "Mbps", &[chart(points.clone()), chart(points)]).unwrap();
            assert!(svg.trim_end().ends_with("</svg>") && !svg.contains("NaN"), "{svg}");
        }
    }

    #[test]
    fn the_axis_is_labelled_between_powers_of_ten() {
        let axis = Axis { scale: Scale::Logarithmic, low: 0.8, high: 12.0 };
        assert_eq!(axis.key_points(10), [1.0, 2.0, 3.0, 5.0, 7.0, 10.0]);
        assert_eq!((axis.map(&0.8, (10, 110)), axis.map(&12.0, (10, 110))), (10, 110));
        assert_eq!(Axis::format(&0.2), "0.2");
    }

    #[test]
    fn time_begins_at_zero_and_cuts_are_dashed() {
        let points = vec![(0.0, 20.0), (1.0, 30.0), (4.0, 35.0)];
        let lines = vec![PlotLine { name: String::new(), points }];
        // The last is not on the axis.
        let cuts = vec![1.0, 3.0, 5.0];
        let chart = LineChart { title: "Gaussians".into(), lines, rings: Vec::new(), from_zero: true, cuts };
        let drawn = |chart: &LineChart| svg(Scale::Linear, "s", std::slice::from_ref(chart)).unwrap();
        let with_cuts = drawn(&chart);
        assert_eq!(with_cuts.matches("<circle").count(), 3, "{with_cuts}");
        let shows_zero = |svg: &str| svg.lines().any(|line| line.trim() == "0.0");
        assert!(shows_zero(&with_cuts), "{with_cuts}");
        assert!(!shows_zero(&drawn(&LineChart { from_zero: false, ..chart.clone() })));
        let dashes = with_cuts.matches("#969696").count();
        assert!(dashes > 2 * 20, "{dashes}");
        let without = drawn(&LineChart { cuts: Vec::new(), ..chart });
        assert_eq!(without.matches("#969696").count(), 0);
        let axis = Axis { scale: Scale::Linear, low: 0.0, high: 4.0 };
        assert_eq!((axis.map(&0.0, (10, 110)), axis.map(&3.0, (10, 110))), (10, 85));
    }
}
