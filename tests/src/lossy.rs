//! Runs a program with a graphics device that fails: the Vulkan layer of `examples/lossy_driver.rs` below it.

use std::fs;
use std::path::Path;
use std::process::Command;

use crate::programs::example;

/// Name of the layer.
const LAYER: &str = "VK_LAYER_AARC_lossy_driver";

/// Adds the layer to a command; `when` is its `AARC_LOSE`. Its description is written to `folder`.
///
/// # Panics
/// If the layer cannot be built, or the folder cannot be written.
pub fn lossy(command: &mut Command, folder: &Path, when: &str) {
    let layer = serde_json::json!({
        "file_format_version": "1.1.2",
        "layer": {
            "name": LAYER, "type": "GLOBAL", "library_path": example("lossy_driver"),
            "api_version": "1.3.0", "implementation_version": "1", "description": "loses the device",
        },
    });
    fs::write(folder.join("lossy.json"), layer.to_string()).expect("files can be written");
    command.env("VK_ADD_LAYER_PATH", folder).env("VK_INSTANCE_LAYERS", LAYER).env("AARC_LOSE", when);
}
