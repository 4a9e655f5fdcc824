//! Choosing the Gaussians a package keeps.
//!
//! [`Ranking`]s order them by importance. A [`Floor`] keeps a budget's worth without losing what
//! holds the subject together, seen in the persistence of its density. [`Pictures`] of the whole,
//! held against what is left, tell [`select()`] which ranking is best. [`recolor()`] lets the colours of
//! those that stay make up for those that leave.

mod density;
mod extent;
mod floor;
mod persistence;
mod pictures;
mod posed_views;
mod rank;
mod recolor;
#[cfg(test)]
pub(crate) mod scenes;
mod select;
mod topology;

pub use floor::{Floor, FloorError, FloorSettings, Kept, ROUNDS};
pub use persistence::{Connectivity, Feature, MergeTree};
pub use pictures::Pictures;
pub use posed_views::{PosedView, dome, instants, posed_views, steps_aside};
pub use rank::{Ranking, by_importance, contributions_to};
pub use recolor::{PASSES, recolor};
pub use select::{Candidate, RESOLUTION_DB, Selection, select};
pub use topology::{Measure, Topology};
