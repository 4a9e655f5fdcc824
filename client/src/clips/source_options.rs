//! [`SourceOptions`]: where clips may come from, and where downloads are cached.

use std::path::PathBuf;

use codec::Limits;

/// Where clips and playlists may come from, and where downloads are cached.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SourceOptions {
    /// The folder in which downloads are cached, if they are.
    pub cache_dir: Option<PathBuf>,
    /// The servers that downloads may come from.
    pub servers: Servers,
    /// Limits on each clip.
    pub limits: Limits,
}

/// Servers that a download may come from. Private are also link-local and loopback addresses.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Servers {
    /// All, but a redirect from a public address leads to public ones only.
    #[default]
    Guarded,
    /// Those with public addresses: a playlist from a public address names the clip.
    Public,
    /// All.
    All,
}

impl SourceOptions {
    /// The same for a clip that a playlist names, which comes from a public address if `from_public`.
    pub(crate) fn for_entry(&self, from_public: bool) -> SourceOptions {
        let servers = match self.servers {
            Servers::Guarded if from_public => Servers::Public,
            servers => servers,
        };
        SourceOptions { servers, ..self.clone() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_a_public_playlist_names_has_to_be_public() {
        let servers = |servers, from_public| {
            SourceOptions { servers, ..SourceOptions::default() }.for_entry(from_public).servers
        };
        assert_eq!(servers(Servers::Guarded, true), Servers::Public);
        assert_eq!(servers(Servers::Guarded, false), Servers::Guarded);
        assert_eq!(servers(Servers::All, true), Servers::All);
    }
}
