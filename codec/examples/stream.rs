//! Plays the layers of a package as its bytes arrive.
//!
//! `cargo run -p codec --example stream -- assets/demo.aarc`
//!
//! Feeds a package in blocks, as a network would deliver it, and prints when each layer is complete
//! and what it adds. A player would draw the clip from then on. Each layer is decoded once, alone, and
//! appended.

use std::error::Error;
use std::num::NonZero;
use std::{env, fs};

use codec::{Clip, Contents, FormatError, Limits, contents, decode};

/// Bytes that arrive at a time.
const BLOCK_BYTES: usize = 16 << 10;

fn main() -> Result<(), Box<dyn Error>> {
    let path = env::args_os().nth(1).ok_or("usage: stream CLIP.aarc")?;
    let mut stream = Stream::default();
    for block in fs::read(path)?.chunks(BLOCK_BYTES) {
        if stream.push(block)?
            && let Some(clip) = &stream.clip
        {
            println!("{:9} bytes: {}", stream.bytes.len(), describe(clip));
        }
    }
    match stream.clip {
        Some(clip) if clip.layers == clip.layers_announced => Ok(()),
        Some(clip) => Err(format!("{} of {} layers", clip.layers.len(), clip.layers_announced.len()).into()),
        None => Err("the file ends before its first layer".into()),
    }
}

/// A package on arrival.
#[derive(Default)]
struct Stream {
    bytes: Vec<u8>,
    /// The head, once it has arrived.
    head: Option<Contents>,
    /// The complete layers so far.
    clip: Option<Clip>,
}

impl Stream {
    /// Adds bytes, and returns whether they complete a layer.
    fn push(&mut self, block: &[u8]) -> Result<bool, codec::Error> {
        self.bytes.extend_from_slice(block);
        let limits = Limits::default();
        if self.head.is_none() {
            self.head = match contents(&self.bytes, &limits) {
                Ok(head) => Some(head),
                // The head is incomplete; every other error is final.
                Err(codec::Error::Format { error: FormatError::Truncated { .. }, .. }) => return Ok(false),
                Err(error) => return Err(error),
            };
        }
        let Some(head) = &self.head else { return Ok(false) };
        let complete = head.layer_bytes().iter().filter(|end| **end <= self.bytes.len()).count();
        let first = self.clip.as_ref().map_or(0, |clip| clip.layers.len());
        if complete == first {
            return Ok(false);
        }
        match &mut self.clip {
            Some(clip) => {
                clip.append(head.decode_layers(&self.bytes, first, &limits, NonZero::<usize>::MIN)?);
            }
            None => self.clip = Some(decode(&self.bytes, &limits)?),
        }
        Ok(true)
    }
}

/// The Gaussians that the last layer of a clip adds.
fn describe(clip: &Clip) -> String {
    let last = clip.layers.len() - 1;
    let end = clip.layers[last];
    let start = last.checked_sub(1).map(|before| clip.layers[before]).unwrap_or_default();
    let (added_static, added_dynamic) =
        (end.static_count - start.static_count, end.dynamic_count - start.dynamic_count);
    let plate = clip.plate.as_ref().map_or(0, |plate| plate.len());
    format!(
        "layer {} of {}: adds {added_static} static and {added_dynamic} dynamic Gaussians; {} in all, plate {plate}",
        last + 1,
        clip.layers_announced.len(),
        end.total(),
    )
}
