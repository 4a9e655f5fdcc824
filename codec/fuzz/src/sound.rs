//! [`SoundlessPackage`]: a package into which any bytes are put as its section of sound, with valid checksums.

use codec::{Coder, Sound, SoundInfo, with_sound};

use crate::common::{Parts, options, package, static_field};

/// A sound of short packets.
pub fn sound(position: Option<[f32; 3]>) -> Sound {
    let channels = if position.is_some() { 1 } else { 2 };
    let info = SoundInfo {
        channels,
        position,
        stream: 7,
        start: 480,
        length: 9_000,
        lead: 312,
        packet_samples: 960,
    };
    let packets: Vec<Vec<u8>> = (0..info.packet_count()).map(|i| vec![i as u8; 1 + i % 3]).collect();
    Sound::new(info, packets.iter().map(Vec::as_slice)).expect("the sound keeps the rules")
}

/// A package without its sound.
pub struct SoundlessPackage(Parts);

impl SoundlessPackage {
    /// A package of one Gaussian.
    pub fn small() -> SoundlessPackage {
        let package = package(&static_field(1, 0, 1), None, &options(Coder::Fixed, &[]));
        SoundlessPackage(Parts::new(&with_sound(&package, Some(&sound(None))).expect("a whole package")))
    }

    /// The package with `payload` as the section of sound.
    pub fn with(&self, payload: &[u8]) -> Vec<u8> {
        self.0.with_payload(0, payload.to_vec())
    }

    /// Named payloads of sections.
    pub fn seeds() -> Vec<(String, Vec<u8>)> {
        let payload = |position| {
            let package = package(&static_field(1, 0, 1), None, &options(Coder::Fixed, &[]));
            Parts::new(&with_sound(&package, Some(&sound(position))).expect("a whole package")).sections[0]
                .clone()
        };
        vec![("stereo".into(), payload(None)), ("placed".into(), payload(Some([0.5, -1.0, 2.0])))]
    }
}
