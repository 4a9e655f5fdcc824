//! The measurements as Markdown tables and as JSON.

use std::fmt::Write;

use serde::Serialize;

use crate::median_range::MedianRange;
use crate::{coding, playing};

/// The measurements of a field.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct PeerReport {
    /// Name of the field's scene.
    pub(crate) name: String,
    /// Number of Gaussians in the played package.
    pub(crate) gaussians: usize,
    /// Size of the played package in bytes.
    pub(crate) package_bytes: usize,
    /// Size of the played `.splatv` file in bytes.
    pub(crate) splatv_bytes: usize,
    /// Processor and system of the measurement.
    pub(crate) machine: String,
    /// Width and height of the images in pixels.
    pub(crate) size: [u32; 2],
    /// Number of frames per round.
    pub(crate) frames: usize,
    /// Number of rounds of playing.
    pub(crate) rounds: usize,
    /// The players of the playing clip.
    #[serde(rename = "moving")]
    pub(crate) dynamic: Vec<playing::PlayerRow>,
    /// The players of an instant of the clip, while the camera moves.
    pub(crate) frozen: Vec<playing::PlayerRow>,
    /// The coders.
    pub(crate) coding: Vec<coding::CoderRow>,
}

impl PeerReport {
    /// As Markdown.
    pub(crate) fn text(&self) -> String {
        let PeerReport { name, gaussians, machine, size: [width, height], frames, rounds, .. } = self;
        let mut text = format!(
            "## {name}: {gaussians} Gaussians\n\n\
             {machine}; {frames} frames of {width}x{height} in {rounds} rounds. The order of the players is \
             reversed in every second round. Medians of rounds, minimum and maximum in brackets; \"of ours\" is the \
             ratio within a round. The played package has {} bytes, the .splatv file {}.\n\n",
            self.package_bytes, self.splatv_bytes,
        );
        players(&mut text, "The clip, playing", &self.dynamic);
        players(&mut text, "An instant of it", &self.frozen);
        coders(&mut text, &self.coding);
        text
    }
}

fn players(text: &mut String, title: &str, rows: &[playing::PlayerRow]) {
    let head = "| frame, ms | of ours | first image, ms | of ours | fragments | PSNR, dB |";
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
        // A package may have a lower PSNR than the peer's file.
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

/// `median [minimum, maximum]`.
fn spread(MedianRange { median, least, most }: MedianRange, digits: usize) -> String {
    format!("{median:.digits$} [{least:.digits$}, {most:.digits$}]")
}
