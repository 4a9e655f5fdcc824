//! What was measured of playing a clip: the knobs of the renderer, and what the clip does without.
//!
//! The measuring itself is done by a program of the package `aarc-tests`, which has a renderer; it
//! prints the types of this module.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::knob::{Knob, Spread};

/// What the program prints, one a line: first [`Message::Begin`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Message {
    /// What is measured, and on what.
    Begin(Setup),
    /// What is done now; one of [`Setup::steps`].
    Step(String),
    /// A picture.
    Picture(Picture),
    /// A knob, measured.
    Knob(Knob),
    /// An optional part of clips, measured.
    Part(Part),
}

/// What is measured, and on what.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Setup {
    /// Name of the graphics adapter.
    pub adapter: String,
    /// Name and version of its driver.
    pub driver: String,
    /// Whether the GPU says how long it took; else drawing is what remains of a frame.
    pub gpu_timed: bool,
    /// Width and height of the pictures in pixels.
    pub size: [u32; 2],
    /// Gaussians of the clip, the plate's not counted.
    pub gaussians: usize,
    /// Pictures that errors, times and counts are taken of.
    pub pictures: usize,
    /// Frames of the turning head.
    pub turn_frames: usize,
    /// How often each picture was timed.
    pub rounds: usize,
    /// Number of steps.
    pub steps: u64,
}

/// A picture to look at.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Picture {
    /// What it shows.
    pub name: String,
    /// PNG, in base 64.
    pub png: String,
}

/// An optional part of clips, and what a clip saves that does without.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Part {
    /// Its name.
    pub part: String,
    /// Whether this clip does without.
    pub left_out: bool,
    /// What the clip needs of it.
    pub needs: String,
    /// How it was switched on to measure that; empty where it is needed.
    pub switched_on: String,
    /// What the clip takes without.
    pub without: Taken,
    /// What it takes with the part switched on, or as it is where it is needed.
    pub with: Taken,
}

/// What a clip takes.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Taken {
    /// What no machine changes.
    pub counts: BTreeMap<String, f64>,
    /// Milliseconds of a frame.
    pub frame_ms: Option<Spread>,
}

/// What was measured of playing a clip.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Playing {
    /// What was measured, and on what.
    pub setup: Setup,
    /// The knobs of the renderer.
    pub knobs: Vec<Knob>,
    /// The optional parts.
    pub parts: Vec<Part>,
    /// Pictures to look at, that of the reference first.
    #[serde(skip)]
    pub pictures: Vec<Picture>,
}

impl Playing {
    /// What the program is going to tell.
    pub fn begin(setup: Setup) -> Playing {
        Playing { setup, knobs: Vec::new(), parts: Vec::new(), pictures: Vec::new() }
    }

    /// Takes note of a message.
    pub fn add(&mut self, message: Message) {
        match message {
            Message::Begin(_) | Message::Step(_) => {}
            Message::Picture(picture) => self.pictures.push(picture),
            Message::Knob(knob) => self.knobs.push(knob),
            Message::Part(part) => self.parts.push(part),
        }
    }
}
