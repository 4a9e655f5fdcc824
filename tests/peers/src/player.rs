//! [`PeerPlayer`]: a player in a process of its own, and its requests.
//!
//! Each request is a line of JSON on stdin, each reply a line on stdout. `native` implements players in Rust,
//! `web/driver.mjs` players in a browser.

use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use anyhow::Context;
use clap::ValueEnum;
use program::Fault;
use serde::{Deserialize, Serialize};

/// A request to a player.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum PlayerRequest {
    /// Opens a field of the folder and draws the first frame of the work. Reply: [`OpenedField`].
    Open {
        /// File name of the field.
        field: String,
    },
    /// Draws all frames of the work. Reply: [`PlayedFrames`].
    Play {},
    /// Draws one frame, sorted for this frame, and writes it. Reply: `{}`.
    Picture {
        /// Number of the frame.
        frame: usize,
        /// The file to write: red, green, blue of every pixel, in rows from the top.
        out: PathBuf,
    },
}

/// The field is open and its first frame drawn.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct OpenedField {
    /// Milliseconds from the start of the program (in a browser, of the page) to the first image.
    pub(crate) first_ms: f64,
    /// Name and driver of the graphics device.
    pub(crate) device: String,
}

/// All frames were drawn.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct PlayedFrames {
    /// Milliseconds of each frame, from submission until the GPU has finished.
    pub(crate) frames_ms: Vec<f64>,
}

/// A player.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum PlayerKind {
    /// This project's, drawing as in its window: 8 bits, every Gaussian up to an alpha of 1/255.
    Ours,
    /// This project's with `--cutoff 8`, the support radius of other players.
    OursSqrt8,
    /// npm `gsplat`, unchanged.
    Gsplat,
    /// npm `gsplat`, sorting by the correct coordinates.
    GsplatMended,
    /// crates.io `wgpu-3dgs-viewer`.
    Viewer,
    /// npm `@sparkjsdev/spark`.
    Spark,
}

impl PlayerKind {
    /// Name in tables.
    pub(crate) fn name(self) -> &'static str {
        match self {
            PlayerKind::Ours => "ours",
            PlayerKind::OursSqrt8 => "ours, `--cutoff 8`",
            PlayerKind::Gsplat => "gsplat.js",
            PlayerKind::GsplatMended => "gsplat.js, sorting fixed",
            PlayerKind::Viewer => "wgpu-3dgs-viewer",
            PlayerKind::Spark => "Spark",
        }
    }

    /// Name of the file that it plays.
    pub(crate) fn field(self) -> &'static str {
        match self {
            PlayerKind::Ours | PlayerKind::OursSqrt8 => "field.aarc",
            PlayerKind::Gsplat | PlayerKind::GsplatMended => "field.splatv",
            PlayerKind::Viewer | PlayerKind::Spark => "field.ply",
        }
    }

    fn in_browser(self) -> bool {
        matches!(self, PlayerKind::Gsplat | PlayerKind::GsplatMended | PlayerKind::Spark)
    }
}

/// WebGL driver.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(crate) enum WebGl {
    /// Mesa's OpenGL ES: without a GPU, the rasteriser that Vulkan uses too.
    #[default]
    Mesa,
    /// Chromium's own software driver.
    Swiftshader,
}

/// A running player.
pub(crate) struct PeerPlayer {
    pub(crate) kind: PlayerKind,
    folder: PathBuf,
    web_gl: WebGl,
    process: Option<PlayerProcess>,
}

struct PlayerProcess {
    child: Child,
    requests: Option<ChildStdin>,
    replies: BufReader<ChildStdout>,
}

impl PeerPlayer {
    /// A player of the fields and the work in `folder`, not yet started.
    pub(crate) fn new(kind: PlayerKind, folder: &Path, web_gl: WebGl) -> PeerPlayer {
        PeerPlayer { kind, folder: folder.to_owned(), web_gl, process: None }
    }

    /// Opens its field in a new process, or in a new page of the browser.
    pub(crate) fn open(&mut self) -> anyhow::Result<OpenedField> {
        if self.process.is_none() || !self.kind.in_browser() {
            self.process = None;
            self.process = Some(self.start()?);
        }
        self.ask(&PlayerRequest::Open { field: self.kind.field().to_owned() })
    }

    /// Plays all frames.
    pub(crate) fn play(&mut self) -> anyhow::Result<PlayedFrames> {
        self.ask(&PlayerRequest::Play {})
    }

    /// Red, green, blue of every pixel of a frame.
    pub(crate) fn picture(&mut self, frame: usize) -> anyhow::Result<Vec<u8>> {
        let out = self.folder.join(format!("{}.rgb", name_of(self.kind)));
        let EmptyReply {} = self.ask(&PlayerRequest::Picture { frame, out: out.clone() })?;
        let rgb = std::fs::read(&out)?;
        std::fs::remove_file(&out)?;
        Ok(rgb)
    }

    fn start(&self) -> anyhow::Result<PlayerProcess> {
        let mut command = if self.kind.in_browser() {
            let mut command = Command::new("node");
            command.arg(web_folder().join("driver.mjs")).args([name_of(self.kind), name_of(self.web_gl)]);
            command
        } else {
            let mut command = Command::new(std::env::current_exe()?);
            command.args(["play".into(), name_of(self.kind)]);
            command
        };
        command.arg(&self.folder).stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = command.spawn().map_err(|error| {
            Fault::Device(format!("{}: {error}", command.get_program().to_string_lossy()))
        })?;
        let requests = child.stdin.take();
        let replies = BufReader::new(child.stdout.take().expect("it is piped"));
        Ok(PlayerProcess { child, requests, replies })
    }

    fn ask<Reply: for<'a> Deserialize<'a>>(&mut self, request: &PlayerRequest) -> anyhow::Result<Reply> {
        let name = self.kind.name();
        let process = self.process.as_mut().with_context(|| format!("{name} is not open"))?;
        let requests = process.requests.as_mut().expect("open until it is dropped");
        let mut line = serde_json::to_vec(request)?;
        line.push(b'\n');
        let mut reply = String::new();
        // A player that fails prints the reason on stderr.
        let sent = requests.write_all(&line).and_then(|()| requests.flush());
        if sent.is_err() || process.replies.read_line(&mut reply)? == 0 {
            return Err(Fault::Device(format!("{name} ended without a reply")).into());
        }
        serde_json::from_str(&reply).with_context(|| format!("{name} replied {reply}"))
    }
}

impl Drop for PlayerProcess {
    fn drop(&mut self) {
        // A player exits at the end of its stdin. An error here was reported before.
        self.requests = None;
        let _ = self.child.wait();
    }
}

/// A reply without content.
#[derive(Deserialize)]
struct EmptyReply {}

/// Name of a value on command lines; for a player in a browser, also of its module in `web`.
fn name_of(value: impl ValueEnum) -> String {
    value.to_possible_value().expect("no value is hidden").get_name().to_owned()
}

/// Folder of the scripts for Node and the browser.
pub(crate) fn web_folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("web")
}
