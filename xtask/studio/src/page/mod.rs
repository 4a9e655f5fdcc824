//! Pages: self-contained HTML of text, tables and plots, which reports and `ingest` write.

mod html;
mod plot;
mod table;

pub(crate) use html::{decimals, escape, grouped, page, prose, row, table};
pub(crate) use plot::{LineChart, PlotLine, Scale, svg};
pub(crate) use table::Table;
