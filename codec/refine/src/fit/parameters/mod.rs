//! What a fit optimises: the columns of [`Parameters`], the [`Bounds`] that they are kept in, and the
//! units of time ([`Timeline`]) and length ([`scene_extent`]).

mod bounds;
mod columns;
mod extent;
mod timeline;

#[cfg(feature = "gpu")]
pub(super) use bounds::LOGIT_MAX;
pub(super) use bounds::{Bounds, NORM_MIN};
pub use columns::Parameters;
pub(super) use columns::COLUMNS;
pub(super) use extent::scene_extent;
pub use timeline::Timeline;
