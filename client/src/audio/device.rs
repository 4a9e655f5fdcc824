//! [`OpenDevice`]: a stream to the system's audio device, which calls a [`RingOutput`].

use std::sync::Arc;
use std::time::Instant;

use codec::SOUND_RATE_HZ;
use cpal::traits::{DeviceTrait, HostTrait, StreamTrait};
use cpal::{BufferSize, ErrorKind, SampleFormat, StreamConfig, SupportedStreamConfigRange};

use super::filler::{RING_S, RingFiller};
use super::link::Link;
use super::output::RingOutput;

/// A device that plays.
pub(super) struct OpenDevice {
    pub(super) filler: RingFiller,
    /// Plays until it is dropped.
    _stream: cpal::Stream,
}

impl OpenDevice {
    /// Opens the default device. Times are seconds since `epoch`.
    ///
    /// # Errors
    /// Why there is none.
    pub(super) fn open(link: &Arc<Link>, epoch: Instant) -> Result<OpenDevice, String> {
        let device = cpal::default_host().default_output_device().ok_or("there is no audio device")?;
        let config = config(&device)?;
        let StreamConfig { channels, sample_rate, .. } = config;
        let (producer, consumer) = rtrb::RingBuffer::new((RING_S * f64::from(sample_rate)) as usize);
        link.begin_device();
        let mut output = RingOutput::new(consumer, link.clone(), sample_rate);
        let render = move |samples: &mut [f32], info: &cpal::OutputCallbackInfo| {
            let times = info.timestamp();
            let latency = times.playback.saturating_duration_since(times.callback);
            let now_s = epoch.elapsed().as_secs_f64();
            output.render(samples, channels.into(), now_s, latency.as_secs_f64());
        };
        let lost = link.clone();
        let on_error = move |error: cpal::Error| match error.kind() {
            // It goes on, on another device or after a gap.
            ErrorKind::DeviceChanged | ErrorKind::Xrun | ErrorKind::RealtimeDenied => {}
            _ => {
                log::warn!("the audio device was lost: {error}");
                lost.set_lost();
            }
        };
        let stream =
            device.build_output_stream(config, render, on_error, None).map_err(|error| why(&error))?;
        stream.play().map_err(|error| why(&error))?;
        Ok(OpenDevice { filler: RingFiller::new(producer, link.clone(), sample_rate), _stream: stream })
    }
}

/// Why there is no sound.
fn why(error: &cpal::Error) -> String {
    match error.kind() {
        ErrorKind::DeviceNotAvailable => "there is no audio device".into(),
        _ => format!("the audio device refuses: {}", error.to_string().trim_end_matches('.')),
    }
}

/// The configuration to open a device with: stereo at the rate of tracks if it has that.
fn config(device: &cpal::Device) -> Result<StreamConfig, String> {
    let is_wanted = |range: &SupportedStreamConfigRange| {
        range.channels() == 2
            && range.sample_format() == SampleFormat::F32
            && (range.min_sample_rate()..=range.max_sample_rate()).contains(&SOUND_RATE_HZ)
    };
    let mut ranges = device.supported_output_configs().map_err(|error| why(&error))?;
    if ranges.any(|range| is_wanted(&range)) {
        let buffer_size = BufferSize::Default;
        return Ok(StreamConfig { channels: 2, sample_rate: SOUND_RATE_HZ, buffer_size });
    }
    device.default_output_config().map(|config| config.config()).map_err(|error| why(&error))
}
