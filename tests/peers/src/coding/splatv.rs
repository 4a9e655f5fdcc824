//! `.splatv`, the format of splaTV and gsplat.js: dynamic fields without compression.

use std::path::Path;

use codec::{ClipInfo, Field};
use formats::import;

use super::peer_file::PeerFile;

/// Codes a field as the file that gsplat.js plays.
pub(super) fn file(field: &Field, info: &ClipInfo, folder: &Path) -> anyhow::Result<PeerFile> {
    let path = folder.join("coded.splatv");
    let bytes = formats::write_splatv(field, info);
    std::fs::write(&path, &bytes)?;
    Ok(PeerFile {
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
