//! One module per subcommand: its arguments and what it does.

mod audio;
mod backend;
pub(crate) mod capture;
pub(crate) mod depths;
pub(crate) mod eval;
pub(crate) mod export;
pub(crate) mod fit;
mod fit_folder;
mod fit_plate;
mod fit_progress;
mod fit_setting;
mod fit_source;
pub(crate) mod ingest;
pub(crate) mod inspect;
pub(crate) mod join;
mod options;
pub(crate) mod package;
pub(crate) mod poster;
pub(crate) mod render;
pub(crate) mod report;
pub(crate) mod synth;
pub(crate) mod takes;
pub(crate) mod trim;
