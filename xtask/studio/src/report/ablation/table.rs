//! The tables of an ablation.

use refine::capture::Split;

use super::result::{Ablation, Method, PackageFigures, measures_in};
use crate::eval::SplitMeasures;
use crate::page::{Table, decimals, grouped};

/// A measure of a split: heading, decimals, value.
type Measure = (&'static str, usize, fn(&SplitMeasures) -> Option<f64>);

const PSNR: Measure = ("PSNR, dB", 2, |row| row.psnr_fg);
const SSIM: Measure = ("SSIM", 4, |row| Some(row.ssim));
const LPIPS: Measure = ("LPIPS", 4, |row| row.lpips);

/// Headings of the columns of a measure that any row has, and its cells in a row.
struct Columns(Vec<(Split, Measure)>);

impl Columns {
    fn new<'a>(
        splits: &[Split],
        measures: &[Measure],
        rows: impl Iterator<Item = &'a [SplitMeasures]> + Clone,
    ) -> Columns {
        let all = measures.iter().flat_map(|measure| splits.iter().map(move |split| (*split, *measure)));
        let is_known = |(split, measure): &(Split, Measure)| {
            rows.clone().any(|row| measures_in(row, *split).is_some_and(|row| measure.2(row).is_some()))
        };
        Columns(all.filter(is_known).collect())
    }

    fn head(&self) -> impl Iterator<Item = String> {
        self.0.iter().map(|(split, (name, ..))| format!("{} {name}", split.name()))
    }

    fn cells(&self, splits: &[SplitMeasures]) -> impl Iterator<Item = String> {
        let cell = |(split, (_, places, value)): &(Split, Measure)| {
            decimals(measures_in(splits, *split).and_then(value), *places)
        };
        self.0.iter().map(cell)
    }
}

/// PSNR and cost of the fits and other methods.
pub(super) fn methods(ablation: &Ablation) -> Table {
    let columns = Columns::new(&ablation.splits(), &[PSNR], splits_of(ablation));
    let mut head = vec!["method".to_owned()];
    head.extend(columns.head());
    head.extend(["Gaussians", "seconds", "ms a step", "fragments per lit pixel"].map(String::from));
    let memory = |method: &Method| method.fit.as_ref().and_then(|fit| fit.peak_device_bytes);
    let on_device = ablation.methods.iter().any(|method| memory(method).is_some());
    head.extend(on_device.then(|| "peak device MB".to_owned()));
    let row = |method: &Method| {
        let fit = method.fit.as_ref();
        let mut row = vec![method.name.clone()];
        row.extend(columns.cells(&method.splits));
        row.push(fit.map_or_else(|| "-".into(), |fit| grouped(fit.gaussians as f64)));
        row.push(decimals(fit.map(|fit| fit.seconds), 1));
        row.push(decimals(fit.map(|fit| fit.ms_per_step), 1));
        row.push(decimals(method.fragments_per_lit_pixel, 1));
        let megabytes = || decimals(memory(method).map(|bytes| bytes as f64 * 1e-6), 0);
        row.extend(on_device.then(megabytes));
        row
    };
    Table::new(head).with_rows(ablation.methods.iter().map(row))
}

/// SSIM and LPIPS of the fits and other methods.
pub(super) fn similarity(ablation: &Ablation) -> Table {
    let columns = Columns::new(&ablation.splits(), &[SSIM, LPIPS], splits_of(ablation));
    let head = ["method".to_owned()].into_iter().chain(columns.head());
    let row =
        |method: &Method| [method.name.clone()].into_iter().chain(columns.cells(&method.splits)).collect();
    Table::new(head).with_rows(ablation.methods.iter().map(row))
}

fn splits_of(ablation: &Ablation) -> impl Iterator<Item = &[SplitMeasures]> + Clone {
    ablation.methods.iter().map(|method| &method.splits[..])
}

/// The packages of the fits.
pub(super) fn packages(ablation: &Ablation) -> Table {
    let rows = ablation.packages.iter().map(|package| &package.splits[..]);
    let columns = Columns::new(&ablation.splits(), &[PSNR], rows);
    let mut head = ["fit", "budget", "Gaussians", "bytes", "Mbps", "Topo"].map(String::from).to_vec();
    head.extend(columns.head());
    let row = |package: &PackageFigures| {
        let mut row = vec![
            package.method.clone(),
            grouped(package.budget as f64),
            grouped(package.gaussians as f64),
            grouped(package.bytes as f64),
            format!("{:.2}", package.mbps),
            format!("{:.3}", package.topology),
        ];
        row.extend(columns.cells(&package.splits));
        row
    };
    Table::new(head).with_rows(ablation.packages.iter().map(row))
}
