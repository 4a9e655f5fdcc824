//! [`SourceOptions`]: where downloads are cached, which way is up, and limits on clips.

use std::path::PathBuf;

use codec::Limits;

/// Where downloads are cached, which way is up in fields of other programs, and limits on clips.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SourceOptions {
    /// The folder in which downloads are cached, if they are.
    pub cache_dir: Option<PathBuf>,
    /// The axis of fields of other programs that points up, if not what they say.
    pub up: Option<[i8; 3]>,
    /// Limits on each clip.
    pub limits: Limits,
}
