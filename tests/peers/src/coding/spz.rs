//! SPZ version 3 with zstd instead of gzip, as in version 4: static fields.

use std::io::Read;
use std::path::Path;

use anyhow::Context;
use codec::Field;
use flate2::read::GzDecoder;
use formats::import;

use super::peer_file::PeerFile;

/// Highest zstd level that any decoder accepts.
const ZSTD_LEVEL: i32 = 19;

/// Codes a static field.
pub(super) fn file(field: &Field, folder: &Path) -> anyhow::Result<PeerFile> {
    let path = folder.join("coded.spz");
    // With y up the axes do not change.
    let gzipped = formats::write_spz(field, [0.0, 1.0, 0.0]);
    std::fs::write(&path, &gzipped)?;
    let mut plain = Vec::new();
    GzDecoder::new(&*gzipped).read_to_end(&mut plain)?;
    let bytes = zstd::bulk::compress(&plain, ZSTD_LEVEL).context("zstd")?;
    Ok(PeerFile {
        name: "SPZ, zstd 19",
        leaves_out: "motion: one instant",
        bytes: bytes.len(),
        field: import(&path)?.field,
        decode: Box::new(move || {
            import(&path)?;
            Ok(())
        }),
    })
}
