//! [`ComparedField`]: the compared field, and this project's package of it.

use std::path::Path;

use codec::{Clip, ClipInfo, Field, Surroundings};
use formats::is_package;
use indicatif::ProgressBar;
use refine::prune::{Ranking, by_importance, contributions_to};
use studio::package::QUALITY_DB;
use studio::report::ReportSubject;
use studio::segments::TakeFile;

use super::{Judge, SIZE, views_of};

/// Angle in degrees beside the first viewpoint of the images that rank Gaussians for a budget.
const ASIDE: f64 = 10.0;

/// The input of all players and coders.
pub(crate) struct ComparedField {
    /// Name of the field's scene.
    pub(crate) name: String,
    pub(crate) info: ClipInfo,
    /// The field before coding. Without the static background, which not every peer supports.
    pub(crate) field: Field,
    /// Its package, at the default quality of `cargo xtask package`.
    pub(crate) package: Vec<u8>,
    /// The decoded package.
    pub(crate) clip: Clip,
}

impl ComparedField {
    /// Reads a field or a package, and selects the `budget` Gaussians that contribute most to images. A package
    /// without a background is played unchanged if there is no budget.
    pub(crate) fn load(
        path: &Path,
        budget: Option<usize>,
        progress: &ProgressBar,
    ) -> anyhow::Result<ComparedField> {
        progress.set_message("reading");
        let ReportSubject { mut scene, mut field, .. } = ReportSubject::load(path)?;
        let is_played_unchanged = budget.is_none() && is_package(path) && scene.plate.is_none();
        let info = &mut scene.info;
        if info.viewpoints.is_empty() {
            info.viewpoints.push(Surroundings::new(&field, None, info.up).opening());
        }
        if let Some(budget) = budget.filter(|&budget| budget < field.len()) {
            progress.set_message("ranking");
            let seen = contributions_to(&views_of(&field, info, ASIDE, SIZE), &field, || progress.tick());
            let mut rows = by_importance(&Ranking::BlendSum.scores(&field, &seen));
            rows.truncate(budget);
            field = field.select(&rows);
        }
        let info = scene.info;
        let (package, clip) = if is_played_unchanged {
            let file = TakeFile::open(path)?;
            (file.read(0)?, file.decode(0)?)
        } else {
            let coded = Judge::new(&field, &info, progress).ours(QUALITY_DB)?;
            (coded.bytes, coded.clip)
        };
        Ok(ComparedField { name: scene.name, info, field, package, clip })
    }
}
