//! [`ladder`]: whether the first layers of a package are as good as a package of their size.
//!
//! One file serves every budget if they are: whoever has less room or less time stops reading
//! early. A package of a smaller budget has the same ranking, but a topology floor, a refit and a
//! precision of its own.

use codec::Limits;
use indicatif::ProgressBar;
use refine::prune::{Pictures, Ranking};
use refine::reference;
use serde::Serialize;

use super::whole::{judging_shots, scene_of};
use super::{Package, Prepared, Settings, package_showing, prepare};
use crate::input::prefix_bytes;
use crate::scene::Scene;

/// The first layers of a package beside a package of as many Gaussians.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Rung {
    /// Gaussians in these layers.
    pub gaussians: usize,
    /// Bytes of the package up to the end of them.
    pub prefix_bytes: usize,
    /// PSNR in dB between pictures of what they decode to and of the whole field.
    pub prefix_psnr_db: f64,
    /// Size of the other package.
    pub own_bytes: usize,
    /// Its PSNR, in the same pictures.
    pub own_psnr_db: f64,
    /// How much less faithful the first layers are, in dB; below 0 where they are more.
    pub loss_db: f64,
}

/// Compares every prefix of `package`, which is made of `scene` with `settings` alone, with a package of
/// that budget and the same ranking. The last rung is the package itself.
///
/// # Errors
/// A defect of this program.
pub fn ladder(
    scene: &Scene,
    settings: &Settings,
    package: &Package,
    progress: &ProgressBar,
) -> anyhow::Result<Vec<Rung>> {
    let limits = Limits::default();
    let Prepared { field, plate, .. } = prepare(scene, settings)?;
    let judge = Pictures::take(&scene_of(&field, plate.as_ref()), judging_shots(scene, &field), || ());
    let look = |bytes: &[u8]| -> anyhow::Result<f64> {
        let clip = codec::decode(bytes, &limits)?;
        Ok(judge.psnr(&reference::RenderScene::from(&clip), || ()))
    };
    let contents = codec::contents(&package.bytes, &limits)?;
    let layers = &package.report.layers;
    let mut rungs = Vec::new();
    for (layer, &gaussians) in layers.iter().enumerate() {
        let prefix_bytes = prefix_bytes(&contents, layer);
        let prefix_psnr_db = look(&package.bytes[..prefix_bytes])?;
        let (own_bytes, own_psnr_db) = if gaussians == package.report.subject.gaussians_out {
            (prefix_bytes, prefix_psnr_db)
        } else {
            progress.reset();
            progress.set_prefix(format!("{gaussians}: "));
            let rank = Ranking::ALL.into_iter().find(|ranking| ranking.name() == package.report.ranking);
            let settings = Settings { budget: Some(gaussians), rank, ..settings.clone() };
            let own = package_showing(scene, &settings, None, progress)?;
            (own.bytes.len(), look(&own.bytes)?)
        };
        let loss_db = if own_psnr_db == prefix_psnr_db { 0.0 } else { own_psnr_db - prefix_psnr_db };
        rungs.push(Rung { gaussians, prefix_bytes, prefix_psnr_db, own_bytes, own_psnr_db, loss_db });
    }
    Ok(rungs)
}
