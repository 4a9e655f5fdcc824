//! [`clip_limits`]: limits on clips that fit the memory of a standalone headset.
//!
//! A headset has one memory for the system, the GPU and this program. Android's memory class
//! (`ActivityManager.getMemoryClass`) bounds the heap of Java alone, which this program does not use; native programs
//! share what the machine has, and the system ends those that take too much of it. So clips get a share of the
//! machine's memory, `MemTotal` of `/proc/meminfo`. `MemAvailable` would let a clip play in one run and not in the
//! next.

use codec::Limits;

use crate::gpu::{RESIDENT_BYTES, UPLOAD_BYTES};

/// Part of the machine's memory that clips may take, as a divisor. The system, the runtime and its images
/// need the rest. Not measured on a headset.
const SHARE: u64 = 4;

/// Buffers of [`Limits::max_bytes`] at most while a clip is loaded: the package as it arrives, three times while
/// its vector grows; the copy that is decoded; and the decoded clip with the decoder's work space.
const BUFFERS: u64 = 5;

/// Clips that can be drawn at a time: the clip on display, the next clip, and a version that is being loaded.
const RESIDENT: u64 = 3;

/// Limits on each clip of a machine with `total_bytes` of memory, so that everything that clips take fits into a
/// quarter of it: half of that for buffers, half for what is uploaded.
pub fn clip_limits(total_bytes: u64) -> Limits {
    let half = total_bytes / SHARE / 2;
    let gaussian_bytes = UPLOAD_BYTES as u64 + RESIDENT * RESIDENT_BYTES as u64;
    let desktop = Limits::default();
    Limits {
        max_gaussians: desktop.max_gaussians.min((half / gaussian_bytes) as usize),
        max_bytes: desktop.max_bytes.min((half / BUFFERS) as usize),
    }
}

/// Memory of a machine that does not say how much it has: no headset for this program has less.
#[cfg(target_os = "android")]
const LEAST_BYTES: u64 = 4 << 30;

/// Memory of this machine in bytes.
#[cfg(target_os = "android")]
pub(super) fn total_bytes() -> u64 {
    let text = std::fs::read_to_string("/proc/meminfo").unwrap_or_default();
    parse(&text).unwrap_or_else(|| {
        log::warn!("/proc/meminfo does not say how much memory there is: clips get a share of 4 GiB");
        LEAST_BYTES
    })
}

/// `MemTotal` of `/proc/meminfo` in bytes.
#[cfg(any(target_os = "android", test))]
fn parse(text: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix("MemTotal:"))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()?.checked_mul(1 << 10)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn everything_that_clips_take_fits_into_their_share() {
        for gigabytes in [0, 1, 4, 6, 8, 12, 16, 64] {
            let total = gigabytes << 30;
            let Limits { max_gaussians, max_bytes } = clip_limits(total);
            let uploaded = max_gaussians * (UPLOAD_BYTES + 3 * RESIDENT_BYTES);
            assert!((5 * max_bytes + uploaded) as u64 <= total / 4, "{gigabytes} GiB");
        }
        let default = Limits::default();
        assert_eq!(clip_limits(u64::MAX), default, "never more than a desktop");
        assert!(clip_limits(8 << 30).max_bytes < default.max_bytes);
    }

    #[test]
    fn the_smallest_headset_plays_ten_times_a_usual_clip() {
        let Limits { max_gaussians, max_bytes } = clip_limits(4 << 30);
        assert!(max_gaussians >= 400_000, "{max_gaussians}");
        // Decoded, with all columns, a Gaussian takes 296 bytes.
        assert!(max_bytes >= 300_000 * 296, "{max_bytes}");
    }

    #[test]
    fn the_memory_of_a_machine_is_read() {
        let text = "MemTotal:        7864320 kB\nMemFree:          123 kB\n";
        assert_eq!(parse(text), Some(7_864_320 << 10));
        for text in
            ["", "MemFree: 1 kB", "MemTotal: x kB", "MemTotal: 1 MB", "MemTotal: 18446744073709551615 kB"]
        {
            assert_eq!(parse(text), None, "{text}");
        }
    }
}
