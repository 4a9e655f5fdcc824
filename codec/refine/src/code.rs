//! [`code`]: packages a field by the coder `rans` with a target PSNR.
//!
//! The sensitivity of each Gaussian in pictures sets its precision. The package is decoded, rendered and
//! compared with the field, and the precision is searched at which it just meets the target. Small fields
//! are also coded with the same precision for all rows, as learning each row's precision can cost more
//! than it saves. Where their PSNR jumps over the target, some of the rows are coded more coarsely.
//!
//! [`JointRounding`] rounds the numbers together at coarser precisions, which still meet the target. It begins near the
//! precision that was found, or for large fields, whose search would take longer than the rounds, near the precision
//! that a single package leads to.
//!
//! Pictures take nearly all of the time. `Trials` renders each at most once per precision, and those
//! first that tell soonest that a precision is too coarse.

mod error;
mod joint;
mod scan;
mod search;
mod trials;

use codec::{Clip, Precision, Sensitivity, Source};

use crate::prune::{Fidelity, Pictures};
use crate::reference::PosedView;
use crate::reference::{Sensitivities, sensitivities};

pub use error::CodeError;
use joint::RoundingState;
pub use joint::{JOINT_ROUNDS, JointRounding};
use scan::{SCANNED, Scan};
pub use search::{Miss, SURPLUS_MAX_DB, TRIALS, WORST_BELOW_DB};
use search::{SLOPE, Search};
use trials::{Fineness, Trials, decode};

/// A package with its decoded clip and quality.
#[derive(Clone, Debug)]
pub struct Coded {
    /// Bytes of the package.
    pub bytes: Vec<u8>,
    /// The decoded package.
    pub clip: Clip,
    /// Pictures of the clip against pictures of the field.
    pub fidelity: Fidelity,
    /// Why the target is not met, or exceeded; `None` if it is met within [`SURPLUS_MAX_DB`].
    pub miss: Option<Miss>,
    /// Bytes of the package without joint rounding; `None` if its numbers were not rounded jointly, or that package of a
    /// large field was not made.
    pub bytes_alone: Option<usize>,
}

/// Expected gain of joint rounding at one precision, in dB, for a static and a dynamic field: somewhat less than the 0.8 to
/// 0.9 of playbot and the guitar and the 0.5 to 0.6 of spinach. Motion and opacities in time are not rounded jointly, so a
/// dynamic field gains less.
const JOINT_GAINS_DB: [f64; 2] = [0.7, 0.5];

/// Most precisions at which numbers are rounded jointly. Each takes rounds of its own, since another precision has other
/// rounding errors; it begins with the targets of the last one. With half the rounds, later ones often lost what the first
/// had gained.
const JOINT_TRIALS: usize = 3;

/// Excess in dB over the target PSNR that ends joint rounding: a further precision would take longer than the package
/// without it, for at most 1.2 % of the bytes.
const JOINT_CLOSE_DB: f64 = SURPLUS_MAX_DB;

/// Excess in dB that each further precision aims at. Its gain is not known exactly, and what misses the target is lost.
const JOINT_AIM_DB: f64 = 0.1;

/// What to make of a source.
#[derive(Clone, Copy, Debug)]
pub struct PackageTarget<'a> {
    /// Layer ends in rows.
    pub layers: &'a [usize],
    /// PSNR in dB against the field before coding.
    pub psnr_db: f64,
    /// Whether a graphics device computes numbers of the package, which says so.
    pub by_device: bool,
}

/// What coding does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CodeStep {
    /// It tries a precision.
    Trial {
        /// What is tried.
        what: &'static str,
        /// Number of the trial, from 1.
        number: usize,
        /// Most trials of this kind.
        most: usize,
    },
    /// It has done one of the views, or of [`code_steps`].
    Done,
}

/// Hears of steps.
type OnStep<'a> = &'a mut dyn FnMut(CodeStep);

/// Packages `source` at a PSNR of `target.psnr_db` to [`SURPLUS_MAX_DB`] above, no picture more than
/// [`WORST_BELOW_DB`] below it, or as close as possible. Sensitivities are taken from the views `seen`; `judge` holds
/// pictures of the source to compare with; `joint` rounds the numbers jointly. `on_step` hears of every trial, and of the end
/// of each of `seen` and of each of [`code_steps`].
///
/// # Errors
/// Errors of [`codec::encode`] and [`codec::decode`].
pub fn code(
    source: &Source,
    target: PackageTarget,
    seen: &[PosedView],
    judge: &Pictures,
    joint: Option<&mut JointRounding>,
    mut on_step: impl FnMut(CodeStep),
) -> Result<Coded, CodeError> {
    let known = sensitivities(source.field, source.plate, seen, || on_step(CodeStep::Done));
    let PackageTarget { layers, psnr_db, by_device } = target;
    let mut coder = TargetCoder::new(source, layers, known, judge).mark(by_device);
    match joint {
        None => coder.code(psnr_db, on_step),
        Some(joint) => coder.code_jointly(psnr_db, joint, on_step),
    }
}

/// Number of steps of [`TargetCoder::code_jointly`] with as many rounds at a precision, or of [`TargetCoder::code`] with 0.
pub fn code_steps(rounds: usize) -> usize {
    TRIALS + JOINT_TRIALS * rounds
}

/// Packages a source with target PSNRs, one after another. What a small field's trials for one target
/// found out is not computed again for the next. Nor is the package of the latest target, with which joint rounding of a
/// small field begins.
#[derive(Debug)]
pub struct TargetCoder<'a> {
    /// With the precision of each row by its sensitivity.
    own: Trials<'a>,
    /// With equal precision for all rows; `None` if that is the same.
    equal: Option<Trials<'a>>,
    /// The latest target in dB and its package, with each number rounded alone.
    latest: Option<(f64, Met)>,
}

impl<'a> TargetCoder<'a> {
    /// A coder of `source` in `layers`, given by their ends in rows.
    /// `known` is what [`sensitivities`] computes of it; `judge` holds pictures of the source.
    pub fn new(
        source: &'a Source<'a>,
        layers: &'a [usize],
        known: Option<Sensitivities>,
        judge: &'a Pictures,
    ) -> TargetCoder<'a> {
        let Some(known) = known else {
            return TargetCoder {
                own: Trials::new(source, layers, Precision::default(), judge),
                equal: None,
                latest: None,
            };
        };
        let equal = Sensitivities {
            field: equal_sensitivities(&known.field),
            plate: equal_sensitivities(&known.plate),
            ..known
        };
        let trials = |known: Sensitivities| {
            let precision = Precision {
                sensitivities: known.field,
                plate_sensitivities: known.plate,
                footprint: Some(known.footprint),
                ..Precision::default()
            };
            Trials::new(source, layers, precision, judge)
        };
        let equal = (equal != known).then(|| trials(equal));
        TargetCoder { equal, own: trials(known), latest: None }
    }

    /// Sets the mark of packages for which a graphics device computes numbers.
    fn mark(mut self, by_device: bool) -> TargetCoder<'a> {
        for trials in self.equal.iter_mut().chain([&mut self.own]) {
            trials.by_device = by_device;
        }
        self
    }

    /// Packages the source at `psnr_db`, as [`code`] does. `on_step` hears of every trial, and of [`TRIALS`] ends.
    ///
    /// # Errors
    /// Errors of [`codec::encode`] and [`codec::decode`].
    pub fn code(&mut self, psnr_db: f64, mut on_step: impl FnMut(CodeStep)) -> Result<Coded, CodeError> {
        self.meet(psnr_db, &mut on_step).map(|met| met.coded)
    }

    /// Packages the source at `psnr_db` with numbers that are rounded jointly, if that is smaller. `on_step` hears of
    /// every trial, and of the end of each of [`code_steps`]; where no rounds of a large field come close, a search follows
    /// the last one.
    ///
    /// # Errors
    /// Errors of [`codec::encode`] and [`codec::decode`].
    pub fn code_jointly(
        &mut self,
        psnr_db: f64,
        joint: &mut JointRounding,
        mut on_step: impl FnMut(CodeStep),
    ) -> Result<Coded, CodeError> {
        let Start { alone, precision, gain_db } = self.start(psnr_db, &mut on_step)?;
        let source = self.own.source;
        let bytes_alone = alone.as_ref().map(|alone| alone.bytes.len());
        let mut best = alone.map(|alone| Coded { bytes_alone, ..alone });
        let mut options = self.own.options(precision);
        options.precision.psnr -= gain_db / SLOPE;
        let mut state = RoundingState::new(source.field);
        let mut steps = 0;
        for number in 1..=JOINT_TRIALS {
            on_step(CodeStep::Trial { what: "joint rounding", number, most: JOINT_TRIALS });
            let bytes = joint.round(source, &options, &mut state, || {
                steps += 1;
                on_step(CodeStep::Done);
            })?;
            let (clip, fidelity) = self.own.compare(&bytes)?;
            let surplus_db = search::surplus_db(&fidelity, psnr_db);
            let miss = search::miss_of(&fidelity, psnr_db);
            let coded = Coded { bytes, clip, fidelity, miss, bytes_alone };
            if best.as_ref().is_none_or(|best| coded.is_better_than(best)) {
                best = Some(coded);
            }
            if (0.0..JOINT_CLOSE_DB).contains(&surplus_db) || gain_db == 0.0 {
                break;
            }
            options.precision.psnr += (JOINT_AIM_DB - surplus_db) / SLOPE;
        }
        (TRIALS + steps..code_steps(joint.rounds())).for_each(|_| on_step(CodeStep::Done));
        match best {
            // Out of reach of the rounds, a search may be closer.
            Some(best) if bytes_alone.is_some() || !matches!(best.miss, Some(Miss::Below | Miss::Above)) => {
                Ok(best)
            }
            best => {
                let alone = self.meet(psnr_db, &mut trials_only(&mut on_step))?.coded;
                Ok(best.filter(|best| best.is_better_than(&alone)).unwrap_or(alone))
            }
        }
    }

    /// Where joint rounding begins for a target. `on_step` hears of [`TRIALS`] ends.
    fn start(&mut self, psnr_db: f64, on_step: OnStep) -> Result<Start, CodeError> {
        let gain_db = JOINT_GAINS_DB[usize::from(self.own.source.field.temporal.is_some())];
        if self.own.is_small() {
            let Met { coded, precision } = self.meet(psnr_db, on_step)?;
            let gain_db = if coded.miss == Some(Miss::Below) { 0.0 } else { gain_db };
            return Ok(Start { alone: Some(coded), precision, gain_db });
        }
        let mut search = Search::new(psnr_db);
        on_step(CodeStep::Trial { what: PRECISION, number: 1, most: 1 });
        let (_, fidelity) = self.own.compare(&self.own.encode(Fineness::even(psnr_db))?)?;
        search.record(&fidelity, usize::MAX);
        (0..TRIALS).for_each(|_| on_step(CodeStep::Done));
        let precision = self.own.at(Fineness::even(search.next().unwrap_or(psnr_db)));
        Ok(Start { alone: None, precision, gain_db })
    }

    /// The package of the rows' own precisions, or of equal ones if that is better. The latest one is not made again.
    fn meet(&mut self, psnr_db: f64, on_step: OnStep) -> Result<Met, CodeError> {
        if let Some((_, met)) = self.latest.as_ref().filter(|(latest_db, _)| *latest_db == psnr_db) {
            (0..TRIALS).for_each(|_| on_step(CodeStep::Done));
            return Ok(met.clone());
        }
        let met = self.search(psnr_db, on_step)?;
        self.latest = Some((psnr_db, met.clone()));
        Ok(met)
    }

    /// Makes the package that [`TargetCoder::meet`] returns.
    fn search(&mut self, psnr_db: f64, on_step: OnStep) -> Result<Met, CodeError> {
        let own = meet(&mut self.own, psnr_db, on_step)?;
        let Some(equal) = self.equal.as_mut().filter(|equal| equal.is_small()) else { return Ok(own) };
        let equal = match own.coded.miss {
            Some(Miss::Below) => Some(meet(equal, psnr_db, &mut trials_only(on_step))?),
            _ => scan(equal, psnr_db, own.coded.bytes.len(), &mut trials_only(on_step))?,
        };
        Ok(equal.filter(|equal| equal.coded.is_better_than(&own.coded)).unwrap_or(own))
    }

    /// Packages the source at `psnr_db` with equal precision for all rows. `on_step` hears of every trial, and of
    /// [`TRIALS`] ends.
    ///
    /// # Errors
    /// Errors of [`codec::encode`] and [`codec::decode`].
    pub fn code_equally(
        &mut self,
        psnr_db: f64,
        mut on_step: impl FnMut(CodeStep),
    ) -> Result<Coded, CodeError> {
        meet(self.equal.as_mut().unwrap_or(&mut self.own), psnr_db, &mut on_step).map(|met| met.coded)
    }
}

/// The root mean square of `rows` for each of them: equal precision.
fn equal_sensitivities(rows: &[Sensitivity]) -> Vec<Sensitivity> {
    let root_mean_square = |number: fn(&Sensitivity) -> f32| {
        let squares: f64 = rows.iter().map(|row| f64::from(number(row)).powi(2)).sum();
        (squares / rows.len() as f64).sqrt() as f32
    };
    vec![
        Sensitivity {
            color: root_mean_square(|row| row.color),
            geometry: root_mean_square(|row| row.geometry)
        };
        rows.len()
    ]
}

/// Where joint rounding begins.
struct Start {
    /// The package without it; `None` for a large field, where its search would take longer than the rounds.
    alone: Option<Coded>,
    /// The precision at which that package meets the target, as far as is known.
    precision: Precision,
    /// How much coarser the rounds begin, in dB of the PSNR.
    gain_db: f64,
}

/// A package, with its precision.
#[derive(Clone, Debug)]
struct Met {
    coded: Coded,
    precision: Precision,
}

/// What [`meet`] tries.
const PRECISION: &str = "precision";

/// Hears of trials alone.
fn trials_only(on_step: OnStep) -> impl FnMut(CodeStep) {
    |step| {
        if step != CodeStep::Done {
            on_step(step);
        }
    }
}

/// The package at the coarsest precision that meets a target, or the package that comes closest to it.
fn meet(trials: &mut Trials, psnr_db: f64, on_step: OnStep) -> Result<Met, CodeError> {
    if !trials.is_small() {
        return search(trials, psnr_db, on_step);
    }
    match scan(trials, psnr_db, usize::MAX, on_step)? {
        Some(met) => Ok(met),
        // Out of reach, a search comes as close as any.
        None => search(trials, psnr_db, &mut trials_only(on_step)),
    }
}

/// Searches a precision as [`Search`] does.
fn search(trials: &Trials, psnr_db: f64, on_step: OnStep) -> Result<Met, CodeError> {
    let mut best: Option<Met> = None;
    let mut search = Search::new(psnr_db);
    let mut steps = 0;
    while let Some(finer_db) = search.next() {
        let fineness = Fineness::even(finer_db);
        on_step(CodeStep::Trial { what: PRECISION, number: steps + 1, most: TRIALS });
        let bytes = trials.encode(fineness)?;
        let (clip, fidelity) = trials.compare(&bytes)?;
        let miss = search.record(&fidelity, bytes.len());
        let coded = Coded { bytes, clip, fidelity, miss, bytes_alone: None };
        if best.as_ref().is_none_or(|best| coded.is_better_than(&best.coded)) {
            best = Some(Met { coded, precision: trials.at(fineness) });
        }
        steps += 1;
        on_step(CodeStep::Done);
    }
    (steps..TRIALS).for_each(|_| on_step(CodeStep::Done));
    Ok(best.expect("a search has at least one trial"))
}

/// Trials that find how many rows can be coded more coarsely where the PSNR jumps; each halves what is unknown.
const SHARE_TRIALS: usize = 7;

/// Takes the coarsest precision of [`Scan`] that meets the target with fewer than `limit` bytes; `None` if none does.
/// Where its PSNR is well above the target, as many rows are coarser as meet it.
fn scan(trials: &mut Trials, psnr_db: f64, limit: usize, on_step: OnStep) -> Result<Option<Met>, CodeError> {
    let mut found: Option<(Fineness, Fidelity)> = None;
    let least_db = (psnr_db, psnr_db - WORST_BELOW_DB);
    let mut scan = Scan::new(psnr_db);
    let mut steps = 0;
    while let Some(finer_db) = scan.next() {
        // Finer packages are larger, so the scan goes on below this precision, as if it met the target.
        let fineness = Fineness::even(finer_db);
        on_step(CodeStep::Trial { what: PRECISION, number: steps + 1, most: SCANNED });
        if trials.bytes(fineness)?.len() >= limit {
            scan.record(true);
        } else {
            let fidelity = trials.meets(fineness, least_db)?;
            scan.record(fidelity.is_some());
            found = fidelity.map(|fidelity| (fineness, fidelity)).or(found);
        }
        steps += 1;
        if steps <= TRIALS {
            on_step(CodeStep::Done);
        }
    }
    (steps..TRIALS).for_each(|_| on_step(CodeStep::Done));
    let Some((mut fineness, mut fidelity)) = found else { return Ok(None) };
    let mut too_many = 1.0;
    for number in 1..=SHARE_TRIALS {
        if search::miss_of(&fidelity, psnr_db) != Some(Miss::Above) {
            break;
        }
        on_step(CodeStep::Trial { what: "share of coarser Gaussians", number, most: SHARE_TRIALS });
        let coarser_share = 0.5 * (fineness.coarser_share + too_many);
        let coarser = Fineness { coarser_share, ..fineness };
        match trials.meets(coarser, least_db)? {
            Some(met) => (fineness, fidelity) = (coarser, met),
            None => too_many = coarser_share,
        }
    }
    let bytes = trials.bytes(fineness)?.to_vec();
    let clip = decode(&bytes)?;
    let miss = search::miss_of(&fidelity, psnr_db);
    let coded = Coded { bytes, clip, fidelity, miss, bytes_alone: None };
    Ok(Some(Met { coded, precision: trials.at(fineness) }))
}

impl Coded {
    /// Whether this package is better for the target than `other`: the smaller of two packages that are not below it,
    /// else the package with the higher PSNR.
    fn is_better_than(&self, other: &Coded) -> bool {
        let reaches = |coded: &Coded| coded.miss != Some(Miss::Below);
        match (reaches(self), reaches(other)) {
            (true, true) => self.bytes.len() < other.bytes.len(),
            (false, false) => self.fidelity.psnr_db > other.fidelity.psnr_db,
            (reaches, _) => reaches,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prune::posed_views;
    use crate::prune::scenes::{around, cloud};
    use crate::reference::RenderScene;
    use codec::{ClipInfo, Field};

    #[test]
    fn a_later_target_gets_the_same_package_with_fewer_trials() {
        let field = cloud(1, 60);
        let info = ClipInfo::default();
        let source = Source { info: &info, field: &field, plate: None };
        let cameras = around(&field, 0.0, (32, 24));
        let views = posed_views(&cameras, &[0.5]);
        let known = sensitivities(&field, None, &views, || ());
        let judge = Pictures::take(&RenderScene::from(&field), views, || ());
        let coder = || TargetCoder::new(&source, &[], known.clone(), &judge);
        let [mut alone, mut after] = [coder(), coder()];
        let first = after.code(40.0, |_| ()).unwrap();
        let before = after.own.known.len();
        let [expected, second] = [&mut alone, &mut after].map(|coder| coder.code(42.0, |_| ()).unwrap());
        assert!(expected.bytes == second.bytes && expected.fidelity == second.fidelity);
        assert!(first.bytes.len() < second.bytes.len() && second.miss.is_none(), "{:?}", second.miss);
        let (fresh, added) = (alone.own.known.len(), after.own.known.len() - before);
        assert!(added < fresh, "{added} trials of {fresh}");
    }

    /// A package of a dense cloud of `count` at `psnr` with its numbers rounded jointly, on `threads` threads; and one with
    /// each alone.
    fn jointly(count: usize, psnr: f64, threads: usize) -> [Coded; 2] {
        let field = cloud(1, count);
        let plate = Field { temporal: None, ..cloud(2, 200) };
        let info = ClipInfo::default();
        let source = Source { info: &info, field: &field, plate: Some(&plate) };
        let views = |turn: f64| {
            let instants = [0.1, 0.3, 0.5, 0.7, 0.9];
            posed_views(&around(&field, turn, (64, 48)), &instants)
        };
        let known = sensitivities(&field, Some(&plate), &views(0.0), || ());
        let scene = RenderScene::from(&field).with_plate(&plate);
        let judge = Pictures::take(&scene, views(0.5), || ());
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut coder = TargetCoder::new(&source, &[], known.clone(), &judge);
            let rounds = std::num::NonZero::new(4).unwrap();
            let mut backend = crate::fit::Cpu::default();
            let mut joint = JointRounding::new(views(0.25), rounds, &mut backend);
            let (mut steps, mut trials) = (0, Vec::new());
            let on_step = |step| match step {
                CodeStep::Done => steps += 1,
                CodeStep::Trial { what, number, most } => trials.push((what, number, most)),
            };
            let coded = coder.code_jointly(psnr, &mut joint, on_step).unwrap();
            assert_eq!(steps, code_steps(rounds.get()));
            assert!(trials.iter().all(|(_, number, most)| number <= most), "{trials:?}");
            assert!(trials.contains(&("joint rounding", 1, JOINT_TRIALS)), "{trials:?}");
            [coded, coder.code(psnr, |_| ()).unwrap()]
        })
    }

    #[test]
    fn joint_rounding_saves_bytes_at_the_same_quality_on_any_number_of_threads() {
        // What it saves at one quality is partly chance.
        let packages = [43.0, 45.0, 47.0].map(|psnr| jointly(3000, psnr, 1));
        let (mut jointly_bytes, mut alone_bytes) = (0, 0);
        for [coded, alone] in &packages {
            assert_eq!((coded.bytes_alone, alone.bytes_alone), (Some(alone.bytes.len()), None));
            assert_ne!(coded.miss, Some(Miss::Below));
            jointly_bytes += coded.bytes.len();
            alone_bytes += alone.bytes.len();
        }
        let saved = 1.0 - jointly_bytes as f64 / alone_bytes as f64;
        assert!(saved > 0.005, "{saved}: {jointly_bytes} of {alone_bytes}");
        assert!(jointly(3000, 45.0, 3)[0].bytes == packages[1][0].bytes);
    }

    #[test]
    fn rounds_of_a_large_field_begin_without_its_package_alone() {
        let [coded, alone] = jointly(17_000, 40.0, 2);
        assert!(coded.bytes_alone.is_none() && coded.miss != Some(Miss::Below), "{:?}", coded.miss);
        assert!(coded.bytes.len() < alone.bytes.len(), "{} of {}", coded.bytes.len(), alone.bytes.len());
    }

    #[test]
    fn a_large_field_gets_the_package_alone_where_no_rounds_meet_the_target() {
        let [coded, alone] = jointly(17_000, 400.0, 2);
        assert_eq!(coded.miss, Some(Miss::Below));
        assert!(coded.fidelity.psnr_db >= alone.fidelity.psnr_db, "{:?}", coded.fidelity);
    }

    /// Nothing is known of its Gaussians, and all pictures are equal.
    #[test]
    fn a_field_that_no_view_sees_gets_a_package() {
        let field = cloud(1, 60);
        let source = Source { info: &ClipInfo::default(), field: &field, plate: None };
        let mut cameras = around(&field, 0.0, (32, 24));
        for camera in &mut cameras {
            // It is behind them.
            for row in [0, 2] {
                camera.camera_from_world[row].iter_mut().for_each(|number| *number = -*number);
            }
        }
        let views = posed_views(&cameras, &[0.5]);
        let judge = Pictures::take(&RenderScene::from(&field), views.clone(), || ());
        let mut backend = crate::fit::Cpu::default();
        let mut joint = JointRounding::new(views.clone(), std::num::NonZero::<usize>::MIN, &mut backend);
        let target = PackageTarget { layers: &[20, 60], psnr_db: 40.0, by_device: false };
        for joint in [None, Some(&mut joint)] {
            let coded = code(&source, target, &views, &judge, joint, |_| ()).unwrap();
            assert_eq!((coded.clip.merged().len(), coded.miss), (60, Some(Miss::Above)));
            assert!(coded.clip.merged().centers.as_flattened().iter().all(|x| x.is_finite()));
        }
    }
}
