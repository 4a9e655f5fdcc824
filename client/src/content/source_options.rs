//! [`SourceOptions`]: where downloads are cached, and limits on clips.

use std::path::PathBuf;

use codec::Limits;

/// Where downloads are cached, and limits on clips.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SourceOptions {
    /// The folder in which downloads are cached, if they are.
    pub cache_dir: Option<PathBuf>,
    /// Limits on each clip.
    pub limits: Limits,
}
