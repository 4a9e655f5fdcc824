//! The host tool as a library: fitting, packaging, reports, procedural data,
//! and the commands of `aarc-studio`.

#[cfg(feature = "onnx")]
pub mod backbone;
pub mod capture;
pub mod cli;
mod commands;
pub mod eval;
mod ffmpeg;
pub mod fields;
pub mod fit;
pub mod ingest;
pub mod input;
mod left_out;
pub mod lpips_weights;
pub mod machine;
mod messages;
pub mod package;
mod page;
mod parse;
pub mod playlist;
pub mod progress;
pub mod report;
pub mod scene;
pub mod segments;
pub mod sound;
pub mod synth;
pub mod takes;
