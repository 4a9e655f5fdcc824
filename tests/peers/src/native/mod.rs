//! Answers for the players in Rust, each in a process of its own.

mod drawer;
mod ours;
mod viewer;

use std::io::{BufRead, Write};
use std::path::Path;
use std::time::Instant;

use client::gpu::Cutoff;
use serde::Serialize;

use crate::player::{Kind, Opened, Played, Request};
use crate::work::Work;
use drawer::Drawer;

/// Answers the requests on stdin for the player `kind`. The program was started at `start`.
pub(crate) fn answer(kind: Kind, folder: &Path, start: Instant) -> anyhow::Result<()> {
    let work = Work::read(folder)?;
    let mut drawer: Option<Box<dyn Drawer>> = None;
    for line in std::io::stdin().lock().lines() {
        match (serde_json::from_str(&line?)?, drawer.as_mut()) {
            (Request::Open { field }, _) => {
                let path = folder.join(field);
                let mut opened = match kind {
                    Kind::Ours => ours::open(&path, &work, Cutoff::Exact)?,
                    Kind::OursSqrt8 => ours::open(&path, &work, Cutoff::Sqrt8)?,
                    Kind::Viewer => viewer::open(&path, &work)?,
                    Kind::Gsplat | Kind::GsplatMended | Kind::Spark => {
                        anyhow::bail!("{} plays in a browser", kind.name())
                    }
                };
                opened.draw(&work.frames[0])?;
                opened.read()?;
                let first_ms = start.elapsed().as_secs_f64() * 1e3;
                reply(&Opened { first_ms, device: opened.device() })?;
                drawer = Some(opened);
            }
            (Request::Play {}, Some(drawer)) => {
                let mut frames_ms = Vec::new();
                for frame in &work.frames {
                    let start = Instant::now();
                    drawer.draw(frame)?;
                    frames_ms.push(start.elapsed().as_secs_f64() * 1e3);
                }
                reply(&Played { frames_ms })?;
            }
            (Request::Picture { frame, out }, Some(drawer)) => {
                drawer.draw(&work.frames[frame])?;
                std::fs::write(out, drawer.read()?)?;
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
