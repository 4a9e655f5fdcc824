//! The player's modules that its transfers use to measure a server.

#[path = "../../../client/src/takes/layers.rs"]
#[allow(dead_code, reason = "the player uses the rest")]
mod layers;

pub(crate) use layers::Traffic;
