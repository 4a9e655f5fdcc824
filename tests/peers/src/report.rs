//! What was measured, as tables to read and as JSON.

use std::fmt::Write;

use serde::Serialize;

use crate::spread::MedianRange;
use crate::{coding, playing};

/// All that was measured of a field.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct PeerReport {
    /// Where the field comes from.
    pub(crate) name: String,
    /// Gaussians played.
    pub(crate) gaussians: usize,
    /// Bytes of the package that was played.
    pub(crate) package_bytes: usize,
    /// Bytes of the `.splatv` file that was played.
    pub(crate) splatv_bytes: usize,
    /// What it was measured on.
    pub(crate) machine: String,
    /// Width and height of the pictures.
    pub(crate) size: [u32; 2],
    /// Frames that are played in each round.
    pub(crate) frames: usize,
    /// Rounds of playing.
    pub(crate) rounds: usize,
    /// The clip, playing, while the camera moves.
    pub(crate) moving: Vec<playing::PlayerRow>,
    /// An instant of it, while the camera moves.
    pub(crate) frozen: Vec<playing::PlayerRow>,
    /// Files.
    pub(crate) coding: Vec<coding::CoderRow>,
}

impl PeerReport {
    /// As Markdown.
    pub(crate) fn text(&self) -> String {
        let PeerReport { name, gaussians, machine, size: [width, height], frames, rounds, .. } = self;
        let mut text = format!(
            "## {name}: {gaussians} Gaussians\n\n\
             {machine}; {frames} frames of {width}x{height} in {rounds} rounds, one player after the other and in \
             the next round the other way round. Medians of rounds, least and most in brackets; \"of ours\" is the \
             ratio within a round. Played were a package of {} bytes and a .splatv of {}.\n\n",
            self.package_bytes, self.splatv_bytes,
        );
        players(&mut text, "The clip, playing", &self.moving);
        players(&mut text, "An instant of it", &self.frozen);
        coders(&mut text, &self.coding);
        text
    }
}

fn players(text: &mut String, title: &str, rows: &[playing::PlayerRow]) {
    let head = "| frame, ms | of ours | first picture, ms | of ours | fragments | PSNR, dB |";
    let _ = writeln!(text, "| {title} {head}\n|---|--:|--:|--:|--:|--:|--:|");
    for row in rows {
        let _ = writeln!(
            text,
            "| {} | {} | {} | {} | {} | {:.2} M | {:.2} |",
            row.player,
            spread(row.frame_ms, 1),
            spread(row.frame_ratio, 2),
            spread(row.first_ms, 0),
            spread(row.first_ratio, 1),
            row.fragments / 1e6,
            row.psnr_db,
        );
    }
    text.push('\n');
    for row in rows {
        let _ = writeln!(text, "{}: {}  ", row.player, row.device);
    }
    text.push('\n');
}

fn coders(text: &mut String, rows: &[coding::CoderRow]) {
    let head =
        "| leaves out | Gaussians | PSNR, dB | bytes | ours | of ours | decoded in ms | ours | of ours |";
    let _ = writeln!(text, "| Coder {head}\n|---|---|--:|--:|--:|--:|--:|--:|--:|--:|");
    for row in rows {
        // A package may not reach what another file has.
        let reached = if row.our_psnr_db < row.psnr_db {
            format!(" at {:.1} dB", row.our_psnr_db)
        } else {
            String::new()
        };
        let _ = writeln!(
            text,
            "| {} | {} | {} | {:.1} | {} | {}{reached} | {:.2} | {} | {} | {} |",
            row.coder,
            row.leaves_out,
            row.gaussians,
            row.psnr_db,
            row.bytes,
            row.our_bytes,
            row.bytes as f64 / row.our_bytes as f64,
            spread(row.decode_ms, 1),
            spread(row.our_decode_ms, 1),
            spread(row.decode_ratio, 2),
        );
    }
}

/// `median [least, most]`.
fn spread(MedianRange { median, least, most }: MedianRange, digits: usize) -> String {
    format!("{median:.digits$} [{least:.digits$}, {most:.digits$}]")
}
