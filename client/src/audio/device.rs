//! [`OpenDevice`]: a stream to the system's audio device, which calls a [`RingOutput`].

use std::sync::Arc;
use std::time::Instant;

use codec::SOUND_RATE_HZ;
use cpal::traits::{DeviceTrait, HostTrait, StreamTrait};
use cpal::{
    BufferSize, ErrorKind, FromSample, I24, SampleFormat, SizedSample, StreamConfig,
    SupportedStreamConfigRange, U24,
};

use super::binaural::BinauralSource;
use super::filler::{RING_S, RingFiller};
use super::link::Link;
use super::output::RingOutput;

/// Formats of samples that are played, the best first: formats that lose nothing, then formats of fewer bits.
const FORMATS: [SampleFormat; 12] = [
    SampleFormat::F32,
    SampleFormat::F64,
    SampleFormat::I32,
    SampleFormat::I64,
    SampleFormat::U32,
    SampleFormat::U64,
    SampleFormat::I24,
    SampleFormat::U24,
    SampleFormat::I16,
    SampleFormat::U16,
    SampleFormat::I8,
    SampleFormat::U8,
];

/// A device that plays.
pub(super) struct OpenDevice {
    pub(super) filler: RingFiller,
    pub(super) binaural: BinauralSource,
    /// Plays until it is dropped.
    _stream: cpal::Stream,
}

impl OpenDevice {
    /// Opens the default device. Times are seconds since `epoch`.
    ///
    /// # Errors
    /// Why there is none.
    pub(super) fn open(link: &Arc<Link>, epoch: Instant) -> Result<OpenDevice, String> {
        #[cfg(all(target_os = "linux", any(target_arch = "x86_64", target_arch = "aarch64")))]
        super::alsa::load()?;
        let device = cpal::default_host().default_output_device().ok_or("there is no audio device")?;
        let (config, format) = config(&device)?;
        let (producer, consumer) = rtrb::RingBuffer::new((RING_S * f64::from(config.sample_rate)) as usize);
        link.begin_device();
        let (binaural, placed) = BinauralSource::new(config.sample_rate);
        let output = RingOutput::new(consumer, placed, link.clone(), config.sample_rate);
        let filler = RingFiller::new(producer, link.clone(), config.sample_rate);
        let player = DevicePlayer { device, config, output, lost: link.clone(), epoch };
        let stream = player.play(format)?;
        Ok(OpenDevice { filler, binaural, _stream: stream })
    }
}

/// What plays on a device.
struct DevicePlayer {
    device: cpal::Device,
    config: StreamConfig,
    output: RingOutput,
    lost: Arc<Link>,
    epoch: Instant,
}

impl DevicePlayer {
    /// Plays samples of `format`, one of [`FORMATS`].
    ///
    /// # Errors
    /// Why the device does not.
    fn play(self, format: SampleFormat) -> Result<cpal::Stream, String> {
        match format {
            SampleFormat::F32 => self.play_as::<f32>(),
            SampleFormat::F64 => self.play_as::<f64>(),
            SampleFormat::I32 => self.play_as::<i32>(),
            SampleFormat::I64 => self.play_as::<i64>(),
            SampleFormat::U32 => self.play_as::<u32>(),
            SampleFormat::U64 => self.play_as::<u64>(),
            SampleFormat::I24 => self.play_as::<I24>(),
            SampleFormat::U24 => self.play_as::<U24>(),
            SampleFormat::I16 => self.play_as::<i16>(),
            SampleFormat::U16 => self.play_as::<u16>(),
            SampleFormat::I8 => self.play_as::<i8>(),
            SampleFormat::U8 => self.play_as::<u8>(),
            other => Err(format!("the audio device takes samples of {other} alone")),
        }
    }

    fn play_as<S: SizedSample + FromSample<f32>>(self) -> Result<cpal::Stream, String> {
        let DevicePlayer { device, config, mut output, lost, epoch } = self;
        let render = move |samples: &mut [S], info: &cpal::OutputCallbackInfo| {
            let times = info.timestamp();
            let latency = times.playback.saturating_duration_since(times.callback);
            let now_s = epoch.elapsed().as_secs_f64();
            let channels = config.channels.into();
            output.render(samples, S::from_sample, channels, now_s, latency.as_secs_f64());
        };
        let on_error = move |error: cpal::Error| match error.kind() {
            // It goes on, on another device or after a gap.
            ErrorKind::DeviceChanged | ErrorKind::Xrun | ErrorKind::RealtimeDenied => {}
            // A device may repeat it until it is closed.
            _ if lost.set_lost() => log::warn!("the audio device was lost: {error}"),
            _ => {}
        };
        let stream =
            device.build_output_stream(config, render, on_error, None).map_err(|error| why(&error))?;
        stream.play().map_err(|error| why(&error))?;
        Ok(stream)
    }
}

/// Why there is no sound.
fn why(error: &cpal::Error) -> String {
    match error.kind() {
        ErrorKind::DeviceNotAvailable => "there is no audio device".into(),
        _ => format!("the audio device refuses: {}", error.to_string().trim_end_matches('.')),
    }
}

/// The configuration to open a device with, and the format of its samples.
fn config(device: &cpal::Device) -> Result<(StreamConfig, SampleFormat), String> {
    let ranges = device.supported_output_configs().map_err(|error| why(&error))?;
    match best(ranges) {
        Some(format) => {
            let buffer_size = BufferSize::Default;
            Ok((StreamConfig { channels: 2, sample_rate: SOUND_RATE_HZ, buffer_size }, format))
        }
        None => {
            let found = device.default_output_config().map_err(|error| why(&error))?;
            Ok((found.config(), found.sample_format()))
        }
    }
}

/// The best format that a device takes in stereo at the rate of tracks; `None` if it takes none.
fn best(ranges: impl Iterator<Item = SupportedStreamConfigRange>) -> Option<SampleFormat> {
    let rank = |format: &SampleFormat| FORMATS.iter().position(|other| other == format);
    let stereo = ranges.filter(|range| range.channels() == 2 && range.contains_rate(SOUND_RATE_HZ));
    let formats = stereo.map(|range| range.sample_format());
    formats.filter(|format| rank(format).is_some()).min_by_key(rank)
}

#[cfg(test)]
mod tests {
    use cpal::SupportedBufferSize;

    use super::*;

    fn range(channels: u16, rates_hz: [u32; 2], format: SampleFormat) -> SupportedStreamConfigRange {
        let [least, most] = rates_hz;
        SupportedStreamConfigRange::new(channels, least, most, SupportedBufferSize::Unknown, format)
    }

    #[test]
    fn stereo_at_the_rate_of_tracks_is_taken_in_the_best_format_that_there_is() {
        let wide = [8_000, 192_000];
        let one = |format| best([range(2, wide, format)].into_iter());
        for format in FORMATS {
            assert_eq!(one(format), Some(format), "a device of this format alone plays");
        }
        assert_eq!(one(SampleFormat::DsdU8), None);
        let several = [SampleFormat::U8, SampleFormat::I16, SampleFormat::I32, SampleFormat::DsdU32];
        assert_eq!(best(several.into_iter().map(|format| range(2, wide, format))), Some(SampleFormat::I32));
        let others = [range(6, wide, SampleFormat::F32), range(2, [44_100, 44_100], SampleFormat::F32)];
        assert_eq!(best(others.into_iter()), None);
    }

    /// What a device of samples `S` is given for full scale on the left and half of it below zero on the right, and for
    /// silence on a third channel.
    fn played<S: SizedSample + FromSample<f32> + PartialEq>() -> [S; 3] {
        let link = Arc::new(Link::default());
        link.set_gain(1.0);
        link.set_source_m(None);
        let (mut producer, consumer) = rtrb::RingBuffer::new(2_000);
        (0..2_000).for_each(|_| producer.push([1.0, -0.5]).unwrap());
        let mut out = vec![S::EQUILIBRIUM; 3 * 2_000];
        let (_, placed) = BinauralSource::new(SOUND_RATE_HZ);
        let mut output = RingOutput::new(consumer, placed, link, SOUND_RATE_HZ);
        output.render(&mut out, S::from_sample, 3, 0.0, 0.0);
        *out.last_chunk().unwrap()
    }

    #[test]
    fn samples_are_converted_to_the_format_of_the_device() {
        assert_eq!(played::<f32>(), [1.0 - f32::EPSILON / 2.0, -0.5, 0.0]);
        assert_eq!(played::<i16>(), [i16::MAX, i16::MIN / 2, 0]);
        assert_eq!(played::<u16>(), [u16::MAX, 1 << 14, 1 << 15]);
        assert_eq!(played::<I24>().map(I24::inner), [(1 << 23) - 1, -(1 << 22), 0]);
        // A binary32 number has 24 bits.
        assert_eq!(played::<i32>(), [i32::MAX - 127, i32::MIN / 2, 0]);
        assert_eq!(played::<u8>(), [u8::MAX, 64, 128]);
    }
}
