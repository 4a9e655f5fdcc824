//! Pruning: chooses the Gaussians of a field that fit a budget.
//!
//! 1. A [`Ranking`] scores the rows, and [`by_importance`] sorts them.
//! 2. [`Floor::choices`] keeps a budget of rows, and swaps some to preserve the topology of the density.
//! 3. [`select()`] compares the rankings by the pictures of their packages, see [`Pictures`].
//! 4. [`within_fragments`] keeps a budget of fragments, if there is one: the rows that show least for theirs go.
//! 5. [`recolor()`] adjusts the colours of the remaining rows to the pictures of the whole field.
//!
//! ```
//! use refine::prune::{Floor, FloorSettings, Ranking, by_importance};
//! # let field = codec::Field {
//! #     centers: (0..8).map(|i| [i as f32, 0.0, 0.0]).collect(),
//! #     rotations: vec![[1.0, 0.0, 0.0, 0.0]; 8],
//! #     log_scales: vec![[-1.0; 3]; 8],
//! #     opacities: (1..9).map(|i| i as f32 / 9.0).collect(),
//! #     sh: vec![[0.0; 3]; 8],
//! #     ..codec::Field::default()
//! # };
//! let order = by_importance(&Ranking::Mass.scores(&field, &[]));
//! let floor = Floor::new(&field, FloorSettings::default());
//! let retained = floor.enforce(&order, 5, || ());
//! assert_eq!(retained.rows.len(), 5);
//! ```

mod density;
mod floor;
mod fragments;
mod persistence;
mod pictures;
mod posed_views;
mod rank;
mod recolor;
#[cfg(test)]
pub(crate) mod scenes;
mod select;
mod topology;

pub use floor::{Floor, FloorSettings, ROUNDS, Retained};
pub use fragments::{weight_per_fragment, within_fragments};
pub use persistence::{Connectivity, Feature, MergeTree};
pub(crate) use pictures::PictureErrors;
pub use pictures::{Fidelity, Pictures, WorstPicture};
pub use posed_views::{instants, posed_views, steps_aside};
pub use rank::{Ranking, by_importance, contributions_to};
pub use recolor::{PASSES, recolor};
pub use select::{Candidate, RESOLUTION_DB, Selection, select};
pub use topology::{Measure, Topology};
