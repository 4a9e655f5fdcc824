//! Take packages for tests, put together from clip packages.

use codec::{ClipInfo, Contents, Limits, SegmentPackage, contents, encode_take_head, take_order};

use crate::scene::info;

/// A segment of a take package.
#[derive(Clone, Debug)]
pub struct SegmentFile {
    /// Start in seconds.
    pub start_s: f64,
    /// Duration in seconds.
    pub duration_s: f64,
    /// Its clip package.
    pub package: Vec<u8>,
}

/// The package of a take of `duration_s` seconds, with the viewpoints of [`info`], and the offset of each segment of
/// `segments` in it.
///
/// # Panics
/// If the segments make no take.
pub fn take_package(duration_s: f64, fps: f32, segments: &[SegmentFile]) -> (Vec<u8>, Vec<usize>) {
    let limits = Limits::default();
    let heads: Vec<Contents> =
        segments.iter().map(|segment| contents(&segment.package, &limits).expect("a clip")).collect();
    let spans: Vec<(f64, f64)> =
        segments.iter().map(|segment| (segment.start_s, segment.duration_s)).collect();
    let order = take_order(duration_s, &spans);
    let stored: Vec<SegmentPackage<'_>> = order
        .iter()
        .map(|&at| SegmentPackage {
            start_s: spans[at].0,
            duration_s: spans[at].1,
            level: 0,
            contents: &heads[at],
        })
        .collect();
    let info = ClipInfo { fps, ..info() };
    let mut bytes = encode_take_head(&info, duration_s, &stored).expect("segments of a take");
    let mut offsets = vec![0; segments.len()];
    for at in order {
        offsets[at] = bytes.len();
        bytes.extend_from_slice(&segments[at].package);
    }
    (bytes, offsets)
}
