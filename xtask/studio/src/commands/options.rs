//! Options that many commands have.

use std::path::PathBuf;

/// Where a command writes.
#[derive(clap::Args, Clone, Debug)]
pub(super) struct OutOption {
    /// File or folder to write
    #[arg(short = 'o', long = "out", value_name = "PATH")]
    pub(super) path: PathBuf,
}

/// Whether a command prints JSON.
#[derive(clap::Args, Clone, Copy, Debug, Default)]
pub(super) struct JsonOption {
    /// Print JSON
    #[arg(long = "json")]
    pub(super) is_given: bool,
}
