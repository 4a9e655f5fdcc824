//! The initial corpus: small fields of every combination of columns, as packages and as inputs of the
//! round trip.

use codec::{Coder, Limits, Poster, split, with_poster, with_sound};

use crate::{
    common::{Shape, field, options, package, segment_package, small_take, static_field, take_package},
    properties::RoundTripInput,
    sound::sound,
};

/// Named packages of all coders.
pub fn packages() -> Vec<(String, Vec<u8>)> {
    let mut packages = Vec::new();
    for coder in Coder::ALL {
        for (name, RoundTripInput { field, layers, plate }) in inputs() {
            let plate = plate.then(|| static_field(3, field.sh_degree ^ 1, 3));
            let package = package(&field, plate.as_ref(), &options(coder, &layers));
            packages.push((format!("{}-{name}.aarc", coder.name()), package));
        }
    }
    // Three chunks of equal Gaussians, which compress to almost nothing; with view-dependent colours
    // they exceed the limits.
    for sh_degree in [0, 3] {
        let field = static_field(1, sh_degree, 2).select(&[0; 8193]);
        let package = package(&field, None, &options(Coder::Fixed, &[]));
        packages.push((format!("flood-sh{sh_degree}.aarc"), package));
    }
    let poster = Poster { time_s: 0.5, position: [0.0, 0.0, -5.0], target: [0.0; 3], fov_y: 0.8 };
    let clip = package(&static_field(3, 1, 1), None, &options(Coder::Fixed, &[1]));
    let posted = with_poster(&clip, Some(&poster), &Limits::default()).expect("a whole package");
    packages.push(("poster.aarc".into(), posted));
    let package_with = |position| {
        let package = package(&static_field(3, 1, 1), None, &options(Coder::Fixed, &[1]));
        with_sound(&package, Some(&sound(position))).expect("a whole package")
    };
    packages.push(("sound.aarc".into(), package_with(None)));
    packages.push(("sound-placed.aarc".into(), package_with(Some([0.5, -1.0, 2.0]))));
    for coder in Coder::ALL {
        packages.push((format!("take-{}.aarc", coder.name()), small_take(coder)));
        // Of many small segments.
        let segments = split(&field(Shape { sh_degree: 0, ..Shape::full(12) }, 1), 4.0, 0.5);
        let package = |segment: &codec::SplitSegment| {
            let package = segment_package(&segment.field, None, &options(coder, &[]), segment.duration_s);
            (segment.start_s, segment.duration_s, segment.level, package)
        };
        let segments: Vec<_> = segments.iter().map(package).collect();
        packages.push((format!("take-{}-split.aarc", coder.name()), take_package(4.0, &segments)));
    }
    packages
}

/// Named inputs of the round trip.
pub fn sources() -> Vec<(String, Vec<u8>)> {
    inputs().into_iter().map(|(name, input)| (name, input.to_bytes())).collect()
}

/// A field of each combination of columns, half of them with layers, half of them with a plate.
fn inputs() -> Vec<(String, RoundTripInput)> {
    let input = RoundTripInput { field: static_field(7, 1, 1), layers: vec![2], plate: true };
    let mut inputs = vec![("static".to_owned(), input)];
    for sh_degree in 0..=3 {
        for motion_order in 0..=3 {
            for rotation_rates in [false, true] {
                let shape = Shape { rows: 9, sh_degree, motion_order, rotation_rates, some_static: true };
                let field = field(shape, inputs.len() as u64);
                let layers = if (sh_degree + motion_order) % 2 == 0 { vec![2, 6] } else { Vec::new() };
                let plate = (sh_degree / 2 + motion_order) % 2 == 0;
                let rates = if rotation_rates { "-rates" } else { "" };
                let name = format!("sh{sh_degree}-motion{motion_order}{rates}");
                inputs.push((name, RoundTripInput { field, layers, plate }));
            }
        }
    }
    inputs
}
