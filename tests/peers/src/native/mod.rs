//! Players in Rust, each in a process of its own.

mod ours;
mod renderer;
mod viewer;

use std::io::{BufRead, Write};
use std::path::Path;
use std::time::Instant;

use client::gpu::Cutoff;
use serde::Serialize;

use crate::player::{OpenedField, PlayedFrames, PlayerKind, PlayerRequest};
use crate::workload::Workload;
use renderer::PeerRenderer;

/// Answers the requests on stdin for the player `kind`. The program was started at `start`.
pub(crate) fn answer(kind: PlayerKind, folder: &Path, start: Instant) -> anyhow::Result<()> {
    let work = Workload::read(folder)?;
    let mut renderer: Option<Box<dyn PeerRenderer>> = None;
    for line in std::io::stdin().lock().lines() {
        match (serde_json::from_str(&line?)?, renderer.as_mut()) {
            (PlayerRequest::Open { field }, _) => {
                let path = folder.join(field);
                let mut opened = match kind {
                    PlayerKind::Ours => ours::open(&path, &work, Cutoff::Exact)?,
                    PlayerKind::OursSqrt8 => ours::open(&path, &work, Cutoff::Sqrt8)?,
                    PlayerKind::Viewer => viewer::open(&path, &work)?,
                    PlayerKind::Gsplat | PlayerKind::GsplatMended | PlayerKind::Spark => {
                        anyhow::bail!("{} plays in a browser", kind.name())
                    }
                };
                opened.draw(&work.frames[0])?;
                opened.read()?;
                let first_ms = start.elapsed().as_secs_f64() * 1e3;
                reply(&OpenedField { first_ms, device: opened.device() })?;
                renderer = Some(opened);
            }
            (PlayerRequest::Play {}, Some(renderer)) => {
                let mut frames_ms = Vec::new();
                for frame in &work.frames {
                    let start = Instant::now();
                    renderer.draw(frame)?;
                    frames_ms.push(start.elapsed().as_secs_f64() * 1e3);
                }
                reply(&PlayedFrames { frames_ms })?;
            }
            (PlayerRequest::Picture { frame, out }, Some(renderer)) => {
                renderer.draw(&work.frames[frame])?;
                std::fs::write(out, renderer.read()?)?;
                reply(&serde_json::json!({}))?;
            }
            (_, None) => anyhow::bail!("no field is open"),
        }
    }
    Ok(())
}

fn reply(reply: &impl Serialize) -> anyhow::Result<()> {
    let mut line = serde_json::to_vec(reply)?;
    line.push(b'\n');
    let mut out = std::io::stdout().lock();
    out.write_all(&line)?;
    Ok(out.flush()?)
}
