//! Frozen packages of version 1 of the format, one per coder and a take: every version of this library decodes them to
//! the same bits on every machine. They never change, nor do the listings of their numbers, `.txt`.
//!
//! The encoder decides differently from version to version, but alike on every machine: what it makes of the same fields
//! is in `encoder`. `UPDATE_GOLDEN=1` rewrites these files and fails once.

mod common;

use codec::{
    Clip, Coder, EncodeOptions, Field, Limits, PixelFilter, Poster, Sound, SoundInfo, contents, decode,
    package, split, with_poster, with_sound,
};
use common::{Shape, field, options, segment_package, static_field, take_package};
use std::{fmt::Write, fs, num::NonZero, path::PathBuf};

fn path(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/golden").join(name)
}

/// A package that exercises every feature of the format.
fn clip_package(coder: Coder) -> Vec<u8> {
    let field = Field { filter: PixelFilter::Mip, near: 0.25, ..field(Shape::full(21), 1) };
    let options = EncodeOptions { by_device: true, ..options(coder, &[8]) };
    let package = common::package(&field, Some(&static_field(5, 2, 2)), &options);
    let poster = Poster { time_s: 0.5, position: [0.0, 1.0, -5.0], target: [0.0; 3], fov_y: 0.8 };
    let package = with_poster(&package, Some(&poster), &Limits::default()).unwrap();
    let info = SoundInfo {
        channels: 1,
        position: Some([0.5, -1.0, 2.0]),
        stream: 7,
        start: 480,
        length: 2_000,
        lead: 312,
        packet_samples: 960,
    };
    let packets = [[1u8; 5], [2; 5], [3; 5]];
    let sound = Sound::new(info, packets.iter().map(|packet| &packet[..])).unwrap();
    with_sound(&package, Some(&sound)).unwrap()
}

/// Reads a frozen file.
fn frozen(name: &str) -> Vec<u8> {
    fs::read(path(name)).unwrap()
}

/// Checks a listing against a frozen one.
fn check_listing(name: &str, actual: &str) {
    let expected = String::from_utf8(frozen(name)).unwrap();
    for (number, (actual, expected)) in actual.lines().zip(expected.lines()).enumerate() {
        assert_eq!(actual, expected, "line {} of {name}", number + 1);
    }
    assert_eq!(actual.lines().count(), expected.lines().count(), "lines of {name}");
}

/// Checks what the encoder makes against what it made before, or replaces that.
fn check_encoded(name: &str, actual: &[u8]) {
    let path = path("encoder").join(name);
    if std::env::var_os("UPDATE_GOLDEN").is_some() {
        fs::write(path, actual).unwrap();
        panic!("{name} was rewritten; run again without UPDATE_GOLDEN, and review the change");
    }
    let expected = fs::read(path).unwrap();
    let first = actual.iter().zip(&expected).position(|(a, e)| a != e);
    let lengths = [actual.len(), expected.len()];
    assert!(actual == expected, "{name}: [actual, expected] bytes {lengths:?}, first difference {first:?}");
}

/// Names of the coders' files.
const CODERS: [(Coder, &str); 2] = [(Coder::Fixed, "v1"), (Coder::Rans, "v1-rans")];

/// Runs a check for each coder, even if one fails.
fn for_each_coder(check: impl Fn(Coder, &str) + std::panic::RefUnwindSafe) {
    let failed = CODERS.map(|(coder, name)| std::panic::catch_unwind(|| check(coder, name)).is_err());
    assert_eq!(failed, [false; 2], "coders that fail");
}

#[test]
fn packages_decode_to_the_same_bits() {
    for_each_coder(|_, name| {
        let (package, limits) = (frozen(&format!("{name}.aarc")), Limits::default());
        let head = contents(&package, &limits).unwrap();
        let extra = format!(
            "by device {}\n{:?}\n{:?}\n",
            head.by_device,
            head.poster(&package).unwrap(),
            head.sound(&package, &limits).unwrap(),
        );
        check_listing(&format!("{name}.txt"), &(extra + &listing(&decode(&package, &limits).unwrap())));
    });
}

#[test]
fn the_encoder_writes_the_same_bytes_on_every_machine() {
    for_each_coder(|coder, name| check_encoded(&format!("{name}.aarc"), &clip_package(coder)));
}

/// A take of a field that was split, on three levels, with a plate in the segment that spans it.
fn take() -> Vec<u8> {
    let plate = static_field(5, 2, 2);
    let segments = split(&field(Shape::full(21), 1), 3.5, 0.8).into_iter().map(|segment| {
        let plate = (segment.duration_s == 3.5).then_some(&plate);
        let options = options(Coder::Rans, &[segment.field.len() / 2 + 1]);
        let package = segment_package(&segment.field, plate, &options, segment.duration_s);
        (segment.start_s, segment.duration_s, segment.level, package)
    });
    take_package(3.5, &segments.collect::<Vec<_>>())
}

#[test]
fn takes_decode_to_the_same_bits() {
    let bytes = frozen("v1-take.aarc");
    let take = package(&bytes, &Limits::default()).unwrap();
    let mut actual = format!("{:?}\nduration {:?}, head {}\n", take.info, take.duration_s, take.head_bytes);
    writeln!(actual, "bounds {:?}", take.bounds).unwrap();
    writeln!(
        actual,
        "coder {}, SH {}, motion {}, rates {}, filter {}, plate of {}, SH {}, filter {}",
        take.coder.name(),
        take.sh_degree,
        take.motion_order,
        take.rotation_rates,
        take.filter.name(),
        take.plate_len,
        take.plate_sh_degree,
        take.plate_filter.name(),
    )
    .unwrap();
    for (index, segment) in take.segments.iter().enumerate() {
        let bytes = &bytes[segment.offset as usize..][..segment.bytes()];
        let clip = take.decode_segment(index, bytes, &Limits::default(), NonZero::<usize>::MIN).unwrap();
        writeln!(actual, "{index}: {segment:?}\n{}", listing(&clip)).unwrap();
    }
    check_listing("v1-take.txt", &actual);
}

#[test]
fn takes_are_the_same_bytes_on_every_machine() {
    check_encoded("v1-take.aarc", &take());
}

/// A listing of a clip, with numbers as the bits of their `f32`.
fn listing(clip: &Clip) -> String {
    let mut out = String::new();
    let Clip { info, bounds, static_field, dynamic_field, layers, layers_announced, time_index, plate } =
        clip;
    writeln!(out, "{info:?}").unwrap();
    writeln!(out, "bounds {bounds:?}").unwrap();
    writeln!(out, "layers {layers:?} of {}", layers_announced.len()).unwrap();
    for t in [0.0, 0.25, 0.5, 0.75, 1.0] {
        let ranges: Vec<_> = time_index.candidates(t, layers.len()).collect();
        writeln!(out, "candidates at {t}: {ranges:?}").unwrap();
    }
    list(&mut out, "static", static_field);
    list(&mut out, "dynamic", dynamic_field);
    if let Some(plate) = plate {
        list(&mut out, "plate", plate);
    }
    out
}

fn list(out: &mut String, region: &str, field: &Field) {
    writeln!(out, "{region} filter {}, near {}", field.filter.name(), field.near).unwrap();
    column(out, region, "centers", field.centers.as_flattened());
    column(out, region, "rotations", field.rotations.as_flattened());
    column(out, region, "log_scales", field.log_scales.as_flattened());
    column(out, region, "opacities", &field.opacities);
    column(out, region, "sh", field.sh.as_flattened());
    if let Some(temporal) = &field.temporal {
        column(out, region, "tau", &temporal.tau);
        column(out, region, "s", &temporal.s);
        column(out, region, "motion", temporal.motion.as_flattened());
        let rates = temporal.rotation_rates.as_deref().unwrap_or_default();
        column(out, region, "rotation_rates", rates.as_flattened());
    }
}

fn column(out: &mut String, region: &str, name: &str, numbers: &[f32]) {
    writeln!(out, "{region} {name}: {}", numbers.len()).unwrap();
    for line in numbers.chunks(12) {
        let bits: Vec<String> = line.iter().map(|x| format!("{:08x}", x.to_bits())).collect();
        writeln!(out, "{}", bits.join(" ")).unwrap();
    }
}
