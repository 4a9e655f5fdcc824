//! `.splatv`, the format of splaTV and gsplat.js: moving fields, not compressed.

use std::path::Path;

use codec::{ClipInfo, Field};
use studio::export;
use studio::import::import;

use super::Theirs;

/// The file that is played in the WebGL players.
pub(super) fn file(field: &Field, info: &ClipInfo, folder: &Path) -> anyhow::Result<Theirs> {
    let path = folder.join("coded.splatv");
    let bytes = export::splatv(field, info);
    std::fs::write(&path, &bytes)?;
    Ok(Theirs {
        name: ".splatv",
        leaves_out: "",
        bytes: bytes.len(),
        field: import(&path)?.field,
        decode: Box::new(move || {
            import(&path)?;
            Ok(())
        }),
    })
}
