//! Other coders: how large and how exact their files are, and how large this project's are where they
//! are as exact.

mod fourdgs;
mod sog;
mod splatv;
mod spz;

use std::path::Path;
use std::time::Instant;

use anyhow::anyhow;
use codec::{ClipInfo, Field, Limits, Source};
use indicatif::ProgressBar;
use refine::code::{CodeError, Coded, code};
use refine::prune::{Pictures, PosedView, instants, posed_views, steps_aside};
use refine::reference::RenderScene;
use serde::Serialize;
use studio::export;

use crate::material::Material;
use crate::spread::{Spread, in_turn};

/// Where the layers of packages end, as `cargo xtask package` has them.
const LAYERS: [usize; 5] = [5_000, 10_000, 20_000, 40_000, 80_000];

/// Size in pixels of pictures that tell what an error of coding looks like.
const SIZE: (u32, u32) = (640, 480);

/// Instants of a moving field at which pictures are taken.
const INSTANTS: usize = 4;

/// Steps aside, in degrees, of the pictures that a coder may look at, and of those that judge.
const SEEN_ASIDE: f64 = 10.0;
const JUDGED_ASIDE: f64 = 6.0;

/// A file of another coder.
struct Theirs {
    name: &'static str,
    /// What the format, as it is used here, has no place for.
    leaves_out: &'static str,
    bytes: usize,
    /// What the file holds.
    field: Field,
    /// Decodes the file.
    decode: Box<dyn Fn() -> anyhow::Result<()>>,
}

/// A coder against this project's.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Row {
    pub(crate) coder: &'static str,
    pub(crate) leaves_out: &'static str,
    /// Gaussians coded.
    pub(crate) gaussians: usize,
    pub(crate) bytes: usize,
    /// PSNR in dB of pictures of the decoded file against those of the field.
    pub(crate) psnr_db: f64,
    /// Milliseconds, by one thread.
    pub(crate) decode_ms: Spread,
    /// The same of this project's package that is at least as exact, or as exact as it can be.
    pub(crate) our_bytes: usize,
    pub(crate) our_psnr_db: f64,
    pub(crate) our_decode_ms: Spread,
    /// Their time by ours, round by round.
    pub(crate) decode_ratio: Spread,
}

/// Codes the material, and what it is at clip time `t`, by every coder. Files are made in `folder`.
pub(crate) fn compare(
    material: &Material,
    t: f64,
    folder: &Path,
    rounds: usize,
    progress: &ProgressBar,
) -> anyhow::Result<Vec<Row>> {
    let Material { field, info, .. } = material;
    let mut rows = Vec::new();
    let judge = Judge::new(field, info, progress);
    if field.sh_degree == 0 {
        for theirs in fourdgs::files(field, info)? {
            rows.push(judge.compare(theirs, rounds)?);
        }
        rows.push(judge.compare(splatv::file(field, info, folder)?, rounds)?);
    }
    let frozen = export::frozen(field, t);
    let judge = Judge::new(&frozen, info, progress);
    rows.push(judge.compare(spz::file(&frozen, folder)?, rounds)?);
    rows.push(judge.compare(sog::file(&frozen, folder)?, rounds)?);
    Ok(rows)
}

/// A field, what of it is seen, and pictures to judge codings of it by.
pub(crate) struct Judge<'a> {
    field: &'a Field,
    info: &'a ClipInfo,
    seen: Vec<PosedView>,
    pictures: Pictures,
    progress: &'a ProgressBar,
}

impl<'a> Judge<'a> {
    pub(crate) fn new(field: &'a Field, info: &'a ClipInfo, progress: &'a ProgressBar) -> Judge<'a> {
        progress.set_message("pictures to judge codings by");
        let judged = shots_of(field, info, JUDGED_ASIDE);
        let pictures = Pictures::take(&RenderScene::from(field), judged, || progress.tick());
        Judge { field, info, seen: shots_of(field, info, SEEN_ASIDE), pictures, progress }
    }

    /// This project's package of the field, no less exact than `psnr_db` where that can be reached.
    pub(crate) fn ours(&self, psnr_db: f64) -> anyhow::Result<Coded> {
        self.progress.set_message(format!("coding to {psnr_db:.1} dB"));
        let source = Source { info: self.info, field: self.field, plate: None };
        let coded = code(&source, &LAYERS, psnr_db, &self.seen, &self.pictures, || self.progress.tick());
        coded.map_err(|error| match error {
            CodeError::Encode(error) => anyhow!(error),
            CodeError::Decode(error) => anyhow!(error),
        })
    }

    fn compare(&self, theirs: Theirs, rounds: usize) -> anyhow::Result<Row> {
        self.progress.set_message(format!("judging {}", theirs.name));
        let psnr_db = self.pictures.psnr(&RenderScene::from(&theirs.field), || self.progress.tick());
        let ours = self.ours(psnr_db)?;
        let decode_ours = || -> anyhow::Result<()> {
            codec::decode(&ours.bytes, &Limits::default())?;
            Ok(())
        };
        self.progress.set_message(format!("decoding {}", theirs.name));
        let decoders: [&dyn Fn() -> anyhow::Result<()>; 2] = [&decode_ours, &*theirs.decode];
        let mut times = [Vec::new(), Vec::new()];
        for round in 0..rounds {
            for i in in_turn(round, decoders.len()) {
                let start = Instant::now();
                decoders[i]()?;
                times[i].push(start.elapsed().as_secs_f64() * 1e3);
            }
        }
        let [our_ms, their_ms] = times;
        Ok(Row {
            coder: theirs.name,
            leaves_out: theirs.leaves_out,
            gaussians: self.field.len(),
            bytes: theirs.bytes,
            psnr_db,
            decode_ratio: Spread::of_ratios(&their_ms, &our_ms),
            decode_ms: Spread::of(their_ms),
            our_bytes: ours.bytes.len(),
            our_psnr_db: ours.psnr_db,
            our_decode_ms: Spread::of(our_ms),
        })
    }
}

/// Pictures from the first viewpoint and from `aside` degrees to its sides, at instants all over the clip.
pub(crate) fn shots_of(field: &Field, info: &ClipInfo, aside: f64) -> Vec<PosedView> {
    let cameras = steps_aside(&info.viewpoints[0], info.up, aside.to_radians(), SIZE);
    posed_views(&cameras, &instants(field, INSTANTS))
}
