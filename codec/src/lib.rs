//! 4D Gaussian fields and the `.aarc` clip package.
//!
//! A [`Field`] is a set of Gaussians that move along cubic trajectories and fade in and out of
//! temporal windows. [`decode()`] turns the bytes of a package into a [`Clip`], which holds the
//! field split and ordered for playing; `encode` (feature `encode`) goes the other way, and
//! [`contents`] reads only what a package says of itself. The format is specified in FORMAT.md.
//!
//! This crate does no I/O, has no unsafe code, and neither panics nor allocates without bound on
//! any input.
//!
//! ```
//! use codec::{ClipInfo, EncodeOptions, Field, Limits, Source, decode, encode};
//!
//! // Two motionless Gaussians, the more important one first.
//! let field = Field {
//!     centers: vec![[0.0, 1.0, 0.0], [0.5, 1.0, 0.0]],
//!     rotations: vec![[1.0, 0.0, 0.0, 0.0]; 2],
//!     log_scales: vec![[-2.0, -2.0, -3.0]; 2],
//!     opacities: vec![1.0, 0.2],
//!     sh_degree: 0,
//!     sh: vec![[0.8, 0.1, -0.4], [0.0, 0.0, 0.0]],
//!     temporal: None,
//! };
//! let info = ClipInfo {
//!     duration_s: 2.0,
//!     fps: 30.0,
//!     up: [0.0, 1.0, 0.0],
//!     metres_per_unit: 1.0,
//!     viewpoints: Vec::new(),
//! };
//! let source = Source { info: &info, field: &field, plate: None };
//! let package = encode(&source, &EncodeOptions { layers: vec![1], ..EncodeOptions::default() })?;
//!
//! let clip = decode(&package, &Limits::default())?;
//! assert_eq!(clip.info, info);
//! assert_eq!((clip.static_field.len(), clip.dynamic_field.len()), (2, 0));
//! assert_eq!(clip.layers.len(), 2);
//!
//! // The first layer plays without the second.
//! let cut = decode(&package[..package.len() - 1], &Limits::default())?;
//! assert_eq!((cut.len(), cut.layers.len(), cut.layers_announced), (1, 1, 2));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
#![forbid(unsafe_code)]

mod bytes;
mod camera;
mod clip;
mod context;
mod decode;
#[cfg(feature = "encode")]
mod encode;
mod error;
mod field;
mod fixed;
mod header;
mod limits;
#[cfg(feature = "encode")]
mod measure;
mod parallel;
#[cfg(feature = "encode")]
mod precision;
mod quant;
mod rows;
mod section;
mod time_index;

pub use camera::Camera;
pub use clip::{Clip, ClipInfo, LayerEnd, Viewpoint};
pub use decode::{decode, decode_parallel};
#[cfg(feature = "encode")]
pub use encode::{EncodeOptions, Source, encode, encode_parallel};
#[cfg(feature = "encode")]
pub use error::EncodeError;
pub use error::{Error, FormatError};
pub use field::{ALPHA_MIN, Field, MOTION_ORDER_MAX, SH_C0, SH_DEGREE_MAX, Temporal, sh_coefficients};
pub use header::{Coder, Contents, VERSION_MAJOR, VERSION_MINOR, contents};
pub use limits::Limits;
#[cfg(feature = "encode")]
pub use measure::{AttributeSize, measure};
#[cfg(feature = "encode")]
pub use precision::{Precision, Sensitivity};
pub use section::{Region, Section, SectionKind};
pub use time_index::TimeIndex;
