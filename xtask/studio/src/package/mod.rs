//! [`package`]: a scene becomes the bytes of an `.aarc` package, and a report.
//!
//! ```text
//! scene -> visible -> choose (rank, floor, render, order) -> refine -> snap and encode in layers -> verify
//! ```
//!
//! `take` packages a take, segment by segment.

mod analysis;
mod choose;
mod encode;
mod layer_order;
mod lens_fragments;
mod pipeline;
mod report;
mod settings;
mod snap;
mod take;
mod views;
mod visible;

pub(crate) use analysis::{FLOOR_INSTANTS, FieldAnalysis, floor};
pub(crate) use encode::{encode, refused, show};
pub use layer_order::TriedOrder;
#[cfg(feature = "measure")]
pub(crate) use lens_fragments::LensCounter;
pub use lens_fragments::LensFragments;
pub use pipeline::{Package, package, package_with};
pub use report::{Counts, PackageReport, PreservedTopology, Shortfall, TriedCandidate, WorstView};
pub use settings::{Coding, DropPart, LAYERS, PackageSettings, QUALITY_DB};
pub use snap::Snapped;
pub use take::{SegmentReport, SegmentSources, TakeReport, package_take};
#[cfg(feature = "measure")]
pub(crate) use views::recolor_views;
pub(crate) use views::{
    CODED_SIZE, Shown, blind_viewpoints, compared_views, rate_views, render_scene, rounding_views,
    visibility_views,
};
pub(crate) use visible::{VisibleScene, check_repairs, visible, visible_scene};
