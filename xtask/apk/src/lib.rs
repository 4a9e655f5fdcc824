//! Packing, signing and checking the APK of the player.

pub mod identity;
pub mod package;
