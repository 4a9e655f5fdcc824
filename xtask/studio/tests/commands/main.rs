//! Tests of the host tool's commands and of the code behind them: one program, as each would link the renderer anew and
//! run while no other does.

mod ablation;
mod audio;
mod capture;
mod eval;
mod failures;
mod fit;
mod fit_faults;
mod fit_segments;
mod fit_slide;
mod ingest;
mod inspect;
mod learn;
mod mattes;
mod package;
mod plate;
mod poster;
mod report;
mod rig;
mod segments;
mod stage;
mod takes;
mod undistortion;
mod videos;

#[path = "../small_rig/mod.rs"]
mod small_rig;
#[path = "../small_stage/mod.rs"]
mod small_stage;
#[path = "../../../../codec/formats/tests/support/mod.rs"]
mod support;
#[path = "../tool/mod.rs"]
mod tool;
