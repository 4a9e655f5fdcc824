//! Writes playlists for the player, see `xtask/PLAYLIST.md`.

use program::Fault;
use serde_json::json;

/// Maximum size in bytes of a playlist in the player.
const BYTES_MAX: usize = 1 << 20;

/// File name of a playlist beside its clips.
pub const FILE: &str = "playlist.json";

/// Contents of a playlist; `clips` are paths relative to its folder.
///
/// # Errors
/// [`Fault::Data`] if a path has control characters or the playlist is too large for the player.
pub fn from_clips(clips: impl IntoIterator<Item = String>) -> Result<Vec<u8>, Fault> {
    let clips: Vec<String> = clips.into_iter().collect();
    if let Some(clip) = clips.iter().find(|clip| clip.chars().any(char::is_control)) {
        return Err(Fault::Data(format!(
            "{clip:?}: a name of a playlist has no control characters: rename it"
        )));
    }
    let text = format!("{:#}\n", json!({"version": 1, "clips": clips}));
    match text.len() > BYTES_MAX {
        true => Err(Fault::Data(format!(
            "the playlist would have {} bytes, and players read {BYTES_MAX}: make several lists, or shorten names",
            text.len()
        ))),
        false => Ok(text.into_bytes()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_players_refuse_is_not_written() {
        let long = |count: usize| from_clips((0..count).map(|_| "x".repeat(1000)));
        assert!(long(1000).is_ok_and(|bytes| bytes.len() > 1_000_000));
        assert!(long(1100).unwrap_err().to_string().contains("make several lists"));
        let error = from_clips(["a\tb.aarc".to_owned()]).unwrap_err().to_string();
        assert!(error.starts_with("\"a\\tb.aarc\": "), "{error}");
    }
}
