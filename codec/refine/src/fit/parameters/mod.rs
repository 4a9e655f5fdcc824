//! What a fit optimises: the columns of [`Parameters`], the [`Bounds`] that they are kept in, and the
//! units of time ([`Timeline`]) and length ([`scene_extent`]).

mod bounds;
mod carried;
mod columns;
mod extent;
mod timeline;

pub(super) use bounds::{Bounds, NORM_MIN};
pub use carried::Carried;
pub(super) use carried::{STATIC_SHARE, keep_limits};
#[cfg(feature = "gpu")]
pub(super) use columns::LOGIT_MAX;
pub use columns::Parameters;
pub(super) use columns::{COLUMNS, row_of};
pub(super) use extent::scene_extent;
pub use timeline::Timeline;
