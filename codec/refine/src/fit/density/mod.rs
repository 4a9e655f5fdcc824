//! Capacity control: how the number of Gaussians changes. Densification (clone, split), pruning above
//! the capacity floor, resets of the opacity, relocation, the floater filter, and thinning of what stands still.

mod control;
mod densify;
mod floaters;
mod prune;
mod relocate;
mod reset;
mod rule;
mod screen_gradients;
#[cfg(test)]
mod tests;
mod thin;

pub(super) use control::{DensityControl, DensityState};
pub use rule::{DensityChange, DensityRule};
pub(super) use screen_gradients::ScreenGradients;
pub(super) use thin::thin;
