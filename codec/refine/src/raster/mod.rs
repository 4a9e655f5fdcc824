//! The rasteriser on the CPU, generic over the precision: [`crate::reference`] is its f64 case, and fits run it in f32.
//!
//! It has one file per stage: `project` turns a Gaussian at an instant into a splat, `sort` orders the splats by depth,
//! `bin` lists them by tiles of 16x16 pixels, and `rasterize` composites the tiles in parallel. A block of 4x4 pixels is a
//! SIMD vector.
//!
//! Tests hold both precisions and the graphics device to `naive`, a loop over pixels and Gaussians.
//!
//! Every sum has a fixed order and no operation is fused with another. Results are therefore the same bit by bit for
//! any number of threads and any vector width.

mod bin;
#[cfg(test)]
pub(crate) mod naive;
mod project;
mod rasterize;
mod real;
mod sh;
mod sort;
mod vector;

pub(crate) use bin::Tiles;
#[cfg(feature = "gpu")]
pub(crate) use project::slope_limits;
pub(crate) use project::{Footprint, Projected, Projection, Splat};
#[cfg(all(test, feature = "gpu"))]
pub(crate) use rasterize::{ALPHA_MAX, TRANSMITTANCE_MIN};
pub(crate) use rasterize::{
    BLOCKS, DrawnSplat, Grid, LANES, Lanes, Place, Sink, SplatBlock, TileSplat, Transmittance, draw_tiles,
    pixels_of, rasterize, sum_by_splat, sum_lanes,
};
pub use real::Real;
pub(crate) use sh::{basis, basis_backward};
pub(crate) use sort::{SortKey, front_to_back};
pub(crate) use vector::{add, cross, dot, matrix, scaled, transposed_times};
