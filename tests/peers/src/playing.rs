//! Measures frame times, start-up times and image errors of interleaved players.

use std::path::Path;

use anyhow::ensure;
use codec::Clip;
use image::RgbImage;
use indicatif::ProgressBar;
use refine::image::Image;
use refine::reference::{Order, Radius, RenderScene, coverage, render};
use serde::Serialize;

use crate::median_range::{MedianRange, in_turn};
use crate::player::{PeerPlayer, PlayerKind, WebGl};
use crate::workload::{WorkFrame, Workload};

/// Rounds of opening a field, which takes seconds in a browser.
const OPENINGS: usize = 3;

/// Number of images compared with the reference.
const COMPARED_IMAGES: usize = 3;

/// A player compared with this project's.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct PlayerRow {
    pub(crate) player: &'static str,
    /// Name and driver of the graphics device.
    pub(crate) device: String,
    /// Median frame time of each round in milliseconds.
    pub(crate) frame_ms: MedianRange,
    /// Its frame time divided by ours, within each round.
    pub(crate) frame_ratio: MedianRange,
    /// Milliseconds from the start to the first image.
    pub(crate) first_ms: MedianRange,
    /// Its `first_ms` divided by ours, within each round.
    pub(crate) first_ratio: MedianRange,
    /// Mean number of pixel centres per frame in quads of its support radius.
    pub(crate) fragments: f64,
    /// PSNR in dB against the reference, over all pixels of all compared images.
    pub(crate) psnr_db: f64,
}

/// Measures `kinds`, whose first is this project's player, on the work and the fields of `clip` in `folder`. Writes
/// images to `folder`.
pub(crate) fn compare(
    kinds: &[PlayerKind],
    (clip, work): (&Clip, &Workload),
    folder: &Path,
    (rounds, web_gl): (usize, WebGl),
    progress: &ProgressBar,
) -> anyhow::Result<Vec<PlayerRow>> {
    let mut players: Vec<PeerPlayer> =
        kinds.iter().map(|&kind| PeerPlayer::new(kind, folder, web_gl)).collect();
    let mut devices = vec![String::new(); players.len()];
    let mut first_ms = vec![Vec::new(); players.len()];
    for round in 0..OPENINGS {
        for i in in_turn(round, players.len()) {
            progress.set_message(format!("{}: opening, round {} of {OPENINGS}", kinds[i].name(), round + 1));
            let opened = players[i].open()?;
            devices[i] = opened.device;
            first_ms[i].push(opened.first_ms);
        }
    }

    let mut frame_ms = vec![Vec::new(); players.len()];
    for round in 0..rounds {
        for i in in_turn(round, players.len()) {
            progress.set_message(format!("{}: playing, round {} of {rounds}", kinds[i].name(), round + 1));
            frame_ms[i].push(MedianRange::new(players[i].play()?.frames_ms).median);
        }
    }

    let psnrs = judge(&mut players, clip, work, folder, progress)?;
    progress.set_message("counting fragments");
    let row = |i: usize| PlayerRow {
        player: kinds[i].name(),
        device: devices[i].clone(),
        frame_ms: MedianRange::new(frame_ms[i].clone()),
        frame_ratio: MedianRange::of_ratios(&frame_ms[i], &frame_ms[0]),
        first_ms: MedianRange::new(first_ms[i].clone()),
        first_ratio: MedianRange::of_ratios(&first_ms[i], &first_ms[0]),
        fragments: fragments(kinds[i], clip, work),
        psnr_db: psnrs[i],
    };
    Ok((0..players.len()).map(row).collect())
}

/// PSNR in dB of each player's images. Writes each frame as a strip with the reference at the left.
fn judge(
    players: &mut [PeerPlayer],
    clip: &Clip,
    work: &Workload,
    folder: &Path,
    progress: &ProgressBar,
) -> anyhow::Result<Vec<f64>> {
    let mut squares = vec![0.0; players.len()];
    let frames: Vec<usize> =
        (0..COMPARED_IMAGES).map(|k| k * (work.frames.len() - 1) / (COMPARED_IMAGES - 1)).collect();
    for &frame in &frames {
        progress.set_message(format!("reference of frame {frame}"));
        let WorkFrame { t, camera } = &work.frames[frame];
        let truth = render(&RenderScene::from(clip), camera, *t, Order::Depth);
        let mut strip = vec![truth.to_rgb8()];
        for (i, player) in players.iter_mut().enumerate() {
            progress.set_message(format!("{}: image of frame {frame}", player.kind.name()));
            let rgb = player.picture(frame)?;
            ensure!(rgb.len() == strip[0].len(), "{}: an image of another size", player.kind.name());
            squares[i] += truth.squared_error(&image_of(&rgb, work));
            strip.push(rgb);
        }
        side_by_side(&strip, work).save(folder.join(format!("frame-{frame:02}.png")))?;
    }
    let values = 3.0 * f64::from(work.width) * f64::from(work.height) * frames.len() as f64;
    Ok(squares.into_iter().map(|squares| -10.0 * (squares / values).log10()).collect())
}

fn image_of(rgb: &[u8], work: &Workload) -> Image {
    let unit = |byte: u8| f64::from(byte) / 255.0;
    let pixels = rgb.chunks_exact(3).map(|c| [unit(c[0]), unit(c[1]), unit(c[2]), 1.0]).collect();
    Image { width: work.width, height: work.height, pixels }
}

fn side_by_side(pictures: &[Vec<u8>], work: &Workload) -> RgbImage {
    let row = 3 * work.width as usize;
    let rows = (0..work.height as usize)
        .flat_map(|y| pictures.iter().map(move |picture| &picture[y * row..][..row]));
    let bytes = rows.flatten().copied().collect();
    RgbImage::from_raw(work.width * pictures.len() as u32, work.height, bytes)
        .expect("all have the size of the work")
}

/// Mean number of fragments per frame, if the player draws every Gaussian as a quad of the support radius in its
/// shaders, at the Gaussian's position in the reference.
fn fragments(kind: PlayerKind, clip: &Clip, work: &Workload) -> f64 {
    let sqrt_8 = 8f64.sqrt();
    let radius = match kind {
        PlayerKind::Ours => Radius::Exact,
        PlayerKind::OursSqrt8 => Radius::AtMost(sqrt_8),
        PlayerKind::Gsplat | PlayerKind::GsplatMended | PlayerKind::Spark => Radius::Fixed(sqrt_8),
        // Its support radius counts twice: in the length of the axes, and in the extent along them.
        PlayerKind::Viewer => Radius::Fixed(sqrt_8 * sqrt_8 / 2.0),
    };
    let scene = RenderScene::from(clip);
    let fragments = |frame: &WorkFrame| {
        coverage(&scene, std::slice::from_ref(&frame.camera), frame.t, radius).fragments
    };
    let all: u64 = work.frames.iter().map(fragments).sum();
    all as f64 / work.frames.len() as f64
}
