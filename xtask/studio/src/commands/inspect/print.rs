//! The text of `inspect`.

use std::path::Path;

use program::counted;

use super::Inspection;
use super::rows::{Alive, Audio, Damage, Plate, PosterRow};
use crate::messages::decimal;
use crate::segments::Course;

impl Inspection {
    pub(super) fn print(&self, path: &Path) {
        let segments = counted(self.segments.len(), "segment");
        println!("{}: .aarc {}, coder {}, {segments}", path.display(), self.format_version, self.coder);
        if self.bytes < self.bytes_announced {
            let (complete, layers) = self.layers_there();
            println!(
                "cut short: {} of {} bytes; every segment has its first {complete} of {layers} layers",
                self.bytes, self.bytes_announced
            );
        }
        println!();
        self.print_metadata();
        self.print_layers_and_segments();
        self.print_sections();
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
            println!("{time_s:<12.3}{candidates:>12}{alive:>12}{:>8.1} %", self.percent(*alive));
        }
    }

    fn print_metadata(&self) {
        let row = |name: &str, value: String| println!("{name:<12}{value}");
        let Course { startup_bytes, resident_max, mean_mbps, peak_mbps, peak_s, .. } = &self.course;
        let [still, moving] = [self.static_count, self.dynamic_count];
        row("gaussians", format!("{} ({still} motionless, {moving} moving or fading)", self.gaussians));
        row("", format!("at most {resident_max} in the segments of an instant, plates included"));
        row("bytes", format!("{}, {:.2} per Gaussian", self.bytes, self.bytes_per_gaussian));
        row("GPU", format!("{} bytes for the largest segment", self.gpu_bytes));
        let peak = match *peak_mbps > 0.0 {
            true => format!(
                ", after the first instant at most {peak_mbps:.2} over one second, from {peak_s:.3} s"
            ),
            false => String::new(),
        };
        row("Mbps", format!("{mean_mbps:.2} in the mean{peak}; {startup_bytes} bytes for the first instant"));
        let [duration_s, fps] = [self.duration_s, f64::from(self.fps)].map(|x| decimal(x, 3));
        row("duration", format!("{duration_s} s at {fps} frames per second"));
        for [from, to] in self.gaps.iter().map(|gap| gap.map(|t_s| decimal(t_s, 3))) {
            row("gap", format!("no segment shows {from} to {to} s"));
        }
        row("up", format!("{:?}, {} m per unit", self.up, self.metres_per_unit));
        row("bounds", format!("{:?} to {:?}", self.bounds[0], self.bounds[1]));
        for view in &self.viewpoints {
            let (name, position, target, fov_y_deg) =
                (&view.name, view.position, view.target, view.fov_y_deg);
            row(
                "viewpoint",
                format!("\"{name}\" at {position:?}, looks at {target:?}, {fov_y_deg:.1} degrees high"),
            );
        }
        let rotates = if self.rotation_rates { "rotation over time" } else { "no rotation over time" };
        let (degree, order) = (self.sh_degree, self.motion_order);
        row("columns", format!("SH degree {degree}, motion of order {order}, {rotates}"));
        row("filter", self.filter.into());
        if let Some(near) = self.near {
            row("near", format!("fades nearer than {near} units to the eye"));
        }
        if self.by_device {
            row("computed", "by a graphics device; elsewhere the same field may give another package".into());
        }
        let plate = |Plate { gaussians, sh_degree, filter }: &Plate| {
            format!("at most {gaussians} Gaussians, SH degree {sh_degree}, filter {filter}")
        };
        row("plate", self.plate.as_ref().map_or("none".into(), plate));
        let line = |section, value| Damage::line(&self.damaged, section, value);
        row("sound", line("sound", self.audio.as_ref().map(Audio::describe)));
        row("poster", line("poster", self.poster.as_ref().map(PosterRow::describe)));
    }

    fn print_layers_and_segments(&self) {
        println!("\n{:<8}{:>12}{:>12}  (to its end)", "layer", "gaussians", "bytes");
        for (i, layer) in self.layers.iter().enumerate() {
            let missing = if layer.complete { "" } else { "  missing" };
            println!("{i:<8}{:>12}{:>12}{missing}", layer.gaussians, layer.bytes);
        }

        println!(
            "\n{:<8}{:>11}{:>12}{:>7}{:>8}{:>12}{:>12}",
            "segment", "from, s", "seconds", "level", "layers", "gaussians", "bytes"
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
            "from, s", "to, s", "segments", "gaussians", "bytes", "Mbps"
        );
        for row in &self.course.rows {
            println!(
                "{:<11.3}{:>11.3}{:>10}{:>12}{:>12}{:>9.2}",
                row.from_s, row.to_s, row.segments, row.gaussians, row.bytes, row.mbps
            );
        }
        println!("(segments and gaussians: the most at an instant; bytes: of segments that begin)");
    }

    fn print_sections(&self) {
        println!("\n{:<20}{:>8}{:>12}{:>12}", "sections", "number", "bytes", "raw bytes");
        println!("{:<20}{:>8}{:>12}", "heads", "", self.head_bytes);
        for sum in &self.sections {
            println!("{:<20}{:>8}{:>12}{:>12}", sum.name(), sum.number, sum.bytes, sum.raw_bytes);
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
