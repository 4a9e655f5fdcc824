//! Compares the files of other coders with this project's packages of the same error.

mod compared_field;
mod fourdgs;
mod judge;
mod peer_file;
mod sog;
mod splatv;
mod spz;

use std::path::Path;

use indicatif::ProgressBar;

pub(crate) use compared_field::ComparedField;
pub(crate) use judge::{CoderRow, Judge, SIZE, views_of};

/// Compares all coders on the field and on its instant at clip time `t`. Writes the files to `folder`.
pub(crate) fn compare(
    compared: &ComparedField,
    t: f64,
    folder: &Path,
    rounds: usize,
    progress: &ProgressBar,
) -> anyhow::Result<Vec<CoderRow>> {
    let ComparedField { field, info, .. } = compared;
    let mut rows = Vec::new();
    let judge = Judge::new(field, info, progress);
    if field.sh_degree == 0 {
        for theirs in fourdgs::files(field, info)? {
            rows.push(judge.compare(theirs, rounds)?);
        }
        rows.push(judge.compare(splatv::file(field, info, folder)?, rounds)?);
    }
    let frozen = formats::frozen(field, t);
    let judge = Judge::new(&frozen, info, progress);
    rows.push(judge.compare(spz::file(&frozen, folder)?, rounds)?);
    rows.push(judge.compare(sog::file(&frozen, folder)?, rounds)?);
    Ok(rows)
}
