//! Procedural data: scenes from formulas, without captures and without fitting.

pub mod juggler;
pub mod limbs;
pub mod rig;
pub mod stage;
