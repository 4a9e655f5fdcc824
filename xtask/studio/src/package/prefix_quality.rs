//! [`prefix_quality`]: whether the first layers of a package are as good as a package of their size.
//!
//! If they are, one file serves every budget: a player with less memory or time stops reading early. A
//! package of a smaller budget has the ranking of the layers, but its own topology floor and precision.

use codec::Limits;
use refine::prune::{Pictures, Ranking};
use refine::reference;
use serde::Serialize;

use refine::fit::Backend;

use super::pipeline::{Package, package_with};
use super::settings::PackageSettings;
use super::views::{render_scene, whole_views};
use super::visible::{VisibleScene, visible_scene};
use crate::progress::StagedProgress;
use crate::scene::Scene;

/// The first layers of a package beside a package of as many Gaussians.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PrefixStep {
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
/// that budget and the ranking of the layers. The last step is the package itself.
///
/// # Errors
/// A defect of this program.
pub fn prefix_quality(
    scene: &Scene,
    settings: &PackageSettings,
    package: &Package,
    backend: &mut dyn Backend,
    progress: &StagedProgress,
) -> anyhow::Result<Vec<PrefixStep>> {
    let limits = Limits::default();
    let VisibleScene { field, plate, .. } = visible_scene(scene, settings)?;
    let judge = Pictures::take(&render_scene(&field, plate.as_ref()), whole_views(scene, &field), || ());
    let psnr_of = |bytes: &[u8]| -> anyhow::Result<f64> {
        let clip = codec::decode(bytes, &limits)?;
        Ok(judge.psnr(&reference::RenderScene::from(&clip), || ()))
    };
    let contents = codec::contents(&package.bytes, &limits)?;
    let layers = &package.report.layers;
    let mut steps = Vec::new();
    for (&gaussians, prefix_bytes) in layers.iter().zip(contents.layer_bytes()) {
        let prefix_psnr_db = psnr_of(&package.bytes[..prefix_bytes])?;
        let (own_bytes, own_psnr_db) = if gaussians == package.report.subject.gaussians_out {
            (prefix_bytes, prefix_psnr_db)
        } else {
            progress.set_prefix(format!("{gaussians}: "));
            let rank =
                Ranking::ALL.into_iter().find(|ranking| ranking.name() == package.report.layer_ranking);
            let settings = PackageSettings { budget: Some(gaussians), rank, ..settings.clone() };
            let own = package_with(scene, &settings, None, backend, progress)?;
            (own.bytes.len(), psnr_of(&own.bytes)?)
        };
        let loss_db = if own_psnr_db == prefix_psnr_db { 0.0 } else { own_psnr_db - prefix_psnr_db };
        steps.push(PrefixStep { gaussians, prefix_bytes, prefix_psnr_db, own_bytes, own_psnr_db, loss_db });
    }
    Ok(steps)
}
