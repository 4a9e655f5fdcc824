//! The most memory that a Gaussian of a clip takes besides the decoded clip, for budgets that are set before
//! the clip is known. The columns that a clip lacks take none.

use std::mem::size_of;

use codec::{MOTION_ORDER_MAX, SH_DEGREE_MAX};
use shaders::layout::Gaussian;
use shaders::{Motion, sh_words};

use super::pack::moment::Moment;
use super::stages::alive::ROW_BYTES;
use super::stages::sort::Item;

/// The record, the motion and the spherical harmonics.
const RECORD_BYTES: usize = size_of::<Gaussian>()
    + size_of::<u32>()
        * (Motion { order: MOTION_ORDER_MAX, rotates: true }.words() + sh_words(SH_DEGREE_MAX));

/// Bytes per Gaussian of a clip that can be drawn: its record on the GPU, the columns that culling reads, the
/// items of the sort and their scratch, and the draw orders of a foveated frame with their buffer.
pub const RESIDENT_BYTES: usize = RECORD_BYTES + ROW_BYTES + 2 * size_of::<Item>() + 4 * size_of::<u32>();

/// Further bytes per Gaussian while a clip is uploaded: its moment and the interval in which it is alive, its
/// packed record, and the copy of that on the way to the GPU.
pub const UPLOAD_BYTES: usize = size_of::<Moment>() + size_of::<[f32; 2]>() + 2 * RECORD_BYTES;
