//! Players in turn: how long frames and first pictures take, and how right the pictures are.

use std::path::Path;

use anyhow::ensure;
use codec::Clip;
use image::RgbImage;
use indicatif::ProgressBar;
use refine::image::Image;
use refine::reference::{Order, Radius, RenderScene, coverage, render};
use serde::Serialize;

use crate::player::{PeerPlayer, PlayerKind, WebGl};
use crate::spread::{MedianRange, in_turn};
use crate::work::Work;

/// Rounds of opening: a browser takes seconds to each.
const OPENINGS: usize = 3;

/// Pictures that are compared with the reference.
const PICTURES: usize = 3;

/// A player against this project's.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct PlayerRow {
    pub(crate) player: &'static str,
    /// What drew.
    pub(crate) device: String,
    /// Milliseconds of the middle frame of each round.
    pub(crate) frame_ms: MedianRange,
    /// Its time by ours, round by round.
    pub(crate) frame_ratio: MedianRange,
    /// Milliseconds from the start to the first picture.
    pub(crate) first_ms: MedianRange,
    /// Its time by ours, round by round.
    pub(crate) first_ratio: MedianRange,
    /// Mean over the frames of the pixel centres in rectangles of its reach.
    pub(crate) fragments: f64,
    /// PSNR in dB against the reference, over all pixels of all compared pictures.
    pub(crate) psnr_db: f64,
}

/// Has `kinds` play the work and the fields in `folder`, which belong to `clip`; the first is ours.
/// Pictures are left in `folder`.
pub(crate) fn compare(
    kinds: &[PlayerKind],
    (clip, work): (&Clip, &Work),
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
            frame_ms[i].push(MedianRange::of(players[i].play()?.frames_ms).median);
        }
    }

    let psnrs = judge(&mut players, clip, work, folder, progress)?;
    progress.set_message("counting fragments");
    let row = |i: usize| PlayerRow {
        player: kinds[i].name(),
        device: devices[i].clone(),
        frame_ms: MedianRange::of(frame_ms[i].clone()),
        frame_ratio: MedianRange::of_ratios(&frame_ms[i], &frame_ms[0]),
        first_ms: MedianRange::of(first_ms[i].clone()),
        first_ratio: MedianRange::of_ratios(&first_ms[i], &first_ms[0]),
        fragments: fragments(kinds[i], clip, work),
        psnr_db: psnrs[i],
    };
    Ok((0..players.len()).map(row).collect())
}

/// PSNR in dB of the pictures of each player. Each frame is left as a strip, the reference at its left.
fn judge(
    players: &mut [PeerPlayer],
    clip: &Clip,
    work: &Work,
    folder: &Path,
    progress: &ProgressBar,
) -> anyhow::Result<Vec<f64>> {
    let mut squares = vec![0.0; players.len()];
    let frames: Vec<usize> = (0..PICTURES).map(|k| k * (work.frames.len() - 1) / (PICTURES - 1)).collect();
    for &frame in &frames {
        progress.set_message(format!("reference of frame {frame}"));
        let shot = &work.frames[frame];
        let truth = render(&RenderScene::from(clip), &shot.camera, shot.t, Order::Depth);
        let mut strip = vec![truth.to_rgb8()];
        for (i, player) in players.iter_mut().enumerate() {
            progress.set_message(format!("{}: picture of frame {frame}", player.kind.name()));
            let rgb = player.picture(frame)?;
            ensure!(rgb.len() == strip[0].len(), "{}: a picture of another size", player.kind.name());
            squares[i] += truth.squared_error(&image_of(&rgb, work));
            strip.push(rgb);
        }
        side_by_side(&strip, work).save(folder.join(format!("frame-{frame:02}.png")))?;
    }
    let values = 3.0 * f64::from(work.width) * f64::from(work.height) * frames.len() as f64;
    Ok(squares.into_iter().map(|squares| -10.0 * (squares / values).log10()).collect())
}

fn image_of(rgb: &[u8], work: &Work) -> Image {
    let unit = |byte: u8| f64::from(byte) / 255.0;
    let pixels = rgb.chunks_exact(3).map(|c| [unit(c[0]), unit(c[1]), unit(c[2]), 1.0]).collect();
    Image { width: work.width, height: work.height, pixels }
}

fn side_by_side(pictures: &[Vec<u8>], work: &Work) -> RgbImage {
    let row = 3 * work.width as usize;
    let rows = (0..work.height as usize)
        .flat_map(|y| pictures.iter().map(move |picture| &picture[y * row..][..row]));
    let bytes = rows.flatten().copied().collect();
    RgbImage::from_raw(work.width * pictures.len() as u32, work.height, bytes)
        .expect("all have the size of the work")
}

/// What a player shades, as far as it draws every Gaussian as a rectangle of the reach that its
/// shaders give it; counted where the reference sees the Gaussians.
fn fragments(kind: PlayerKind, clip: &Clip, work: &Work) -> f64 {
    let sqrt_8 = 8f64.sqrt();
    let radius = match kind {
        PlayerKind::Ours => Radius::Exact,
        PlayerKind::OursSqrt8 => Radius::AtMost(sqrt_8),
        PlayerKind::Gsplat | PlayerKind::GsplatMended | PlayerKind::Spark => Radius::Fixed(sqrt_8),
        // Its reach counts twice: in the length of the axes, and in how far along them it goes.
        PlayerKind::Viewer => Radius::Fixed(sqrt_8 * sqrt_8 / 2.0),
    };
    let scene = RenderScene::from(clip);
    let all: u64 =
        work.frames.iter().map(|frame| coverage(&scene, &frame.camera, frame.t, radius).fragments).sum();
    all as f64 / work.frames.len() as f64
}
