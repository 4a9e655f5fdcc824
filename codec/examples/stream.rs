//! Plays the layers of a package as its bytes arrive.
//!
//! `cargo run -p codec --example stream -- assets/demo.aarc`
//!
//! Feeds a package in blocks, as a network would deliver it, and prints when each layer is complete
//! and what it adds. A player would draw the clip from then on.

use std::error::Error;
use std::{env, fs};

use codec::{Clip, FormatError, Limits, contents, decode};

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
        Some(clip) if clip.layers.len() == clip.layers_announced => Ok(()),
        Some(clip) => Err(format!("{} of {} layers", clip.layers.len(), clip.layers_announced).into()),
        None => Err("the file ends before its first layer".into()),
    }
}

/// A package on arrival.
#[derive(Default)]
struct Stream {
    bytes: Vec<u8>,
    /// Offsets of the ends of the layers, once the head has arrived.
    layer_ends: Option<Vec<usize>>,
    /// The complete layers so far.
    clip: Option<Clip>,
}

impl Stream {
    /// Adds bytes, and returns whether they complete a layer.
    fn push(&mut self, block: &[u8]) -> Result<bool, codec::Error> {
        self.bytes.extend_from_slice(block);
        let limits = Limits::default();
        if self.layer_ends.is_none() {
            self.layer_ends = match contents(&self.bytes, &limits) {
                Ok(head) => Some(head.layer_bytes()),
                // The head is incomplete; every other error is final.
                Err(codec::Error::Format { error: FormatError::Truncated { .. }, .. }) => return Ok(false),
                Err(error) => return Err(error),
            };
        }
        let ends = self.layer_ends.iter().flatten();
        let complete = ends.filter(|end| **end <= self.bytes.len()).count();
        if complete == self.clip.as_ref().map_or(0, |clip| clip.layers.len()) {
            return Ok(false);
        }
        // Decodes every complete layer again, so that all rows lie in one field.
        self.clip = Some(decode(&self.bytes, &limits)?);
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
        clip.layers_announced,
        end.total(),
    )
}
