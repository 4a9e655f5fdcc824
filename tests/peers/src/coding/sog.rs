//! SOG, by npm `@playcanvas/splat-transform`: static fields.

use std::path::Path;
use std::process::Command;

use codec::Field;
use formats::import;
use program::Fault;

use super::peer_file::PeerFile;
use crate::player::web_folder;

/// Path of the program from [`web_folder`].
const CLI: &str = "../node_modules/@playcanvas/splat-transform/bin/cli.mjs";

/// Codes a static field.
pub(super) fn file(field: &Field, folder: &Path) -> anyhow::Result<PeerFile> {
    let (ply, path) = (folder.join("coded.ply"), folder.join("coded.sog"));
    std::fs::write(&ply, formats::write_static_ply(field, None))?;
    let mut command = Command::new("node");
    command.arg(web_folder().join(CLI)).args(["--quiet", "--overwrite", "--gpu", "cpu"]).arg(&ply).arg(&path);
    let output = command.output().map_err(|error| Fault::Device(format!("node: {error}")))?;
    if !output.status.success() {
        let message = String::from_utf8_lossy(&output.stderr).trim().to_owned();
        return Err(Fault::Device(format!("splat-transform: {message}")).into());
    }
    Ok(PeerFile {
        name: "SOG",
        leaves_out: "motion: one instant",
        bytes: std::fs::read(&path)?.len(),
        field: import(&path)?.field,
        decode: Box::new(move || {
            import(&path)?;
            Ok(())
        }),
    })
}
