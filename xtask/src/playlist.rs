//! A playlist, as the player reads it: see `xtask/PLAYLIST.md`.

use serde_json::json;

/// What a playlist is called beside its clips.
pub const FILE: &str = "playlist.json";

/// The contents of a playlist of clips, which are named by their paths from its folder.
pub fn of(clips: impl IntoIterator<Item = String>) -> Vec<u8> {
    let clips: Vec<String> = clips.into_iter().collect();
    format!("{:#}\n", json!({"version": 1, "clips": clips})).into_bytes()
}
