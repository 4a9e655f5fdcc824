//! [`Material`]: the field that is compared, and this project's package of it.

use std::path::Path;

use codec::{Clip, ClipInfo, Field, Limits, Viewpoint};
use indicatif::ProgressBar;
use refine::prune::{Ranking, by_importance, contributions_to};
use studio::input::{Input, read_package};
use studio::package::QUALITY_DB;
use studio::report::ReportSubject;

use crate::coding::{Judge, views_of};

/// Steps aside of the pictures that decide what a budget keeps, in degrees.
const ASIDE: f64 = 10.0;

/// What all players play and all coders code.
pub(crate) struct Material {
    /// Where it comes from.
    pub(crate) name: String,
    pub(crate) info: ClipInfo,
    /// As exact as it is known. The background is left out: not every peer has one.
    pub(crate) field: Field,
    /// The package of it, as exact as `cargo xtask package` makes them.
    pub(crate) package: Vec<u8>,
    /// The package, decoded: what players play.
    pub(crate) clip: Clip,
}

impl Material {
    /// Reads a field or a package, of a field keeping the `budget` Gaussians that contribute most to
    /// pictures. A package without a background is played as it is.
    pub(crate) fn load(
        path: &Path,
        budget: Option<usize>,
        progress: &ProgressBar,
    ) -> anyhow::Result<Material> {
        progress.set_message("reading");
        let is_whole_package =
            budget.is_none() && matches!(Input::load(path)?, Input::Package(clip) if clip.plate.is_none());
        let ReportSubject { mut scene, mut field, .. } = ReportSubject::load(path)?;
        let info = &mut scene.info;
        if info.viewpoints.is_empty() {
            info.viewpoints.push(Viewpoint::framing(field.bounds(), info.up));
        }
        if let Some(budget) = budget.filter(|&budget| budget < field.len()) {
            progress.set_message("ranking");
            let seen = contributions_to(&views_of(&field, info, ASIDE), &field, || progress.tick());
            let mut kept = by_importance(&Ranking::BlendSum.scores(&field, &seen));
            kept.truncate(budget);
            field = field.select(&kept);
        }
        let info = scene.info;
        let (package, clip) = if is_whole_package {
            let package = read_package(path)?;
            let clip = codec::decode(&package, &Limits::default())?;
            (package, clip)
        } else {
            let coded = Judge::new(&field, &info, progress).ours(QUALITY_DB)?;
            (coded.bytes, coded.clip)
        };
        Ok(Material { name: scene.name, info, field, package, clip })
    }
}
