//! The numbers of SPZ version 3, compressed by zstd in place of gzip, as version 4 does: static fields.

use std::io::Read;
use std::path::Path;

use anyhow::Context;
use codec::Field;
use flate2::read::GzDecoder;
use studio::export;
use studio::import::import;

use super::peer_file::PeerFile;

/// The highest level that needs no special decoder.
const ZSTD_LEVEL: i32 = 19;

/// A file of a field that stands still.
pub(super) fn file(field: &Field, folder: &Path) -> anyhow::Result<PeerFile> {
    let path = folder.join("coded.spz");
    // With y up the axes stay as they are.
    let gzipped = export::spz(field, [0.0, 1.0, 0.0]);
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
