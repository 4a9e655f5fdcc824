//! The sound of a package: any file that ffmpeg reads becomes packets of Opus, for a clip or for the segments of a take.
//!
//! ```text
//! samples: ffmpeg decodes, mixes to one or two channels at 48 kHz, into a scratch file; samples that are no numbers become
//!          silence, and what is above full scale is made quieter as a whole
//! packets: ffmpeg encodes the samples; the packets are taken out of its Ogg file
//! cut:     the packets of a clip, or of each segment of a take
//! ```

mod cut;
mod packets;
mod samples;
mod soundtrack;
mod source;

pub(crate) use soundtrack::put;
pub use soundtrack::{SoundReport, Soundtrack};
pub use source::SoundSource;
