//! Procedural data: scenes made of formulas, without footage and without fitting.

pub mod juggler;
pub mod limbs;
pub mod stage;
