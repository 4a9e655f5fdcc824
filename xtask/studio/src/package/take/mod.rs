//! [`package_take`]: packages the segments of a take one after another.
//!
//! ```text
//! survey: count, compare -> surroundings -> budgets -> ranking, tried on three segments -> package each, to a scratch file -> take
//! ```
//!
//! Memory holds one segment and does not grow with the length of the take; for the opening view of a take without viewpoints,
//! those that are shown first. The fields are read three times: for the survey, for the places where people stand in the take,
//! and for their packages.

mod budget;
mod report;
mod sources;

use std::path::Path;
use std::time::Duration;

use codec::ClipInfo;
use indicatif::HumanDuration;
use program::{Fault, counted};
use refine::fit::Backend;
use refine::prune::Ranking;

use crate::package::{
    FieldAnalysis, Package, PackageSettings, VisibleScene, package_with, visible, visible_scene,
};
use crate::progress::StagedProgress;
use crate::scene::Scene;
use crate::segments::{Agreement, Span, TakeWriter, gaps, held_at_starts};
use crate::sound::{Soundtrack, put};
use budget::budgets;
use report::{LeastTopology, TriedRanking};
pub use report::{SegmentReport, TakeReport};
pub use sources::SegmentSources;

/// Estimated seconds of packaging a Gaussian of the source on one core, seconds of the pictures of a segment however
/// small, and bytes of a packaged Gaussian; codec/MEASURED.md has 0.0005 s, 0.24 s and 4 to 13 bytes.
const SECONDS_PER_GAUSSIAN: f64 = 1e-3;
const SECONDS_PER_SEGMENT: f64 = 0.2;
const BYTES_PER_GAUSSIAN: f64 = 30.0;

/// What is known of the segments before they are packaged.
struct Survey {
    spans: Vec<Span>,
    /// Visible Gaussians of each.
    gaussians: Vec<usize>,
    /// Gaussians of all.
    rows: usize,
    /// Metadata of the take.
    info: ClipInfo,
    /// Whether its viewpoints are stated.
    states_viewpoints: bool,
    /// The largest near distance. All segments get it, so that a part of the take looks as it does in the whole.
    near: f32,
}

/// Packages a take and writes it to `out`.
///
/// `soundtrack` is the sound of the whole take. `settings` hold in every segment, except that `budget` bounds the
/// Gaussians of all segments that hold one instant. The same sources and settings give the same bytes, on any number of
/// threads.
///
/// # Errors
/// Those of [`package_with`]; [`Fault::Data`] that names two segments that do not fit together, [`Fault::Usage`] where
/// the budget leaves a segment without a Gaussian, or the output cannot be written.
pub fn package_take(
    sources: &SegmentSources,
    settings: &PackageSettings,
    backend: &mut dyn Backend,
    soundtrack: Option<&Soundtrack>,
    out: &Path,
) -> anyhow::Result<TakeReport> {
    let mut writer = TakeWriter::begin(out)?;
    let survey = survey(sources)?;
    let surroundings = sources.surroundings(survey.rows, survey.info.up)?;
    let read = |i: usize| {
        let scene = sources.scene(i)?;
        anyhow::Ok(scene.in_take(&surroundings, &survey.info.viewpoints, survey.states_viewpoints))
    };
    let kept = shares(sources, settings, &survey)?;
    let over_budget = |i: usize| kept.as_ref().is_some_and(|kept| kept[i] < survey.gaussians[i]);
    let probes = match settings.rank {
        None => probes(&survey.gaussians).into_iter().filter(|&i| over_budget(i)).collect(),
        Some(_) => Vec::new(),
    };
    let plan = plan(&survey, &probes);
    print_estimate(&survey, kept.as_deref(), plan.iter().map(|(_, gaussians)| gaussians).sum());
    let progress = StagedProgress::visible();
    progress.plan(plan);
    let mut tried = Vec::new();
    for &i in &probes {
        progress.stage(trying(i), 1);
        let budget = kept.as_ref().map_or(usize::MAX, |kept| kept[i]);
        tried.push(try_rankings(&read(i)?, settings, budget)?);
    }
    let tried = best_ranking(&tried);
    let chosen = tried.iter().find(|ranking| ranking.chosen).map(|ranking| ranking.ranking);
    let rank = settings.rank.or(Ranking::ALL.into_iter().find(|ranking| Some(ranking.name()) == chosen));

    let sounds = soundtrack.map(|soundtrack| soundtrack.of_segments(sources.duration_s, &survey.spans));
    let mut segments = Vec::new();
    for (i, &span) in survey.spans.iter().enumerate() {
        progress.stage(packaging(i, survey.spans.len()), 1);
        let budget = kept.as_ref().map(|kept| kept[i]);
        // Where nothing is left out, no ranking was tried.
        let rank = rank.or(budget.map(|_| Ranking::Mass));
        let of_segment = PackageSettings { budget, rank, ..settings.clone() };
        let scene = fading(read(i)?, survey.near);
        let Package { mut bytes, mut report } =
            package_with(&scene, &of_segment, None, backend, &StagedProgress::hidden())?;
        if let Some(sound) = sounds.as_ref().and_then(|sounds| sounds[i].as_ref()) {
            bytes = put(&bytes, Some(sound), out)?;
            report.bytes = bytes.len();
        }
        if let Some(miss) = report.miss.as_ref().filter(|miss| settings.strict && miss.is_below) {
            anyhow::bail!("{}: {}; --strict refuses it, choose a lower --quality", scene.name, miss.text);
        }
        writer.add(span, &bytes)?;
        segments.push(SegmentReport::new(span, budget, report));
    }
    let bytes = writer.finish(&survey.info, sources.duration_s)?;
    progress.finish();
    Ok(report(sources, &survey, segments, tried, bytes))
}

/// Reads every segment once: counts its visible Gaussians, and compares it with the others.
fn survey(sources: &SegmentSources) -> anyhow::Result<Survey> {
    let mut agreement = Agreement::default();
    let spans: Vec<Span> = (0..sources.len()).map(|i| sources.span(i)).collect();
    let (mut gaussians, mut rows, mut head, mut near) = (Vec::new(), 0, None, 0.0f32);
    let mut last_plate: Option<usize> = None;
    for i in 0..sources.len() {
        let scene = sources.scene(i)?;
        let plate = scene.plate.as_ref().map(|plate| &plate.field);
        if plate.is_some() {
            // Segments are in the order of their starts, apart from those that span the whole and come first.
            if let Some(last) = last_plate.filter(|&last| spans[i].start_s < spans[last].end_s()) {
                return Err(Fault::Data(format!(
                    "{}: segments {last} and {i} have a plate at {} s, where one is drawn; remove the plate of one of \
                     them from field.json",
                    sources.name, spans[i].start_s
                ))
                .into());
            }
            last_plate =
                Some(i).filter(|&i| last_plate.is_none_or(|last| spans[i].end_s() > spans[last].end_s()));
        }
        agreement.add(&scene.name, &scene.info, &scene.fit_record(), &scene.subject.field, plate)?;
        near = near.max(scene.subject.field.near).max(plate.map_or(0.0, |plate| plate.near));
        gaussians.push(visible(&scene.subject).0.len());
        rows += scene.subject.field.len();
        if head.is_none() {
            let states_viewpoints = scene.states_viewpoints();
            head =
                Some((ClipInfo { viewpoints: sources.viewpoints(&scene)?, ..scene.info }, states_viewpoints));
        }
    }
    let (info, states_viewpoints) = head.expect("there is a segment");
    Ok(Survey { spans, gaussians, rows, info, states_viewpoints, near })
}

/// The scene with a near distance.
fn fading(mut scene: Scene, near: f32) -> Scene {
    scene.subject.field.near = near;
    if let Some(plate) = &mut scene.plate {
        plate.field.near = near;
    }
    scene
}

/// Most Gaussians of each segment; `None` without a budget.
fn shares(
    sources: &SegmentSources,
    settings: &PackageSettings,
    survey: &Survey,
) -> Result<Option<Vec<usize>>, Fault> {
    let Some(budget) = settings.budget else { return Ok(None) };
    let kept = budgets(budget, &survey.spans, &survey.gaussians);
    let left_out = (0..kept.len()).find(|&i| kept[i] == 0 && survey.gaussians[i] > 0);
    match left_out {
        None => Ok(Some(kept)),
        Some(i) => Err(Fault::Usage(format!(
            "--budget {budget}: it leaves segment {i} of {}, from {} s, without a Gaussian; choose a larger one",
            sources.name, survey.spans[i].start_s
        ))),
    }
}

/// The segments on which rankings are tried: the first, the middle one, and the segment with the most Gaussians.
fn probes(gaussians: &[usize]) -> Vec<usize> {
    let fullest =
        (0..gaussians.len()).fold(0, |best, i| if gaussians[i] > gaussians[best] { i } else { best });
    let mut probes = vec![0, gaussians.len() / 2, fullest];
    probes.sort_unstable();
    probes.dedup();
    probes
}

/// The stages with their work: Gaussians.
fn plan(survey: &Survey, probes: &[usize]) -> Vec<(String, f64)> {
    let gaussians = |i: usize| survey.gaussians[i] as f64;
    let all = survey.spans.len();
    let stages = probes.iter().map(|&i| (trying(i), gaussians(i)));
    stages.chain((0..all).map(|i| (packaging(i, all), gaussians(i)))).collect()
}

/// The stage that tries rankings on a segment.
fn trying(i: usize) -> String {
    format!("ranking, segment {i}")
}

/// The stage that packages a segment.
fn packaging(i: usize, all: usize) -> String {
    format!("segment {i} of {all}")
}

/// PSNR in dB of the best candidate of each ranking for a budget of a segment.
fn try_rankings(
    scene: &Scene,
    settings: &PackageSettings,
    budget: usize,
) -> anyhow::Result<Vec<(Ranking, f64)>> {
    let VisibleScene { field, plate, .. } = visible_scene(scene, settings)?;
    let progress = StagedProgress::hidden();
    let analysis = FieldAnalysis::new(scene, &field, plate.as_ref(), settings, &progress)?;
    let candidates = analysis.select(budget).candidates;
    let best = |ranking: Ranking| {
        let own = candidates.iter().filter(|candidate| candidate.ranking == ranking);
        (ranking, own.map(|candidate| candidate.psnr_db).fold(f64::NEG_INFINITY, f64::max))
    };
    Ok(Ranking::ALL.map(best).to_vec())
}

/// The rankings that were tried, with their means; the first of the best is chosen.
fn best_ranking(tried: &[Vec<(Ranking, f64)>]) -> Vec<TriedRanking> {
    if tried.is_empty() {
        return Vec::new();
    }
    let mean = |k: usize| tried.iter().map(|segment| segment[k].1).sum::<f64>() / tried.len() as f64;
    let rankings = 0..Ranking::ALL.len();
    let best = rankings.clone().fold(0, |best, k| if mean(k) > mean(best) { k } else { best });
    let row = |k: usize| TriedRanking { ranking: tried[0][k].0.name(), chosen: k == best, psnr_db: mean(k) };
    rankings.map(row).collect()
}

/// Says on standard error how long the work will take, and how much disk.
fn print_estimate(survey: &Survey, kept: Option<&[usize]>, whole: f64) {
    let kept: usize = kept.unwrap_or(&survey.gaussians).iter().sum();
    let seconds = SECONDS_PER_GAUSSIAN * whole + SECONDS_PER_SEGMENT * survey.spans.len() as f64;
    let seconds = seconds / rayon::current_num_threads() as f64;
    // The segments wait beside the output until the head is known.
    let megabytes = 2.0 * BYTES_PER_GAUSSIAN * 1e-6 * kept as f64;
    eprintln!(
        "note: {}, {kept} Gaussians: about {:#} and up to {megabytes:.1} MB of disk",
        counted(survey.spans.len(), "segment"),
        HumanDuration(Duration::from_secs_f64(seconds.ceil()))
    );
}

fn report(
    sources: &SegmentSources,
    survey: &Survey,
    segments: Vec<SegmentReport>,
    tried: Vec<TriedRanking>,
    bytes: u64,
) -> TakeReport {
    let (worst_segment, self_psnr_db, median_psnr_db) = TakeReport::fidelity(&segments);
    let counts = || segments.iter().map(|segment| &segment.package.subject);
    let whole = sources.whole.as_ref();
    let out: Vec<usize> = counts().map(|counts| counts.gaussians_out).collect();
    let least = |value: fn(&SegmentReport) -> f64| segments.iter().map(value).fold(1.0, f64::min);
    TakeReport {
        gaussians_in: whole
            .map_or_else(|| counts().map(|counts| counts.gaussians_in).sum(), |whole| whole.gaussians_in),
        gaussians_out: out.iter().sum(),
        dropped: TakeReport::sums(counts().chain(whole).map(|counts| &counts.dropped)),
        repaired: TakeReport::sums(counts().chain(whole).map(|counts| &counts.repaired)),
        resident_max: resident_max(&survey.spans, &out),
        ranking: segments[0].package.ranking,
        tried,
        topology: LeastTopology {
            recall: least(|segment| segment.package.topology.recall),
            precision: least(|segment| segment.package.topology.precision),
        },
        duration_s: sources.duration_s,
        bytes,
        segment_bytes: segments.iter().map(|segment| segment.package.bytes as u64).sum(),
        coder: segments[0].package.coder,
        self_psnr_db,
        median_psnr_db,
        worst_segment,
        gaps: gaps(sources.duration_s, &survey.spans),
        segments,
    }
}

/// Most `gaussians` of segments that hold one instant.
fn resident_max(spans: &[Span], gaussians: &[usize]) -> usize {
    let held = |(_, held): (f64, Vec<usize>)| held.into_iter().map(|i| gaussians[i]).sum();
    held_at_starts(spans).map(held).max().unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_segments_decide_the_ranking_by_their_mean() {
        assert_eq!(probes(&[5, 1, 1, 1, 9]), [0, 2, 4]);
        assert_eq!(probes(&[7]), [0]);
        assert_eq!(probes(&[9, 9]), [0, 1]);
        let tried = |psnrs: &[f64]| -> Vec<(Ranking, f64)> {
            Ranking::ALL.into_iter().zip(psnrs.iter().copied().chain(std::iter::repeat(0.0))).collect()
        };
        let rankings = best_ranking(&[tried(&[30.0, 20.0]), tried(&[20.0, 40.0])]);
        let chosen: Vec<&TriedRanking> = rankings.iter().filter(|ranking| ranking.chosen).collect();
        assert_eq!(chosen.len(), 1);
        assert_eq!((chosen[0].ranking, chosen[0].psnr_db), (Ranking::ALL[1].name(), 30.0));
        assert!(best_ranking(&[]).is_empty());
    }

    #[test]
    fn the_fullest_instant_counts() {
        let span = |start_s, duration_s| Span { start_s, duration_s, level: 0 };
        let spans = [span(0.0, 4.0), span(-1.0, 2.0), span(1.0, 1.0), span(2.0, 2.0)];
        assert_eq!(resident_max(&spans, &[1, 10, 20, 7]), 21);
        assert_eq!(resident_max(&spans, &[1, 10, 2, 7]), 11);
    }
}
