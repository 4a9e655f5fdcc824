//! [`Judge`]: compares another coder's file with this project's package of the same error.

use std::num::NonZero;
use std::time::Instant;

use anyhow::anyhow;
use codec::{ClipInfo, Field, Limits, Source};
use indicatif::ProgressBar;
use refine::code::{CodeError, Coded, JOINT_ROUNDS, JointRounding, PackageTarget, code};
use refine::fit::Cpu;
use refine::prune::{Pictures, instants, posed_views, steps_aside};
use refine::reference::PosedView;
use refine::reference::RenderScene;
use serde::Serialize;
use studio::package::LAYERS;

use super::peer_file::PeerFile;
use crate::median_range::{MedianRange, in_turn};

/// Size of the judged images in pixels.
pub(crate) const SIZE: (u32, u32) = (640, 480);

/// Number of instants of the judged images.
const INSTANTS: usize = 4;

/// Angles in degrees beside the first viewpoint of the images for the coder, and of the judged images.
const CODING_ASIDE: f64 = 10.0;
const JUDGED_ASIDE: f64 = 6.0;

/// Angles of the images for joint rounding, and their size.
const ROUNDING_ASIDE: [f64; 5] = [2.0, 4.0, 8.0, 12.0, 15.0];
const ROUNDING_SIZE: (u32, u32) = (256, 192);

/// A peer's coder and this project's, on one field.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct CoderRow {
    pub(crate) coder: &'static str,
    pub(crate) leaves_out: &'static str,
    /// Number of Gaussians coded.
    pub(crate) gaussians: usize,
    pub(crate) bytes: usize,
    /// PSNR in dB of images of the decoded file against images of the field.
    pub(crate) psnr_db: f64,
    /// Decoding time in milliseconds, on one thread.
    pub(crate) decode_ms: MedianRange,
    /// Size of this project's package, coded to at least that PSNR if possible.
    pub(crate) our_bytes: usize,
    pub(crate) our_psnr_db: f64,
    pub(crate) our_decode_ms: MedianRange,
    /// Their decoding time divided by ours, within each round.
    pub(crate) decode_ratio: MedianRange,
}

/// Compares codings of a field by images.
pub(crate) struct Judge<'a> {
    field: &'a Field,
    info: &'a ClipInfo,
    coding_views: Vec<PosedView>,
    pictures: Pictures,
    progress: &'a ProgressBar,
}

impl<'a> Judge<'a> {
    pub(crate) fn new(field: &'a Field, info: &'a ClipInfo, progress: &'a ProgressBar) -> Judge<'a> {
        progress.set_message("rendering images to judge codings by");
        let judging = views_of(field, info, JUDGED_ASIDE, SIZE);
        let pictures = Pictures::take(&RenderScene::from(field), judging, || progress.tick());
        Judge { field, info, coding_views: views_of(field, info, CODING_ASIDE, SIZE), pictures, progress }
    }

    /// This project's package of the field, of at least `psnr_db` if possible.
    pub(crate) fn ours(&self, psnr_db: f64) -> anyhow::Result<Coded> {
        self.progress.set_message(format!("coding to {psnr_db:.1} dB"));
        let source = Source { info: self.info, field: self.field, plate: None };
        let tick = || self.progress.tick();
        let views =
            ROUNDING_ASIDE.map(|aside| views_of(self.field, self.info, aside, ROUNDING_SIZE)).concat();
        let mut backend = Cpu::default();
        let mut joint =
            NonZero::new(JOINT_ROUNDS).map(|rounds| JointRounding::new(views, rounds, &mut backend));
        let target = PackageTarget { layers: &LAYERS, psnr_db, by_device: false };
        let coded = code(&source, target, &self.coding_views, &self.pictures, joint.as_mut(), tick);
        coded.map_err(|error| match error {
            CodeError::Encode(error) => anyhow!(error),
            CodeError::Decode(error) => anyhow!(error),
            CodeError::Device(error) => anyhow!(error),
        })
    }

    /// Compares a peer's file with this project's package of the same PSNR.
    pub(super) fn compare(&self, theirs: PeerFile, rounds: usize) -> anyhow::Result<CoderRow> {
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
        Ok(CoderRow {
            coder: theirs.name,
            leaves_out: theirs.leaves_out,
            gaussians: self.field.len(),
            bytes: theirs.bytes,
            psnr_db,
            decode_ratio: MedianRange::of_ratios(&their_ms, &our_ms),
            decode_ms: MedianRange::new(their_ms),
            our_bytes: ours.bytes.len(),
            our_psnr_db: ours.fidelity.psnr_db,
            our_decode_ms: MedianRange::new(our_ms),
        })
    }
}

/// Views of this size in pixels from the first viewpoint and from `aside` degrees to its sides, at instants over the
/// clip.
pub(crate) fn views_of(field: &Field, info: &ClipInfo, aside: f64, size: (u32, u32)) -> Vec<PosedView> {
    let cameras = steps_aside(&info.viewpoints[0], info.up, aside.to_radians(), size);
    posed_views(&cameras, &instants(field, INSTANTS))
}
