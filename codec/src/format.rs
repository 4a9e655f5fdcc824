//! Constants of the package format that more than one module needs. Changing one breaks every
//! package in existence; FORMAT.md specifies them.

/// First bytes of every package.
pub const MAGIC: [u8; 4] = *b"AARC";

/// Major version of the package format, of all packages that are read and written.
pub const VERSION_MAJOR: u16 = 1;

/// Minor version of the package format that is written. A later one may add sections that are not critical; readers skip
/// those.
pub const VERSION_MINOR: u16 = 0;

/// Bytes of a section with a poster.
pub(crate) const POSTER_BYTES: usize = 36;

/// Bytes of a section of sound before the lengths of its packets.
pub(crate) const SOUND_HEAD_BYTES: usize = 32;

/// Numbers of samples that a packet of sound may have: the durations of packets of one frame.
pub(crate) const SOUND_PACKET_SAMPLES: [u16; 6] = [120, 240, 480, 960, 1920, 2880];

/// Bytes up to and including the length of the head.
pub(crate) const PREFIX_BYTES: usize = 12;

/// Bytes of the head whose length does not vary: offset of the counts per layer.
pub(crate) const FIXED_BYTES: usize = 76;

/// Offset of the number of layers, which is 0 in the head of a take.
pub(crate) const LAYERS_OFFSET: usize = 64;

/// Offset of the counts that determine the memory of a decoded clip.
pub(crate) const COUNTS_OFFSET: usize = 68;

/// Bytes of one entry of the section table.
pub(crate) const ENTRY_BYTES: usize = 24;

/// Largest number of viewpoints.
pub(crate) const VIEWPOINTS_MAX: usize = 64;

/// Largest length of a viewpoint's name in bytes.
pub const NAME_BYTES_MAX: usize = 63;

/// Largest number of layers.
pub(crate) const LAYERS_MAX: usize = 16;

/// Gaussians per chunk; the last chunk of a region in a layer holds the rest.
pub(crate) const CHUNK_ROWS: usize = 4096;

/// Largest number of segments of a take.
pub const SEGMENTS_MAX: usize = 65_536;

/// Bytes of an entry of the segment table before its layers.
pub(crate) const SEGMENT_BYTES: usize = 24;

/// Bytes of a layer in an entry of the segment table.
pub(crate) const SEGMENT_LAYER_BYTES: usize = 8;

/// Most segments of a take that hold one instant.
pub const RESIDENT_MAX: usize = 32;
