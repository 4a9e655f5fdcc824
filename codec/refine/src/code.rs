//! [`code`]: packages a field with a target PSNR.
//!
//! The sensitivity of each Gaussian in pictures sets its precision. The package is decoded, rendered and
//! compared with the field, and the precision is searched at which it just meets the target. Small fields
//! are also coded with the same precision for all rows, as learning each row's precision can cost more
//! than it saves.

mod scan;
mod search;

use std::num::NonZero;

use codec::{
    Clip, Coder, EncodeError, EncodeOptions, Error, Limits, Precision, Sensitivity, Source, decode_parallel,
    encode_parallel,
};

use crate::prune::{Fidelity, Pictures, PosedView};
use crate::reference::{RenderScene, sensitivities};

use scan::Scan;
use search::Search;
pub use search::{Miss, SURPLUS_MAX_DB, TRIALS, WORST_BELOW_DB};

/// Rows of a small field at most. In small and regular fields, many Gaussians have the same numbers and so the
/// same errors: the PSNR jumps by up to 10 dB between neighbouring precisions, and equal precision for all
/// rows can be smaller. In large fields it was not in any case measured.
const SMALL_ROWS: usize = 16_384;

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
}

/// Error of [`code`].
#[derive(Debug)]
pub enum CodeError {
    /// The field cannot be packaged.
    Encode(EncodeError),
    /// The package cannot be decoded.
    Decode(Error),
}

/// Packages `source` with the coder `context` at a PSNR of `psnr_db` to [`SURPLUS_MAX_DB`] above, no
/// picture more than [`WORST_BELOW_DB`] below `psnr_db`, or as close as possible. `layers` are the layer
/// ends in rows. Sensitivities are taken from the views `seen`; `judge` holds pictures of the source to
/// compare with. `on_step` is called after each of `seen` and each of [`TRIALS`].
///
/// # Errors
/// Errors of [`codec::encode`] and [`codec::decode`].
pub fn code(
    source: &Source,
    layers: &[usize],
    psnr_db: f64,
    seen: &[PosedView],
    judge: &Pictures,
    mut on_step: impl FnMut(),
) -> Result<Coded, CodeError> {
    let known = sensitivities(source.field, source.plate, seen, &mut on_step);
    code_knowing(source, layers, psnr_db, known.as_ref(), judge, on_step)
}

/// Packages `source` as [`code`] does with known sensitivities and footprint, as computed by
/// [`sensitivities`]. `on_step` is called after each of [`TRIALS`].
///
/// # Errors
/// Errors of [`codec::encode`] and [`codec::decode`].
pub fn code_knowing(
    source: &Source,
    layers: &[usize],
    psnr_db: f64,
    sensitivities: Option<&(Vec<Sensitivity>, f32)>,
    judge: &Pictures,
    mut on_step: impl FnMut(),
) -> Result<Coded, CodeError> {
    let own = code_at(source, layers, psnr_db, precision(sensitivities), judge, &mut on_step)?;
    let Some((rows, footprint)) = sensitivities.filter(|_| source.field.len() <= SMALL_ROWS) else {
        return Ok(own);
    };
    let equal = (equal_sensitivities(rows), *footprint);
    if equal.0 == *rows {
        return Ok(own);
    }
    let equal = code_at(source, layers, psnr_db, precision(Some(&equal)), judge, || ())?;
    Ok(match equal.is_better_than(&own) {
        true => equal,
        false => own,
    })
}

/// The root mean square of `rows`, which are at least one, for each of them: equal precision.
pub fn equal_sensitivities(rows: &[Sensitivity]) -> Vec<Sensitivity> {
    let of = |number: fn(&Sensitivity) -> f32| {
        let squares: f64 = rows.iter().map(|row| f64::from(number(row)).powi(2)).sum();
        (squares / rows.len() as f64).sqrt() as f32
    };
    vec![Sensitivity { color: of(|row| row.color), geometry: of(|row| row.geometry) }; rows.len()]
}

fn precision(sensitivities: Option<&(Vec<Sensitivity>, f32)>) -> Precision {
    match sensitivities {
        Some((rows, footprint)) => {
            Precision { sensitivities: rows.clone(), footprint: Some(*footprint), ..Precision::default() }
        }
        None => Precision::default(),
    }
}

/// Finds the [`Precision::psnr`] at which the package meets the target.
fn code_at(
    source: &Source,
    layers: &[usize],
    psnr_db: f64,
    precision: Precision,
    judge: &Pictures,
    on_step: impl FnMut(),
) -> Result<Coded, CodeError> {
    let packager = Packager { source, layers, precision, judge };
    match source.field.len() <= SMALL_ROWS {
        true => packager.scan(psnr_db, on_step),
        false => packager.search(psnr_db, on_step),
    }
}

/// Packages a source at any precision.
struct Packager<'a> {
    source: &'a Source<'a>,
    layers: &'a [usize],
    /// All but [`Precision::psnr`].
    precision: Precision,
    judge: &'a Pictures,
}

impl Packager<'_> {
    fn package(&self, finer_db: f64) -> Result<(Vec<u8>, Clip), CodeError> {
        let threads = NonZero::new(rayon::current_num_threads()).unwrap_or(NonZero::<usize>::MIN);
        let precision = Precision { psnr: finer_db, ..self.precision.clone() };
        let options = EncodeOptions { coder: Coder::Context, layers: self.layers.to_vec(), precision };
        let bytes = encode_parallel(self.source, &options, threads).map_err(CodeError::Encode)?;
        let clip = decode_parallel(&bytes, &Limits::default(), threads).map_err(CodeError::Decode)?;
        Ok((bytes, clip))
    }

    /// Searches a precision as [`Search`] does.
    fn search(&self, psnr_db: f64, mut on_step: impl FnMut()) -> Result<Coded, CodeError> {
        let mut best: Option<Coded> = None;
        let mut search = Search::new(psnr_db);
        let mut trials = 0;
        while let Some(finer_db) = search.next() {
            let (bytes, clip) = self.package(finer_db)?;
            let fidelity = self.judge.compare(&RenderScene::from(&clip), || ());
            let miss = search.record(&fidelity, bytes.len());
            let coded = Coded { bytes, clip, fidelity, miss };
            if best.as_ref().is_none_or(|best| coded.is_better_than(best)) {
                best = Some(coded);
            }
            trials += 1;
            on_step();
        }
        (trials..TRIALS).for_each(|_| on_step());
        Ok(best.expect("a search has at least one trial"))
    }

    /// Takes the coarsest precision of [`Scan`] that meets the target.
    fn scan(&self, psnr_db: f64, mut on_step: impl FnMut()) -> Result<Coded, CodeError> {
        let mut found: Option<Coded> = None;
        let mut scan = Scan::new(psnr_db);
        let mut trials = 0;
        while let Some(finer_db) = scan.next() {
            let (bytes, clip) = self.package(finer_db)?;
            let least = (psnr_db, psnr_db - WORST_BELOW_DB);
            let fidelity = self.judge.compare_at_least(&RenderScene::from(&clip), least);
            scan.record(fidelity.is_some());
            if let Some(fidelity) = fidelity {
                let miss = search::miss_of(&fidelity, psnr_db);
                found = Some(Coded { bytes, clip, fidelity, miss });
            }
            trials += 1;
            if trials <= TRIALS {
                on_step();
            }
        }
        (trials..TRIALS).for_each(|_| on_step());
        // Out of reach, a search comes as close as any.
        found.map_or_else(|| self.search(psnr_db, || ()), Ok)
    }
}

impl Coded {
    /// Whether this package is the better one for the target: the smaller one of two that are not below it,
    /// else the one with the higher PSNR.
    fn is_better_than(&self, other: &Coded) -> bool {
        let reaches = |coded: &Coded| coded.miss != Some(Miss::Below);
        match (reaches(self), reaches(other)) {
            (true, true) => self.bytes.len() < other.bytes.len(),
            (false, false) => self.fidelity.psnr_db > other.fidelity.psnr_db,
            (reaches, _) => reaches,
        }
    }
}
