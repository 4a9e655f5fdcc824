//! Colour profiles (ICC) of photographs, which are not applied: [`foreign_profile`] names one that is not sRGB's.

use std::path::Path;

use image::{ImageDecoder, ImageReader};

/// Parts of the descriptions of sRGB's profiles, in lower case: `sRGB IEC61966-2.1`, and the smallest one, `c2`.
const SRGB: [&str; 2] = ["srgb", "c2"];

/// Most tags of a profile that are looked at: profiles have about 20.
const TAGS_MAX: usize = 256;

/// The description of the colour profile of the picture at `path`, if that states another one than sRGB's.
pub(super) fn foreign_profile(path: &Path) -> Option<String> {
    let reader = ImageReader::open(path).ok()?.with_guessed_format().ok()?;
    let profile = reader.into_decoder().ok()?.icc_profile().ok()??;
    let name = description(&profile).unwrap_or_else(|| "of no name".into());
    let lower = name.to_lowercase();
    (!lower.contains(SRGB[0]) && lower != SRGB[1]).then_some(name)
}

/// The description of a profile, in its first language.
fn description(profile: &[u8]) -> Option<String> {
    let part = |at: usize, len: usize| profile.get(at..at.checked_add(len)?);
    let number = |at: usize| Some(u32::from_be_bytes(part(at, 4)?.try_into().ok()?) as usize);
    let tags = (0..number(128)?.min(TAGS_MAX)).map(|i| 132 + 12 * i);
    let at = number(tags.into_iter().find(|tag| part(*tag, 4) == Some(&b"desc"[..]))? + 4)?;
    let text = match part(at, 4)? {
        // Of version 2: ASCII.
        b"desc" => String::from_utf8_lossy(part(at + 12, number(at + 8)?)?).into_owned(),
        // Of version 4: UTF-16 of several languages.
        b"mluc" => {
            let bytes = part(at.checked_add(number(at + 24)?)?, number(at + 20)?)?;
            let units = bytes.as_chunks::<2>().0.iter().map(|unit| u16::from_be_bytes(*unit));
            String::from_utf16_lossy(&units.collect::<Vec<u16>>())
        }
        _ => return None,
    };
    let shown: String = text.chars().filter(|c| !c.is_control()).collect();
    Some(shown.trim().to_owned()).filter(|name| !name.is_empty())
}

#[cfg(test)]
mod tests {
    use image::codecs::png::PngEncoder;
    use image::{ExtendedColorType, ImageEncoder};

    use super::*;

    /// A profile with a description of version 2 or 4.
    fn profile(name: &str, version: u8) -> Vec<u8> {
        let mut profile = vec![0; 128];
        for number in [1, u32::from_be_bytes(*b"desc"), 144, 100] {
            profile.extend(number.to_be_bytes());
        }
        if version == 2 {
            profile.extend(b"desc\0\0\0\0");
            profile.extend((name.len() as u32 + 1).to_be_bytes());
            profile.extend(name.bytes().chain([0]));
        } else {
            let text: Vec<u8> = name.encode_utf16().flat_map(u16::to_be_bytes).collect();
            profile.extend(b"mluc\0\0\0\0\0\0\0\x01\0\0\0\x0cenUS");
            profile.extend((text.len() as u32).to_be_bytes());
            profile.extend(28u32.to_be_bytes());
            profile.extend(text);
        }
        profile
    }

    #[test]
    fn profiles_other_than_srgb_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        let of = |profile: Option<Vec<u8>>| {
            let file = std::fs::File::create(&path).unwrap();
            let mut encoder = PngEncoder::new(file);
            profile.into_iter().for_each(|profile| encoder.set_icc_profile(profile).unwrap());
            encoder.write_image(&[0; 3], 1, 1, ExtendedColorType::Rgb8).unwrap();
            foreign_profile(&path)
        };
        assert_eq!(of(None), None);
        for version in [2, 4] {
            for (name, foreign) in [
                ("sRGB IEC61966-2.1", None),
                ("GIMP built-in sRGB", None),
                ("c2", None),
                ("Display P3", Some("Display P3")),
                ("Adobe RGB (1998)", Some("Adobe RGB (1998)")),
            ] {
                assert_eq!(of(Some(profile(name, version))).as_deref(), foreign, "{name} {version}");
            }
        }
        assert_eq!(of(Some(profile("P3", 4)[..150].to_vec())).as_deref(), Some("of no name"));
        let lie = [&profile("P3", 2)[..152], &[0xff; 4]].concat();
        assert_eq!(of(Some(lie)).as_deref(), Some("of no name"), "a length beyond its end");
    }
}
