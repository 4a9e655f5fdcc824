//! The library part of the host tool: importers and exporters, scenes, procedural data.

#[cfg(feature = "onnx")]
pub mod backbone;
pub mod capture;
pub mod eval;
pub mod export;
pub mod fault;
pub mod fit;
pub mod import;
pub mod input;
pub mod machine;
pub mod output;
pub mod package;
pub mod playlist;
pub mod report;
pub mod scene;
pub mod synth;
pub mod takes;
pub mod workspace;
