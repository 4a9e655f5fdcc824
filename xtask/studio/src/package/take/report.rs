//! [`TakeReport`]: what went into a take, and how faithful its segments are.

use std::collections::BTreeMap;

use refine::metrics::median;
use serde::Serialize;

use crate::package::PackageReport;
use crate::segments::Span;

/// What went into a take, what was omitted, and how faithful the rest is.
#[derive(Clone, Debug, Serialize)]
pub struct TakeReport {
    /// Rows of all fields.
    pub gaussians_in: usize,
    /// Gaussians of all segments, without the plates'.
    pub gaussians_out: usize,
    /// Reason to number of rows left out; together they make up the difference.
    pub dropped: BTreeMap<&'static str, usize>,
    /// Reason to number of rows changed on import.
    pub repaired: BTreeMap<&'static str, usize>,
    /// Most Gaussians of segments that hold one instant, without the plates'.
    pub resident_max: usize,
    /// The ranking that retained the Gaussians of all segments.
    pub ranking: &'static str,
    /// The rankings that were tried for a budget on a few segments.
    pub tried: Vec<TriedRanking>,
    /// The least topology that a segment preserves.
    pub topology: LeastTopology,
    /// Duration of the take in seconds.
    pub duration_s: f64,
    /// Size of the take in bytes.
    pub bytes: u64,
    /// Sum of the sizes of its segments in bytes.
    pub segment_bytes: u64,
    /// How the Gaussians are coded.
    pub coder: &'static str,
    /// PSNR in dB of the worst segment against its field before coding.
    pub self_psnr_db: f64,
    /// Median of that over the segments.
    pub median_psnr_db: f64,
    /// Number of the worst segment, from 0.
    pub worst_segment: usize,
    /// Parts of the take that no segment shows, as seconds.
    pub gaps: Vec<[f64; 2]>,
    /// The segments in the order of the take.
    pub segments: Vec<SegmentReport>,
}

/// What went into a segment.
#[derive(Clone, Debug, Serialize)]
pub struct SegmentReport {
    /// Second of the take at which it begins.
    pub start_s: f64,
    /// Level on the dyadic grid.
    pub level: u8,
    /// Most Gaussians that the budget of the take leaves to it; `None` without a budget.
    pub budget: Option<usize>,
    /// The report on its package.
    #[serde(flatten)]
    pub package: PackageReport,
}

/// A ranking that was tried for a budget.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TriedRanking {
    /// The ranking.
    pub ranking: &'static str,
    /// Whether the segments are ranked by it.
    pub chosen: bool,
    /// Mean over the segments that were tried of the PSNR in dB between pictures of the selection and of the whole.
    pub psnr_db: f64,
}

/// How much of the topology of its field the worst segment preserves.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct LeastTopology {
    /// Fraction of the persistent features that is preserved.
    pub recall: f64,
    /// Fraction of the retained Gaussians' features that are not cut-off pieces.
    pub precision: f64,
}

impl SegmentReport {
    pub(super) fn new(span: Span, budget: Option<usize>, package: PackageReport) -> SegmentReport {
        SegmentReport { start_s: span.start_s, level: span.level, budget, package }
    }
}

impl TakeReport {
    /// Number of the segment with the lowest PSNR, that PSNR, and the median of all.
    pub(super) fn fidelity(segments: &[SegmentReport]) -> (usize, f64, f64) {
        let psnrs: Vec<f64> = segments.iter().map(|segment| segment.package.self_psnr_db).collect();
        let worst =
            (0..psnrs.len()).min_by(|&a, &b| psnrs[a].total_cmp(&psnrs[b])).expect("a take has segments");
        (worst, psnrs[worst], median(psnrs).expect("a take has segments"))
    }

    /// Sums of the counts of all segments by reason.
    pub(super) fn sums<'r>(
        counts: impl IntoIterator<Item = &'r BTreeMap<&'static str, usize>>,
    ) -> BTreeMap<&'static str, usize> {
        let mut sums = BTreeMap::new();
        for (reason, rows) in counts.into_iter().flatten() {
            *sums.entry(*reason).or_default() += rows;
        }
        sums
    }
}
