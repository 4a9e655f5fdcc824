//! The sound of clips: from packets to the audio device, in time with the picture.
//!
//! ```text
//!            frame thread                sound thread                        device's thread
//! clock ---> timing --commands--> filler <-- packets <-- track   ring --> output --> device
//!               ^                    |                     ^                  |
//!               |                    +-- anchor --+        +------------------+
//!               +-------- link <------------------+-------- heard ------------+
//! ```
//!
//! The audio device is the master clock while a clip plays forward at its captured rate: `timing` turns what is heard
//! into the seconds by which a frame advances the clock. At other speeds, backwards, and while the timeline is held,
//! nothing is heard and the display's clock counts. `packets` decodes, `filler` keeps a ring of samples filled ahead, on
//! the thread of `parts`, `output` is the callback of the device: it fades, places and measures, and neither locks nor
//! allocates. `binaural` is a source as the ears of a head hear it, by the `responses` of a measured one, and `placing`
//! applies it to samples. Only `device` names the audio library, and `alsa` loads what that needs on Linux. Without the
//! feature `audio` there is the track alone, always empty.

#[cfg(all(
    feature = "audio",
    any(feature = "window", feature = "xr"),
    target_os = "linux",
    any(target_arch = "x86_64", target_arch = "aarch64")
))]
mod alsa;
#[cfg(all(feature = "audio", any(feature = "window", feature = "xr")))]
mod binaural;
#[cfg(all(feature = "audio", any(feature = "window", feature = "xr")))]
mod device;
#[cfg(all(feature = "audio", any(feature = "window", feature = "xr")))]
mod filler;
#[cfg(all(feature = "audio", any(feature = "window", feature = "xr")))]
mod link;
#[cfg(all(feature = "audio", any(feature = "window", feature = "xr")))]
mod output;
#[cfg(all(feature = "audio", any(feature = "window", feature = "xr")))]
mod packets;
#[cfg(all(feature = "audio", any(feature = "window", feature = "xr")))]
mod parts;
#[cfg(all(feature = "audio", any(feature = "window", feature = "xr")))]
mod placing;
#[cfg(all(feature = "audio", any(feature = "window", feature = "xr")))]
mod rate;
#[cfg(all(feature = "audio", any(feature = "window", feature = "xr")))]
mod responses;
#[cfg(any(feature = "window", feature = "xr"))]
mod speaker;
#[cfg(all(test, feature = "audio", any(feature = "window", feature = "xr")))]
mod tests;
#[cfg(all(feature = "audio", any(feature = "window", feature = "xr")))]
mod timing;
mod track;
#[cfg(any(feature = "window", feature = "xr"))]
mod volume;

#[cfg(any(feature = "window", feature = "xr"))]
pub(crate) use speaker::Speaker;
pub(crate) use track::SoundTrack;
#[cfg(feature = "window")]
pub(crate) use volume::Volume;
