//! 4D Gaussian fields and the `.aarc` package.
//!
//! A [`Field`] is a set of Gaussians that move along cubic trajectories and fade in and out of
//! temporal windows. A package stores a field for streaming: its Gaussians come in *layers*, the
//! most important first, so that any prefix with the first layer plays. A [`Take`] is a package of
//! minutes: *segments* that overlap in time, each a clip package. A player needs only the segments
//! that hold the present instant.
//!
//! This crate does no I/O and has no unsafe code. On any bytes it neither panics nor allocates beyond
//! [`Limits`], and every [`Error`] names a byte offset. FORMAT.md, beside the
//! sources, specifies the format.
//!
//! # Tour
//!
//! | to | call | feature |
//! |---|---|---|
//! | read the head of a package: metadata, layers, sections | [`contents`] | |
//! | decode a package, or the complete layers of a prefix | [`decode()`], [`decode_parallel`] | |
//! | decode further layers alone, and add them | [`Contents::decode_layers`], [`Clip::append`] | |
//! | read the head of a clip or a take as a take | [`package`](package()), [`Take::from`] | |
//! | decode the segments that hold a time | [`Take::at`], [`Take::decode_segment`], [`Take::decode_segment_layers`] | |
//! | check segments without decoding them | [`Take::segment_contents`], [`Contents::check_sections`] | |
//! | find the Gaussians alive at a time | [`TimeIndex::candidates`] of [`Clip::time_index`] | |
//! | evaluate one of them | [`Field::position_at`], [`Field::opacity_at`], [`Field::rotation_at`] | |
//! | look at them | [`Viewpoint::camera`], [`Camera`] | |
//! | read the sound of a clip or of a segment | [`Contents::sound`], [`Sound`] | |
//! | read the poster of a clip or take | [`poster()`], [`Contents::poster`] | |
//! | package a field | `encode`, `encode_parallel`, `encode_rounded` | `encode` |
//! | cut a long field into segments, write the head of a take | `split`, `encode_take_head`, `take_order` | `encode` |
//! | put sound or a poster into a package | `with_sound`, `with_poster` | `encode` |
//! | size by attribute | `measure` | `encode` |
//! | camera files | [`Camera`] with serde | `serde` |
//!
//! `examples/list.rs` lists a clip or a take, `examples/stream.rs` plays the layers of a clip as bytes arrive.
//!
//! # Conventions
//!
//! - Lengths are in the units of the source, along the axes of the source; [`ClipInfo`] has the up
//!   vector and the scale in metres.
//! - Clip time runs from 0 to 1; [`ClipInfo::duration_s`] converts it to seconds. Times of a take are in
//!   seconds; [`Segment::clip_time`] converts them.
//! - Quaternions are `w, x, y, z`. Colours are display-referred.
//! - Row `i` of all columns of a [`Field`] is one Gaussian.
//!
//! # Example
//!
//! ```
//! use codec::{ClipInfo, EncodeOptions, Field, Limits, Source, decode, encode};
//!
//! // Two static Gaussians, the more important one first.
//! let field = Field {
//!     centers: vec![[0.0, 1.0, 0.0], [0.5, 1.0, 0.0]],
//!     rotations: vec![[1.0, 0.0, 0.0, 0.0]; 2],
//!     log_scales: vec![[-2.0, -2.0, -3.0]; 2],
//!     opacities: vec![1.0, 0.2],
//!     sh_degree: 0,
//!     sh: vec![[0.8, 0.1, -0.4], [0.0, 0.0, 0.0]],
//!     ..Field::default()
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
//! let mut prefix = decode(&package[..package.len() - 1], &Limits::default())?;
//! assert_eq!((prefix.len(), prefix.layers.len(), prefix.layers_announced.len()), (1, 1, 2));
//!
//! // Once it has arrived, the second is decoded alone.
//! let head = codec::contents(&package, &Limits::default())?;
//! let one = std::num::NonZero::<usize>::MIN;
//! prefix.append(head.decode_layers(&package, 1, &Limits::default(), one)?);
//! assert_eq!(prefix, clip);
//!
//! // A take of 3 seconds: the clip plays in its first two and, again, in its last two.
//! use codec::{SegmentPackage, encode_take_head};
//! let segments =
//!     [0.0, 1.0].map(|start_s| SegmentPackage { start_s, duration_s: 2.0, level: 0, contents: &head });
//! let mut bytes = encode_take_head(&info, 3.0, &segments)?;
//! segments.iter().for_each(|_| bytes.extend_from_slice(&package));
//!
//! let take = codec::package(&bytes, &Limits::default())?;
//! assert_eq!(take.at(0.5).collect::<Vec<_>>(), [0]);
//! assert_eq!(take.at(1.5).collect::<Vec<_>>(), [0, 1]);
//! let segment = &take.segments[1];
//! let clip = take.decode_segment(
//!     1,
//!     &bytes[segment.offset as usize..][..segment.bytes()],
//!     &Limits::default(),
//!     one,
//! )?;
//! assert_eq!((clip.len(), segment.clip_time(1.5)), (2, 0.25));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
#![forbid(unsafe_code)]

// Unit tests share the helpers of the tests in `tests`, which name this crate.
#[cfg(all(test, feature = "encode"))]
extern crate self as codec;

mod bytes;
mod camera;
mod clip;
mod coder;
mod columns;
mod counters;
mod decode;
#[cfg(feature = "encode")]
mod encode;
mod error;
#[cfg(feature = "encode")]
mod extra;
mod field;
mod fixed;
mod format;
mod gaussian;
mod header;
mod limits;
#[cfg(feature = "encode")]
mod measure;
mod morton;
mod near;
#[cfg(feature = "encode")]
mod order;
mod parallel;
mod pixel_filter;
mod poster;
mod preamble;
#[cfg(feature = "encode")]
mod precision;
mod quant;
mod rans;
mod rows;
mod section;
mod sound;
mod standing;
mod take;
mod time_index;

pub use camera::Camera;
pub use clip::{Clip, ClipInfo, LayerEnd, Layers, Viewpoint};
pub use coder::Coder;
pub use decode::{decode, decode_parallel};
#[cfg(feature = "encode")]
pub use encode::{ChunkForms, EncodeOptions, Rounded, Source, encode, encode_parallel, encode_rounded};
#[cfg(feature = "encode")]
pub use error::EncodeError;
pub use error::{Error, FormatError};
pub use field::{
    ALPHA_MIN, Field, MAGNITUDE_MAX, MOTION_ORDER_MAX, SH_C0, SH_DEGREE_MAX, Temporal, sh_coefficients,
};
pub use format::{MAGIC, NAME_BYTES_MAX, RESIDENT_MAX, SEGMENTS_MAX, VERSION_MAJOR, VERSION_MINOR};
pub use header::{Contents, contents};
pub use limits::Limits;
#[cfg(feature = "encode")]
pub use measure::{AttributeSize, measure};
pub use near::{FADE_START, NEAR_OF_SIZE, NEAR_SHARE, near_fade};
pub use pixel_filter::PixelFilter;
#[cfg(feature = "encode")]
pub use poster::with_poster;
pub use poster::{Poster, poster};
#[cfg(feature = "encode")]
pub use precision::{Precision, Sensitivity};
pub use section::{Region, Section, SectionKind};
#[cfg(feature = "encode")]
pub use sound::with_sound;
pub use sound::{SOUND_RATE_HZ, Sound, SoundInfo};
pub use standing::{CoarseField, Sight, StandPoints, Surroundings, SurroundingsBuilder};
pub use take::{Resident, SPAN_TOLERANCE_S, Segment, SegmentLayer, Take, package, span_holds};
#[cfg(feature = "encode")]
pub use take::{SegmentGrid, SegmentPackage, SplitSegment, encode_take_head, retime, split, take_order};
pub use time_index::TimeIndex;
